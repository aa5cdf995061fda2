"""The fixed-lag tracker: samples go in one by one, and every frame gets its answer."""

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
from vip_factors.live.measurement import LiveFrame, MeasuredStretch, video_of
from vip_factors.live.prediction import continued, corrections
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
"""Kinds of findings on a start that more data cannot settle."""


class SolvePace:
    """Widens the stretch between updates in proportion to what samples have waited, frame by frame.

    No frame is left out: those between updates are predicted, and answered, and count in the next one. So the wait
    settles where updates and predictions fill the time that there is, whatever each of them takes and whoever else
    wants the processor: it is looked at before every update, and falls behind by one of them at most. That tracking
    begins behind, since its start takes longer than a frame, is made up for without a word.

    Attributes:
        solve_every: frames to each update, now.
    """

    FRAME_WAIT_S = 0.025  # a sample's wait for each frame more to an update: longer than an update takes
    WIDEST = 6  # frames to each update, at most: 10 solved each second, on 15 frames of the lag
    REPORT_S = 2.0  # over which the reported rate is counted; a shorter stretch is not worth a finding
    RECOVER_S = 5.0  # with all frames solved, before that is reported
    LEAST_SHARE = 0.8  # of the frames that are solved usually: a hiccup now and then is not worth a finding

    def __init__(self, usual: int, frame_rate: float) -> None:
        self.solve_every = self._usual = usual
        self._rate = frame_rate
        self._recent = deque[bool](maxlen=max(1, round(self.REPORT_S * frame_rate)))  # whether frames were solved
        self._begun: float | None = None  # s, when the first frame came
        self._late_at = 0.0  # s, when fewer were solved last
        self._told_from: float | None = None  # s, from when on they are, as was told
        self._least = frame_rate  # solved a second since then

    def step(self, time: float, behind_s: float, solved: bool) -> list[Finding]:
        """One frame more.

        Args:
            time: seconds of the stream.
            behind_s: that its last sample had waited.
            solved: whether the frame before was.
        """
        self._begun = time if self._begun is None else self._begun
        self.solve_every = min(self._usual + int(behind_s / self.FRAME_WAIT_S), max(self.WIDEST, self._usual))
        is_late = self.solve_every > self._usual
        self._late_at = time if is_late else self._late_at
        if self._recent or not is_late or time - self._begun >= self.RECOVER_S:
            self._recent.append(solved)
        return self._findings(time, behind_s)

    def _findings(self, time: float, behind_s: float) -> list[Finding]:
        """What is to be said: that fewer are solved, once, and when that is over."""
        if len(self._recent) < (self._recent.maxlen or 0):
            return []
        rate, begin = self._rate * sum(self._recent) / len(self._recent), self._told_from
        self._least = min(self._least, rate)
        if begin is None and rate < self.LEAST_SHARE * self._rate / self._usual:
            self._told_from, self._least = time, rate
            return [Finding("fewer frames solved", numbers={"begin": time, "rate": rate, "behind": behind_s})]
        if begin is not None and time - self._late_at >= self.RECOVER_S:
            self._told_from = None
            numbers = {"begin": begin, "end": time, "rate": rate, "least": self._least}
            what = f"are solved again; it were {self._least:.0f} at least, from {begin:.1f} to {time:.1f} s"
            return [Finding("recovered", subject=f"{rate:.0f} frames a second", numbers=numbers, words={"what": what})]
        return []


def _no_poses(when: str, reason: str) -> Finding:
    return Finding("no poses", words={"when": when, "reason": reason})


DEFAULT = LiveSettings()
NOT_SEEN = "until the next one nothing has shown where its wearers are by now"


