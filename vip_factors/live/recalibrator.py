"""Recalibration of a stream: from which data, when, and in which process.

A start of a second determines neither the mountings nor the bone lengths. The batch stages estimate headings,
mountings, the body, its hinge axes, exchanged sensors, keypoint offsets and standing cameras from all data since the
start, and tracking continues from there.

The work runs in a program of its own behind two pipes. ``multiprocessing`` would run a user's script or notebook again,
and a script that tracks at its top level would never end.
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
from vip_factors.live.frames import FrameState, LiveFrame, MeasuredStretch
from vip_factors.live.start import EarlierCalibration, TrackingStart, solve_stretch, tracking_start, unsettled_starts
from vip_factors.problem.layout import Layout
from vip_factors.problem.state import WearerState
from vip_factors.problem.wearer import WearerProblem
from vip_factors.sensors.live import VideoFrame
from vip_factors.sensors.scene import Scene
from vip_factors.settings import LiveSettings
from vip_factors.stages.accelerometers import is_sign_opposite
from vip_factors.stages.fusion import FusionSolution
from vip_factors.stages.scene_solution import SceneSolution
from vip_factors.stages.sensor_assignment import exchange_finding, exchanges_of
from vip_factors.stages.solver import Solver

FRAMES = 30  # that tracking continues from
SETTLING_S = 9.0  # of data, from which exchanged sensors are sought and rival starts solved
NO_PRIOR = np.pi  # radians: the information replaces the priors of headings and mountings


def recalibrate(
    stretch: MeasuredStretch,
    settings: LiveSettings,
    previous_calibration: EarlierCalibration | None = None,
    previous: TrackingStart | None = None,
) -> TrackingStart:
    """Solve a stretch by the batch stages: a start on its last frames, with the information of the whole stretch.

    Args:
        stretch: the measurements.
        settings: settings of a stream.
        previous_calibration: calibration from before a pause.
        previous: the last result, if no sensor has moved since; without its frames.

    Raises:
        RecordingError: if the sensors measure too little.
        SolveError: if the problem is not determined.
    """
    # Frames are thinned (40 s to every 0.27 s): neighbours carry nearly the same information.
    most_frames = 150
    thinning = np.ceil(len(stretch.time) / settings.coarse_factor / most_frames)
    inflation = 2.0  # of standard deviations: on recorded scenes mountings are off by 1.4 sigma
    batch = replace(
        settings,
        calibration=settings.recalibration.calibration,
        calibration_rate=settings.calibration_rate / thinning,
        solve=replace(settings.solve, relative_decrease=settings.fusion.relative_decrease),
    )
    with threadpool_limits(limits=1, user_api="blas"):
        coarse = solve_stretch(stretch, batch, previous_calibration, previous)
        end = MeasuredStretch(stretch.head, stretch.frames[-FRAMES:])
        fine = coarse.problem_on(end.frames_of(coarse), batch)
        wearers = tuple(
            _free_calibration(*wearer, settings) for wearer in zip(fine.model.wearers, fine.state.wearers, strict=True)
        )
        fine = replace(fine, model=replace(fine.model, wearers=wearers))
        start = tracking_start(end, coarse, fine, settings)
        information = information_of(coarse.fusion, start.problem.layout, inflation)
        exchanges, in_place = list[Finding](), previous is not None and previous.in_place
        if stretch.seconds >= SETTLING_S:
            coarse = coarse.with_rivals_solved(batch, Solver(batch.solve, silent))
            exchanges, in_place = ([], True) if in_place else _exchanges(coarse)
            mirrored = [wearer.subject.name for wearer in coarse.scene.wearers if is_sign_opposite(wearer, batch)]
            exchanges += [Finding("acceleration mirrored", name) for name in mirrored]
        findings = (*unsettled_starts(coarse), *exchanges)
        return replace(start, information=information, seconds=stretch.seconds, findings=findings, in_place=in_place)


def _exchanges(coarse: SceneSolution) -> tuple[list[Finding], bool]:
    """Findings about exchanged sensors, and whether every exchange is ruled out."""
    findings, is_excluded = list[Finding](), True
    for wearer in coarse.scene.wearers:
        exchanges = exchanges_of(wearer, -LEAST_NATS)
        likely = [exchange for exchange in exchanges if exchange.nats >= LEAST_NATS]
        findings += [exchange_finding(wearer, exchange, False, "exchange them in the placement") for exchange in likely]
        is_excluded = is_excluded and not exchanges
    return findings, is_excluded


def information_of(solution: FusionSolution, layout: Layout, inflation: float) -> Array:
    """Information ``(s, s)`` of a solved scene about the static variables of a layout, at its solution.

    Standard deviations are scaled by ``inflation``.

    Raises:
        SolveError: if the scene does not determine them.
    """
    objective = SceneObjective(solution.model)
    covariance = objective.linearise(solution.state).static_covariance()
    rows, scene_rows = list[int](), list[int]()
    for owner, block, columns in layout.placed:
        scene_columns = objective.layout.columns(owner, block.name)
        if block.free and len(scene_columns) == block.width:
            rows += range(columns.start, columns.stop)
            scene_rows += scene_columns.tolist()
    information = np.zeros((layout.static_width, layout.static_width))
    information[np.ix_(rows, rows)] = np.linalg.inv(covariance[np.ix_(scene_rows, scene_rows)]) / inflation**2
    return information


def _free_calibration(model: WearerProblem, state: WearerState, settings: LiveSettings) -> WearerProblem:
    """A wearer's problem with free calibration, starting from ``state``, without other priors."""
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
    """Process that solves stretches; :attr:`close` ends it, whatever its state, and so does the end of the program."""

    def __init__(self) -> None:
        niceness = 10  # the tracker's updates come first
        self._process = subprocess.Popen(
            [sys.executable, "-m", __name__],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
            # Ctrl-C is for the program that tracks. A process group, not a session: Linux divides processors among
            # sessions first (autogroups, sched(7)), and niceness has no effect between sessions.
            process_group=0,
        )
        if hasattr(os, "setpriority"):  # from outside: the imports of the process take a second
            os.setpriority(os.PRIO_PROCESS, self._process.pid, niceness)
        self.close = weakref.finalize(self, _end_process, self._process)

    def submit(
        self,
        stretch: MeasuredStretch,
        settings: LiveSettings,
        previous_calibration: EarlierCalibration | None = None,
        previous: TrackingStart | None = None,
    ) -> "Future[TrackingStart]":
        """Submit a stretch, one at a time. The future raises :class:`SolveError` if it cannot be solved."""
        answer, frames = Future[TrackingStart](), stretch.frames
        # Pickled here, because the tracker goes on changing caches of these objects.
        request = pickle.dumps((stretch.head, len(frames), (settings, previous_calibration, previous)))
        threading.Thread(target=_transfer, args=(self._process, request, frames, answer), daemon=True).start()
        return answer


