"""The queue between the thread that reads a source and the tracker, which may be busy for longer than samples wait."""

import time
from collections import deque
from collections.abc import Callable
from itertools import count
from threading import Condition

from vip_factors.sensors.live import ImuSample, LiveFinding, LiveItem, LiveLoss, VideoFrame

KEPT = 8  # one IMU sample in so many stays where they must be dropped: who is late is to catch up, not to stay late
MOST_FINDINGS = 1000  # that wait: somebody who connects and errs all the time must not fill the memory
SAY_EVERY = 1.0  # seconds between findings about dropped samples: the tracker is to know why there is a gap
TELL_EVERY = 10.0  # seconds between those that are for people


class LiveQueue:
    """Items of one source in the order of their arrival; of findings, the newest thousand wait.

    When more samples than ``limit`` wait, either the reader waits too (a file has time), or the oldest video frame is
    dropped, and without one all IMU samples but the newest: a pose without a video frame is still a pose, and old
    samples are of less use than new ones. How many were dropped is said in a finding, at most once a second.

    Args:
        limit: of waiting samples.
        drops: False makes :meth:`put` wait instead of dropping.
        clock: monotonic seconds.
    """

    def __init__(self, limit: int, drops: bool = True, clock: Callable[[], float] = time.monotonic) -> None:
        self._limit = limit
        self._drops = drops
        self._clock = clock
        self._changed = Condition()
        self._number = count()
        # Each with its number of arrival, so that the three together keep the order.
        self._frames: deque[tuple[int, LiveItem]] = deque()
        self._imu: deque[tuple[int, LiveItem]] = deque()
        self._findings: deque[tuple[int, LiveItem]] = deque()
        self._lost = {VideoFrame: 0, ImuSample: 0}  # since it was told last
        self._losing = False  # whether some were since it was said last
        self._said = self._told = -float("inf")
        self._finished = False
        self._closed = False

    def __len__(self) -> int:
        return len(self._frames) + len(self._imu) + len(self._findings)

    def put(self, item: LiveItem) -> None:
        """Append an item; does nothing once the queue is closed."""
        with self._changed:
            if isinstance(item, LiveFinding):
                self._findings.append((next(self._number), item))
                if len(self._findings) > MOST_FINDINGS:
                    self._findings.popleft()
            else:
                if not self._drops:
                    self._changed.wait_for(lambda: self._closed or self._waiting < self._limit)
                if self._closed:
                    return
                kind = self._frames if isinstance(item, VideoFrame) else self._imu
                kind.append((next(self._number), item))
                if self._waiting > self._limit:
                    self._drop()
            self._changed.notify_all()

    def get(self) -> LiveItem | None:
        """The next item, waiting for one; None after the last."""
        with self._changed:
            self._changed.wait_for(lambda: len(self) > 0 or self._finished or self._closed)
            if self._closed:
                return None
            finding = self._loss()
            if finding is not None:
                return finding
            waiting = [kind for kind in (self._frames, self._imu, self._findings) if kind]
            if not waiting:
                return None
            _, item = min(waiting, key=lambda kind: kind[0][0]).popleft()
            self._changed.notify_all()
            return item

    def finish(self) -> None:
        """Nothing more will come: :meth:`get` ends after what is there."""
        with self._changed:
            self._finished = True
            self._changed.notify_all()

    def close(self) -> None:
        """Nothing more is wanted: whoever waits, returns."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    @property
    def _waiting(self) -> int:
        return len(self._frames) + len(self._imu)

    def _drop(self) -> None:
        if self._frames:
            self._lose(self._frames)
            return
        left = max(1, self._limit // KEPT)
        while len(self._imu) > left:
            self._lose(self._imu)

    def _lose(self, kind: deque[tuple[int, LiveItem]]) -> None:
        self._lost[VideoFrame if kind is self._frames else ImuSample] += 1
        self._losing = True
        kind.popleft()

    def _loss(self) -> LiveLoss | None:
        """That some were dropped since it was said last, if it is time to say it."""
        now = self._clock()
        frames, samples = self._lost[VideoFrame], self._lost[ImuSample]
        telling = frames + samples > 0 and (now - self._told >= TELL_EVERY or self._finished)
        if not telling and not (self._losing and now - self._said >= SAY_EVERY):
            return None
        self._said, self._losing = now, False
        if telling:
            self._told, self._lost = now, {VideoFrame: 0, ImuSample: 0}
        what = [f"{number} {name}" for number, name in ((frames, "video frames"), (samples, "IMU samples")) if number]
        return LiveLoss(
            f"the tracker does not keep up: {' and '.join(what)} were dropped; this machine is too slow, or busy: use "
            "fewer frames per second (--frame-rate), fewer wearers, fewer cameras or a shorter lag",
            again=not telling,
        )
