"""The video-inertial trackers of the thesis on simulated scenes with known truth (4.4.2), beside its tables."""

from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from time import perf_counter

import numpy as np

from tests.studies.scenes import (
    SETTLED_S,
    Clip,
    ClipStudy,
    SensorError,
    StartErrors,
    middle_of,
    posed_scene,
    sensor_errors,
    start_errors,
    straps_and_sensors,
    true_motion,
)
from tests.studies.study import NAN, Fixed, Study, Tell, bullets, group, mean, table
from tests.studies.vip_variants import (
    PUBLISHED,
    PUBLISHED_BY_ACTIVITY,
    VARIANTS,
    Variant,
    chosen_variants,
    settings_of,
    told,
)
from vip_factors.body.kinematics import Motion
from vip_factors.errors import RecordingError, SolveError
from vip_factors.estimate import Estimate, WearerEstimate
from vip_factors.evaluate.evaluation import Evaluation, evaluate_scene
from vip_factors.evaluate.metrics import common_frames, mpjae, mpjpe
from vip_factors.findings import sentences
from vip_factors.pipeline import smooth
from vip_factors.sensors.calibration import Calibration
from vip_factors.sensors.scene import Scene
from vip_factors.settings import Settings
from vip_factors.simulate.scene_settings import CameraKind, SceneSettings
from vip_factors.simulate.settings import SimulateSettings

# Pairs of variants whose MPJPE is to be compared.
COMPARED = (
    ("VIP", "IT"), ("VIP-IT", "IT"), ("VIP-Cam", "VIP"), ("VIP-25", "VIP"), ("VIP-45", "VIP"),
    ("VIP-gtip-25", "VIP-gtip"), ("VIP-gtip-45", "VIP-gtip"),
)  # fmt: skip
CALIBRATION_HEAD = ("mean", "95 %", "feet and hands", "95 %")


@dataclass(frozen=True)
class Trial:
    """One variant on one recording; NaN where there is nothing to measure.

    Attributes:
        variant, kind, clip, seed: which.
        frames: compared, those of the initial pose left out.
        mpjpe_mm, mpjae_deg: over them.
        sensors: errors of the calibration used or found.
        camera_m, camera_deg: mean errors of the camera's path after the gauge.
        precision, recall: of the association, percent.
        solve_seconds, seconds: of the solves, and of the whole pipeline.
        start: how far off the start of the recording was.
        failure: what the pipeline said if it gave up.
    """

    variant: str
    kind: str
    clip: str
    seed: int
    frames: int = 0
    mpjpe_mm: float = NAN
    mpjae_deg: float = NAN
    sensors: tuple[SensorError, ...] = ()
    camera_m: float = NAN
    camera_deg: float = NAN
    precision: float = NAN
    recall: float = NAN
    solve_seconds: float = NAN
    seconds: float = NAN
    findings: tuple[str, ...] = ()
    start: StartErrors | None = None
    failure: str = ""


@dataclass(frozen=True, kw_only=True)
class VipTables(Study):
    """What studies of the thesis's trackers have in common."""

    variants: tuple[str, ...] = ()
    """Names of trackers, such as IT VIP VIP-IT; all if absent."""
    frame_rate: float = 60.0
    """Frames per second of the reconstructions."""
    iterations: int = 30
    """At most, of each solve."""
    base: Fixed[Settings] = field(default_factory=Settings)

    @property
    def settings(self) -> Settings:
        """Of the estimator; its calibration is each variant's own."""
        solve = replace(self.base.solve, max_iterations=self.iterations)
        return replace(self.base, frame_rate=self.frame_rate, solve=solve)

    def title(self, rows: Sequence[Trial]) -> str:
        """What was recorded, and how."""
        raise NotImplementedError

    def tables(self, rows: Sequence[Trial]) -> Iterator[str]:
        """Accuracy, then calibration, camera, association and time of every variant, and the thesis's own figures."""
        yield self.title(rows)
        yield _start_line([own[0].start for own in group(rows, lambda one: (one.clip, one.seed)).values()])
        variants = group(rows, lambda one: one.variant)
        means = {name: errors_by_kind(own) for name, own in variants.items()}
        kinds = list(dict.fromkeys(trial.kind for trial in rows))
        shown = [*kinds, "mean"] if len(kinds) > 1 else ["mean"]
        yield table(
            ["variant", *shown, "thesis, mean"],
            [[name, *(row.get(kind) for kind in shown), PUBLISHED.get(name)] for name, row in means.items()],
        )
        yield bullets("", _compared(variants))
        yield "Errors of headings and mountings in degrees (after the common yaw), and all else"
        head = [f"{what} {one}" for what in ("heading", "mounting") for one in CALIBRATION_HEAD]
        head += ["camera mm", "camera deg", "precision %", "recall %", "solve s", "all s"]
        yield table(["variant", *head], [[name, *_details(own)] for name, own in variants.items()])
        yield "Thesis, on TotalCapture (other motions, real sensors; tables 4.2 and 4.3)"
        published = list(PUBLISHED_BY_ACTIVITY["VIP"])
        lines = [[name, *(row[kind] for kind in published)] for name, row in PUBLISHED_BY_ACTIVITY.items()]
        yield table(["variant", *published], lines)
        failures = (f"{t.variant}, {t.clip}, seed {t.seed}: {t.failure}" for t in rows if t.failure)
        yield bullets("Not solved, and left out of the means:", failures)


