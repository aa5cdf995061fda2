"""Video frames that wait for the frame they belong to."""

import math
from bisect import insort
from collections import deque

from vip_factors.sensors.live import VideoFrame

MOST_WAITING = 1024  # half a minute of one camera at 30 Hz: no sensor is so far behind the video
MOST_REMEMBERED = 64  # handed out before: a link that sends again does so within moments
SAME_TIME = 1e-6  # s


class VideoQueue:
    """Video frames in the order of time."""

    def __init__(self) -> None:
        self._waiting: list[tuple[float, str, int, VideoFrame]] = []
        self._handed_out: deque[tuple[str, float]] = deque(maxlen=MOST_REMEMBERED)
        self._arrived = 0

    @property
    def first_time(self) -> float:
        """Seconds of the earliest frame that waits; infinite if none does."""
        return self._waiting[0][0] if self._waiting else math.inf

    def add(self, time: float, frame: VideoFrame) -> bool:
        """A frame at ``time`` on the stream's clock; False if it is there already. The oldest makes room."""
        waiting = [(camera, moment) for moment, camera, _, _ in self._waiting[-MOST_REMEMBERED:]]
        for camera, moment in (*waiting, *self._handed_out):
            if camera == frame.camera and abs(moment - time) <= SAME_TIME:
                return False
        if len(self._waiting) >= MOST_WAITING:
            self._waiting.pop(0)
        self._arrived += 1
        insort(self._waiting, (time, frame.camera, self._arrived, frame))
        return True

    def take(self, before: float) -> list[tuple[float, VideoFrame]]:
        """Those earlier than ``before``, in the order of time."""
        count = sum(entry[0] < before for entry in self._waiting)
        taken, self._waiting = self._waiting[:count], self._waiting[count:]
        self._handed_out.extend((camera, time) for time, camera, _, _ in taken)
        return [(time, frame) for time, _, _, frame in taken]
