"""When a stream's calibration is found anew: the data of it, the process that does it, the answer."""

import time as clock
from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass

from vip_factors.errors import SolveError
from vip_factors.live.buffered import MeasuredStretch
from vip_factors.live.measurement import FrameMeasurement
from vip_factors.live.recalibration_process import RecalibrationProcess
from vip_factors.live.settings import LiveSettings
from vip_factors.live.start import Started
from vip_factors.live.state import FrameState
from vip_factors.sensors.live import LiveSetup, VideoFrame

READY = 0.6  # of the data when the process is begun: it takes a second or two before it can do anything


@dataclass(frozen=True)
class Found:
    """A calibration found anew.

    Attributes:
        started: where tracking goes on from.
        at_find: the last frame of its data, as it was tracked.
        seconds: of data.
        video: of the frames of ``started``.
    """

    started: Started
    at_find: FrameState
    seconds: float
    video: list[tuple[int, VideoFrame]]


@dataclass(frozen=True)
class _Job:
    stretch: MeasuredStretch
    at_find: FrameState
    answer: "Future[Started]"


class Recalibrator:
    """Collects what is measured from the first frame on, and has it solved when there is twice as much.

    Args:
        setup: of the stream.
        columns: carrier and name of each sensor in the measurements.
        settings: of all.
        real_time: whether the stream goes on by itself: then an answer is taken when it is there, and else waited for.

    Attributes:
        waited_s: seconds spent waiting, in all.
    """

    def __init__(
        self, setup: LiveSetup, columns: Sequence[tuple[str, str]], settings: LiveSettings, real_time: bool
    ) -> None:
        self._setup, self._columns, self._settings, self._real_time = setup, list(columns), settings, real_time
        own = settings.recalibration
        self._due, self._over = own.first_s, not own.use
        self._measurements: list[FrameMeasurement] = []
        self._video: list[tuple[int, VideoFrame]] = []
        self.waited_s = 0.0
        self._process: RecalibrationProcess | None = None
        self._job: _Job | None = None

    def remember(self, measured: FrameMeasurement) -> None:
        """One frame more."""
        if not self._over:
            self._measurements.append(measured)
            self._video += [(one.frame, one.video) for one in measured.video]

    def begin(self, newest: FrameState) -> None:
        """Have all that was measured solved, if there is enough; ``newest`` is the last frame as it is tracked."""
        own, rate = self._settings.recalibration, self._settings.frame_rate
        measured_s = len(self._measurements) / rate
        if self._over or self._job is not None or measured_s < READY * self._due:
            return
        if self._process is None:
            self._process = RecalibrationProcess()
        if measured_s < self._due:
            return
        stretch = MeasuredStretch(self._setup, self._measurements, self._video, self._columns)
        self._job = _Job(stretch, newest, self._process.submit(stretch, self._settings))
        self._due *= own.growth

    def answer(self, newest: int) -> Found | str | None:
        """The calibration found anew, or why there is none; None as long as it is not time.

        Args:
            newest: number of the newest frame.
        """
        own, job = self._settings.recalibration, self._job
        if job is None or newest < job.stretch.measurements[-1].frame + own.delay_s * self._settings.frame_rate:
            return None
        if self._real_time and not job.answer.done():
            return None
        self._job = None
        begin = clock.perf_counter()
        try:
            started = job.answer.result()
        except SolveError as error:
            return f"the calibration was not found anew: {error}"
        finally:
            self.waited_s += clock.perf_counter() - begin
            if self._due > own.longest_s:
                self.close()
        video = job.stretch.tail(own.frames).video
        return Found(started, job.at_find, float(job.stretch.time[-1] - job.stretch.time[0]), video)

    def close(self) -> None:
        """Nothing is collected or solved from here on."""
        self._over, self._job = True, None
        self._measurements, self._video = [], []
        if self._process is not None:
            self._process.close()
            self._process = None
