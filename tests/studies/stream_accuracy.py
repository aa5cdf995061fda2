"""The fixed-lag tracker beside the batch pipeline on the same simulated scenes: what waiting less costs."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from time import process_time
from typing import Literal, get_args

from tests.studies.live_measures import PoseErrors, SinceStart, pose_errors, since_start
from tests.studies.live_run import LiveRun, live_settings, run_live
from tests.studies.sip import find_clips
from tests.studies.vip import SensorError
from tests.studies.vip_suite import BLEND_S, HOLD_S, PLACEMENT, VipTrials, middle_of, scene_of, seed_of
from vip_factors.body.held_out_clips import HELD_OUT_CLIPS, held_out_names
from vip_factors.body.motion import Motion
from vip_factors.errors import InputError, RecordingError, SolveError
from vip_factors.estimate import Estimate
from vip_factors.evaluate.calibration_metrics import ENDS
from vip_factors.evaluate.evaluation import evaluate
from vip_factors.evaluate.frames import common_frames
from vip_factors.io.motions.files import read_motion
from vip_factors.live.settings import LiveSettings
from vip_factors.pipeline import smooth_scene
from vip_factors.sensors.calibration import Calibration
from vip_factors.sensors.placement import preset
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene
from vip_factors.simulate.scene import Performer, simulate_scene
from vip_factors.simulate.staging import lasting

Filming = Literal["fixed", "hand-held", "none"]
Begins = Literal["t-pose", "in-motion"]
SETTLED_S = HOLD_S + BLEND_S  # errors count from here on, with and without a T-pose
BATCH = "batch"
LAGS = (0.1, 0.25, 0.5, 1.0)
Tell = Callable[[str, float], None]


@dataclass(frozen=True)
class StreamTrials:
    """Which scenes are made, and with which lags they are tracked."""

    scenes: VipTrials = field(default_factory=VipTrials)  # what is recorded; its camera and settings are not used
    lags: tuple[float, ...] = LAGS  # s, of scenes with a T-pose; the others are tracked with the settings' own
    cameras: tuple[Filming, ...] = get_args(Filming)
    begins: tuple[Begins, ...] = get_args(Begins)
    settings: LiveSettings = field(default_factory=LiveSettings)  # of the tracker, and of the pipeline but for the lag

    def __post_init__(self) -> None:
        for what, given, known in (("camera", self.cameras, Filming), ("begin", self.begins, Begins)):
            unknown = [one for one in given if one not in get_args(known)]
            if unknown:
                raise InputError(f"{what} '{unknown[0]}': expected some of {', '.join(get_args(known))}")
        if not all(lag > 0 for lag in self.lags):
            raise InputError(f"lags of {', '.join(f'{lag:g}' for lag in self.lags)} s: expected more than 0")

    def lags_of(self, begin: Begins) -> tuple[float, ...]:
        """The lags that scenes with this beginning are tracked with."""
        own = self.settings.lag_s
        return self.lags if begin == "t-pose" or own not in self.lags else (own,)


@dataclass(frozen=True)
class StreamTrial:
    """One estimator on one recording.

    Attributes:
        kind, clip, seed, camera, begin: of the recording.
        lag_s: of the tracker; None for the batch pipeline.
        newest: with zero lag; None for batch.
        smoothed: one lag later, or batch.
        sensors: calibration errors at the end, the common yaw removed.
        over_time: newest poses by time since tracking began.
        jitter_truth: m/s³.
        lost: frames without an answer.
        cpu_ms, cpu_ms_95: of an answer, median and 95th percentile; the start apart, in ``start_cpu_s``.
        cpu_s: in all.
        failure: why there is no estimate.
    """

    kind: str
    clip: str
    seed: int
    camera: Filming
    begin: Begins
    lag_s: float | None
    newest: PoseErrors | None = None
    smoothed: PoseErrors | None = None
    sensors: tuple[SensorError, ...] = ()
    over_time: tuple[SinceStart, ...] = ()
    jitter_truth: float = float("nan")
    lost: int = 0
    cpu_ms: float = float("nan")
    cpu_ms_95: float = float("nan")
    start_cpu_s: float = float("nan")
    cpu_s: float = float("nan")
    findings: tuple[str, ...] = ()
    failure: str = ""

    @property
    def estimator(self) -> str:
        """Its name in tables."""
        return BATCH if self.lag_s is None else f"lag {self.lag_s:g} s"


def run_stream_accuracy(
    motions: Path, trials: StreamTrials | None = None, tell: Tell | None = None,
    clips: Mapping[str, Sequence[str]] | None = None, keep: Callable[[tuple[StreamTrial, ...]], None] | None = None,
) -> tuple[StreamTrial, ...]:  # fmt: skip
    """Run batch and tracker on clips.

    Args:
        motions: folder with the motion files of the clips, searched with all folders below it.
        trials: what is recorded, and the lags.
        tell: called with what is done and the fraction of it.
        clips: names by kind; those held out of the pose prior's training if absent.
        keep: called with all trials so far after each of them: runs are long.

    Raises:
        InputError: if a clip has no file in the folder or is too short.
    """
    trials, clips = trials or StreamTrials(), clips or HELD_OUT_CLIPS
    files = find_clips(motions, [name for names in clips.values() for name in names])
    known = held_out_names()
    listed = [(kind, name) for kind, names in clips.items() for name in names]
    work = [
        (seed, n, kind, name, camera, begin)
        for seed in range(trials.scenes.seeds)
        for n, (kind, name) in enumerate(listed)
        for camera in trials.cameras
        for begin in trials.begins
    ]
    found: list[StreamTrial] = []
    for done, (seed, n, kind, name, camera, begin) in enumerate(work):
        number = known.index(name) if name in known else n  # the same clip is always recorded alike
        scene = stream_scene(read_motion(files[name]), name, trials, camera, begin, seed_of(number, seed))
        blank = StreamTrial(kind, name, seed, camera, begin, None)
        for trial in trials_of(scene, blank, trials):
            found.append(trial)
            if tell is not None:
                tell(f"{name}, {camera}, {begin}", done / len(work))
            if keep is not None:
                keep(tuple(found))
    return tuple(found)


def stream_scene(motion: Motion, name: str, trials: StreamTrials, camera: Filming, begin: Begins, seed: int) -> Scene:
    """The scene of the suite, begun in a T-pose or in the middle of the motion; without its camera for none.

    Both beginnings have the same straps, sensors and detector.
    """
    scenes = replace(trials.scenes, camera="fixed" if camera == "none" else camera)
    if begin == "t-pose":
        scene = scene_of(motion, name, scenes, seed)
    else:
        middle = middle_of(motion, scenes.seconds, name)
        whole = lasting(middle, HOLD_S + len(middle) / middle.rate)  # as much as after a T-pose is compared
        performer = Performer("wearer", whole, preset(PLACEMENT, whole.skeleton))
        scene = simulate_scene([performer], scenes.scene_settings, seed, name)
    return scene if camera != "none" else replace(scene, camera=None, truth=None)


def trials_of(scene: Scene, blank: StreamTrial, trials: StreamTrials) -> Iterator[StreamTrial]:
    """Batch, then every lag; what fails says so."""
    yield _guarded(blank, partial(_batch, scene, blank, trials.settings))
    for lag in trials.lags_of(blank.begin):
        one, settings = replace(blank, lag_s=lag), live_settings(trials.settings, lag_s=lag)
        yield _guarded(one, partial(_live, scene, one, settings))


def _guarded(blank: StreamTrial, work: Callable[[], StreamTrial]) -> StreamTrial:
    try:
        return work()
    except (InputError, RecordingError, SolveError) as error:  # one recording must not end a run of hours
        return replace(blank, failure=f"{type(error).__name__}: {error}")


def _batch(scene: Scene, trial: StreamTrial, settings: LiveSettings) -> StreamTrial:
    begin = process_time()
    estimate = smooth_scene(scene, settings)
    seconds, own = process_time() - begin, estimate.wearers[0]
    measured = _with_calibration(trial, scene.wearers[0], own.motion, own.calibration)
    return replace(measured, smoothed=_errors(scene, own.motion), cpu_s=seconds, findings=estimate.findings)


def _live(scene: Scene, trial: StreamTrial, settings: LiveSettings) -> StreamTrial:
    run = run_live(scene, settings)
    measured = _with_calibration(trial, scene.wearers[0], run.smoothed, run.calibration)
    median, high = run.cpu_ms
    return replace(
        measured,
        newest=_errors(scene, run.newest),
        smoothed=_errors(scene, run.smoothed),
        over_time=_over_time(scene, run),
        lost=run.lost,
        cpu_ms=median,
        cpu_ms_95=high,
        start_cpu_s=run.cpu_seconds[0],
        cpu_s=sum(run.cpu_seconds),
        findings=tuple(f"{time:.1f} s: {finding}" for time, finding in run.findings),
    )


def _errors(scene: Scene, motion: Motion) -> PoseErrors:
    return pose_errors(motion, _truth(scene.wearers[0]), SETTLED_S)


def _over_time(scene: Scene, run: LiveRun) -> tuple[SinceStart, ...]:
    return since_start(run.newest_poses, run.start, _truth(scene.wearers[0]))


def _truth(wearer: Recording) -> Motion:
    if wearer.truth is None:
        raise InputError(f"recording '{wearer.name}' has no truth to measure by: expected a simulated one")
    return wearer.truth.motion


def _with_calibration(trial: StreamTrial, wearer: Recording, motion: Motion, calibration: Calibration) -> StreamTrial:
    """The trial with the errors of a calibration, and the truth's own jitter."""
    assert wearer.truth is not None
    part = common_frames(motion, wearer.truth.motion)[0]
    table = evaluate(Estimate(wearer.name, "", part, calibration), wearer.truth, wearer.placement)
    ends = {site.sensor for site in wearer.placement.sites if site.bone in ENDS}
    sensors = tuple(
        SensorError(name, name in ends, abs(row["heading_deg"]), row["mounting_deg"])
        for name, row in table.sensors.items()
    )
    return replace(trial, sensors=sensors, jitter_truth=table["jitter_truth"])
