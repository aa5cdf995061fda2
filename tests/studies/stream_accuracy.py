"""The fixed-lag tracker beside the batch pipeline on the same simulated scenes: what waiting less costs."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from time import process_time
from typing import Literal

from tests.studies.live_run import PoseErrors, live_settings, pose_errors, run_live
from tests.studies.scenes import (
    HOLD_S,
    PLACEMENT,
    SETTLED_S,
    ClipStudy,
    middle_of,
    posed_scene,
    straps_and_sensors,
    true_motion,
    without_camera,
)
from tests.studies.study import NAN, Fixed, Tell, bullets, group, mean, table
from vip_factors.body.kinematics import Motion
from vip_factors.errors import InputError, RecordingError, SolveError
from vip_factors.findings import sentences
from vip_factors.live.settings import LiveSettings
from vip_factors.pipeline import smooth
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.scene import Scene
from vip_factors.settings import CommonSettings, Settings
from vip_factors.simulate.scene import Performer, simulate_scene
from vip_factors.simulate.scene_settings import SceneSettings
from vip_factors.simulate.staging import lasting

Filming = Literal["fixed", "hand-held", "none"]
Begins = Literal["t-pose", "in-motion"]
ERRORS = {"mpjpe_mm": "mm", "mpjae_deg": "deg", "root_cm": "root cm"}


@dataclass(frozen=True)
class StreamTrial:
    """One estimator on one recording.

    Attributes:
        clip, seed, camera, begin: of the recording.
        lag_s: of the tracker; None for the batch pipeline.
        newest: with zero lag; None for batch.
        smoothed: one lag later, or batch.
        lost: frames without an answer.
        cpu_s: in all.
        failure: why there is no estimate.
    """

    clip: str
    seed: int
    camera: Filming
    begin: Begins
    lag_s: float | None
    newest: PoseErrors | None = None
    smoothed: PoseErrors | None = None
    lost: int = 0
    cpu_s: float = NAN
    findings: tuple[str, ...] = ()
    failure: str = ""

    @property
    def estimator(self) -> str:
        return "batch" if self.lag_s is None else f"lag {self.lag_s:g} s"


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
            scene, own = self.scene(clip.motion(), clip.name, camera, begin, clip.seed), self.settings.lag_s
            for lag in (None, *(self.lags if begin == "t-pose" or own not in self.lags else (own,))):
                trial = StreamTrial(clip.name, clip.repetition, camera, begin, lag)
                tell(f"{clip.name}, {camera}, {begin}, {trial.estimator}", done / len(work))
                try:
                    yield self._measured(trial, scene)
                except (InputError, RecordingError, SolveError) as error:  # one must not end a run of hours
                    yield replace(trial, failure=f"{type(error).__name__}: {error}")

    def scene(self, motion: Motion, name: str, camera: Filming, begin: Begins, seed: int) -> Scene:
        """Begun in a T-pose or in the middle of the motion, with the same straps, sensors and detector."""
        filmed = "fixed" if camera == "none" else camera
        settings = SceneSettings(camera=filmed, keypoints="openpose18", imu=straps_and_sensors())
        middle = middle_of(motion, self.seconds, name)
        if begin == "t-pose":
            scene = posed_scene(middle, name, settings, self.pose_error_deg, seed)
        else:
            whole = lasting(middle, HOLD_S + len(middle) / middle.rate)  # as much as after a T-pose is compared
            performer = Performer("wearer", whole, preset(PLACEMENT, whole.skeleton))
            scene = simulate_scene([performer], settings, seed, name)
        return scene if camera != "none" else without_camera(scene)

    def _measured(self, trial: StreamTrial, scene: Scene) -> StreamTrial:
        truth = true_motion(scene.wearers[0])
        if trial.lag_s is None:
            begin = process_time()
            own = {one.name: getattr(self.settings, one.name) for one in fields(CommonSettings)}
            estimate = smooth(scene, Settings(**own))
            seconds = process_time() - begin
            smoothed = pose_errors(estimate.wearers[0].motion, truth, SETTLED_S)
            return replace(trial, smoothed=smoothed, cpu_s=seconds, findings=sentences(estimate.findings))
        run = run_live(scene, live_settings(self.settings, lag_s=trial.lag_s))
        newest, late = (pose_errors(one, truth, SETTLED_S) for one in (run.newest, run.smoothed))
        return replace(trial, newest=newest, smoothed=late, lost=run.lost, cpu_s=run.cpu_s, findings=run.findings)

    def tables(self, rows: Sequence[StreamTrial]) -> Iterator[str]:
        """Errors by camera, beginning and lag."""
        yield (
            f"{len({(one.clip, one.seed) for one in rows})} recordings of {self.seconds:g} s, 13 sensors; errors from "
            f"{SETTLED_S:g} s on, each clip alike. newest: zero lag; smoothed: one lag later"
        )
        head = [f"{what} {unit}" for what in ("newest", "smoothed") for unit in ERRORS.values()]
        lines = []
        for names, own in group(rows, lambda one: (one.camera, one.begin, one.estimator)).items():
            both = [one.newest for one in own], [one.smoothed for one in own]
            errors = (mean(getattr(e, name) for e in those if e is not None) for those in both for name in ERRORS)
            lines.append([*names, *errors, sum(one.lost for one in own), mean(one.cpu_s for one in own)])
        yield table(["camera", "begin", "estimator", *head, "lost", "CPU s"], lines)
        failures = (f"{t.clip}, {t.camera}, {t.begin}, {t.estimator}: {t.failure}" for t in rows if t.failure)
        yield bullets("No estimate, and left out of the means:", failures)