def _transfer(
    process: "subprocess.Popen[bytes]", request: bytes, frames: Sequence[LiveFrame], answer: "Future[TrackingStart]"
) -> None:
    """Send the request in pieces and wait for the result; the future is set in any case."""
    piece = 60  # frames sent at once, in half a millisecond that the tracker waits
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        process.stdin.write(request)
        for begin in range(0, len(frames), piece):
            pickle.dump(frames[begin : begin + piece], process.stdin)
        process.stdin.flush()
        result = pickle.load(process.stdout)
    except (OSError, ValueError, EOFError, pickle.UnpicklingError):
        result = "the recalibration process has ended"
    except Exception as error:  # an exception in a thread would be lost, and the tracker would wait
        result = f"{type(error).__name__}: {error}"
    if isinstance(result, TrackingStart):
        answer.set_result(result)
    else:
        answer.set_exception(SolveError(str(result)))


def _end_process(process: "subprocess.Popen[bytes]") -> None:
    process.kill()
    process.wait()
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            with contextlib.suppress(OSError):  # unwritten data is lost with the process
                pipe.close()


def _end_with(parent: int) -> None:
    """Exit when the parent process is gone, instead of finishing the work, which takes up to half a minute."""
    interval_s = 1.0  # between checks of the parent process
    while os.getppid() == parent:
        time.sleep(interval_s)
    os._exit(1)


