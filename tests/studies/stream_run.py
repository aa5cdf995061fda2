"""A scene's samples through the tracker: what it answered, when, how wrong, and when it is good again."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tests.studies.faults import Fault
from tests.studies.study import mean
from vip_factors.body.kinematics import Motion, forward_kinematics
from vip_factors.body.skeleton import Skeleton
from vip_factors.evaluate.metrics import POSITION_JOINTS, indices, resample
from vip_factors.geometry.poses import align_rigid, align_yaw
from vip_factors.geometry.rotations import Array
from vip_factors.io.live.settings import LiveSourceSettings
from vip_factors.io.live.source import LiveQueue
from vip_factors.live.settings import LiveSettings
from vip_factors.live.tracker import FixedLagTracker
from vip_factors.live_estimate import LiveEstimate, LivePose
from vip_factors.sensors.live import LiveFinding, LiveLoss, LiveSample
from vip_factors.sensors.scene import Scene

GOOD = 1.2  # times the error of the undisturbed stream
SUSTAINED_S = 1.0
GAUGE_S = 2.0  # before the fault, from which place and heading of the estimate's world are taken


@dataclass(frozen=True)
class StreamRun:
    """What came of a stream.

    Attributes:
        answers: in order.
        arrival: of each answer, the scene's own time (s) when it was given.
        told: sentences of the queue, with when.
        clock_shift_s: by which the answers' times lag behind the scene's at the end.
    """

    answers: tuple[LiveEstimate, ...]
    arrival: tuple[float, ...]
    told: tuple[tuple[float, str], ...] = ()
    clock_shift_s: float = 0.0

    @property
    def findings(self) -> list[tuple[float, str]]:
        """All sentences with the time at which they were said."""
        said = [
            (time, sentence)
            for answer, time in zip(self.answers, self.arrival, strict=True)
            for sentence in answer.findings
        ]
        return sorted([*said, *self.told], key=lambda one: one[0])

    def latency(self, start: float, end: float) -> float:
        """How old the newest pose was at most, seconds, of answers given from ``start`` to ``end``."""
        ages = [
            arrival - one.time
            for one, arrival in zip(self.answers, self.arrival, strict=True)
            if start <= arrival < end and one.wearers[0].smoothed is not None
        ]
        return max(ages, default=float("nan"))


def run_stream(samples: Iterable[LiveSample], setup: Scene, settings: LiveSettings, fault: Fault | None) -> StreamRun:
    """Track a stream, with a fault if there is one."""
    sent = _Sent(samples)
    changed = iter(sent) if fault is None else fault.change(sent)
    if fault is not None and fault.overload_s:
        return _overloaded(list(changed), setup, settings, fault)
    tracker, again = FixedLagTracker(setup, settings), fault is not None and fault.restart
    answers: list[LiveEstimate] = []
    arrival: list[float] = []
    for sample in changed:
        if fault is not None and again and sample.time >= fault.end:
            again = False
            answers += (rest := tracker.finish())
            arrival += [sent.now] * len(rest)
            tracker = FixedLagTracker(_unposed(setup), settings)
        new = tracker.push(sample)
        answers += new
        arrival += [sent.now] * len(new)
    rest = tracker.finish()
    run = StreamRun((*answers, *rest), (*arrival, *[sent.now] * len(rest)))
    return _on_the_scenes_clock(run, fault) if fault is not None and fault.jump else run


class _Sent:
    """Undisturbed samples; ``now`` is the newest one's time, when what a fault makes of it comes."""

    def __init__(self, samples: Iterable[LiveSample]) -> None:
        self._samples, self.now = samples, 0.0

    def __iter__(self) -> Iterator[LiveSample]:
        for sample in self._samples:
            self.now = max(self.now, sample.time)
            yield sample


def _unposed(setup: Scene) -> Scene:
    return replace(setup, wearers=tuple(replace(one, initial_pose="none") for one in setup.wearers))


def _on_the_scenes_clock(run: StreamRun, fault: Fault) -> StreamRun:
    """Answers after a leap of all clocks, at the times of what they show: a stream cannot know how long it took."""
    ages = np.array([arrival - one.time for one, arrival in zip(run.answers, run.arrival, strict=True)])
    arrival = np.array(run.arrival)
    before, after = arrival < fault.begin, arrival > fault.begin + 2
    shift = float(np.median(ages[after]) - np.median(ages[before])) if after.any() and before.any() else 0.0
    moved = tuple(
        _moved(one, shift) if time >= fault.begin else one
        for one, time in zip(run.answers, run.arrival, strict=True)
    )  # fmt: skip
    return replace(run, answers=moved, clock_shift_s=shift)


def _moved(answer: LiveEstimate, shift: float) -> LiveEstimate:
    wearers = tuple(
        replace(
            one,
            newest=replace(one.newest, time=one.newest.time + shift),
            smoothed=None if one.smoothed is None else replace(one.smoothed, time=one.smoothed.time + shift),
        )
        for one in answer.wearers
    )
    return replace(answer, time=answer.time + shift, wearers=wearers)


