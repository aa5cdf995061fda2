"""An MCAP file that another program is still writing, as a live source."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from vip_factors.errors import FileFormatError
from vip_factors.io.live.growing_channels import Channels, Route
from vip_factors.io.live.growing_file import GrowingFile
from vip_factors.io.live.growing_setup import SAMPLES, GatheredSetup
from vip_factors.io.live.messages import imu_sample_of, video_frame_of
from vip_factors.io.live.session import Throttle
from vip_factors.io.live.source import DEFAULT, LiveSource, LiveSourceSettings
from vip_factors.io.mcap_messages import naming
from vip_factors.io.schemas.imu_sample_pb2 import ImuSample
from vip_factors.sensors.camera_model import VideoClock
from vip_factors.sensors.live import LiveFinding, LiveSample, LiveSetup


class GrowingFileSource(LiveSource):
    """Follows the file to its footer, or until it has not grown for a while. Nothing is dropped: a file can wait.

    Args:
        path: of the file, which may come a little later.
        settings, tell: as of every source.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        settings: LiveSourceSettings = DEFAULT,
        tell: Callable[[LiveFinding], None] | None = None,
    ) -> None:
        super().__init__(str(path), settings, drops=False, tell=tell)
        self._path = Path(path)

    def _read(self) -> None:
        throttle = Throttle(self._put)

        def tell(kind: str, sentence: str) -> None:
            throttle.tell(kind, f"{self._path}: {sentence}")

        file = GrowingFile(self._path, self._settings, self._stop, tell)
        reader = _SceneReader(tell)
        for route, message in Channels(tell).messages(file.records()):
            throttle.flush()
            if self._stop.is_set():
                return
            if reader.setup_known:
                self._sample(reader, route, message)
            else:
                reader.gather(route, message)
                if reader.whole or reader.held > self._settings.queue_limit:
                    self._begin(reader)
        throttle.flush(every=True)
        if not reader.setup_known and not self._stop.is_set():
            self._begin(reader)

    def _begin(self, reader: "_SceneReader") -> None:
        with naming(self._path):
            self._announce(reader.begin())
        for route, message in reader.release():
            self._sample(reader, route, message)

    def _sample(self, reader: "_SceneReader", route: Route, message: Any) -> None:
        sample = reader.sample(route, message)
        if sample is not None:
            self._put(sample)


class _SceneReader:
    """Turns the messages of a file into a set-up and samples."""

    def __init__(self, tell: Callable[[str, str], None]) -> None:
        self._tell = tell
        self._gathered = GatheredSetup()
        self._held: list[tuple[Route, Any]] = []
        self._names: dict[str, str] = {}
        self._clocks: dict[str, VideoClock] = {}
        self._keypoints: dict[str, int] = {}
        self._mounts: dict[str, str] = {}
        self._start_ns = 0
        self.setup_known = False

    @property
    def held(self) -> int:
        """Samples that came before the set-up was whole."""
        return len(self._held)

    @property
    def whole(self) -> bool:
        """Whether nothing is missing of the set-up."""
        return not self._gathered.missing and not self._gathered.awaits_poses

    def gather(self, route: Route, message: Any) -> None:
        """A message before the set-up is known."""
        self._gathered.take(route, message)
        if route.kind in SAMPLES:
            self._held.append((route, message))

    def begin(self) -> LiveSetup:
        """The set-up; samples can be read from now on."""
        setup = self._gathered.setup()
        for sentence in self._gathered.findings():
            self._tell(sentence, sentence)
        self._start_ns = setup.start_ns
        self._names = self._gathered.names(setup)
        self._clocks = self._gathered.clocks()
        self._keypoints = {camera.name: len(camera.keypoints) for camera in setup.cameras}
        self._mounts = {camera.name: camera.mount.sensor for camera in setup.cameras if camera.mount is not None}
        self.setup_known = True
        return setup

    def release(self) -> list[tuple[Route, Any]]:
        """The samples that were held."""
        held, self._held = self._held, []
        return held

    def sample(self, route: Route, message: Any) -> LiveSample | None:
        """A sample; None for other messages, and for one that cannot be used, which is told."""
        if route.kind not in SAMPLES:
            return None
        name = self._names.get(route.owner)
        if name is None:
            self._tell(
                f"owner {route.owner}",
                f"{route.channel.topic} belongs to nobody whom the file's beginning describes: its messages are left "
                "out",
            )
            return None
        try:
            if route.kind is ImuSample:
                sensor = self._mounts.get(name) or route.channel.topic.rpartition("/")[2]
                return imu_sample_of(message, name, self._start_ns, sensor)
            clock = self._clocks.get(route.owner)
            return video_frame_of(message, name, self._start_ns, self._keypoints.get(name), clock)
        except FileFormatError as error:
            self._tell(route.kind.DESCRIPTOR.name, str(error))
            return None
