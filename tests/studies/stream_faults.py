"""What faults of a live stream cost: errors before, during and after, and how long until all is good again."""

from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from tests.studies.scenes import BLEND_S, HOLD_S, PLACEMENT, POSE, find_clips, straps_and_sensors
from tests.studies.stream_error import ErrorOverTime, bad_seconds, error_over_time, seconds_until_good
from tests.studies.stream_fault import Fault
from tests.studies.stream_fault_list import chosen_faults
from tests.studies.stream_killed import Killed, kill_while_writing
from tests.studies.stream_run import StreamRun, run_stream
from vip_factors.errors import InputError
from vip_factors.io.motions.files import read_motion
from vip_factors.live.settings import LiveSettings
from vip_factors.sensors.live import LiveSetup, live_samples
from vip_factors.sensors.placement import preset
from vip_factors.sensors.scene import Scene
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.scene import Performer, simulate_scene
from vip_factors.simulate.scene_settings import CameraKind, SceneSettings
from vip_factors.simulate.settings import SimulateSettings
from vip_factors.simulate.staging import lasting
from vip_factors.simulate.stance import with_initial_pose

Tell = Callable[[str, float], None]
UNTIL_FAULT_S = 4.0  # before it, over which errors are compared
LASTING_S = 3.0  # after the beginning of what does not end: that counts as "during"
LEAST_AFTER_S = 3.0  # that are left after it
KILLS = (0.0, 0.13, 0.29, 0.41)  # seconds after the fault's time: anywhere between two flushes
KILLED = "killed"


@dataclass(frozen=True)
class StreamTrials:
    """Which streams are made, and what is done to them."""

    seconds: float = 24.0  # with the initial pose
    fault_s: float = 8.0  # 4 s after the initial pose: calibrations have settled by then
    cameras: tuple[CameraKind, ...] = ("fixed", "hand-held")
    faults: tuple[str, ...] = ()  # parts of names; all if empty
    pose_error_deg: float = 4.0  # of the held T-pose, as in the suite of single wearers
    sensors: SimulateSettings = field(default_factory=straps_and_sensors)
    settings: LiveSettings = field(default_factory=LiveSettings)
    processes: int = 1

    def __post_init__(self) -> None:
        if not self.fault_s >= HOLD_S + BLEND_S:
            raise InputError(f"a fault at {self.fault_s:g} s: expected {HOLD_S + BLEND_S:g} s or more")
        if not self.seconds >= self.fault_s + LASTING_S + LEAST_AFTER_S:
            raise InputError(
                f"streams of {self.seconds:g} s with faults at {self.fault_s:g} s: expected at least "
                f"{LASTING_S + LEAST_AFTER_S:g} s more"
            )


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


@dataclass(frozen=True)
class KilledTrial:
    """Programs killed while they write."""

    camera: str
    clip: str
    kills: tuple[Killed, ...]


@dataclass(frozen=True)
class StreamResults:
    """All there is."""

    trials: tuple[FaultTrial, ...]
    killed: tuple[KilledTrial, ...]


def stream_scene(trials: StreamTrials, camera: CameraKind, motions: Path | None, clip: str, seed: int = 0) -> Scene:
    """One wearer of 13 sensors who holds a T-pose and then does what a clip shows; the package's gestures without one.

    Raises:
        InputError: if there is no such clip.
    """
    if motions is None:
        motion = gestures(trials.seconds - HOLD_S, 60.0)
    else:
        motion = read_motion(find_clips(motions, [clip])[clip])
        motion = lasting(motion.frames(slice(None, None, max(1, round(motion.rate / 60)))), trials.seconds - HOLD_S)
    posed = with_initial_pose(motion, POSE, HOLD_S, BLEND_S, trials.pose_error_deg, seed)
    performer = Performer("wearer", posed, preset(PLACEMENT, motion.skeleton), POSE)
    settings = SceneSettings.realistic(camera=camera, imu=trials.sensors)
    return simulate_scene([performer], settings, seed, f"{clip}, {camera}")


def run_stream_faults(
    trials: StreamTrials, motions: Path | None = None, clips: Sequence[str] = (), tell: Tell | None = None
) -> StreamResults:
    """All faults in all streams.

    Args:
        trials: which.
        motions: folder of motions; None: the package's gestures.
        clips: names of files in it.
        tell: called with what is done and the fraction of it.

    Raises:
        InputError: for clips without a folder or the reverse, and for a fault that there is not.
    """
    if (motions is None) != (not clips):
        raise InputError("give both a folder of motions and the names of clips in it, or neither")
    work = [(camera, clip) for clip in clips or ("gestures",) for camera in trials.cameras]
    found: list[FaultTrial] = []
    killed: list[KilledTrial] = []
    for number, (camera, clip) in enumerate(work):
        own: Tell | None = None
        if tell is not None:
            own = partial(_part, tell, number, len(work))
        scene = stream_scene(trials, camera, motions, clip)
        faults = chosen_faults(scene, trials.fault_s, tuple(name for name in trials.faults if name != KILLED))
        if trials.faults == (KILLED,):
            faults = []
        usual = _run((scene, trials.settings, None))
        assert isinstance(usual, StreamRun)
        jobs = [(scene, trials.settings, fault) for fault in faults]
        if trials.processes > 1:
            with ProcessPoolExecutor(trials.processes) as pool:
                runs = list(pool.map(_run, jobs))
        else:
            runs = []
            for done, job in enumerate(jobs):
                if own is not None:
                    own("benchmark", (1 + done) / (1 + len(jobs)))
                runs.append(_run(job))
        found += [_scored(scene, camera, clip, fault, run, usual, trials)
                  for fault, run in zip(faults, runs, strict=True)]  # fmt: skip
        if not trials.faults or KILLED in trials.faults:
            killed.append(_killed(scene, camera, clip, usual, trials))
    return StreamResults(tuple(found), tuple(killed))


def _part(tell: Tell, number: int, count: int, stage: str, fraction: float) -> None:
    tell(stage, (number + fraction) / count)


def _run(job: tuple[Scene, LiveSettings, Fault | None]) -> StreamRun | str:
    scene, settings, fault = job
    try:
        return run_stream(live_samples(scene), LiveSetup.of(scene), settings, fault)
    except Exception as error:  # of a tracker that must never end so: told in the table
        if fault is None:
            raise
        return f"{type(error).__name__}: {error}"


def _scored(
    scene: Scene, camera: str, clip: str, fault: Fault, run: StreamRun | str, usual: StreamRun, trials: StreamTrials
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


def errors_of(scene: Scene, run: StreamRun, trials: StreamTrials) -> tuple[ErrorOverTime, ErrorOverTime]:
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


def _killed(scene: Scene, camera: str, clip: str, usual: StreamRun, trials: StreamTrials) -> KilledTrial:
    kills = []
    for late in KILLS:
        until = trials.fault_s + late
        one = kill_while_writing(usual.answers, LiveSetup.of(scene), trials.settings.frame_rate, until)
        if one is not None:
            kills.append(one)
    return KilledTrial(camera, clip, tuple(kills))
