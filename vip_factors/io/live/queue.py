"""The queue between the thread that reads a source and the tracker, which may be busy for longer than samples wait."""

import time
from collections import deque
from collections.abc import Callable
from itertools import count
from threading import Condition

from vip_factors.sensors.live import ImuSample, LiveFinding, LiveItem, LiveLoss, VideoFrame

KEPT = 8  # one IMU sample in so many stays where they must be dropped: who is late is to catch up, not to stay late
KEPT_WAIT = 0.45  # likewise of the seconds that samples may wait: the gap is to be one over which tracking goes on
AGAIN_WAIT = 0.4  # and of these, once some were dropped lately: a start takes long once, a slow machine always
LATELY_S = 10.0
VIDEO_WAIT = 0.8  # of these seconds, that video frames may wait: without them a tracker is faster, and may catch up
MOST_FINDINGS = 1000  # that wait: somebody who connects and errs all the time must not fill the memory
SAY_EVERY = 1.0  # seconds between findings about dropped samples: the tracker spares itself as long as they come
TELL_EVERY = 10.0  # seconds between those that are for people


class LiveQueue:
    """Items of one source in the order of their arrival; of findings, the newest thousand wait.

    When more samples than ``limit`` wait, either the reader waits too (a file has time), or the oldest video frame is
    dropped, and without one all IMU samples but the newest: a pose without a video frame is still a pose, and old
    samples are of less use than new ones. So it is with samples that have waited for longer than ``longest_wait``. How
    many were dropped is said in a finding, at most once a second.

    Args:
        limit: of waiting samples.
        drops: False makes :meth:`put` wait instead of dropping.
        clock: monotonic seconds.
        longest_wait: seconds.
    """

    def __init__(
        self, limit: int, drops: bool = True, clock: Callable[[], float] = time.monotonic,
        longest_wait: float = float("inf"),
    ) -> None:  # fmt: skip
        self._limit, self._longest_wait = limit, longest_wait
        self._drops = drops
        self._clock = clock
        self._changed = Condition()
        self._number = count()
        # Each with its number and time of arrival; by the numbers the three together keep the order.
        self._frames: deque[tuple[int, float, LiveItem]] = deque()
        self._imu: deque[tuple[int, float, LiveItem]] = deque()
        self._findings: deque[tuple[int, float, LiveItem]] = deque()
        self._lost = {VideoFrame: 0, ImuSample: 0}  # since it was told last
        self._losing = False  # whether some were since it was said last
        self._said = self._told = self._dropped = -float("inf")  # s: some for being late, the last one
        self._finished = False
        self._closed = False

    def __len__(self) -> int:
        return len(self._frames) + len(self._imu) + len(self._findings)

    def put(self, item: LiveItem) -> None:
        """Append an item; does nothing once the queue is closed."""
        with self._changed:
            if isinstance(item, LiveFinding):
                self._findings.append((next(self._number), self._clock(), item))
                if len(self._findings) > MOST_FINDINGS:
                    self._findings.popleft()
            else:
                if not self._drops:
                    self._changed.wait_for(lambda: self._closed or self._waiting < self._limit)
                if self._closed:
                    return
                kind = self._frames if isinstance(item, VideoFrame) else self._imu
                now = self._clock()
                kind.append((next(self._number), now, item))
                if self._waiting > self._limit:
                    self._drop()
                if self._drops:
                    self._drop_late(now)
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
            _, _, item = min(waiting, key=lambda kind: kind[0][0]).popleft()
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

    def _drop_late(self, now: float) -> None:
        """What has waited for too long: all video frames but the newest, and if that does not help, samples."""
        longest = self._longest_wait * (AGAIN_WAIT if now - self._dropped < LATELY_S else 1.0)
        if self._frames and now - self._frames[0][1] > VIDEO_WAIT * longest:
            while len(self._frames) > 1:
                self._lose(self._frames)
        if self._imu and now - self._imu[0][1] > longest:
            self._dropped, since = now, now - KEPT_WAIT * longest
            for kind in (self._imu, self._frames):
                while kind and kind[0][1] < since:
                    self._lose(kind)

    def _lose(self, kind: deque[tuple[int, float, LiveItem]]) -> None:
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