def main() -> None:
    """Solve the requests on standard input until it ends."""
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # printed output of libraries goes to standard error
    while True:
        try:
            head, count, arguments = pickle.load(sys.stdin.buffer)
            frames = list[LiveFrame]()
            while len(frames) < count:
                frames += pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        result: TrackingStart | str
        try:
            result = recalibrate(MeasuredStretch(head, frames), *arguments)
        except VipFactorsError as error:
            result = str(error)
        except Exception as error:  # the stream continues with what it has, and reports it
            result = f"{type(error).__name__}: {error}"
        try:
            pickle.dump(result, answers)
            answers.flush()
        except BrokenPipeError:  # the parent process was killed
            os._exit(1)  # without flushing the buffer


if __name__ == "__main__":
    main()


@dataclass(frozen=True)
class _Job:
    stretch: MeasuredStretch
    newest: FrameState  # as tracked
    answer: "Future[TrackingStart]"


class Recalibrator:
    """Collects measurements and solves them again each time their amount has doubled.

    Args:
        head: the set-up of the stream.
        settings: settings of a stream.
        real_time: whether the stream does not wait: results are used when they are ready, otherwise waited for.

    Attributes:
        waited_s: total seconds spent waiting.
    """

    SETTLED_S = 2.0  # of data, below which poses are marked as preliminary
    # Turn of a quarter of the sensors, before which nothing is solved: a held pose does not determine mountings.
    MOVING_DEG = 20.0
    STILL_S = 5.0  # of data, after which it is solved without motion as well
    GROWTH = 2.0  # of the data from one solution to the next
    DELAY_SHARE = 0.5  # of the duration of the data, if less than the delay

    def __init__(self, head: Scene, settings: LiveSettings, real_time: bool) -> None:
        self._head, self._settings, self._real_time = head, settings, real_time
        recalibration = settings.recalibration
        self._measurements: deque[LiveFrame] = deque(maxlen=round(recalibration.longest_s * settings.frame_rate))
        self._due_s, self._is_closed = recalibration.first_s, not recalibration.use
        self._began = 0  # number of the first frame since the start or a pause
        self._since = 0  # number of the frame since which no sensor has moved
        ends = np.cumsum([len(wearer.placement.sites) for wearer in head.wearers])
        self._columns = np.split(np.arange(ends[-1]), ends[:-1])  # of each wearer's sensors
        self._still, self._moving_from = set(range(len(ends))), 0  # wearers; frame since which all move
        self._last_coarse: dict[str, int] = {}  # by camera, coarse frame of its last needed video frame
        self._usable_from: dict[int, int] = {}  # by column of a moved sensor: its first valid frame
        self.waited_s = 0.0
        self._process: RecalibrationProcess | None = None
        self._job: _Job | None = None
        self._previous_calibration: EarlierCalibration | None = None
        self._previous: TrackingStart | None = None  # the last result, if no sensor has moved since
        self._is_stale = False  # whether the job is about data from before a pause
        self._moved: set[int] = set()  # sensors that moved after its data
        self._is_urgent = False  # whether a sensor has moved since the last result

    def remember(self, measured: LiveFrame) -> None:
        """Collect the measurements of a frame."""
        moving_s = 0.2  # of motion, before anything is solved
        if self._is_closed:
            return
        if not self._measurements:
            self._since = self._began = measured.number
            self._still = set(range(len(self._columns)))
        video = list[VideoFrame]()
        for frame in measured.video:
            # The first of its camera in a coarse frame; further ones add hardly any information.
            camera, coarse = frame.camera, frame.frame // self._settings.coarse_factor
            if coarse > self._last_coarse.get(camera, -1):
                video.append(frame)
                self._last_coarse[camera] = coarse
        measured = replace(measured, video=tuple(video))
        self._measurements.append(measured)
        if self._still:
            first_frame = self._measurements[0]
            self._still -= {w for w in self._still if self._has_turned(self._columns[w], first_frame, measured)}
            self._moving_from = measured.number + round(moving_s * self._settings.frame_rate)

    def _has_turned(self, columns: np.ndarray, first_frame: LiveFrame, frame: LiveFrame) -> bool:
        """Whether a quarter of a wearer's sensors has turned."""
        moving_share = 0.25  # of a wearer's sensors: both arms
        measured = columns[first_frame.orientation_valid[columns] & frame.orientation_valid[columns]]
        if not len(measured):
            return False
        R, R_first = frame.R_inertial_sensor[measured], first_frame.R_inertial_sensor[measured]
        cosine = (np.einsum("sij,sij->s", R_first, R) - 1) / 2
        turned = cosine < np.cos(np.deg2rad(self.MOVING_DEG))
        return bool(turned.mean() >= moving_share)

    def restart(self, previous_calibration: EarlierCalibration | None) -> None:
        """Drop all data, as the stream has paused; ``previous_calibration`` remains."""
        self._previous_calibration, self._previous = previous_calibration, None
        self._measurements.clear()
        self._usable_from.clear()
        self._due_s, self._is_stale, self._is_urgent = self._settings.recalibration.first_s, True, False

    def leave_out(self, columns: Sequence[int], number: int) -> None:
        """Ignore what sensors (columns) measured up to a frame, because they have moved."""
        self._usable_from.update((column, number + 1) for column in columns)
        self._moved.update(columns)
        self._previous = None
        if not self._is_urgent:  # a sensor that moves again and again would prevent any result
            due_s = self._settings.recalibration.first_s * self.GROWTH
            self._since, self._due_s, self._is_urgent = number, due_s, True

    def begin(self, newest: FrameState) -> None:
        """Submit the measurements if it is time; ``newest`` is the state of the last frame as tracked."""
        ready = 0.6  # of the data, at which the process is started: it takes a second or two
        if self._is_closed or self._job is not None or not self._measurements:
            return
        last_number = self._measurements[-1].number
        unchanged_s = (last_number + 1 - self._since) / self._settings.frame_rate
        if unchanged_s < ready * self._due_s:
            return
        if self._process is None:
            self._process = RecalibrationProcess()
        is_moving = not self._still and last_number >= self._moving_from
        if unchanged_s < self._due_s or (not is_moving and unchanged_s < self.STILL_S):
            return
        stretch = self._stretch()
        # A calibration from before the first frame is dropped with the data that followed it.
        calibration = self._previous_calibration if stretch.first_number <= self._began else None
        previous = self._previous if calibration is None else None
        answer = self._process.submit(stretch, self._settings, calibration, previous)
        self._job, self._is_stale, self._is_urgent, self._moved = _Job(stretch, newest, answer), False, False, set()
        self._due_s += min((self.GROWTH - 1) * self._due_s, self._settings.recalibration.longest_s)

    def _stretch(self) -> MeasuredStretch:
        """The measurements, without those of sensors from before they moved."""
        measurements = list[LiveFrame]()
        for frame in self._measurements:
            moved = [column for column, usable_from in self._usable_from.items() if frame.number < usable_from]
            if moved:
                oriented, accelerated = frame.orientation_valid.copy(), frame.acceleration_valid_before.copy()
                oriented[moved] = accelerated[moved] = False
                frame = replace(frame, orientation_valid=oriented, acceleration_valid_before=accelerated)
            measurements.append(frame)
        first_number = measurements[0].number
        if first_number == 0 and self._usable_from:
            first_number = 1  # moved sensors sat differently while the declared pose was held
        video = -first_number % self._settings.coarse_factor  # needed video starts with a coarse frame
        return MeasuredStretch(self._head, measurements[first_number + video - measurements[0].number :])

    def answer(self, newest: int) -> TrackingStart | Finding | None:
        """The result of a recalibration, or the reason why there is none; None while it is not time.

        Args:
            newest: number of the newest frame.
        """
        answer_s = 300.0  # longest wait for a result; it takes 3 s of a core, but a machine may be busy
        recalibration, job = self._settings.recalibration, self._job
        if job is None:
            return None
        delay_s = min(recalibration.delay_s, self.DELAY_SHARE * job.stretch.seconds)
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
            self._previous = replace(start, frames=[], states=[], associated=(), information=None, video=())
        return replace(start, tracked_state=job.newest, moved=tuple(self._moved))

    def give_up(self) -> None:
        """Abandon all work; a signal handler may call it."""
        self._is_closed = True
        if self._process is not None:
            self._process.close()

    def close(self) -> None:
        """End the collection and the process."""
        self._is_closed, self._job = True, None
        self._measurements.clear()
        if self._process is not None:
            self._process.close()
            self._process = None
