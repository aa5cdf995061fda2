"""Any recordings, one row for each wearer: batch and live beside their truth, what is found fault with, and starts."""

import time as clock
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

from tests.studies.live_run import filled_motion
from tests.studies.study import Study, Tell, columns, table
from vip_factors.body.kinematics import Motion
from vip_factors.cli.options import Flag
from vip_factors.errors import InputError
from vip_factors.evaluate.evaluation import evaluate_motion
from vip_factors.evaluate.metrics import common_frames
from vip_factors.findings import sentences
from vip_factors.geometry.rotations import Array, angle_between, rotation_z, transpose, wrap_angle, yaw_of
from vip_factors.initialise.calibration import InitialCalibration
from vip_factors.io.mcap_recording import read_scene
from vip_factors.live.settings import LiveSettings
from vip_factors.live.tracker import FixedLagTracker
from vip_factors.live_estimate import LiveEstimate
from vip_factors.pipeline import smooth
from vip_factors.sensors.frames import ImuFrames, resample
from vip_factors.sensors.live import live_samples, stream_head
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene
from vip_factors.settings import Settings
from vip_factors.stages.calibration_start import search_start
from vip_factors.stages.inertial import first_calibration
from vip_factors.stages.sensor_checks import checked

METRICS = ("mpjpe", "mpjae", "knee_flexion_rmse")
NOTHING = (np.nan, np.nan, np.nan)
DEFAULT = LiveSettings()
WRONG_DEG = 60.0  # a bone turned by more starts in another valley than the truth's


@dataclass(frozen=True)
class RecordingTrial:
    """One wearer of a recording.

    Attributes:
        recording, wearer: their names.
        seconds: of it.
        batch, live, late: MPJPE (mm), MPJAE (°) and RMSE of knee flexion (°) of ``smooth``, of the smoothed poses of
            ``stream``, and of these in the second half; NaN without truth.
        batch_cpu_s, live_cpu_s: of the whole recording, this process alone.
        batch_findings, live_findings: sentences, each as often as it was told.
        who_is_who: precision and recall of the wearer's detections before the first camera, in percent, of ``smooth``;
            NaN where the recording does not say whom they show.
    """

    recording: str
    wearer: str
    seconds: float
    batch: tuple[float, ...]
    live: tuple[float, ...]
    late: tuple[float, ...]
    batch_cpu_s: float
    live_cpu_s: float
    batch_findings: tuple[str, ...]
    live_findings: tuple[str, ...]
    who_is_who: tuple[float, float] = (np.nan, np.nan)


@dataclass(frozen=True, kw_only=True)
class Recordings(Study):
    """Recordings of your own, smoothed and streamed, one row for each wearer: errors where they have a truth."""

    recordings: tyro.conf.Positional[tuple[Path, ...]] = ()
    """Recordings or scenes (.mcap)."""
    live: Flag = True
    """Stream them too."""

    def rows(self, tell: Tell) -> Iterator[RecordingTrial]:
        if not self.recordings:
            raise InputError("no recording to measure: expected one .mcap file or more")
        for done, path in enumerate(self.recordings):
            tell(path.name, done / len(self.recordings))
            yield from recording_trials(path.name, read_scene(path), self.live)

    def tables(self, rows: Sequence[RecordingTrial]) -> Iterator[str]:
        yield recordings_table(rows)


def recordings_table(rows: Sequence[RecordingTrial]) -> str:
    """A line for each wearer."""
    return columns(rows, {
        "recording": lambda one: one.recording, "wearer": lambda one: one.wearer, "s": lambda one: f"{one.seconds:.0f}",
        "batch mm / °": lambda one: one.batch[:2], "knee °": lambda one: one.batch[2],
        "who is who: precision / recall %": lambda one: one.who_is_who, "live": lambda one: one.live[:2],
        "live, second half": lambda one: one.late[:2],
        "findings: batch, live": lambda one: f"{len(one.batch_findings)}, {len(one.live_findings)}",
    })  # fmt: skip


def recording_trials(name: str, scene: Scene, with_live: bool) -> Iterator[RecordingTrial]:
    """All wearers of a scene, smoothed and, if wanted, streamed."""
    begin = clock.process_time()
    estimate = smooth(scene)
    batch_s, begin = clock.process_time() - begin, clock.process_time()
    answers = streamed(scene) if with_live else []
    live_s = clock.process_time() - begin
    said = tuple(sentence for answer in answers for sentence in answer.findings)
    for wearer, (recording, own) in enumerate(zip(scene.wearers, estimate.wearers, strict=True)):
        truth = None if recording.truth is None else recording.truth.motion
        start, end = recording.interval
        motion = smoothed_motion(answers, wearer, scene)
        live, late = (_errors(motion, truth, since) for since in (start, (start + end) / 2))
        yield RecordingTrial(
            name, recording.subject.name, end - start, _errors(own.motion, truth, start), live, late, batch_s, live_s,
            sentences(dict.fromkeys((*estimate.findings, *own.findings))), said,
            who_is_who(scene, estimate.wearer_of_detection, wearer),
        )  # fmt: skip


def who_is_who(scene: Scene, given: np.ndarray, wearer: int) -> tuple[float, float]:
    """Precision and recall of one wearer's detections in percent; NaN without truth, or where there is none."""
    if scene.truth is None or len(given) != len(scene.truth.wearer):
        return np.nan, np.nan
    right = np.sum((given == wearer) & (scene.truth.wearer == wearer))
    counts = [np.sum(one == wearer) for one in (given, scene.truth.wearer)]
    precision, recall = (float(100 * right / count) if count else np.nan for count in counts)
    return precision, recall


