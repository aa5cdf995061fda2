"""The video-inertial trackers of the thesis on simulated scenes with known truth (4.4.2)."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from time import perf_counter

import numpy as np

from tests.studies.sip import find_clips
from tests.studies.vip_suite import (
    BLEND_S,
    HOLD_S,
    StartErrors,
    VipTrials,
    scene_of,
    seed_of,
    start_errors,
)
from tests.studies.vip_variants import VARIANTS, Variant, chosen_variants, settings_of, told
from vip_factors.body.held_out_clips import HELD_OUT_CLIPS, held_out_names
from vip_factors.errors import InputError, RecordingError, SolveError
from vip_factors.estimate import Estimate, SceneEstimate
from vip_factors.evaluate.calibration_metrics import ENDS
from vip_factors.evaluate.frames import common_frames
from vip_factors.evaluate.metrics import mpjae, mpjpe
from vip_factors.evaluate.scene import SceneEvaluation, evaluate_scene
from vip_factors.io.motions.files import read_motion
from vip_factors.pipeline import smooth_scene
from vip_factors.sensors.calibration import Calibration
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene
from vip_factors.settings import Settings

Tell = Callable[[str, float], None]
NAN = float("nan")


@dataclass(frozen=True)
class SensorError:
    """How far a sensor's calibration is off in degrees; ``at_end``: on a hand or foot."""

    sensor: str
    at_end: bool
    heading_deg: float
    mounting_deg: float


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
    failure: str = ""


@dataclass(frozen=True)
class VipResults:
    """All trials, and how far off the start of the recordings was."""

    trials: tuple[Trial, ...]
    start: StartErrors | None = None


@dataclass(frozen=True)
class Work:
    """One recording to be made and estimated by all variants."""

    kind: str
    clip: str
    file: Path
    number: int
    seed: int


def chosen_clips(kinds: Sequence[str] = (), names: Sequence[str] = ()) -> dict[str, tuple[str, ...]]:
    """The held-out clips of some kinds or of some names; all without either.

    Raises:
        InputError: for an unknown kind or name, or if no clip is of both.
    """
    known = {*HELD_OUT_CLIPS, *held_out_names()}
    unknown = [name for name in (*kinds, *names) if name not in known]
    if unknown:
        raise InputError(f"'{unknown[0]}' is neither a kind of motion nor a held-out clip: expected {sorted(known)}")
    chosen = {
        kind: tuple(name for name in clips if not names or name in names)
        for kind, clips in HELD_OUT_CLIPS.items()
        if not kinds or kind in kinds
    }
    chosen = {kind: clips for kind, clips in chosen.items() if clips}
    if not chosen:
        raise InputError(f"no clip is both of kind {' or '.join(kinds)} and named {' or '.join(names)}")
    return chosen


def run_vip(
    motions: Path, trials: VipTrials | None = None, variants: Sequence[str] = (), tell: Tell | None = None,
    clips: Mapping[str, Sequence[str]] | None = None, keep: Callable[[VipResults], None] | None = None,
) -> VipResults:  # fmt: skip
    """Run variants on clips.

    Args:
        motions: folder with the motion files of the clips, searched with all folders below it.
        trials: how much, and with which errors.
        variants: names; all if empty.
        tell: called with what is done and the fraction of it.
        clips: names of clips by kind; those held out of the pose prior's training if absent.
        keep: called with the results so far after each recording: runs are long.

    Raises:
        InputError: if a clip has no file in the folder or is too short, or for an unknown variant.
    """
    trials, clips = trials or VipTrials(), clips or HELD_OUT_CLIPS
    wanted = chosen_variants(tuple(variants))
    files = find_clips(motions, [name for names in clips.values() for name in names])
    listed = [(kind, name) for kind, names in clips.items() for name in names]
    work = [
        Work(kind, name, files[name], _number(name, n), seed)
        for seed in range(trials.seeds)
        for n, (kind, name) in enumerate(listed)
    ]
    found: list[Trial] = []
    wearers: list[Recording] = []
    results = VipResults(())
    for done, (one, recording) in enumerate(_all_done(work, trials, wanted, tell or (lambda stage, fraction: None))):
        found += one
        wearers.append(recording)
        results = VipResults(tuple(found), start_errors(wearers, trials.settings))
        if tell is not None:
            tell("benchmark", (done + 1) / len(work))
        if keep is not None:
            keep(results)
    return results


def _all_done(
    work: Sequence[Work], trials: VipTrials, variants: tuple[Variant, ...], tell: Tell
) -> Iterator[tuple[list[Trial], Recording]]:
    """The trials and the wearer of one recording after the other."""
    if trials.processes == 1:
        for done, one in enumerate(work):

            def part(fraction: float, done: int = done) -> None:
                tell("benchmark", (done + fraction) / len(work))

            yield _done(one, trials, variants, part)
        return
    with ProcessPoolExecutor(trials.processes) as pool:
        yield from pool.map(partial(_done, trials=trials, variants=variants), work)