@dataclass(frozen=True, kw_only=True)
class Vip(VipTables, ClipStudy):
    """The thesis's video-inertial trackers on simulated scenes, beside its tables."""

    camera: CameraKind = "fixed"  # TotalCapture's
    """What films the simulated scenes."""
    processes: int = 1
    """Recordings worked on side by side; times are then those of a busy machine."""
    sensors: Fixed[SimulateSettings] = field(default_factory=straps_and_sensors)
    keypoints: Fixed[str] = "openpose18"  # the thesis's detector

    def scene(self, motion: Motion, name: str, seed: int) -> Scene:
        settings = SceneSettings(camera=self.camera, keypoints=self.keypoints, imu=self.sensors)
        return posed_scene(middle_of(motion, self.seconds, name), name, settings, self.pose_error_deg, seed)

    def rows(self, tell: Tell) -> Iterator[Trial]:
        work, variants = self.chosen(), chosen_variants(self.variants)
        if self.processes > 1:
            with ProcessPoolExecutor(self.processes) as pool:
                for done, trials in enumerate(pool.map(partial(self.trials, variants=variants), work)):
                    tell("trackers", (done + 1) / len(work))
                    yield from trials
            return
        for done, clip in enumerate(work):
            tell(clip.name, done / len(work))
            yield from self.trials(clip, variants)

    def trials(self, clip: Clip, variants: Sequence[Variant]) -> list[Trial]:
        return run_scene(self.scene(clip.motion(), clip.name, clip.seed), clip, variants, self.settings)

    def title(self, rows: Sequence[Trial]) -> str:
        return (
            f"MPJPE mm / MPJAE deg of 13 simulated sensors and a {self.camera} camera, "
            f"{len({(trial.clip, trial.seed) for trial in rows})} recordings of {self.seconds:g} s after a T-pose held "
            f"{self.pose_error_deg:g} deg off per joint and axis; straps {self.sensors.mounting_error_deg:g} deg off "
            f"per axis; {self.keypoints} detections"
        )


def run_scene(
    scene: Scene, clip: Clip, variants: Sequence[Variant], settings: Settings, skip_s: float = SETTLED_S
) -> list[Trial]:
    """All variants on one scene; VIP runs first if another needs what it found."""
    vip = VARIANTS["VIP"]
    ordered = sorted(variants, key=lambda one: one != vip)
    results, found, start = {}, None, start_errors(scene.wearers[0], settings)
    if any(one.needs_vip for one in variants) and vip not in variants:
        ordered.insert(0, vip)
    for variant in ordered:
        trial, estimate = _trial(scene, clip, variant, settings, found, skip_s)
        results[variant.name] = replace(trial, start=start)
        if variant == vip and estimate is not None:
            found = estimate.wearers[0].calibration
    return [results[one.name] for one in variants]


def _trial(
    scene: Scene, clip: Clip, variant: Variant, settings: Settings, found: Calibration | None, skip_s: float
) -> tuple[Trial, Estimate | None]:
    trial = Trial(variant.name, clip.kind, clip.name, clip.repetition)
    settings = settings_of(variant, settings)
    begin = perf_counter()
    try:
        given = told(scene, variant, settings, clip.seed, found)
        estimate = smooth(given, settings)
    except (SolveError, RecordingError) as error:  # one recording that cannot be solved must not end a run of hours
        return replace(trial, failure=f"{type(error).__name__}: {error}", seconds=perf_counter() - begin), None
    seconds = perf_counter() - begin
    # What the variant was told stands where its truth was: it is judged by the scene as recorded.
    judged = replace(given, wearers=scene.wearers)
    return replace(measured(trial, estimate, judged, skip_s), seconds=seconds), estimate


