"""A stream's calibration found anew: when, from what data, how, in which process, and the answer.

A start of a second shows neither where every sensor points nor how long a limb is. The batch stages find headings,
mountings, the body, the axes of its hinges, the sensors' places, the detector's offsets and a standing camera out of
everything since the start, and tracking goes on from there.

The process is a program of its own behind two pipes, and no ``multiprocessing``: that would run a user's script or
notebook again to start with, and a script that tracks at its top level would never end.
"""

import contextlib
import os
import pickle
import subprocess
import sys
import threading
import time
import weakref
from collections import deque
from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from vip_factors.assembly.objective import SceneObjective
from vip_factors.display import silent
from vip_factors.errors import SolveError, VipFactorsError
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array
from vip_factors.initialise.sensor_assignment import LEAST_NATS
from vip_factors.live.measurement import LiveFrame, MeasuredStretch
from vip_factors.live.problem import FrameState
from vip_factors.live.start import EarlierCalibration, TrackingStart, solve_stretch, tracking_start, unsettled_starts
from vip_factors.problem.layout import Layout
from vip_factors.problem.state import WearerState
from vip_factors.problem.wearer import WearerProblem
from vip_factors.sensors.live import VideoFrame
from vip_factors.sensors.scene import Scene
from vip_factors.settings import LiveSettings, Settings
from vip_factors.stages.acceleration_sign import is_sign_opposite
from vip_factors.stages.fusion import FusionSolution
from vip_factors.stages.scene_solution import SceneSolution
from vip_factors.stages.sensor_assignment import exchange_finding, exchanges_of
from vip_factors.stages.solver import Solver

FRAMES = 30  # that tracking goes on from
SETTLING_S = 9.0  # of data in which sensors in each other's places are looked for, and rivals of starts solved
NO_PRIOR = np.pi  # radians, of headings and mountings: what is known of them, the information says


def recalibrate(
    stretch: MeasuredStretch, settings: LiveSettings, earlier: EarlierCalibration | None = None,
    before: TrackingStart | None = None,
) -> TrackingStart:  # fmt: skip
    """The last frames of a stretch, with all that the whole of it teaches of what frames share.

    Args:
        stretch: all that is to be learnt from.
        settings: of all.
        earlier: from before a pause.
        before: what was found last, of sensors as they still sit; its frames are not asked for.

    Raises:
        RecordingError: if the sensors say too little.
        SolveError: if the problem is not determined.
    """
    # Spread over the data: of 40 s every 0.27 s. Neighbours carry nearly the same information.
    most_frames = 150
    thinning = np.ceil(len(stretch.time) / settings.coarse_factor / most_frames)
    inflation = 2.0  # of standard deviations: on foreign scenes mountings are off by 1.4 sigma
    batch = replace(
        settings,
        calibration=settings.recalibration.calibration,
        calibration_rate=settings.calibration_rate / thinning,
        solve=replace(settings.solve, relative_decrease=settings.fusion.relative_decrease),
    )
    with threadpool_limits(limits=1, user_api="blas"):
        coarse, end = solve_stretch(stretch, batch, earlier, before), stretch.tail(FRAMES)
        fine = coarse.problem_on(end.frames_of(coarse), batch)
        wearers = tuple(_freed(*each, settings) for each in zip(fine.model.wearers, fine.state.wearers, strict=True))
        fine = replace(fine, model=replace(fine.model, wearers=wearers))
        found = tracking_start(end, coarse, fine, settings)
        information = information_of(coarse.fused, found.problem.layout, inflation)
        exchanges, in_place = list[Finding](), before is not None and before.in_place
        if stretch.seconds >= SETTLING_S:
            coarse = coarse.with_rivals_solved(batch, Solver(batch.solve, silent))
            exchanges, in_place = ([], True) if in_place else _exchanges(coarse, settings)
            exchanges += [
                Finding("acceleration mirrored", one.subject.name)
                for one in coarse.scene.wearers
                if is_sign_opposite(one, batch)
            ]
        findings = (*unsettled_starts(coarse), *exchanges)
        return replace(found, information=information, seconds=stretch.seconds, findings=findings, in_place=in_place)


def _exchanges(coarse: SceneSolution, settings: LiveSettings) -> tuple[list[Finding], bool]:
    """About sensors in each other's places; and whether each exchange is as unlikely as those told are likely."""
    own = Settings(calibration=settings.calibration)
    found = [(one, exchange) for one in coarse.scene.wearers for exchange in exchanges_of(one, own, -LEAST_NATS)]
    told = [
        exchange_finding(recording, exchange, False, "exchange them in the placement")
        for recording, exchange in found
        if exchange.nats >= LEAST_NATS
    ]
    return told, not found