def _done(
    work: Work, trials: VipTrials, variants: tuple[Variant, ...], tell: Callable[[float], None] = lambda fraction: None
) -> tuple[list[Trial], Recording]:
    scene = scene_of(read_motion(work.file), work.clip, trials, seed_of(work.number, work.seed))
    return run_scene(scene, work, variants, trials.settings, tell), scene.wearers[0]


def _number(name: str, otherwise: int) -> int:
    """A clip's number in the suite, whichever of its clips are run: the same clip is always recorded alike."""
    names = held_out_names()
    return names.index(name) if name in names else otherwise


def run_scene(
    scene: Scene, work: Work, variants: Sequence[Variant], settings: Settings,
    tell: Callable[[float], None] = lambda fraction: None, skip_s: float = HOLD_S + BLEND_S,
) -> list[Trial]:  # fmt: skip
    """All variants on one scene; VIP runs first if another needs what it found."""
    vip = VARIANTS["VIP"]
    ordered = sorted(variants, key=lambda one: one != vip)
    results, found = {}, None
    if any(one.needs_vip for one in variants) and vip not in variants:
        ordered.insert(0, vip)
    for number, variant in enumerate(ordered):
        tell(number / len(ordered))
        trial, estimate = _trial(scene, work, variant, settings, found, skip_s)
        results[variant.name] = trial
        if variant == vip and estimate is not None:
            found = estimate.wearers[0].calibration
    return [results[one.name] for one in variants]


def _trial(
    scene: Scene, work: Work, variant: Variant, settings: Settings, found: Calibration | None, skip_s: float
) -> tuple[Trial, SceneEstimate | None]:
    trial = Trial(variant.name, work.kind, work.clip, work.seed)
    settings = settings_of(variant, settings)
    begin = perf_counter()
    try:
        given = told(scene, variant, settings, seed_of(work.number, work.seed), found)
        estimate = smooth_scene(given, settings)
    except (SolveError, RecordingError) as error:  # one recording that cannot be solved must not end a run of hours
        return replace(trial, failure=f"{type(error).__name__}: {error}", seconds=perf_counter() - begin), None
    seconds = perf_counter() - begin
    # What the variant was told stands where its truth was: it is judged by the scene as recorded.
    judged = replace(given, wearers=scene.wearers)
    return replace(measured(trial, estimate, judged, skip_s), seconds=seconds), estimate


def measured(trial: Trial, estimate: SceneEstimate, scene: Scene, skip_s: float) -> Trial:
    """The trial with all that the scene's truth tells of the estimate; positions from ``skip_s`` seconds on."""
    truth = scene.wearers[0].truth
    if truth is None:
        raise InputError(f"scene '{scene.name}' has no truth to measure by")
    estimated = estimate.wearers[0].motion
    late = int(np.count_nonzero(estimated.time < skip_s - 1e-6))
    motion, reference, _ = common_frames(estimated.frames(slice(late, None)), truth.motion)
    evaluation = evaluate_scene(estimate, scene)
    return replace(
        trial,
        frames=len(motion),
        mpjpe_mm=mpjpe(motion, reference),
        mpjae_deg=mpjae(motion, reference),
        sensors=_sensor_errors(evaluation, scene),
        camera_m=_metric(evaluation, "camera_translation"),
        camera_deg=_metric(evaluation, "camera_rotation"),
        precision=_metric(evaluation, "association_precision"),
        recall=_metric(evaluation, "association_recall"),
        solve_seconds=_solve_seconds(estimate),
        findings=estimate.findings,
    )


def _metric(evaluation: SceneEvaluation, name: str) -> float:
    return evaluation.metrics[name].value if name in evaluation.metrics else NAN


def _sensor_errors(evaluation: SceneEvaluation, scene: Scene) -> tuple[SensorError, ...]:
    wearer = scene.wearers[0]
    ends = {site.sensor for site in wearer.placement.sites if site.bone in ENDS}
    table = evaluation.wearers[wearer.subject.name].sensors
    return tuple(
        SensorError(name, name in ends, abs(row["heading_deg"]), row["mounting_deg"]) for name, row in table.items()
    )


def _solve_seconds(estimate: SceneEstimate) -> float:
    wearers: Sequence[Estimate] = () if estimate.reports else estimate.wearers
    reports = [*estimate.reports, *(report for one in wearers for report in one.reports)]
    return float(sum(report.seconds for report in reports))
