"""Fixed-lag tracker: every frame of a stream gets an estimate as its samples arrive."""

import gc
import time as clock
from collections import deque
from collections.abc import Iterable
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
from threadpoolctl import ThreadpoolController

from vip_factors.errors import RecordingError, SolveError
from vip_factors.factor_graph.extra import ExtraFactors
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array
from vip_factors.live.assembly import FrameAssembler
from vip_factors.live.estimates import EstimateBuilder
from vip_factors.live.frames import LiveFrame, MeasuredStretch, video_of
from vip_factors.live.prediction import continued_start, correction_findings
from vip_factors.live.recalibrator import Recalibrator
from vip_factors.live.sensor_slips import SlipTest
from vip_factors.live.smoother import LagSmoother
from vip_factors.live.start import EarlierCalibration, TrackingStart, start_tracking
from vip_factors.live.tracking import Tracking
from vip_factors.live_estimate import LiveEstimate
from vip_factors.sensors.live import LiveSample, checked_head, sensor_columns
from vip_factors.sensors.scene import Scene
from vip_factors.settings import LiveSettings
from vip_factors.stages.floor import with_declared_floor

KNOWN_AT_ONCE = frozenset({"sensors exchanged", "sensors copied", "low sampling rate", "limited set-up"})
"""Kinds of findings about a start that more data cannot settle."""


class SolvePace:
    """Adapts the number of frames to each update to the time that samples have waited.

    No frame is left out: those between updates are predicted, get answers, and count in the next update. The wait
    settles where updates and predictions fill the available time, whatever else runs on the processor. The delay from a
    start, which takes longer than a frame, is made up for without a finding.

    Attributes:
        solve_every: current number of frames to each update.
    """

    FRAME_WAIT_S = 0.025  # wait for each further frame to an update; longer than an update takes
    WIDEST = 6  # frames to each update at most: 10 solved each second, with 15 frames of lag
    REPORT_S = 2.0  # over which solved frames are counted; shorter periods are not reported
    START_S = 5.0  # in which the delay from a start is made up for
    LEAST_SHARE = 0.8  # of the usual number of solved frames, below which a finding is made

    def __init__(self, usual: int, frame_rate: float) -> None:
        self.solve_every = self._usual = usual
        self._rate = frame_rate
        self._solved = deque[bool](maxlen=max(1, round(self.REPORT_S * frame_rate)))  # of recent frames
        self._begun: float | None = None  # s, when the first frame came
        self._is_reported = False

    def step(self, time: float, behind_s: float, solved: bool) -> list[Finding]:
        """Take in one frame; reports once when fewer frames are solved, until as many as usual are again.

        Args:
            time: seconds of the stream.
            behind_s: seconds that its last sample had waited.
            solved: whether the previous frame was solved.
        """
        self._begun = time if self._begun is None else self._begun
        self.solve_every = min(self._usual + int(behind_s / self.FRAME_WAIT_S), max(self.WIDEST, self._usual))
        if self._solved or self.solve_every == self._usual or time - self._begun >= self.START_S:
            self._solved.append(solved)
        share = sum(self._solved) * self._usual / len(self._solved) if self._solved else 1.0
        is_slow = len(self._solved) == self._solved.maxlen and share < self.LEAST_SHARE
        is_new, self._is_reported = is_slow and not self._is_reported, is_slow or (self._is_reported and share < 1)
        if not is_new:
            return []
        numbers = {"begin": time, "rate": share * self._rate / self._usual, "behind": behind_s}
        return [Finding("fewer frames solved", numbers=numbers)]


DEFAULT = LiveSettings()
NOT_SEEN = "no camera has shown its wearers before the next calibration was ready"