def information_of(solution: FusionSolution, layout: Layout, inflation: float) -> Array:
    """What a solved scene knows of the static variables of a layout: information ``(s, s)`` about its solution.

    Standard deviations are taken ``inflation`` times as large.

    Raises:
        SolveError: if the scene does not determine them.
    """
    objective = SceneObjective(solution.model)
    covariance = objective.linearise(solution.state).static_covariance()
    own, theirs = list[int](), list[int]()
    for owner, block, columns in layout.placed:
        found = objective.layout.columns(owner, block.name)
        if block.free and len(found) == block.width:
            own += range(columns.start, columns.stop)
            theirs += found.tolist()
    information = np.zeros((layout.static_width, layout.static_width))
    information[np.ix_(own, own)] = np.linalg.inv(covariance[np.ix_(theirs, theirs)]) / inflation**2
    return information


def _freed(model: WearerProblem, state: WearerState, settings: LiveSettings) -> WearerProblem:
    """A wearer's problem with calibration free, about what was found and without any other prior."""
    S = len(model.sensors)
    return replace(
        model,
        free_headings=settings.calibration.estimate_headings,
        free_mountings=settings.calibration.estimate_mountings,
        prior_headings=state.headings,
        heading_sigma=np.full(S, NO_PRIOR),
        prior_R_bone_sensor=state.R_bone_sensor,
        mounting_sigma=np.full(S, NO_PRIOR),
        p_world_start=state.p_world_pelvis[0],
    )


class RecalibrationProcess:
    """Begun when it is made; ended by :meth:`close`, or with the program."""

    def __init__(self) -> None:
        polite = 10  # of niceness: the tracker's updates come first where both want a core
        self._process = subprocess.Popen(
            [sys.executable, "-m", __name__],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
            # Ctrl-C is for the program that tracks. A group, not a session, of its own: Linux shares processors out to
            # sessions first (autogroups, sched(7)), and between these niceness says nothing.
            process_group=0,
        )
        if hasattr(os, "setpriority"):  # from without: its imports alone take a second
            os.setpriority(os.PRIO_PROCESS, self._process.pid, polite)
        self._end = weakref.finalize(self, _ended, self._process)

    def submit(
        self, stretch: MeasuredStretch, settings: LiveSettings, earlier: EarlierCalibration | None = None,
        before: TrackingStart | None = None,
    ) -> "Future[TrackingStart]":  # fmt: skip
        """Have a stretch solved; one at a time. The answer raises :class:`SolveError` where there is none."""
        answer: Future[TrackingStart] = Future()
        frames = stretch.frames
        # Packed here: the tracker goes on using these objects, and what they cache would change under the thread.
        known = pickle.dumps((stretch.head, len(frames), (settings, earlier, before)), pickle.HIGHEST_PROTOCOL)
        threading.Thread(target=_exchange, args=(self._process, known, frames, answer), daemon=True).start()
        return answer

    def close(self) -> None:
        """End it, whatever it does."""
        self._end()


def _exchange(
    process: "subprocess.Popen[bytes]", known: bytes, frames: Sequence[LiveFrame],
    answer: "Future[TrackingStart]",
) -> None:  # fmt: skip
    """Hand work over, piece by piece, and wait for what comes back; the answer is set whatever happens."""
    piece = 60  # frames that are handed over at once, in half a millisecond: meanwhile nothing is tracked
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        process.stdin.write(known)
        for first in range(0, len(frames), piece):
            pickle.dump(frames[first : first + piece], process.stdin, pickle.HIGHEST_PROTOCOL)
        process.stdin.flush()
        result = pickle.load(process.stdout)
    except (OSError, ValueError, EOFError, pickle.UnpicklingError):
        result = "the process that should find it has ended"
    except Exception as error:  # nobody sees what a thread raises, and the tracker waits for an answer
        result = f"{type(error).__name__}: {error}"
    if isinstance(result, TrackingStart):
        answer.set_result(result)
    else:
        answer.set_exception(SolveError(str(result)))


def _ended(process: "subprocess.Popen[bytes]") -> None:
    process.kill()
    process.wait()
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            with contextlib.suppress(OSError):  # what was still to be written is lost with the process
                pipe.close()


def _end_with(parent: int) -> None:
    """End when the program that tracks is gone: what it was killed in the midst of takes half a minute more."""
    look_s = 1.0  # seconds between looks whether the program that tracks is still there
    while os.getppid() == parent:
        time.sleep(look_s)
    os._exit(1)


