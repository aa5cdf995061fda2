"""A recording as a live source: as fast as it is read, or in its own time."""

import time
from collections.abc import Callable

from vip_factors.errors import InputError
from vip_factors.io.live.settings import DEFAULT, LiveSourceSettings
from vip_factors.io.live.source import LiveSource
from vip_factors.sensors.live import LiveFinding, LiveSetup, live_samples
from vip_factors.sensors.scene import Scene


class RecordingSource(LiveSource):
    """The samples of a scene in the order of their times.

    As fast as it goes, nothing is dropped; in its own time, a tracker that is too slow loses samples, as it would
    lose those of real sensors.

    Args:
        scene: to be played back.
        real_time: whether each sample comes when it is due.
        speed: multiple of the scene's own time.
        settings, tell: as of every source.
    """

    def __init__(
        self,
        scene: Scene,
        real_time: bool = False,
        speed: float = 1.0,
        settings: LiveSourceSettings = DEFAULT,
        tell: Callable[[LiveFinding], None] | None = None,
    ) -> None:
        if not 0 < speed < float("inf"):
            raise InputError(f"speed {speed}: expected a positive multiple of the recording's own time")
        super().__init__(f"recording '{scene.name}'", settings, drops=real_time, tell=tell)
        self._scene = scene
        self._speed = speed if real_time else None

    def _read(self) -> None:
        samples = live_samples(self._scene)
        self._announce(LiveSetup.of(self._scene))
        begun, first = time.monotonic(), None
        for sample in samples:
            if self._speed is not None:
                first = sample.time if first is None else first
                due = begun + (sample.time - first) / self._speed - time.monotonic()
                if due > 0:
                    self._stop.wait(due)
            if self._stop.is_set():
                return
            self._put(sample)
