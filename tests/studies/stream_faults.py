"""What faults of a live stream cost: errors before, during and after, and how long until all is good again."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tests.studies.faults import Fault, chosen_faults
from tests.studies.live_run import error_over_time
from tests.studies.scenes import HOLD_S, SETTLED_S, find_clips, posed_scene, slowed, straps_and_sensors
from tests.studies.study import NAN, Study, Tell, cell, group, mean, table
from vip_factors.cli.options import Flag
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array
from vip_factors.io.motions.files import read_motion
from vip_factors.live.tracker import FixedLagTracker
from vip_factors.live_estimate import LivePose
from vip_factors.sensors.live import LiveSample, live_samples, stream_head
from vip_factors.sensors.scene import Scene
from vip_factors.settings import LiveSettings, RecalibrationSettings
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.settings import CameraKind, SceneSettings
from vip_factors.simulate.staging import lasting

UNTIL_FAULT_S = 4.0  # before it, over which errors are compared
LASTING_S = 3.0  # after the beginning of what does not end: that counts as "during"
LEAST_AFTER_S = 3.0  # that are left after it
GOOD = 1.2  # times the error of the undisturbed stream
POSE_ERROR_DEG = 4.0  # of the held T-pose, as in the suite of single wearers
HEAD = ("fault", "before", "during", "after", "good again after s", "frames missing")


@dataclass(frozen=True)
class StreamRun:
    """The newest poses of a stream, in order, on the scene's clock; and its sentences, with when they were said."""

    poses: tuple[LivePose, ...] = ()
    findings: tuple[tuple[float, str], ...] = ()


@dataclass(frozen=True)
class FaultTrial:
    """One fault in one stream.

    Attributes:
        fault, camera, clip: which.
        errors: MPJPE mm of the newest pose before, during and after the fault; NaN without an answer.
        usual: the undisturbed stream's in the same times.
        good_s: until errors are as usual again, from the end of the fault (from its beginning, if it lasts); NaN if
            they are not to the end.
        missing: frames without an answer that the undisturbed stream answered.
        findings: what was said from the beginning of the fault on, that the undisturbed stream does not say then.
        failure: what was raised, if anything.
    """

    fault: str
    camera: str
    clip: str
    errors: tuple[float, ...]
    usual: tuple[float, ...]
    good_s: float
    missing: int
    findings: tuple[tuple[float, str], ...] = ()
    failure: str = ""


@dataclass(frozen=True, kw_only=True)
class StreamFaults(Study):
    """Live streams with samples lost, late or wrong: what it costs, and how soon all is good again."""

    motions: Path | None = None
    """Folder of motions, searched with all folders below it; the package's own gestures if absent."""
    clips: tuple[str, ...] = ()
    """Names of the motions' files, such as 07_02; with --motions only."""
    seconds: float = 24.0
    """Of each stream, which begins with a T-pose of 2 s; clips are repeated."""
    fault_s: float = 8.0
    """When the faults begin, in seconds: by then calibrations have settled."""
    cameras: tuple[CameraKind, ...] = ("fixed", "hand-held")
    """What films."""
    faults: tuple[str, ...] = ()
    """Parts of names of faults, such as 'lost', 'shank' or 'clock'; all if absent."""
    processes: int = 1
    """Streams worked on side by side."""
    frame_rate: float = 60.0
    """Frames per second."""
    recalibration: Flag = True
    """Find calibrations anew in between, which takes most of the time."""

    def __post_init__(self) -> None:
        if not self.fault_s >= SETTLED_S:
            raise InputError(f"a fault at {self.fault_s:g} s: expected {SETTLED_S:g} s or more")
        if not self.seconds >= self.fault_s + LASTING_S + LEAST_AFTER_S:
            raise InputError(
                f"streams of {self.seconds:g} s with faults at {self.fault_s:g} s: expected at least "
                f"{LASTING_S + LEAST_AFTER_S:g} s more"
            )
        if (self.motions is None) != (not self.clips):
            raise InputError("give both a folder of motions and the names of clips in it, or neither")

    @property
    def settings(self) -> LiveSettings:
        return LiveSettings(frame_rate=self.frame_rate, recalibration=RecalibrationSettings(use=self.recalibration))

    def rows(self, tell: Tell) -> Iterator[FaultTrial]:
        work = [(camera, clip) for clip in self.clips or ("gestures",) for camera in self.cameras]
        for number, (camera, clip) in enumerate(work):
            tell(f"{clip}, {camera}", number / len(work))
            scene = self.scene(camera, clip)
            faults = chosen_faults(scene, self.fault_s, self.faults)
            usual = run_stream(live_samples(scene), stream_head(scene), self.settings)
            jobs = [(scene, self.settings, fault) for fault in faults]
            with ProcessPoolExecutor(self.processes) if self.processes > 1 else nullcontext() as pool:
                runs = map(_run, jobs) if pool is None else pool.map(_run, jobs)
                for done, (fault, run) in enumerate(zip(faults, runs, strict=True)):
                    tell(fault.name, (number + done / len(faults)) / len(work))
                    yield self._scored(scene, camera, clip, fault, run, usual)

    def scene(self, camera: CameraKind, clip: str = "gestures", seed: int = 0) -> Scene:
        """One wearer of 13 sensors who holds a T-pose and then does what a clip shows."""
        if self.motions is None:
            motion = gestures(self.seconds - HOLD_S, 60.0)
        else:
            motion = lasting(slowed(read_motion(find_clips(self.motions, [clip])[clip])), self.seconds - HOLD_S)
        settings = SceneSettings(camera=camera, imu=straps_and_sensors())
        return posed_scene(motion, f"{clip}, {camera}", settings, POSE_ERROR_DEG, seed)

    def _scored(
        self, scene: Scene, camera: str, clip: str, fault: Fault, run: StreamRun | str, usual: StreamRun
    ) -> FaultTrial:
        failure, run = (run, StreamRun()) if isinstance(run, str) else ("", run)
        wearer = scene.wearers[0]
        assert wearer.truth is not None
        body, truth = wearer.subject.body(), wearer.truth.motion
        error, undisturbed = (error_over_time(one.poses, body, truth, self.frame_rate) for one in (run, usual))
        over = fault.begin + LASTING_S if fault.lasts else fault.end
        spans = ((fault.begin - UNTIL_FAULT_S, fault.begin), (fault.begin, over), (over, self.seconds))
        rows = [slice(max(0, round(start * self.frame_rate)), round(end * self.frame_rate)) for start, end in spans]
        errors, usual_errors = (tuple(mean(one[span]) for span in rows) for one in (error, undisturbed))
        good = seconds_until_good(error, undisturbed, self.frame_rate, fault.begin if fault.lasts else fault.end)
        missing = int(np.isnan(error).sum() - np.isnan(undisturbed).sum())
        said = {(round(time), sentence) for time, sentence in usual.findings}
        new = ((time, one) for time, one in run.findings if time >= fault.begin and (round(time), one) not in said)
        return FaultTrial(fault.name, camera, clip, errors, usual_errors, good, missing, tuple(new), failure)

    def tables(self, rows: Sequence[FaultTrial]) -> Iterator[str]:
        """A table for each stream, and what was said below it."""
        yield (
            f"MPJPE mm of the newest poses of one wearer's stream of {self.seconds:g} s; faults from {self.fault_s:g} "
            "s on; in brackets the same stream without the fault. 'Good again': until the first second whose mean "
            f"error is at most {GOOD:g} times the undisturbed stream's, from the end of the fault, or from its "
            "beginning if it lasts."
        )
        for (clip, camera), own in group(rows, lambda one: (one.clip, one.camera)).items():
            yield f"## {clip}, {camera} camera"
            yield table(HEAD, map(_line, own))
            yield "\n".join(line for one in own for line in _said(one))


