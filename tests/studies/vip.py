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
    as_calibration,
    middle_of,
    nominal_start,
    pelvis_of,
    posed_scene,
    straps_and_sensors,
    true_calibration,
    true_motion,
    turned,
    with_nominal_pose,
    without_camera,
)
from tests.studies.study import NAN, Fixed, Tell, bullets, group, mean, table
from vip_factors.body.kinematics import Motion
from vip_factors.errors import InputError, RecordingError, SolveError
from vip_factors.estimate import Estimate
from vip_factors.evaluate.evaluation import evaluate_scene
from vip_factors.evaluate.metrics import common_frames, mpjae, mpjpe, resample
from vip_factors.findings import sentences
from vip_factors.geometry.rotations import rotation_z, transpose
from vip_factors.initialise.calibration import InitialCalibration
from vip_factors.pipeline import smooth
from vip_factors.sensors.calibration import PRESETS, SITES, Calibration, SensorCalibration
from vip_factors.sensors.recording import Recording, Truth
from vip_factors.sensors.scene import Scene
from vip_factors.settings import Settings
from vip_factors.simulate.settings import CameraKind, SceneSettings, SimulateSettings

SIX = frozenset(SITES[site].bone for site in PRESETS["sip6"])
NOMINAL, TRUE, FOUND = "nominal pose", "true pose", "as VIP found it"
# Metrics of an evaluation that are told, with their columns.
METRICS = {
    "camera_translation": "camera", "camera_rotation": "camera deg", "association_precision": "precision %",
    "association_recall": "recall %",
}  # fmt: skip


@dataclass(frozen=True)
class Variant:
    """One tracker.

    Attributes:
        name: the thesis's, where it has one.
        published: what von Marcard's thesis (2019) reports of it over all of TotalCapture's test sequences, other data
            than ours: MPJPE mm and MPJAE deg.
        start: where mountings and headings come from. :data:`NOMINAL`: the declared T-pose, headings by straps;
            :data:`TRUE`: the true first pose and true headings; :data:`FOUND`: the estimate of VIP.
        free: whether headings and mountings are estimated from there on.
        distortion_deg: the headings of the start are off by up to this, each sensor's for itself.
        six: of the sensors only those of SIP are used.
        camera: whether there is one.
        true_pixels, true_camera: detections without error; the camera's poses told.
        acceleration: False for the inertial tracker, frame by frame.
    """

    name: str
    published: tuple[float, float] | None = None
    start: str = NOMINAL
    free: bool = True
    distortion_deg: float = 0.0
    six: bool = False
    camera: bool = True
    true_pixels: bool = False
    true_camera: bool = False
    acceleration: bool = True


_inertial = partial(Variant, free=False, camera=False)
VARIANTS: dict[str, Variant] = {
    one.name: one
    for one in (
        _inertial("IT", (55.0, 17.5), NOMINAL, acceleration=False),  # table 4.1; its text says 16.9 deg
        Variant("VIP", (26.0, 12.3)),  # table 4.1
        Variant("VIP-45", distortion_deg=45.0),
        Variant("VIP-Cam", (25.3, 12.2), true_camera=True),  # table 4.8
        # Weighted as if they were a detector's, as in the thesis (table 4.7).
        Variant("VIP-2D", (15.1, 10.2), true_pixels=True),
        Variant("VIP-6", (35.8, 14.7), six=True),  # table 4.9
        _inertial("VIP-IT", (28.2, 12.2), FOUND, acceleration=False),  # table 4.4
        Variant("VIP-vanilla", (45.8, 18.0), free=False),
        _inertial("SIP", (52.2, 14.6), TRUE, six=True),
        _inertial("SOP", (76.2, 19.7), TRUE, six=True, acceleration=False),  # table 3.3
    )
}


def chosen_variants(names: tuple[str, ...] = ()) -> tuple[Variant, ...]:
    """Variants by name; all without one."""
    unknown = [name for name in names if name not in VARIANTS]
    if unknown:
        raise InputError(f"unknown variant '{unknown[0]}': expected some of {', '.join(VARIANTS)}")
    return tuple(VARIANTS[name] for name in names or VARIANTS)


def settings_of(variant: Variant, settings: Settings) -> Settings:
    """The pipeline's settings for a variant."""
    from_truth = variant.start != NOMINAL or variant.distortion_deg > 0
    calibration = replace(
        settings.calibration, estimate_headings=variant.free, estimate_mountings=variant.free, from_truth=from_truth
    )
    fusion = replace(settings.fusion, use_camera=variant.camera)
    return replace(
        with_nominal_pose(settings), acceleration=variant.acceleration, fusion=fusion, calibration=calibration
    )


