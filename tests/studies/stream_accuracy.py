"""The fixed-lag tracker beside the batch pipeline on the same simulated scenes: what waiting less costs."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from time import process_time
from typing import Any, Literal

import numpy as np

from tests.studies.live_run import PoseErrors, SinceStart, live_settings, pose_errors, run_live, since_start
from tests.studies.scenes import (
    HOLD_S,
    PLACEMENT,
    SETTLED_S,
    ClipStudy,
    SensorError,
    middle_of,
    posed_scene,
    sensor_errors,
    straps_and_sensors,
    true_motion,
    without_camera,
)
from tests.studies.study import NAN, Fixed, Tell, bullets, group, mean, table
from vip_factors.body.kinematics import Motion
from vip_factors.errors import InputError, RecordingError, SolveError
from vip_factors.estimate import WearerEstimate
from vip_factors.evaluate.evaluation import evaluate
from vip_factors.evaluate.metrics import common_frames
from vip_factors.findings import sentences
from vip_factors.live.settings import LiveSettings
from vip_factors.pipeline import smooth
from vip_factors.sensors.calibration import Calibration, preset
from vip_factors.sensors.scene import Scene
from vip_factors.simulate.scene import Performer, simulate_scene
from vip_factors.simulate.scene_settings import SceneSettings
from vip_factors.simulate.staging import lasting

Filming = Literal["fixed", "hand-held", "none"]
Begins = Literal["t-pose", "in-motion"]
BATCH = "batch"


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
    jitter_truth: float = NAN
    lost: int = 0
    cpu_ms: float = NAN
    cpu_ms_95: float = NAN
    start_cpu_s: float = NAN
    cpu_s: float = NAN
    findings: tuple[str, ...] = ()
    failure: str = ""

    @property
    def estimator(self) -> str:
        return BATCH if self.lag_s is None else f"lag {self.lag_s:g} s"


@dataclass(frozen=True, kw_only=True)
class StreamAccuracy(ClipStudy):
    """The fixed-lag tracker beside the batch pipeline, by lag, camera and beginning, on simulated scenes."""

    lags: tuple[float, ...] = (0.1, 0.25, 0.5, 1.0)
    """Seconds by which smoothed poses come later, of scenes with a T-pose; without one it is 0.25."""
    cameras: tuple[Filming, ...] = ("fixed", "hand-held", "none")
    """What films."""
    begins: tuple[Begins, ...] = ("t-pose", "in-motion")
    """What the wearer does at first."""
    settings: Fixed[LiveSettings] = field(default_factory=LiveSettings)  # of the tracker, and of batch but for the lag

    def __post_init__(self) -> None:
        if not all(lag > 0 for lag in self.lags):
            raise InputError(f"lags of {', '.join(f'{lag:g}' for lag in self.lags)} s: expected more than 0")

    def rows(self, tell: Tell) -> Iterator[StreamTrial]:
        work = [(clip, camera, begin) for clip in self.chosen() for camera in self.cameras for begin in self.begins]
        for done, (clip, camera, begin) in enumerate(work):
            scene = self.scene(clip.motion(), clip.name, camera, begin, clip.seed)
            blank = StreamTrial(clip.kind, clip.name, clip.repetition, camera, begin, None)
            for trial in self._trials(scene, blank):
                tell(f"{clip.name}, {camera}, {begin}, {trial.estimator}", done / len(work))
                yield trial

    def scene(self, motion: Motion, name: str, camera: Filming, begin: Begins, seed: int) -> Scene:
        """Begun in a T-pose or in the middle of the motion, with the same straps, sensors and detector."""
        filmed = "fixed" if camera == "none" else camera
        settings = SceneSettings.realistic(camera=filmed, keypoints="openpose18", imu=straps_and_sensors())
        middle = middle_of(motion, self.seconds, name)
        if begin == "t-pose":
            scene = posed_scene(middle, name, settings, self.pose_error_deg, seed)
        else:
            whole = lasting(middle, HOLD_S + len(middle) / middle.rate)  # as much as after a T-pose is compared
            performer = Performer("wearer", whole, preset(PLACEMENT, whole.skeleton))
            scene = simulate_scene([performer], settings, seed, name)
        return scene if camera != "none" else without_camera(scene)

    def _trials(self, scene: Scene, blank: StreamTrial) -> Iterator[StreamTrial]:
        """Batch, then every lag; what fails says so."""
        yield _guarded(blank, partial(_batch, scene, blank, self.settings))
        own = self.settings.lag_s
        for lag in self.lags if blank.begin == "t-pose" or own not in self.lags else (own,):
            one, settings = replace(blank, lag_s=lag), live_settings(self.settings, lag_s=lag)
            yield _guarded(one, partial(_live, scene, one, settings))

    def tables(self, rows: Sequence[StreamTrial]) -> Iterator[str]:
        """Errors by camera, beginning and lag; then by time since the start."""
        yield (
            f"{len({(one.clip, one.seed) for one in rows})} recordings of {self.seconds:g} s, 13 sensors; errors from "
            f"{SETTLED_S:g} s on, each clip alike. newest: zero lag; smoothed: one lag later"
        )
        head = [
            "camera", "begin", "estimator", "newest mm", "deg", "root cm", "jitter", "smoothed mm", "deg", "root cm",
            "jitter", "of truth", "to batch", "heading", "95 %", "mounting", "95 %", "lost", "CPU ms", "95 %",
        ]  # fmt: skip
        several = group(rows, lambda one: (one.camera, one.begin, one.estimator))
        batch = {(t.clip, t.seed, t.camera, t.begin): t.smoothed for t in rows if t.lag_s is None}
        yield table(head, [[*names, *_cells(own), *_rest(own, batch)] for names, own in several.items()])
        yield "By time since tracking began, newest poses, all clips"
        spans = sorted({(span.since_s, span.until_s) for one in rows for span in one.over_time})
        head = ["camera", "begin", "estimator"]
        for since, until in spans:
            name = f"{since:g} to {until:g} s" if until < 1e8 else f"from {since:g} s"
            head += [f"{name}: mm", "deg RMS", "expected"]
        lines = []
        for names, own in several.items():
            found = [[s for one in own for s in one.over_time if (s.since_s, s.until_s) == key] for key in spans]
            if any(found):
                lines.append([*names, *(value for those in found for value in _span(those))])
        yield table(head, lines)
        failures = (f"{t.clip}, {t.camera}, {t.begin}, {t.estimator}: {t.failure}" for t in rows if t.failure)
        yield bullets("No estimate, and left out of the means:", failures)


def _guarded(blank: StreamTrial, work: Callable[[], StreamTrial]) -> StreamTrial:
    try:
        return work()
    except (InputError, RecordingError, SolveError) as error:  # one recording must not end a run of hours
        return replace(blank, failure=f"{type(error).__name__}: {error}")


def _batch(scene: Scene, trial: StreamTrial, settings: LiveSettings) -> StreamTrial:
    begin = process_time()
    estimate = smooth(scene, settings)
    seconds, own = process_time() - begin, estimate.wearers[0]
    measured = _with_calibration(trial, scene, own.motion, own.calibration)
    smoothed = pose_errors(own.motion, true_motion(scene.wearers[0]), SETTLED_S)
    return replace(measured, smoothed=smoothed, cpu_s=seconds, findings=sentences(estimate.findings))


def _live(scene: Scene, trial: StreamTrial, settings: LiveSettings) -> StreamTrial:
    run, truth = run_live(scene, settings), true_motion(scene.wearers[0])
    median, high = run.cpu_ms
    return replace(
        _with_calibration(trial, scene, run.smoothed, run.calibration),
        newest=pose_errors(run.newest, truth, SETTLED_S),
        smoothed=pose_errors(run.smoothed, truth, SETTLED_S),
        over_time=since_start(run.newest_poses, run.start, truth),
        lost=run.lost,
        cpu_ms=median,
        cpu_ms_95=high,
        start_cpu_s=run.cpu_seconds[0],
        cpu_s=sum(run.cpu_seconds),
        findings=run.findings,
    )


def _with_calibration(trial: StreamTrial, scene: Scene, motion: Motion, calibration: Calibration) -> StreamTrial:
    """The trial with the errors of a calibration, and the truth's own jitter."""
    wearer = scene.wearers[0]
    part = common_frames(motion, true_motion(wearer))[0]
    assert wearer.truth is not None
    found = evaluate(WearerEstimate(wearer.name, "", part, calibration), wearer.truth, wearer.placement)
    return replace(trial, sensors=sensor_errors(found.sensors, wearer), jitter_truth=found["jitter_truth"])


