"""An MCAP file that another program is still writing, as a live source."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from vip_factors.errors import FileFormatError
from vip_factors.io.codec import time_ns_of
from vip_factors.io.live.growing_file import CAMERA, OnFinding, Route, followed_messages, open_when_it_comes
from vip_factors.io.live.messages import camera_of, head_of, imu_sample_of, video_frame_of, wearer_of
from vip_factors.io.live.session import FindingReporter
from vip_factors.io.live.source import LiveSource
from vip_factors.io.mcap_camera import path_of
from vip_factors.io.mcap_messages import naming
from vip_factors.io.schemas.camera_info_pb2 import CameraInfo
from vip_factors.io.schemas.detections_2d_pb2 import Detections2D
from vip_factors.io.schemas.imu_sample_pb2 import ImuSample
from vip_factors.io.schemas.recording_info_pb2 import SceneInfo
from vip_factors.io.settings import DEFAULT, LiveSourceSettings
from vip_factors.sensors.camera_model import VideoClock
from vip_factors.sensors.live import LiveFinding, LiveSample
from vip_factors.sensors.scene import Camera, Scene

SAMPLES = (ImuSample, Detections2D)
# What comes once, by the names of the messages.
INFO = "RecordingInfo"
CAMERA_INFO, CALIBRATION, POSE = "CameraInfo", "CameraCalibration", "PoseInFrame"


class GrowingFileSource(LiveSource):
    """Follows the file to its footer, or until it has not grown for a while. Nothing is dropped: a file can wait.

    Args:
        path: of the file, which may come a little later.
        settings, on_finding: as of every source.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        settings: LiveSourceSettings = DEFAULT,
        on_finding: Callable[[LiveFinding], None] | None = None,
    ) -> None:
        super().__init__(str(path), settings, drops=False, on_finding=on_finding)
        self._path = Path(path)

    def _read(self) -> None:
        reporter = FindingReporter(self._put)

        def on_finding(kind: str, sentence: str) -> None:
            reporter.report(kind, f"{self._path}: {sentence}")

        head, early = _Head(on_finding), list[tuple[Route, Any]]()  # samples before the set-up is complete
        with open_when_it_comes(self._path, self._settings, self._stop) as file:
            for route, message in followed_messages(self._path, file, self._stop, on_finding):
                if self._stop.is_set():
                    return
                if self._setup is not None:
                    self._put_samples(head, [(route, message)])
                    continue
                head.take(route, message)
                if route.kind in SAMPLES:
                    early.append((route, message))
                if head.is_complete or len(early) > self._settings.queue_limit:
                    self._begin(head)
                    self._put_samples(head, early)
        reporter.close()
        if self._setup is None and not self._stop.is_set():
            self._begin(head)
            self._put_samples(head, early)

    def _begin(self, head: "_Head") -> None:
        with naming(self._path):
            self._announce(head.setup())

    def _put_samples(self, head: "_Head", messages: list[tuple[Route, Any]]) -> None:
        for route, message in messages:
            sample = head.sample(route, message)
            if sample is not None:
                self._put(sample)