def _run(job: tuple[Scene, LiveSettings, Fault]) -> StreamRun | str:
    scene, settings, fault = job
    try:
        return run_stream(live_samples(scene), stream_head(scene), settings, fault)
    except Exception as error:  # of a tracker that must never end so: told in the table
        return f"{type(error).__name__}: {error}"


def run_stream(
    samples: Iterable[LiveSample], setup: Scene, settings: LiveSettings, fault: Fault | None = None
) -> StreamRun:
    """Track a stream, with a fault if there is one."""
    now = 0.0  # the newest undisturbed sample's time, when what a fault makes of it comes

    def sent() -> Iterator[LiveSample]:
        nonlocal now
        for sample in samples:
            now = max(now, sample.time)
            yield sample

    tracker, answered = FixedLagTracker(setup, settings), []
    for sample in sent() if fault is None else fault.change(sent()):
        answered += [(now, answer) for answer in tracker.push(sample)]
    answered += [(now, answer) for answer in tracker.finish()]
    poses = [one.wearers[0].newest for _, one in answered]
    if fault is not None and fault.jump:
        # After a leap of all clocks a stream cannot know how long it took: poses are moved to when they were given.
        arrival = np.array([time for time, _ in answered])
        age, before, after = arrival - [pose.time for pose in poses], arrival < fault.begin, arrival > fault.begin + 2
        shift = float(np.median(age[after]) - np.median(age[before])) if after.any() and before.any() else 0.0
        poses = [
            replace(one, time=one.time + shift) if time >= fault.begin else one
            for one, time in zip(poses, arrival, strict=True)
        ]
    findings = sorted((time, str(finding)) for time, one in answered for finding in one.findings)
    return StreamRun(tuple(poses), tuple(findings))


def seconds_until_good(error: Array, undisturbed: Array, rate: float, start: float) -> float:
    """Seconds from ``start`` until a second begins whose mean error is at most 1.2 times the undisturbed stream's in
    the same second; NaN if none does. A frame without an answer is not good."""
    length, begin = round(rate), max(0, round(start * rate))
    for row in range(begin, min(len(error), len(undisturbed)) - length + 1):
        ours, theirs = error[row : row + length], undisturbed[row : row + length]
        seen = np.isfinite(theirs)
        if seen.any() and np.all(np.isfinite(ours[seen])) and ours[seen].mean() <= GOOD * theirs[seen].mean():
            return (row - begin) / rate
    return NAN


def _line(one: FaultTrial) -> list[object]:
    if one.failure:
        return [one.fault, f"failed: {one.failure}", *[""] * (len(HEAD) - 2)]
    during, after = (f"{cell(ours)} ({cell(usual)})" for ours, usual in zip(one.errors[1:], one.usual[1:], strict=True))
    good = cell(one.good_s) if np.isfinite(one.good_s) else "not to the end"
    return [one.fault, one.errors[0], during, after, good, one.missing]


def _said(one: FaultTrial) -> Iterator[str]:
    yield f"- {one.fault}: " + ("" if one.findings else "nothing was said")
    first = {sentence: time for time, sentence in reversed(one.findings)}
    for sentence, count in Counter(sentence for _, sentence in one.findings).items():
        yield f"  - {first[sentence]:.1f} s: {sentence}" + (f" ({count} times)" if count > 1 else "")