def _cells(own: Sequence[StreamTrial]) -> Iterator[float]:
    for several in ([one.newest for one in own], [one.smoothed for one in own]):
        known = [one for one in several if one is not None]
        yield from (
            mean(getattr(one, name) for one in known) for name in ("mpjpe_mm", "mpjae_deg", "root_cm", "jitter")
        )


def _rest(own: Sequence[StreamTrial], batch: Mapping[Any, PoseErrors | None]) -> Iterator[object]:
    yield mean(one.jitter_truth for one in own)
    # MPJPE of newest and smoothed over batch's, over the recordings that both solved.
    pairs = [(one.newest, one.smoothed, batch.get((one.clip, one.seed, one.camera, one.begin))) for one in own]
    both = [(a.mpjpe_mm, b.mpjpe_mm, c.mpjpe_mm) for a, b, c in pairs if a is not None and b is not None and c]
    newest, smoothed, reference = np.sum(both, axis=0) if both else (NAN, NAN, NAN)
    yield f"{newest / reference:.2f} / {smoothed / reference:.2f}" if both else ""
    for name in ("heading_deg", "mounting_deg"):
        values = [getattr(sensor, name) for one in own for sensor in one.sensors]
        yield from (np.mean(values), np.quantile(values, 0.95)) if values else (NAN, NAN)
    yield from (sum(one.lost for one in own), mean(one.cpu_ms for one in own), mean(one.cpu_ms_95 for one in own))


def _span(spans: Sequence[SinceStart]) -> list[float]:
    squares = (float(np.sqrt(mean(getattr(s, name) ** 2 for s in spans))) for name in ("error_deg", "sigma_deg"))
    return [mean(one.mpjpe_mm for one in spans), *squares]
