"""What faults of a live stream cost: errors before, during and after, and how long until all is good again."""

from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.studies.faults import Fault, chosen_faults
from tests.studies.scenes import HOLD_S, SETTLED_S, find_clips, posed_scene, slowed, straps_and_sensors
from tests.studies.stream_run import (
    ErrorOverTime,
    StreamRun,
    bad_seconds,
    error_over_time,
    run_stream,
    seconds_until_good,
)
from tests.studies.study import Study, Tell, cell, group, table
from vip_factors.cli.options import Flag
from vip_factors.errors import InputError
from vip_factors.io.motions import read_motion
from vip_factors.live.settings import LiveSettings, RecalibrationSettings
from vip_factors.sensors.live import live_samples, stream_head
from vip_factors.sensors.scene import Scene
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.scene_settings import CameraKind, SceneSettings
from vip_factors.simulate.staging import lasting

UNTIL_FAULT_S = 4.0  # before it, over which errors are compared
LASTING_S = 3.0  # after the beginning of what does not end: that counts as "during"
LEAST_AFTER_S = 3.0  # that are left after it
POSE_ERROR_DEG = 4.0  # of the held T-pose, as in the suite of single wearers


HEAD = (
    "fault", "newest: before", "during", "after", "smoothed: before", "during", "after", "newest good after s",
    "smoothed good after s", "bad s", "place at end cm", "frames missing", "oldest answer s",
)  # fmt: skip


@dataclass(frozen=True)
class Errors:
    """MPJPE in mm before, during and after a fault; NaN without an answer."""

    before: float
    during: float
    after: float


@dataclass(frozen=True)
class FaultTrial:
    """One fault in one stream.

    Attributes:
        fault, camera, clip: which.
        newest, smoothed: errors of the two answers.
        usual_newest, usual_smoothed: those of the undisturbed stream in the same times.
        place_cm: error of the wearer's place in the last two seconds, and the undisturbed stream's.
        missing: frames without an answer that the undisturbed stream answered.
        latency_s: age of the newest pose at most, during and after.
        good_newest_s, good_smoothed_s: until errors are as usual again, from the end of the fault (from its beginning,
            if it lasts); NaN if they are not to the end.
        bad_newest_s, bad_smoothed_s: seconds since the fault's beginning in which errors were not as usual.
        by_second: ``(newest, smoothed, usual newest, usual smoothed)`` of each second.
        clock_shift_s: by which the stream's clock is behind at the end.
        findings: what was said from the beginning of the fault on, that the undisturbed stream does not say then.
        failure: what was raised, if anything.
    """

    fault: str
    camera: str
    clip: str
    newest: Errors
    smoothed: Errors
    usual_newest: Errors
    usual_smoothed: Errors
    place_cm: tuple[float, float]
    missing: int
    latency_s: float
    good_newest_s: float
    good_smoothed_s: float
    bad_newest_s: float
    bad_smoothed_s: float
    by_second: tuple[tuple[float, float, float, float], ...]
    clock_shift_s: float = 0.0
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
            usual = _run((scene, self.settings, None))
            assert isinstance(usual, StreamRun)
            jobs = [(scene, self.settings, fault) for fault in faults]
            with ProcessPoolExecutor(self.processes) if self.processes > 1 else nullcontext() as pool:
                runs = map(_run, jobs) if pool is None else pool.map(_run, jobs)
                for done, (fault, run) in enumerate(zip(faults, runs, strict=True)):
                    tell(fault.name, (number + done / len(faults)) / len(work))
                    yield _scored(scene, camera, clip, fault, run, usual, self)

    def scene(self, camera: CameraKind, clip: str = "gestures", seed: int = 0) -> Scene:
        """One wearer of 13 sensors who holds a T-pose and then does what a clip shows."""
        if self.motions is None:
            motion = gestures(self.seconds - HOLD_S, 60.0)
        else:
            motion = read_motion(find_clips(self.motions, [clip])[clip])
            motion = lasting(slowed(motion), self.seconds - HOLD_S)
        settings = SceneSettings.realistic(camera=camera, imu=straps_and_sensors())
        return posed_scene(motion, f"{clip}, {camera}", settings, POSE_ERROR_DEG, seed)

    def tables(self, rows: Sequence[FaultTrial]) -> Iterator[str]:
        """A table for each stream, and what was said below it."""
        yield (
            f"MPJPE mm of one wearer's stream of {self.seconds:g} s; faults from {self.fault_s:g} s on; in brackets "
            "the same stream without the fault.\n'Good after': until the first second whose mean error is at most 1.2 "
            "times the undisturbed stream's, from the end of the fault, or from its beginning if it lasts. 'Bad': how "
            "many seconds of smoothed poses in all are not so, from the beginning of the fault on."
        )
        for (clip, camera), own in group(rows, lambda one: (one.clip, one.camera)).items():
            yield f"## {clip}, {camera} camera"
            yield table(HEAD, map(_line, own))
            yield "\n".join(line for one in own for line in _said(one))