class _Head:
    """Takes the messages that come once, says when the set-up is complete, and then turns messages into samples.

    A file without a SceneInfo before its first sample is a recording of one wearer.
    """

    def __init__(self, on_finding: OnFinding) -> None:
        self._on_finding = on_finding
        self._scene: SceneInfo | None = None
        self._once: dict[tuple[str, str], Any] = {}  # by owner and name of the message; the first pose of a camera
        self._has_samples = False
        self._names: dict[str, str] = {}  # of carriers, by what the topics begin with
        self._clocks: dict[str, VideoClock] = {}
        self._cameras: dict[str, Camera] = {}
        self._start_ns = 0

    def take(self, route: Route, message: Any) -> None:
        """Take in a message, a sample's too."""
        if route.kind is SceneInfo:
            self._scene = message
        elif route.kind in SAMPLES:
            self._has_samples = True
        else:
            self._once.setdefault((route.owner, route.kind.DESCRIPTOR.name), message)

    @property
    def missing(self) -> list[str]:
        """What a set-up still needs, in words."""
        needed = [(owner, INFO) for owner in self._wearer_topics]
        needed += [(owner, kind) for owner in self._camera_topics for kind in (CAMERA_INFO, CALIBRATION)]
        lacks = [f"{kind} of {owner or 'the wearer'}" for owner, kind in needed if (owner, kind) not in self._once]
        return lacks or ([] if self._scene or self._has_samples else ["SceneInfo, or a sample"])

    @property
    def is_complete(self) -> bool:
        """Whether nothing is missing, nor the known pose of a camera that stands still yet to come."""
        standing = [owner for owner, info in self._camera_infos.items() if _stands_known(info)]
        return not self.missing and all((owner, POSE) in self._once for owner in standing)

    def setup(self) -> Scene:
        """The set-up, which names carriers and clocks; what of the cameras cannot be used ahead of time is told.

        Raises:
            InputError: for what no wearer or camera can be, or if something is missing.
        """
        if self.missing:
            raise FileFormatError(f"expected a recording or a scene; there is no {', no '.join(self.missing)}")
        recordings = [self._once[owner, INFO] for owner in self._wearer_topics]
        infos, head = self._camera_infos, recordings[0]
        name = self._scene.name if self._scene is not None else head.name
        self._start_ns = time_ns_of(head.start)
        wearers = [
            wearer_of(name, recording.subject, recording.placement, recording.initial_pose, self._start_ns)
            for recording in recordings
        ]
        self._cameras = {owner: self._camera(owner) for owner in infos}
        setup = head_of(name, wearers, list(self._cameras.values()))
        self._names = dict(zip(self._wearer_topics, [wearer.subject.name for wearer in wearers], strict=True))
        self._names |= {owner: camera.name for owner, camera in self._cameras.items()}
        self._clocks = {owner: VideoClock(info.time_offset_s, info.time_drift) for owner, info in infos.items()}
        for info in infos.values():
            if info.moving and info.known_poses:
                sentence = (
                    f"camera '{info.name}' is said to move on a known path, which a growing file does not hold yet: "
                    "its poses are estimated instead"
                )
                self._on_finding(sentence, sentence)
        return setup

    @property
    def _wearer_topics(self) -> list[str]:
        """What the topics of each wearer begin with."""
        return [""] if self._scene is None else list(self._scene.wearer_topics)

    @property
    def _camera_topics(self) -> list[str]:
        """What the topics of each camera begin with."""
        if self._scene is None:
            return []
        return [*([CAMERA] if self._scene.has_camera else []), *self._scene.further_camera_topics]

    @property
    def _camera_infos(self) -> dict[str, CameraInfo]:
        """Of the cameras of which it has come."""
        infos = {owner: self._once.get((owner, CAMERA_INFO)) for owner in self._camera_topics}
        return {owner: info for owner, info in infos.items() if info is not None}

    def _camera(self, owner: str) -> Camera:
        info, calibration = self._once[owner, CAMERA_INFO], self._once[owner, CALIBRATION]
        pose = self._once.get((owner, POSE)) if _stands_known(info) else None
        return camera_of(info, calibration, None if pose is None else path_of([pose], self._start_ns))

    def sample(self, route: Route, message: Any) -> LiveSample | None:
        """A sample; None for other messages, and for one that cannot be used, which is told."""
        if route.kind not in SAMPLES:
            return None
        name = self._names.get(route.owner)
        if name is None:
            self._on_finding(
                f"owner {route.owner}",
                f"{route.channel.topic} belongs to nobody whom the file's beginning describes: its messages are left "
                "out",
            )
            return None
        camera = self._cameras.get(route.owner)
        try:
            if route.kind is ImuSample:
                mount = camera.mount if camera is not None else None
                sensor = mount.imu.name if mount is not None else route.channel.topic.rpartition("/")[2]
                return imu_sample_of(message, name, self._start_ns, sensor)
            keypoints = None if camera is None else len(camera.keypoints)
            return video_frame_of(message, name, self._start_ns, keypoints, self._clocks.get(route.owner))
        except FileFormatError as error:
            self._on_finding(route.kind.DESCRIPTOR.name, str(error))
            return None


def _stands_known(info: CameraInfo) -> bool:
    """Whether a camera stands still at a pose that the file tells."""
    return info.known_poses == 1 and not info.moving