def scene_for(variant: Variant, scene: Scene, settings: Settings, seed: int, found: Calibration | None = None) -> Scene:
    """The scene as a variant gets it; what it may not know of the truth is for the evaluation to keep."""
    wearer = _with_six(scene.wearers[0]) if variant.six else scene.wearers[0]
    scene = replace(scene, wearers=(_started(wearer, variant, settings, seed, found),))
    if not variant.camera:
        return without_camera(scene)
    if scene.camera is None or scene.camera.truth is None or scene.camera.truth.pixels is None:
        raise InputError(f"scene '{scene.name}' has no true camera: expected a simulated one")
    if variant.true_pixels:  # the wearers' own detections alone, each keypoint where it is, with confidence one
        detections, mine = scene.camera.detections, scene.camera.truth.wearer >= 0
        pixels = scene.camera.truth.pixels[mine]
        sure = np.all(np.isfinite(pixels), axis=2).astype(float)
        detections = replace(detections, frame=detections.frame[mine], pixels=pixels, confidence=sure)
        truth = replace(scene.camera.truth, wearer=scene.camera.truth.wearer[mine], pixels=pixels)
        scene = replace(scene, cameras=(replace(scene.camera, detections=detections, truth=truth),))
    if variant.true_camera:
        assert scene.camera is not None
        assert scene.camera.truth is not None
        scene = replace(scene, cameras=(replace(scene.camera, known_path=scene.camera.truth.path),))
    return scene


def _with_six(wearer: Recording) -> Recording:
    sites = tuple(site for site in wearer.placement.sites if site.bone in SIX)
    kept = {site.sensor: wearer.imus[site.sensor] for site in sites if site.sensor in wearer.imus}
    return replace(wearer, imus=kept, placement=replace(wearer.placement, sites=sites))


def _started(
    wearer: Recording, variant: Variant, settings: Settings, seed: int, found: Calibration | None
) -> Recording:
    """The recording with the calibration that the pipeline is to start from where its truth should be."""
    if variant.start == FOUND:
        if found is None:
            raise InputError(f"variant {variant.name} starts from what VIP found: run VIP on the same scene first")
        return replace(wearer, truth=Truth(true_motion(wearer), found), initial_pose="none")
    if variant.start == TRUE:
        return calibrated_at_first_frame(wearer)
    if not variant.distortion_deg:
        return wearer
    names, start = nominal_start(wearer, settings)
    start = distorted(start, pelvis_of(wearer, names), variant.distortion_deg, np.random.default_rng([seed, 0xD157]))
    return replace(wearer, truth=Truth(true_motion(wearer), as_calibration(names, start)))


def calibrated_at_first_frame(recording: Recording) -> Recording:
    """The recording with the calibration that its true first pose and true headings give (thesis, eq. 3.3).

    ``R_bone_sensor = R_world_boneᵀ Rz(γ) R_inertial_sensor`` at each sensor's first sample. Unlike the simulator's own
    mountings these carry the errors of the attitude filter and of soft tissue in that moment.
    """
    motion, calibration = true_motion(recording), {}
    for site in (recording.placement.site(name) for name in recording.placed):
        stream = recording.imus[site.sensor]
        if stream.R_inertial_sensor is None:
            raise InputError(f"sensor '{site.sensor}' gives no orientation: the study cannot calibrate it")
        time = float(np.clip(stream.time[0], motion.time[0], motion.time[-1]))
        R_world_bone = resample(motion, time, motion.rate, 1).state.R_world_bone[0, site.bone_index]
        heading = true_calibration(recording)[site.sensor].heading
        R_world_sensor = rotation_z(heading) @ stream.R_inertial_sensor[0]
        calibration[site.sensor] = SensorCalibration(heading, transpose(R_world_bone) @ R_world_sensor)
    return replace(recording, truth=Truth(motion, calibration), initial_pose="none")


def distorted(start: InitialCalibration, gauge: int, degrees: float, random: np.random.Generator) -> InitialCalibration:
    """The headings off by uniform ±``degrees`` against that of sensor ``gauge``."""
    turns = np.deg2rad(random.uniform(-degrees, degrees, len(start.headings)))
    turns[gauge] = 0.0
    return turned(start, turns)


@dataclass(frozen=True)
class Trial:
    """One variant on one recording; NaN where there is nothing to measure.

    Attributes:
        variant, kind, clip, seed: which.
        mpjpe_mm, mpjae_deg: without the frames of the initial pose.
        heading_deg, mounting_deg: errors of the calibration used or found, of each sensor, the common yaw removed.
        metrics: of :data:`METRICS`.
        seconds: of the whole pipeline.
        failure: what the pipeline said if it gave up.
    """

    variant: str
    kind: str
    clip: str
    seed: int
    mpjpe_mm: float = NAN
    mpjae_deg: float = NAN
    heading_deg: tuple[float, ...] = ()
    mounting_deg: tuple[float, ...] = ()
    metrics: tuple[float, ...] = (NAN,) * len(METRICS)
    seconds: float = NAN
    findings: tuple[str, ...] = ()
    failure: str = ""