def main() -> None:
    """Solve what comes through standard input until it ends."""
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what a library prints is no answer
    while True:
        try:
            head, count, known = pickle.load(sys.stdin.buffer)
            frames = list[LiveFrame]()
            while len(frames) < count:
                frames += pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        found: TrackingStart | str
        try:
            found = recalibrate(MeasuredStretch(head, frames), *known)
        except VipFactorsError as error:
            found = str(error)
        except Exception as error:  # the stream goes on with what it has, and says so
            found = f"{type(error).__name__}: {error}"
        try:
            pickle.dump(found, answers, pickle.HIGHEST_PROTOCOL)
            answers.flush()
        except BrokenPipeError:  # the program that tracks was killed meanwhile
            os._exit(1)  # without another attempt to write what is in the buffer


if __name__ == "__main__":
    main()


@dataclass(frozen=True)
class _Job:
    stretch: MeasuredStretch
    newest: FrameState  # as it was tracked
    answer: "Future[TrackingStart]"


class Recalibrator:
    """Collects what is measured, and has it solved when there is twice as much, and ever again.

    Args:
        head: of the stream.
        settings: of all.
        real_time: whether the stream goes on by itself: then an answer is taken when it is there, and else waited for.

    Attributes:
        waited_s: seconds spent waiting, in all.
    """

    SETTLED_S = 2.0  # of data: poses by a calibration from less are marked as preliminary
    # By which a quarter of the sensors must have turned before: a held pose does not show which way sensors point.
    MOVING_DEG = 20.0
    STILL_S = 5.0  # of data: after so much it is found anyway, however still somebody sits
    GROWTH = 2.0  # each time with so many times as much data: what is left to learn halves with it
    DELAY_SHARE = 0.5  # of the data's length, where that is less than the delay

    def __init__(self, head: Scene, settings: LiveSettings, real_time: bool) -> None:
        self._head, self._settings, self._real_time = head, settings, real_time
        own = settings.recalibration
        self._measurements: deque[LiveFrame] = deque(maxlen=round(own.longest_s * settings.frame_rate))
        self._due_s, self._over = own.first_s, not own.use
        self._began = 0  # number of the first frame, of the stream or after a pause
        self._since = 0  # number of the frame from which on nothing has changed
        ends = np.cumsum([len(wearer.placement.sites) for wearer in head.wearers])
        self._columns = np.split(np.arange(ends[-1]), ends[:-1])  # of each wearer's sensors
        self._still, self._moving_from = set(range(len(ends))), 0  # wearers, and the frame from which on none are
        self._filmed: dict[str, int] = {}  # by camera, the coarse frame of its last video frame that is kept
        self._usable_from: dict[int, int] = {}  # by column of sensors that have moved: the frame after
        self.waited_s = 0.0
        self._process: RecalibrationProcess | None = None
        self._job: _Job | None = None
        self._earlier: EarlierCalibration | None = None
        self._before: TrackingStart | None = None  # the last one found, of sensors that sit as they did
        self._is_stale = False  # whether the job is about what was before a pause
        self._moved: set[int] = set()  # since its data
        self._is_urgent = False  # whether a sensor has moved and nothing was found anew since

    def remember(self, measured: LiveFrame) -> None:
        """One frame more."""
        moving_s = 0.2  # of motion, before anything is found from it
        if self._over:
            return
        if not self._measurements:
            self._since = self._began = measured.number
            self._still = set(range(len(self._columns)))
        if measured.video:
            measured = replace(measured, video=tuple(filter(self._is_needed, measured.video)))
        self._measurements.append(measured)
        if self._still:
            first = self._measurements[0]
            self._still -= {one for one in self._still if self._has_turned(self._columns[one], first, measured)}
            self._moving_from = measured.number + round(moving_s * self._settings.frame_rate)

    def _is_needed(self, video: VideoFrame) -> bool:
        """Whether it is the first of its camera's since a coarse frame: more of them tell that one hardly more."""
        camera, coarse = video.camera, video.frame // self._settings.coarse_factor
        is_first = coarse > self._filmed.get(camera, -1)
        self._filmed[camera] = max(coarse, self._filmed.get(camera, -1))
        return is_first

    def _has_turned(self, columns: np.ndarray, first: LiveFrame, now: LiveFrame) -> bool:
        """Whether a quarter of the sensors has."""
        moving_share = 0.25  # of a wearer's sensors: both arms
        both = columns[first.orientation_valid[columns] & now.orientation_valid[columns]]
        if not len(both):
            return False
        cosine = (np.einsum("sij,sij->s", first.R_inertial_sensor[both], now.R_inertial_sensor[both]) - 1) / 2
        turned = cosine < np.cos(np.deg2rad(self.MOVING_DEG))
        return bool(turned.mean() >= moving_share)

    def restart(self, earlier: EarlierCalibration | None) -> None:
        """The stream has paused: of before it nothing counts but what ``earlier`` has of it."""
        self._earlier, self._before = earlier, None
        self._measurements.clear()
        self._usable_from.clear()
        self._due_s, self._is_stale, self._is_urgent = self._settings.recalibration.first_s, True, False

    def leave_out(self, columns: Sequence[int], number: int) -> None:
        """What these sensors measured up to a frame does not count any more: they have moved."""
        own = self._settings.recalibration
        self._usable_from.update((column, number + 1) for column in columns)
        self._moved.update(columns)
        self._before = None
        if not self._is_urgent:  # else one that moves ever again would keep the calibration from being found
            self._since, self._due_s, self._is_urgent = number, own.first_s * self.GROWTH, True

    def begin(self, newest: FrameState) -> None:
        """Have what was measured solved, if it is time; ``newest`` is the last frame as it is tracked."""
        ready = 0.6  # of the data when the process is begun: it takes a second or two before it can do anything
        own, rate = self._settings.recalibration, self._settings.frame_rate
        if self._over or self._job is not None or not self._measurements:
            return
        unchanged_s = (self._measurements[-1].number + 1 - self._since) / rate
        if unchanged_s < ready * self._due_s:
            return
        if self._process is None:
            self._process = RecalibrationProcess()
        is_moving = not self._still and self._measurements[-1].number >= self._moving_from
        if unchanged_s < self._due_s or (not is_moving and unchanged_s < self.STILL_S):
            return
        stretch = self._stretch()
        earlier = self._earlier if stretch.first <= self._began else None  # older than all that is forgotten: so is it
        before = self._before if earlier is None else None
        answer = self._process.submit(stretch, self._settings, earlier, before)
        self._job, self._is_stale, self._is_urgent, self._moved = _Job(stretch, newest, answer), False, False, set()
        self._due_s += min((self.GROWTH - 1) * self._due_s, own.longest_s)

    def _stretch(self) -> MeasuredStretch:
        measurements = [self._without_moved(one) for one in self._measurements]
        first = measurements[0].number
        if first == 0 and self._usable_from:
            first = 1  # sensors that have moved did not sit so while the declared pose was held
        video = -first % self._settings.coarse_factor  # is kept from coarse frames on
        return MeasuredStretch(self._head, measurements[first + video - measurements[0].number :])

    def _without_moved(self, measured: LiveFrame) -> LiveFrame:
        moved = [column for column, first in self._usable_from.items() if measured.number < first]
        if not moved:
            return measured
        seen, whole = measured.orientation_valid.copy(), measured.acceleration_valid_before.copy()
        seen[moved] = whole[moved] = False
        return replace(measured, orientation_valid=seen, acceleration_valid_before=whole)

    def answer(self, newest: int) -> TrackingStart | Finding | None:
        """The calibration found anew, or why there is none; None as long as it is not time.

        Args:
            newest: number of the newest frame.
        """
        answer_s = 300.0  # that an answer is waited for: it takes 3 s of a core, and a machine may be busy
        own, job = self._settings.recalibration, self._job
        if job is None:
            return None
        delay_s = min(own.delay_s, self.DELAY_SHARE * job.stretch.seconds)
        if newest < job.stretch.frames[-1].number + delay_s * self._settings.frame_rate:
            return None
        if self._real_time and not job.answer.done():
            return None
        self._job = None
        begin = time.perf_counter()
        try:
            start = job.answer.result(answer_s)
        except (SolveError, TimeoutError) as error:
            if isinstance(error, TimeoutError) and self._process is not None:
                self._process.close()
                self._process = None
            finding = Finding("calibration not renewed", words={"reason": str(error) or f"none in {answer_s:g} s"})
            return None if self._is_stale else finding
        finally:
            self.waited_s += time.perf_counter() - begin
        if self._is_stale:
            return None
        if not self._moved:
            self._before = replace(start, frames=[], states=[], associated=(), information=None, video=())
        return replace(start, tracked=job.newest, moved=tuple(self._moved))

    def give_up(self) -> None:
        """Solve nothing more, and wait for nothing that is being solved; a signal handler may call it."""
        self._over = True
        if self._process is not None:
            self._process.close()

    def close(self) -> None:
        """Nothing is collected or solved from here on."""
        self._over, self._job = True, None
        self._measurements.clear()
        if self._process is not None:
            self._process.close()
            self._process = None