class FixedLagTracker:
    """Estimates wearers, camera, headings and mountings while samples arrive.

    Frames before tracking could begin get no answer; the first second gets its answers together, once it is over.

    Args:
        head: who wears what, and which cameras film them: a scene, whose samples and detections are not looked at.
        settings: of all rooms.
        extra_factors: makes GTSAM factors of your own, asked with each new frame's time and number; they may see it,
            the two before it, and what all frames share. See :data:`~vip_factors.factor_graph.extra.ExtraFactors`.
        real_time: whether samples come by themselves. A calibration found anew is then taken up when it is there, and
            fewer frames are solved while the tracker is behind (:meth:`note_behind`); else it is waited for, and the
            answers are the same each time.
    """

    def __init__(
        self, head: Scene, settings: LiveSettings = DEFAULT, extra_factors: ExtraFactors | None = None,
        real_time: bool = False,
    ) -> None:  # fmt: skip
        self.head = head = with_declared_floor(checked_head(head), settings.floor)
        self.settings, self._extra = settings, extra_factors
        self._worn = sum(len(wearer.placement.sites) for wearer in head.wearers)  # columns; the rest is on cameras
        rate = settings.frame_rate
        self._lag = max(1, round(settings.lag_s * rate))
        self._assembler = FrameAssembler(sensor_columns(head), rate, settings.assembly, head.cameras, self._lag)
        self._start_frames = max(self._lag + 3, round(settings.start_s * rate))
        self._recent: deque[LiveFrame] = deque(maxlen=self._start_frames)
        self._paths: deque[tuple[int, Array]] = deque(maxlen=self._start_frames)  # of the pelvises, as smoothed
        self._tracking: Tracking | None = None
        self._earlier: EarlierCalibration | None = None
        self._estimates = EstimateBuilder(head, settings, self._lag)
        self._answered = -1  # number of the last frame with an answer
        self._next_try, self._patience = 0, 0.5  # frame, seconds; rarer with every try in vain
        self._doubts: set[tuple[str, ...]] = set()  # of the last calibration found anew
        self._doubts_told: set[tuple[str, ...]] = set()
        self._found: TrackingStart | None = None  # a calibration to go on with as soon as the wearers are seen
        # How many seconds the last one was found from, and what was tracked before it, until they are compared.
        self._before_recalibration: tuple[float, LagSmoother] | None = None
        self._next_continuation = 0  # frame
        self._learnt_s = 0.0  # of data that calibration and bodies were found from
        self._recalibrator = Recalibrator(head, settings, real_time)
        self._pace = SolvePace(settings.solve_every, rate)
        self._real_time, self._behind_s = real_time, 0.0
        # Finding the libraries takes longer than an update: once.
        self._blas = ThreadpoolController().select(user_api="blas")

    def push(self, sample: LiveSample) -> list[LiveEstimate]:
        """Take one sample; the answers that it allows, in order.

        Bad samples are left out, and the next answer's findings say so.
        """
        return self._answer(self._assembler.push(sample))

    def note_loss(self) -> None:
        """Samples were sent, but dropped on their way here, as answers took too long: no sensor is to blame."""
        self._assembler.note_loss()

    def note_behind(self, seconds: float) -> None:
        """The next sample has waited so long to be pushed; of those that wait for too long fewer frames are solved."""
        self._behind_s = seconds if self._real_time else 0.0

    def give_up(self) -> None:
        """Wait for no calibration any more, as the end was asked for; a signal handler may call it."""
        self._recalibrator.give_up()

    def finish(self) -> list[LiveEstimate]:
        """The end of the stream: answers to the last frames."""
        answers = self._answer(self._assembler.flush())
        self._recalibrator.close()
        return answers

    def _answer(self, measurements: list[LiveFrame]) -> list[LiveEstimate]:
        if not measurements:
            return []
        answers: list[LiveEstimate] = []
        is_limited = all(one.num_threads == 1 for one in self._blas.lib_controllers)
        with nullcontext() if is_limited else self._blas.limit(limits=1):
            for measured in measurements:
                begin = clock.perf_counter()
                self._estimates.add_findings(*self._assembler.take_findings())
                taken = self._take(measured, begin)
                answers += [replace(one, preliminary=True) for one in taken] if self._is_preliminary else taken
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
                if self._found is not None:
                    self._found = replace(self._found, moved=(*self._found.moved, *tracking.moved))
            if self._is_worth_another_start(tracking, measured.number):
                tracking = self._tracking = self._started_again(tracking)
            tracking = self._tracking = self._recalibrated(tracking)
        except SolveError as error:
            self._lose(f"tracking was lost at {measured.time:.1f} s ({error})")
            return []
        answer = self._estimates.of(tracking, begin + self._recalibrator.waited_s - waited)
        oldest = tracking.smoother.numbers[0]
        self._paths.append((oldest, tracking.smoother.state(oldest).p_world_pelvis))
        return [answer]

    def _recalibrated(self, tracking: Tracking) -> Tracking:
        """Tracking with a calibration found anew, if there is one by now."""
        smoother = tracking.smoother
        newest = smoother.numbers[-1]
        if self._before_recalibration is not None and tracking.solved:
            self._estimates.add_findings(*corrections(*self._before_recalibration, smoother))
            self._before_recalibration = None
        answer = self._recalibrator.answer(newest)
        if isinstance(answer, Finding):
            self._estimates.add_findings(answer)
        elif answer is not None and (answer.has_views or not smoother.problem.has_views):
            if self._found is not None:
                self._estimates.add_findings(Finding("calibration not renewed", words={"reason": NOT_SEEN}))
            self._found, self._next_continuation = answer, newest
        if self._found is not None and tracking.solved and newest >= self._next_continuation:
            again = self._continued(tracking, self._found)
            self._next_continuation = newest + self._lag
            if again is not None:
                self._estimates.reset()
                if not self._is_preliminary:  # after the next update: tracking has gone on by one iteration so far
                    self._before_recalibration = self._found.seconds, smoother
                if self._found.seconds >= SlipTest.LEARNT_S:
                    self._tell_of_doubts(self._found)
                self._learnt_s = max(self._learnt_s, self._found.seconds)
                tracking, self._found = again, None
        self._recalibrator.begin(tracking.smoother.state(newest))
        return tracking

    def _continued(self, tracking: Tracking, found: TrackingStart) -> Tracking | None:
        """Tracking with the calibration that was found; None where that does not succeed yet."""
        video = video_of(self._recent)
        start = continued(found, tracking.smoother, self.head.cameras, video)
        if start is None:
            return None
        try:
            learnt_s = max(found.seconds, self._learnt_s)
            tracking = Tracking(self.head, self.settings, start, self._extra, video, learnt_s)
        except SolveError:
            return None
        tracking.let_go(found.moved)
        return tracking

    @property
    def _is_preliminary(self) -> bool:
        """Whether the calibration is that of so little data that it will be corrected."""
        return self.settings.recalibration.use and self._learnt_s < Recalibrator.SETTLED_S

    def _learnt(self, tracking: Tracking, p_world_pelvis: Array) -> EarlierCalibration:
        """What tracking has taught, of wearers at ``(W, 3)`` metres."""
        body_s = 9.0  # of data: a body found from so much is kept over a pause
        problem = tracking.smoother.problem
        names = [one.subject.name for one in self.head.wearers] if self._learnt_s >= body_s else []
        bodies = {name: wearer.skeleton for name, wearer in zip(names, problem.wearers, strict=False)}
        return EarlierCalibration(self._estimates.calibrations(tracking.smoother), p_world_pelvis, bodies)

    def _lose(self, reason: str) -> None:
        """Give up what is tracked, but not what has been learnt of the sensors."""
        self._found = self._before_recalibration = None
        if self._tracking is not None:
            self._earlier = self._learnt(self._tracking, self._paths[-1][1])
            self._estimates.add_findings(_no_poses("until tracking has started again", reason))
        self._tracking = None
        self._next_try = 0

    # Beginning

    def _begin(self, begin: float) -> list[LiveEstimate]:
        newest = self._recent[-1].number
        if len(self._recent) < self._start_frames or newest < self._next_try:
            return []
        try:
            start, tracking = self._fresh_tracking(self._earlier)
        except (RecordingError, SolveError) as error:
            when = f"yet, tracking cannot start at {self._recent[-1].time:.1f} s"
            self._estimates.add_findings(_no_poses(when, str(error)))
            self._next_try = newest + self._lag
            return []
        self._tracking = tracking
        at_once = (finding for finding in start.findings if finding.kind in KNOWN_AT_ONCE)
        self._add_once(start.findings if not self.settings.recalibration.use else at_once)
        gc.freeze()  # what is there stays: the collector need not look at it again in the midst of an update
        answers = self._estimates.initial_estimates(tracking, begin, self._answered + 1)
        self._paths.clear()
        oldest = tracking.smoother.numbers[0]
        self._paths.append((oldest, tracking.smoother.state(oldest).p_world_pelvis))
        return answers

    def _tell_of_doubts(self, start: TrackingStart) -> None:
        """Report, once, a calibration that twice as much data has not settled, and at once what more cannot change."""
        before, self._doubts = self._doubts, {finding.about for finding in start.findings}
        self._add_once(
            finding for finding in start.findings if finding.about in before or finding.kind in KNOWN_AT_ONCE
        )

    def _add_once(self, findings: Iterable[Finding]) -> None:
        new = {finding.about: finding for finding in findings if finding.about not in self._doubts_told}
        self._estimates.add_findings(*new.values())
        self._doubts_told |= new.keys()

    def _fresh_tracking(self, earlier: EarlierCalibration | None) -> tuple[TrackingStart, Tracking]:
        """Tracking with nothing but the last second and what was known earlier."""
        start = start_tracking(MeasuredStretch(self.head, self._recent), self.settings, earlier)
        return start, Tracking(self.head, self.settings, start, self._extra)

    def _is_worth_another_start(self, tracking: Tracking, newest: int) -> bool:
        """Whether a sensor has come, or a camera shows people and no wearer has been found by it yet."""
        measures = 0.9  # of the frames: a sensor that measured in so many is there
        some_video = 10  # frames with people in them, within the time that tracking begins with
        if newest < self._next_try or len(self._paths) < self._start_frames - self._lag:
            return False
        problem = tracking.smoother.problem
        unseen = self.settings.fusion.use_camera and not problem.has_views
        if unseen and sum(len(frame.pixels) > 0 for frame in video_of(self._recent)) > some_video:
            return True
        unused = sorted(set(range(self._worn)) - {column for columns in problem.sensors for column in columns})
        if not unused:
            return False
        seen = np.stack([one.orientation_valid[unused] for one in self._recent]).mean(axis=0)
        return bool(np.any(seen > measures))

    def _started_again(self, tracking: Tracking) -> Tracking:
        """Tracking anew with the last second and all that is known; as it was, if that brings nothing."""
        newest, before = self._recent[-1].number, tracking.smoother.problem
        self._next_try = newest + round(self._patience * self.settings.frame_rate)
        self._patience *= 2
        path = dict(self._paths).get(self._recent[0].number)
        if path is None:
            return tracking
        try:
            _, again = self._fresh_tracking(self._learnt(tracking, path))
        except (RecordingError, SolveError):
            return tracking
        problem = again.smoother.problem
        found = problem.has_views and not before.has_views
        if not found and sum(map(len, problem.sensors)) <= sum(map(len, before.sensors)):
            return tracking
        again.smoother.marginalise_before(newest - self._lag - 1)
        self._estimates.reset()
        subject = "a wearer was found in the video, which" if found else "another sensor"
        self._estimates.add_findings(Finding("recovered", subject=subject, words={"what": "is used from here on"}))
        return again