def measured(trial: Trial, estimate: Estimate, scene: Scene, skip_s: float) -> Trial:
    """The trial with all that the scene's truth tells of the estimate; positions from ``skip_s`` seconds on."""
    wearer, estimated = scene.wearers[0], estimate.wearers[0].motion
    late = int(np.count_nonzero(estimated.time < skip_s - 1e-6))
    motion, reference, _ = common_frames(estimated.frames(slice(late, None)), true_motion(wearer))
    evaluation = evaluate_scene(estimate, scene)
    return replace(
        trial,
        frames=len(motion),
        mpjpe_mm=mpjpe(motion, reference),
        mpjae_deg=mpjae(motion, reference),
        sensors=sensor_errors(evaluation.wearers[wearer.subject.name].sensors, wearer),
        camera_m=_metric(evaluation, "camera_translation"),
        camera_deg=_metric(evaluation, "camera_rotation"),
        precision=_metric(evaluation, "association_precision"),
        recall=_metric(evaluation, "association_recall"),
        solve_seconds=_solve_seconds(estimate),
        findings=sentences(estimate.findings),
    )


def errors_by_kind(trials: Sequence[Trial]) -> dict[str, tuple[float, float]]:
    """MPJPE in mm and MPJAE in degrees by kind of motion, every recording alike, and ``mean`` of the kinds."""
    found = {
        kind: (mean(one.mpjpe_mm for one in own), mean(one.mpjae_deg for one in own))
        for kind, own in group(trials, lambda one: one.kind).items()
    }
    return found | {"mean": (mean(p for p, _ in found.values()), mean(a for _, a in found.values()))}


def _metric(evaluation: Evaluation, name: str) -> float:
    return evaluation.metrics[name].value if name in evaluation.metrics else NAN


def _solve_seconds(estimate: Estimate) -> float:
    wearers: Sequence[WearerEstimate] = () if estimate.reports else estimate.wearers
    reports = [*estimate.reports, *(report for one in wearers for report in one.reports)]
    return float(sum(report.seconds for report in reports))


def _start_line(starts: Sequence[StartErrors | None]) -> str:
    known = [one for one in starts if one is not None]
    heading, mounting, alone = (
        mean(getattr(one, name) for one in known) for name in ("heading_deg", "mounting_deg", "pose_alone_deg")
    )
    return (
        f"At the start headings are off by {heading:.1f} deg on average, mountings by {mounting:.1f} ({alone:.1f} with "
        "true headings)"
    )


def _compared(variants: dict[str, list[Trial]]) -> Iterator[str]:
    """MPJPE of one variant against another's, ours and the thesis's; over the recordings that both solved."""
    for one, other in COMPARED:
        first, second = (
            {(t.clip, t.seed): t for t in variants.get(name, ()) if not t.failure} for name in (one, other)
        )
        both = [key for key in first if key in second]
        if not both:
            continue
        a, b = (errors_by_kind([found[key] for key in both])["mean"][0] for found in (first, second))
        published = ""
        if one in PUBLISHED and other in PUBLISHED:
            theirs, reference = PUBLISHED[one][0], PUBLISHED[other][0]
            published = f" (thesis {100 * theirs / reference:.1f} %, {theirs - reference:+.1f} mm)"
        yield f"MPJPE of {one} is {100 * a / b:.1f} % of {other}'s, {a - b:+.1f} mm{published}"


def _details(own: Sequence[Trial]) -> list[float]:
    sensors = [sensor for trial in own for sensor in trial.sensors]
    cells: list[float] = []
    for name in ("heading_deg", "mounting_deg"):
        for at_end in (False, True):
            values = np.array([getattr(one, name) for one in sensors if one.at_end == at_end])
            cells += [float(values.mean()), float(np.quantile(values, 0.95))] if len(values) else [NAN, NAN]
    names = ("camera_deg", "precision", "recall", "solve_seconds", "seconds")
    return [*cells, 1000 * mean(t.camera_m for t in own), *(mean(getattr(t, name) for t in own) for name in names)]