def streamed(scene: Scene, settings: LiveSettings = DEFAULT) -> list[LiveEstimate]:
    """What the tracker answers to a scene, as fast as it goes."""
    tracker = FixedLagTracker(stream_head(scene), settings)
    return [*(answer for sample in live_samples(scene) for answer in tracker.push(sample)), *tracker.finish()]


def smoothed_motion(answers: Sequence[LiveEstimate], wearer: int, scene: Scene) -> Motion | None:
    """The smoothed poses, on the body that was believed at the end."""
    poses = [pose for answer in answers if (pose := answer.wearers[wearer].smoothed) is not None]
    if not poses:
        return None
    body = answers[-1].wearers[wearer].skeleton or scene.wearers[wearer].subject.body()
    return filled_motion(poses, body, DEFAULT.frame_rate, scene.wearers[wearer].subject.name)


def _errors(motion: Motion | None, truth: Motion | None, since: float) -> tuple[float, ...]:
    if motion is None or truth is None:
        return NOTHING
    ours, true, _ = common_frames(motion, truth)
    later = slice(int(np.searchsorted(ours.time, since)), len(ours))
    metrics = evaluate_motion(ours.frames(later), true.frames(later)).metrics
    return tuple(metrics[name].value if name in metrics else np.nan for name in METRICS)


@dataclass(frozen=True)
class StartTrial:
    """The start of one wearer.

    Attributes:
        recording, wearer: their names.
        initial_pose: declared, or "none".
        off_deg: by sensor, the median over frames of how far the start turns its bone against the truth; all of them
            may face another way together.
        flagged: names of the sensors that the start itself calls in question.
        cpu_s: of the search.
    """

    recording: str
    wearer: str
    initial_pose: str
    off_deg: dict[str, float]
    flagged: tuple[str, ...]
    cpu_s: float

    @property
    def counts(self) -> tuple[int, int, int, int]:
        """Sensors, those that start wrong, of these flagged, and those that are right but flagged."""
        wrong, flagged = {name for name, off in self.off_deg.items() if off > WRONG_DEG}, set(self.flagged)
        return len(self.off_deg), len(wrong), len(wrong & flagged), len(flagged - wrong)


@dataclass(frozen=True, kw_only=True)
class Starts(Study):
    """First headings and mountings of recordings with a truth: sensors that start wrong, one row for each wearer."""

    recordings: tyro.conf.Positional[tuple[Path, ...]] = ()
    """Recordings or scenes (.mcap)."""

    def rows(self, tell: Tell) -> Iterator[StartTrial]:
        found = 0
        for done, path in enumerate(self.recordings):
            tell(path.name, done / len(self.recordings))
            for wearer in read_scene(path).wearers:
                if wearer.truth is not None:
                    found += 1
                    yield _start_trial(path.name, wearer, Settings())
        if not found:
            raise InputError("no start to judge: expected .mcap files of recordings with a truth")

    def tables(self, rows: Sequence[StartTrial]) -> Iterator[str]:
        head = ["recording", "wearer", "pose", "sensors", f"start > {WRONG_DEG:.0f}° wrong", "of these flagged",
                "right but flagged", "CPU s"]  # fmt: skip
        lines = [[one.recording, one.wearer, one.initial_pose, *one.counts, one.cpu_s] for one in rows]
        sums = np.sum([one.counts for one in rows], axis=0)
        yield table(head, [*lines, ["all", "", "", *sums, sum(one.cpu_s for one in rows)]])


def _start_trial(name: str, recording: Recording, settings: Settings) -> StartTrial:
    recording, _ = checked(recording, settings)
    begin = clock.process_time()
    frames = resample(recording, settings.frame_rate)
    usual = first_calibration(recording, frames, settings)
    starts = search_start(recording, frames, usual, settings)
    cpu_s = clock.process_time() - begin
    best, flagged = (starts.best.calibration, (*starts.doubtful, *starts.tilted)) if starts else (usual, ())
    off = dict(zip(frames.sensors, np.rad2deg(bones_off(recording, frames, best)).tolist(), strict=True))
    questioned = tuple(frames.sensors[s] for s in sorted(set(flagged)))
    return StartTrial(name, recording.subject.name, recording.initial_pose, off, questioned, cpu_s)


def bones_off(recording: Recording, frames: ImuFrames, start: InitialCalibration) -> Array:
    """``(S,)`` radians, the median over frames of how far a start turns each sensor's bone against the truth.

    The world's heading is the one about which most sensors agree.
    """
    assert recording.truth is not None
    true = recording.truth.motion
    bones = [recording.placement.site(name).bone_index for name in frames.sensors]
    at = np.clip(np.searchsorted(true.time, frames.time), 0, len(true) - 1)
    R_true = true.state.R_world_bone[at][:, bones]
    R_found = rotation_z(start.headings) @ frames.R_inertial_sensor @ transpose(start.R_bone_sensor)
    seen = frames.orientation_valid & ((frames.time >= true.time[0]) & (frames.time <= true.time[-1]))[:, None]
    yaw = np.angle(np.sum(np.exp(1j * yaw_of(R_found @ transpose(R_true))) * seen, axis=0))
    common = yaw[np.abs(wrap_angle(yaw[:, None] - yaw)).sum(axis=1).argmin()]
    off = angle_between(rotation_z(common) @ R_true, R_found)
    return np.nanmedian(np.where(seen, off, np.nan), axis=0)