def _overloaded(samples: Sequence[LiveSample], setup: Scene, settings: LiveSettings, fault: Fault) -> StreamRun:
    """The queue between a source and a tracker that takes its time, on a clock that is made: any machine gives this."""
    now = 0.0
    queue = LiveQueue(LiveSourceSettings().queue_limit, clock=lambda: now)
    tracker = FixedLagTracker(setup, settings)
    answers: list[LiveEstimate] = []
    arrival: list[float] = []
    told: list[tuple[float, str]] = []
    waiting: Iterator[LiveSample] = iter(samples)
    coming = next(waiting, None)
    while coming is not None or len(queue):
        if not len(queue) and coming is not None:
            now = max(now, coming.time)
        while coming is not None and coming.time <= now:
            queue.put(coming)
            coming = next(waiting, None)
        item = queue.get()
        if isinstance(item, LiveLoss):
            tracker.note_loss()
            told += [] if item.again else [(now, item.sentence)]
        elif isinstance(item, LiveFinding):
            told.append((now, item.sentence))
        elif item is not None:
            new = tracker.push(item)
            slow = fault.begin <= now < fault.end
            now += len(new) * (fault.overload_s if slow else 0.2 / settings.frame_rate)
            answers += new
            arrival += [now] * len(new)
    rest = tracker.finish()
    return StreamRun((*answers, *rest), (*arrival, *[now] * len(rest)), tuple(told))


@dataclass(frozen=True)
class ErrorOverTime:
    """Errors on the truth's own frames; NaN where there was no answer.

    Attributes:
        rate: frames per second.
        mpjpe_mm: ``(T,)``, 14 joints after a rigid alignment of each frame.
        place_cm: ``(T,)`` of the pelvis, in the world that the seconds before the fault agree on.
    """

    rate: float
    mpjpe_mm: Array
    place_cm: Array

    def mean(self, start: float, end: float) -> float:
        """MPJPE from ``start`` to ``end`` (s); NaN without an answer in that time."""
        return mean(self.mpjpe_mm[self._rows(start, end)])

    def place(self, start: float, end: float) -> float:
        """Error of the place, cm, likewise."""
        return mean(self.place_cm[self._rows(start, end)])

    def missing(self, start: float, end: float) -> int:
        """Frames without an answer."""
        return int(np.isnan(self.mpjpe_mm[self._rows(start, end)]).sum())

    def _rows(self, start: float, end: float) -> slice:
        return slice(max(0, round(start * self.rate)), max(0, round(min(end, 1e6) * self.rate)))


def error_over_time(poses: Sequence[LivePose], skeleton: Skeleton, truth: Motion, rate: float, until: float) -> Array:
    """Rows ``(T, 2)`` of MPJPE in mm and place in cm at ``k / rate``; ``until``: when the fault begins (s)."""
    frames = int(np.floor((len(truth) - 1) / truth.rate * rate + 1e-6)) + 1
    found: Array = np.full((frames, 2), np.nan)
    poses = [one for one in poses if 0 <= _row(one.time, rate) < frames]
    if not poses:
        return found
    row = np.array([_row(one.time, rate) for one in poses])
    body = forward_kinematics(
        skeleton, np.stack([one.R_parent_child for one in poses]), np.stack([one.p_world_pelvis for one in poses])
    )
    offset = poses[0].time - row[0] / rate  # frames lie where the stream put them
    true = resample(truth, max(0.0, offset), rate, frames - 1 if offset > 0 else frames).state.p_world_joint
    kept = row < len(true)
    ours, row = body.p_world_joint[kept], row[kept]
    true = true[row]
    joints = indices(POSITION_JOINTS)
    aligned = align_rigid(ours[:, joints], true[:, joints]).apply(ours)
    found[row, 0] = 1e3 * np.linalg.norm(aligned - true, axis=-1)[:, joints].mean(axis=1)
    before = (row >= (until - GAUGE_S) * rate) & (row < until * rate)
    if before.any():
        gauge = align_yaw(ours[before].reshape(-1, 3), true[before].reshape(-1, 3))
        moved = gauge.apply(ours.reshape(-1, 3)).reshape(ours.shape)
        found[row, 1] = 1e2 * np.linalg.norm(moved[:, 0] - true[:, 0], axis=1)
    return found


def _row(time: float, rate: float) -> int:
    """Number of the nearest frame; halfway between two always the later one, so that each has one row."""
    return int(np.floor(time * rate + 0.5 + 1e-6))


def seconds_until_good(error: ErrorOverTime, undisturbed: ErrorOverTime, start: float) -> float:
    """Seconds from ``start`` until a second begins whose mean error is at most 1.2 times the undisturbed stream's in
    the same second; NaN if none does. A frame without an answer is not good."""
    good = _good(error, undisturbed, start)
    return float(np.argmax(good) / error.rate) if good.any() else float("nan")


def bad_seconds(error: ErrorOverTime, undisturbed: ErrorOverTime, start: float) -> float:
    """How many of the seconds from ``start`` on are not so: what gets worse again later counts too."""
    return float(np.sum(~_good(error, undisturbed, start)) / error.rate)


def _good(error: ErrorOverTime, undisturbed: ErrorOverTime, start: float) -> np.ndarray:
    """Of each second, one for every frame from ``start`` on that it can begin with."""
    length = round(SUSTAINED_S * error.rate)
    begin = max(0, round(start * error.rate))
    frames = min(len(error.mpjpe_mm), len(undisturbed.mpjpe_mm))
    good = []
    for row in range(begin, frames - length + 1):
        ours, theirs = error.mpjpe_mm[row : row + length], undisturbed.mpjpe_mm[row : row + length]
        seen = np.isfinite(theirs)
        whole = bool(seen.any() and np.all(np.isfinite(ours[seen])))
        good.append(whole and bool(ours[seen].mean() <= GOOD * theirs[seen].mean()))
    return np.array(good, bool)