@dataclass(frozen=True, kw_only=True)
class Vip(ClipStudy):
    """The thesis's video-inertial trackers on simulated scenes, beside its tables."""

    variants: tuple[str, ...] = ()
    """Names of trackers, such as IT VIP VIP-IT; all if absent."""
    frame_rate: float = 60.0
    """Frames per second of the reconstructions."""
    iterations: int = 30
    """At most, of each solve."""
    camera: CameraKind = "fixed"  # TotalCapture's
    """What films the simulated scenes."""
    processes: int = 1
    """Recordings worked on side by side; times are then those of a busy machine."""
    base: Fixed[Settings] = field(default_factory=Settings)
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
        """All variants on one scene; VIP runs first if another needs what it found."""
        scene, vip = self.scene(clip.motion(), clip.name, clip.seed), VARIANTS["VIP"]
        solve = replace(self.base.solve, max_iterations=self.iterations)
        settings = replace(self.base, frame_rate=self.frame_rate, solve=solve)
        needed = [vip] if vip in variants or any(one.start == FOUND for one in variants) else []
        results, found = {}, None
        for variant in (*needed, *(one for one in variants if one != vip)):
            trial, estimate = _trial(scene, clip, variant, settings, found)
            results[variant.name] = trial
            if variant == vip and estimate is not None:
                found = estimate.wearers[0].calibration
        return [results[one.name] for one in variants]

    def tables(self, rows: Sequence[Trial]) -> Iterator[str]:
        """Accuracy, then calibration, camera, association and time of every variant, and the thesis's own figures."""
        yield (
            f"MPJPE mm / MPJAE deg of 13 simulated sensors and a {self.camera} camera, "
            f"{len({(trial.clip, trial.seed) for trial in rows})} recordings of {self.seconds:g} s after a T-pose held "
            f"{self.pose_error_deg:g} deg off per joint and axis; straps {self.sensors.mounting_error_deg:g} deg off "
            f"per axis; {self.keypoints} detections. Thesis: on TotalCapture"
        )
        variants = group(rows, lambda one: one.variant)
        means = {name: errors_by_kind(own) for name, own in variants.items()}
        kinds = list(dict.fromkeys(trial.kind for trial in rows))
        shown = [*kinds, "mean"] if len(kinds) > 1 else ["mean"]
        lines = [[name, *(row.get(kind) for kind in shown), VARIANTS[name].published] for name, row in means.items()]
        yield table(["variant", *shown, "thesis, mean"], lines)
        yield "Errors of headings and mountings in degrees (after the common yaw), and all else"
        head = ["heading mean", "95 %", "mounting mean", "95 %", *METRICS.values(), "s"]
        yield table(["variant", *head], [[name, *_details(own)] for name, own in variants.items()])
        failures = (f"{t.variant}, {t.clip}, seed {t.seed}: {t.failure}" for t in rows if t.failure)
        yield bullets("Not solved, and left out of the means:", failures)


def _trial(
    scene: Scene, clip: Clip, variant: Variant, settings: Settings, found: Calibration | None
) -> tuple[Trial, Estimate | None]:
    trial, settings = Trial(variant.name, clip.kind, clip.name, clip.repetition), settings_of(variant, settings)
    begin = perf_counter()
    try:
        given = scene_for(variant, scene, settings, clip.seed, found)
        estimate = smooth(given, settings)
    except (SolveError, RecordingError) as error:  # one recording that cannot be solved must not end a run of hours
        return replace(trial, failure=f"{type(error).__name__}: {error}", seconds=perf_counter() - begin), None
    seconds, estimated = perf_counter() - begin, estimate.wearers[0].motion
    late = int(np.count_nonzero(estimated.time < SETTLED_S - 1e-6))
    motion, reference, _ = common_frames(estimated.frames(slice(late, None)), true_motion(scene.wearers[0]))
    # What the variant was told stands where its truth was: it is judged by the scene as recorded.
    evaluation = evaluate_scene(estimate, replace(given, wearers=scene.wearers))
    sensors = evaluation.wearers[scene.wearers[0].subject.name].sensors.values()
    metrics = (evaluation.metrics[name].value if name in evaluation.metrics else NAN for name in METRICS)
    return replace(
        trial, mpjpe_mm=mpjpe(motion, reference), mpjae_deg=mpjae(motion, reference),
        heading_deg=tuple(abs(one["heading_deg"]) for one in sensors),
        mounting_deg=tuple(one["mounting_deg"] for one in sensors),
        metrics=tuple(metrics), seconds=seconds, findings=sentences(estimate.findings),
    ), estimate  # fmt: skip


def errors_by_kind(trials: Sequence[Trial]) -> dict[str, tuple[float, float]]:
    """MPJPE in mm and MPJAE in degrees by kind of motion, every recording alike, and ``mean`` of the kinds."""
    found = {
        kind: (mean(one.mpjpe_mm for one in own), mean(one.mpjae_deg for one in own))
        for kind, own in group(trials, lambda one: one.kind).items()
    }
    return found | {"mean": (mean(p for p, _ in found.values()), mean(a for _, a in found.values()))}


def _details(own: Sequence[Trial]) -> Iterator[float]:
    for values in ([d for one in own for d in one.heading_deg], [d for one in own for d in one.mounting_deg]):
        yield from (float(np.mean(values)), float(np.quantile(values, 0.95))) if values else (NAN, NAN)
    yield from (mean(one.metrics[place] for one in own) for place in range(len(METRICS)))
    yield mean(one.seconds for one in own)