class FixedLagTracker:
    """Estimates wearers, cameras, headings and mountings while samples arrive.

    Frames before the start get no answer; the first second gets its answers together at its end.

    Args:
        head: the set-up: a scene with its wearers and cameras, whose samples and detections are ignored.
        settings: settings of a stream.
        extra_factors: makes a user's GTSAM factors for the time and number of each new frame. They may depend on it,
            the two frames before it, and the shared variables: :data:`~vip_factors.factor_graph.extra.ExtraFactors`.
        real_time: whether the stream does not wait. If so, a new calibration is used when it is ready, and fewer frames
            are solved while the tracker is behind (:meth:`note_behind`); otherwise it is waited for, and answers are
            reproducible.
    """

    def __init__(
        self,
        head: Scene,
        settings: LiveSettings = DEFAULT,
        extra_factors: ExtraFactors | None = None,
        real_time: bool = False,
    ) -> None:
        self.head = head = with_declared_floor(checked_head(head), settings.floor)
        self.settings, self._extra = settings, extra_factors
        self._worn_count = sum(len(wearer.placement.sites) for wearer in head.wearers)  # first columns
        rate = settings.frame_rate
        self._lag = max(1, round(settings.lag_s * rate))
        self._assembler = FrameAssembler(sensor_columns(head), rate, settings.assembly, head.cameras, self._lag)
        self._start_frames = max(self._lag + 3, round(settings.start_s * rate))
        self._recent: deque[LiveFrame] = deque(maxlen=self._start_frames)
        self._paths: deque[tuple[int, Array]] = deque(maxlen=self._start_frames)  # smoothed positions of the pelvises
        self._tracking: Tracking | None = None
        self._earlier: EarlierCalibration | None = None
        self._estimates = EstimateBuilder(head, settings, self._lag)
        self._answered = -1  # number of the last frame with an answer
        self._next_try, self._patience = 0, 0.5  # frame; seconds, doubled by every failed attempt
        self._doubts: set[tuple[str, ...]] = set()  # findings on the last calibration
        self._doubts_reported: set[tuple[str, ...]] = set()
        self._pending_start: TrackingStart | None = None  # a calibration to be used as soon as the wearers are seen
        # Seconds of data of the last calibration, and the smoother before it, until the two are compared.
        self._before_recalibration: tuple[float, LagSmoother] | None = None
        self._next_continuation = 0  # frame
        self._learnt_s = 0.0  # of data in the current calibration and bodies
        self._recalibrator = Recalibrator(head, settings, real_time)
        self._pace = SolvePace(settings.solve_every, rate)
        self._real_time, self._behind_s = real_time, 0.0
        # Finding the libraries takes longer than an update.
        self._blas = ThreadpoolController().select(user_api="blas")

    def push(self, sample: LiveSample) -> list[LiveEstimate]:
        """Take one sample; returns the answers that it completes, in order.

        Unusable samples are left out, and the next answer reports them.
        """
        return self._answer(self._assembler.push(sample))

    def note_loss(self) -> None:
        """Note that samples were dropped on their way, because answers took too long; no sensor is to blame."""
        self._assembler.note_loss()

    def note_behind(self, seconds: float) -> None:
        """Set how long the next sample has waited; fewer frames are solved if it is too long."""
        self._behind_s = seconds if self._real_time else 0.0

    def give_up(self) -> None:
        """Stop waiting for calibrations, because the end was requested; a signal handler may call it."""
        self._recalibrator.give_up()

    def finish(self) -> list[LiveEstimate]:
        """End the stream: answers to the last frames."""
        answers = self._answer(self._assembler.flush())
        self._recalibrator.close()
        return answers

    def _answer(self, measurements: list[LiveFrame]) -> list[LiveEstimate]:
        if not measurements:
            return []
        answers: list[LiveEstimate] = []
        is_limited = all(controller.num_threads == 1 for controller in self._blas.lib_controllers)
        with nullcontext() if is_limited else self._blas.limit(limits=1):
            for measured in measurements:
                begin = clock.perf_counter()
                self._estimates.add_findings(*self._assembler.take_findings())
                estimates = self._take(measured, begin)
                is_preliminary = self._is_preliminary
                answers += [replace(estimate, preliminary=is_preliminary) for estimate in estimates]
        if answers:
            self._answered = answers[-1].frame
        return answers

    def _take(self, measured: LiveFrame, begin: float) -> list[LiveEstimate]:
        if measured.restart:
            self._lose("the stream has paused")
            self._recent.clear()
            self._recalibrator.restart(self._earlier)
        self._recalibrator.remember(measured)
        self._recent.append(measured)
        if self._tracking is None:
            return self._begin(begin)
        tracking, waited = self._tracking, self._recalibrator.waited_s
        try:
            covariance = self._estimates.root_covariance(len(self.head.wearers))
            self._estimates.add_findings(*self._pace.step(measured.time, self._behind_s, tracking.solved))
            self._estimates.add_findings(*tracking.step(measured, self._lag, covariance, self._pace.solve_every))
            if tracking.moved:
                self._recalibrator.leave_out(tracking.moved, measured.number)
                if self._pending_start is not None:
                    moved = (*self._pending_start.moved, *tracking.moved)
                    self._pending_start = replace(self._pending_start, moved=moved)
            if self._is_worth_another_start(tracking, measured.number):
                tracking = self._tracking = self._started_again(tracking)
            tracking = self._tracking = self._recalibrated(tracking)
        except SolveError as error:
            self._lose(f"tracking was lost at {measured.time:.1f} s ({error})")
            return []
        answer = self._estimates.of(tracking, begin + self._recalibrator.waited_s - waited)
        self._remember_place(tracking)
        return [answer]

    def _recalibrated(self, tracking: Tracking) -> Tracking:
        """Tracking with a new calibration, if one is ready."""
        smoother = tracking.smoother
        newest = smoother.numbers[-1]
        if self._before_recalibration is not None and tracking.solved:
            self._estimates.add_findings(*correction_findings(*self._before_recalibration, smoother))
            self._before_recalibration = None
        answer = self._recalibrator.answer(newest)
        if isinstance(answer, Finding):
            self._estimates.add_findings(answer)
        elif answer is not None and (answer.has_views or not smoother.problem.has_views):
            if self._pending_start is not None:
                self._estimates.add_findings(Finding("calibration not renewed", words={"reason": NOT_SEEN}))
            self._pending_start, self._next_continuation = answer, newest
        if self._pending_start is not None and tracking.solved and newest >= self._next_continuation:
            continued_tracking = self._continued(tracking, self._pending_start)
            self._next_continuation = newest + self._lag
            if continued_tracking is not None:
                self._estimates.reset()
                if not self._is_preliminary:  # after the next update: one iteration is not enough to compare
                    self._before_recalibration = self._pending_start.seconds, smoother
                if self._pending_start.seconds >= SlipTest.LEARNT_S:
                    # Findings that twice as much data has not settled, and those that more data cannot settle.
                    findings, doubts = self._pending_start.findings, self._doubts
                    self._add_once(item for item in findings if item.about in doubts or item.kind in KNOWN_AT_ONCE)
                    self._doubts = {finding.about for finding in findings}
                self._learnt_s = max(self._learnt_s, self._pending_start.seconds)
                tracking, self._pending_start = continued_tracking, None
        self._recalibrator.begin(tracking.smoother.state(newest))
        return tracking

    def _continued(self, tracking: Tracking, pending: TrackingStart) -> Tracking | None:
        """Tracking with a new calibration; None if the video does not show the wearers yet."""
        video = video_of(self._recent)
        start = continued_start(pending, tracking.smoother, self.head.cameras, video)
        if start is None:
            return None
        try:
            learnt_s = max(pending.seconds, self._learnt_s)
            tracking = Tracking(self.head, self.settings, start, self._extra, video, learnt_s)
        except SolveError:
            return None
        tracking.free_sensors(pending.moved)
        return tracking

    @property
    def _is_preliminary(self) -> bool:
        """Whether the calibration is from so little data that it will be corrected."""
        return self.settings.recalibration.use and self._learnt_s < Recalibrator.SETTLED_S

    def _learnt(self, tracking: Tracking, p_world_pelvis: Array) -> EarlierCalibration:
        """Calibration and bodies so far, with wearers at ``(W, 3)`` metres."""
        body_s = 9.0  # of data, after which bodies are used after a pause
        problem = tracking.smoother.problem
        names = [wearer.subject.name for wearer in self.head.wearers] if self._learnt_s >= body_s else []
        bodies = {name: wearer.skeleton for name, wearer in zip(names, problem.wearers, strict=False)}
        return EarlierCalibration(self._estimates.calibrations(tracking.smoother), p_world_pelvis, bodies)

    def _lose(self, reason: str) -> None:
        """Stop tracking; the calibration remains."""
        self._pending_start = self._before_recalibration = None
        if self._tracking is not None:
            self._earlier = self._learnt(self._tracking, self._paths[-1][1])
            words = {"when": "until tracking has started again", "reason": reason}
            self._estimates.add_findings(Finding("no poses", words=words))
        self._tracking = None
        self._next_try = 0

    def _begin(self, begin: float) -> list[LiveEstimate]:
        newest = self._recent[-1].number
        if len(self._recent) < self._start_frames or newest < self._next_try:
            return []
        try:
            start, tracking = self._fresh_tracking(self._earlier)
        except (RecordingError, SolveError) as error:
            words = {"when": f"yet, tracking cannot start at {self._recent[-1].time:.1f} s", "reason": str(error)}
            self._estimates.add_findings(Finding("no poses", words=words))
            self._next_try = newest + self._lag
            return []
        self._tracking = tracking
        at_once = (finding for finding in start.findings if finding.kind in KNOWN_AT_ONCE)
        self._add_once(start.findings if not self.settings.recalibration.use else at_once)
        gc.freeze()  # objects so far stay: the garbage collector need not visit them during an update
        answers = self._estimates.initial_estimates(tracking, begin, self._answered + 1)
        self._paths.clear()
        self._remember_place(tracking)
        return answers

    def _remember_place(self, tracking: Tracking) -> None:
        """Remember the pelvises in the oldest frame of the lag."""
        oldest = tracking.smoother.numbers[0]
        self._paths.append((oldest, tracking.smoother.state(oldest).p_world_pelvis))

    def _add_once(self, findings: Iterable[Finding]) -> None:
        new = {finding.about: finding for finding in findings if finding.about not in self._doubts_reported}
        self._estimates.add_findings(*new.values())
        self._doubts_reported |= new.keys()

    def _fresh_tracking(self, previous_calibration: EarlierCalibration | None) -> tuple[TrackingStart, Tracking]:
        """Start tracking from the last second and a previous calibration."""
        start = start_tracking(MeasuredStretch(self.head, self._recent), self.settings, previous_calibration)
        return start, Tracking(self.head, self.settings, start, self._extra)

    def _is_worth_another_start(self, tracking: Tracking, newest: int) -> bool:
        """Whether a sensor has come, or a camera shows people but no wearer is found in it yet."""
        measures = 0.9  # of the frames, from which a sensor counts as present
        some_video = 10  # frames with people in them, during the time of a start
        if newest < self._next_try or len(self._paths) < self._start_frames - self._lag:
            return False
        problem = tracking.smoother.problem
        unseen = self.settings.fusion.use_camera and not problem.has_views
        if unseen and sum(len(frame.pixels) > 0 for frame in video_of(self._recent)) > some_video:
            return True
        unused = sorted(set(range(self._worn_count)) - {column for columns in problem.sensors for column in columns})
        if not unused:
            return False
        measured_share = np.stack([frame.orientation_valid[unused] for frame in self._recent]).mean(axis=0)
        return bool(np.any(measured_share > measures))

    def _started_again(self, tracking: Tracking) -> Tracking:
        """Tracking restarted from the last second and the calibration so far; unchanged if that gains nothing."""
        newest, old_problem = self._recent[-1].number, tracking.smoother.problem
        self._next_try = newest + round(self._patience * self.settings.frame_rate)
        self._patience *= 2
        path = dict(self._paths).get(self._recent[0].number)
        if path is None:
            return tracking
        try:
            _, new_tracking = self._fresh_tracking(self._learnt(tracking, path))
        except (RecordingError, SolveError):
            return tracking
        problem = new_tracking.smoother.problem
        is_found = problem.has_views and not old_problem.has_views
        if not is_found and sum(map(len, problem.sensors)) <= sum(map(len, old_problem.sensors)):
            return tracking
        new_tracking.smoother.marginalise_before(newest - self._lag - 1)
        self._estimates.reset()
        subject = "a wearer was found in the video, which" if is_found else "another sensor"
        self._estimates.add_findings(Finding("recovered", subject=subject, words={"what": "is used from here on"}))
        return new_tracking
