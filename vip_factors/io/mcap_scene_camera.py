"""One camera of a scene, with what was detected in its frames and what is known of it, on topics of its own."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from vip_factors.io.mcap_camera import (
    camera_info_message,
    image_messages,
    intrinsics_message,
    intrinsics_of,
    mount_of,
    path_messages,
    path_of,
    video_of,
)
from vip_factors.io.mcap_contents import McapMessages
from vip_factors.io.mcap_detections import DetectionTruth, detection_messages, detections_of
from vip_factors.io.mcap_imu import read_streams, sample_messages
from vip_factors.io.mcap_messages import calibration_message, calibration_of, of_topic, warn
from vip_factors.io.mcap_writer import MessageWriter, TimedMessage
from vip_factors.io.schemas.calibration_estimate_pb2 import CalibrationEstimate
from vip_factors.io.schemas.camera_info_pb2 import CameraInfo, CameraTruth
from vip_factors.io.schemas.detections_2d_pb2 import Detections2D
from vip_factors.sensors.scene import Camera, CameraMount, SceneTruth


@dataclass(frozen=True)
class CameraTopics:
    """Where one camera's messages are: those of the first are below ``/camera``, others' below ``/camera/<name>``."""

    prefix: str = "/camera"

    @classmethod
    def of(cls, name: str) -> "CameraTopics":
        """Those of a further camera."""
        return cls("/camera/" + name.replace("%", "%25").replace("/", "%2F"))

    def __call__(self, what: str) -> str:
        """The topic of info, calibration, detections, imu, pose or image."""
        return f"{self.prefix}/{what}"

    def truth(self, what: str) -> str:
        """The topic of what is known: info, pose or calibration."""
        return f"/truth{self.prefix}/{what}"


def camera_messages(
    writer: MessageWriter, topics: CameraTopics, camera: Camera, truth: SceneTruth | None, start_ns: int, path: Path
) -> list[Iterable[TimedMessage]]:
    """Write what comes once; returned is what comes in time."""
    writer.write(topics("info"), camera_info_message(camera, path), start_ns)
    writer.write(topics("calibration"), intrinsics_message(camera.model, camera.name, start_ns), start_ns)
    streams: list[Iterable[TimedMessage]] = [
        detection_messages(writer, topics("detections"), camera, truth, start_ns),
        image_messages(writer, topics("image"), camera, start_ns),
    ]
    if camera.known_path is not None:
        streams.append(path_messages(writer, topics("pose"), camera.known_path, start_ns))
    if camera.mount is not None:
        streams.append(sample_messages(writer, topics("imu"), camera.mount.imu, start_ns))
    if truth is not None:
        has_pixels = truth.pixels is not None
        told = CameraTruth(
            time_offset_s=truth.time_offset, time_drift=truth.time_drift, poses=len(truth.camera), has_pixels=has_pixels
        )
        writer.write(topics.truth("info"), told, start_ns)
        if truth.camera_calibration is not None:
            one = calibration_message({camera.name: truth.camera_calibration})
            writer.write(topics.truth("calibration"), one, start_ns)
        streams.append(path_messages(writer, topics.truth("pose"), truth.camera, start_ns))
    return streams


def camera_of(
    path: Path, messages: Sequence[McapMessages], topics: CameraTopics, start_ns: int
) -> tuple[Camera | None, DetectionTruth | None]:
    """The camera of a file and who is known to be who; None, and a warning, if too little of it is left."""
    from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
    from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage

    infos = of_topic(path, messages, topics("info"), CameraInfo)
    intrinsics = of_topic(path, messages, topics("calibration"), CameraCalibration)
    if not infos or not intrinsics:
        expected = topics("info"), topics("calibration")
        found = expected[0] if infos else expected[1] if intrinsics else "neither"
        warn(path, f"the camera is left out: expected topics {' and '.join(expected)}, found {found}")
        return None, None
    info = infos[-1]
    seen = of_topic(path, messages, topics("detections"), Detections2D)
    if len(seen) < info.frames:
        warn(path, f"camera '{info.name}': {len(seen)} of {info.frames} video frames are left")
    detections, known = detections_of(info, seen)
    images = of_topic(path, messages, topics("image"), CompressedImage)
    camera = Camera(
        name=info.name,
        model=intrinsics_of(intrinsics[-1]),
        detections=detections,
        moving=info.moving,
        mount=_mount(path, messages, topics, info, start_ns),
        known_path=path_of(path, messages, topics("pose"), start_ns),
        time_offset=info.time_offset_s,
        time_drift=info.time_drift,
        video=video_of(info.video, images, path) if info.HasField("video") else None,
    )
    return camera, known


def _mount(
    path: Path, messages: Sequence[McapMessages], topics: CameraTopics, info: CameraInfo, start_ns: int
) -> CameraMount | None:
    if not info.HasField("mount"):
        return None
    streams = read_streams(path, [one for one in messages if one.channel.topic == topics("imu")], start_ns)
    if info.mount.imu not in streams:
        warn(path, f"camera '{info.name}': no sample of its sensor '{info.mount.imu}' is left")
        return None
    return mount_of(info.mount, streams[info.mount.imu])


def camera_truth_of(
    path: Path, messages: Sequence[McapMessages], topics: CameraTopics, start_ns: int, known: DetectionTruth | None
) -> SceneTruth | None:
    """What a file knows of a camera and of who is who before it; None if it does not, or too little is left."""
    infos = of_topic(path, messages, topics.truth("info"), CameraTruth)
    if not infos or known is None:
        return None
    poses = path_of(path, messages, topics.truth("pose"), start_ns)
    if poses is None:
        warn(path, f"no pose is left on {topics.truth('pose')}: the truth of the camera is left out")
        return None
    if len(poses) < infos[-1].poses:
        warn(path, f"{len(poses)} of {infos[-1].poses} true poses of the camera are left")
    calibrations = of_topic(path, messages, topics.truth("calibration"), CalibrationEstimate)
    calibration = next(iter(calibration_of(calibrations[-1]).values()), None) if calibrations else None
    pixels = known.pixels if infos[-1].has_pixels else None
    return SceneTruth(
        poses, known.wearer, pixels, calibration, infos[-1].time_offset_s, time_drift=infos[-1].time_drift
    )