def _run(job: tuple[Scene, LiveSettings, Fault | None]) -> StreamRun | str:
    scene, settings, fault = job
    try:
        return run_stream(live_samples(scene), stream_head(scene), settings, fault)
    except Exception as error:  # of a tracker that must never end so: told in the table
        if fault is None:
            raise
        return f"{type(error).__name__}: {error}"


def _scored(
    scene: Scene, camera: str, clip: str, fault: Fault, run: StreamRun | str, usual: StreamRun, trials: StreamFaults
) -> FaultTrial:
    failure, run = (run, StreamRun((), ())) if isinstance(run, str) else ("", run)
    newest, smoothed = errors_of(scene, run, trials)
    usual_newest, usual_smoothed = errors_of(scene, usual, trials)
    over = fault.begin + LASTING_S if fault.lasts else fault.end
    good_from = fault.begin if fault.lasts else fault.end
    spans = ((fault.begin - UNTIL_FAULT_S, fault.begin), (fault.begin, over), (over, trials.seconds))
    said = {(round(time), sentence) for time, sentence in usual.findings}
    seconds = int(trials.seconds)
    series = (newest, smoothed, usual_newest, usual_smoothed)
    last = (trials.seconds - 2, trials.seconds)
    errors = [Errors(*(one.mean(*span) for span in spans)) for one in series]
    by_second = []
    for second in range(seconds):
        ours, late, usual_ours, usual_late = (one.mean(second, second + 1) for one in series)
        by_second.append((ours, late, usual_ours, usual_late))
    return FaultTrial(
        fault=fault.name, camera=camera, clip=clip,
        newest=errors[0], smoothed=errors[1], usual_newest=errors[2], usual_smoothed=errors[3],
        place_cm=(smoothed.place(*last), usual_smoothed.place(*last)),
        missing=newest.missing(0, trials.seconds) - usual_newest.missing(0, trials.seconds),
        latency_s=run.latency(fault.begin, float("inf")),
        good_newest_s=seconds_until_good(newest, usual_newest, good_from),
        good_smoothed_s=seconds_until_good(smoothed, usual_smoothed, good_from),
        bad_newest_s=bad_seconds(newest, usual_newest, fault.begin),
        bad_smoothed_s=bad_seconds(smoothed, usual_smoothed, fault.begin),
        by_second=tuple(by_second),
        clock_shift_s=run.clock_shift_s,
        findings=tuple(
            (time, one) for time, one in run.findings if time >= fault.begin and (round(time), one) not in said
        ),
        failure=failure,
    )  # fmt: skip


def errors_of(scene: Scene, run: StreamRun, trials: StreamFaults) -> tuple[ErrorOverTime, ErrorOverTime]:
    """Of the newest and of the smoothed poses of the first wearer."""
    wearer, rate = scene.wearers[0], trials.settings.frame_rate
    assert wearer.truth is not None
    newest = [one.wearers[0].newest for one in run.answers]
    smoothed = [late for one in run.answers if (late := one.wearers[0].smoothed) is not None]
    told = [one.wearers[0].skeleton for one in run.answers[-1:]]
    body, truth = (told[0] if told else None) or wearer.subject.body(), wearer.truth.motion
    found = []
    for poses in (newest, smoothed):
        rows = error_over_time(poses, body, truth, rate, trials.fault_s)
        found.append(ErrorOverTime(rate, rows[:, 0], rows[:, 1]))
    return found[0], found[1]


def _line(one: FaultTrial) -> list[object]:
    if one.failure:
        return [one.fault, f"failed: {one.failure}", *[""] * (len(HEAD) - 2)]
    late = (cell(s) if np.isfinite(s) else "not to the end" for s in (one.good_newest_s, one.good_smoothed_s))
    pairs = [(one.newest, one.usual_newest), (one.smoothed, one.usual_smoothed)]
    errors = (
        text for ours, usual in pairs
        for text in (cell(ours.before), _both(ours.during, usual.during), _both(ours.after, usual.after))
    )  # fmt: skip
    return [one.fault, *errors, *late, one.bad_smoothed_s, _both(*one.place_cm), one.missing, f"{one.latency_s:.2f}"]


def _both(ours: float, usual: float) -> str:
    return f"{cell(ours)} ({cell(usual)})"


def _said(one: FaultTrial) -> Iterator[str]:
    shift = f" (the stream's clock is {one.clock_shift_s:.2f} s behind from then on)" if one.clock_shift_s else ""
    yield f"- {one.fault}{shift}: " + ("" if one.findings else "nothing was said")
    first = {sentence: time for time, sentence in reversed(one.findings)}
    for sentence, count in Counter(sentence for _, sentence in one.findings).items():
        yield f"  - {first[sentence]:.1f} s: {sentence}" + (f" ({count} times)" if count > 1 else "")
