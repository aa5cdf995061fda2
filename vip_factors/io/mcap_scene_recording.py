"""A scene as an MCAP file: the recordings of its wearers, and the camera with what was detected in its frames.

One wearer's topics are those of a plain recording, so that each can be read as the other; several wearers' begin
with ``/wearer/<name>`` (data_schemas/README.md).
"""

import os
from collections.abc import Iterable, Sequence
from pathlib import Path

from vip_factors.errors import FileFormatError
from vip_factors.io.atomic import atomic_open
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
from vip_factors.io.mcap_contents import McapChannel, McapContents, McapMessages, read_contents
from vip_factors.io.mcap_detections import DetectionTruth, detection_messages, detections_of
from vip_factors.io.mcap_imu import read_streams, sample_messages
from vip_factors.io.mcap_messages import calibration_message, calibration_of, is_ours, naming, of_topic, warn
from vip_factors.io.mcap_recording import BEYOND, ESTIMATE, WEARER, recording_messages, recording_of
from vip_factors.io.mcap_writer import MessageWriter, TimedMessage
from vip_factors.io.schemas.calibration_estimate_pb2 import CalibrationEstimate
from vip_factors.io.schemas.camera_info_pb2 import CameraInfo, CameraTruth
from vip_factors.io.schemas.detections_2d_pb2 import Detections2D
from vip_factors.io.schemas.scene_info_pb2 import SceneInfo
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Camera, CameraMount, Scene, SceneTruth

INFO = "/scene/info"
CAMERA_INFO, INTRINSICS, DETECTIONS = "/camera/info", "/camera/calibration", "/camera/detections"
CAMERA_IMU, CAMERA_POSE, IMAGE = "/camera/imu", "/camera/pose", "/camera/image"
TRUTH_INFO, TRUTH_POSE = "/truth/camera/info", "/truth/camera/pose"
TRUTH_CALIBRATION = "/truth/camera/calibration"


def write_scene(scene: Scene, path: str | os.PathLike[str], overwrite: bool = False) -> None:
    """Write a scene, its truth included; what is not kept to the bit: rotations, and times of camera paths (1 ns).

    Raises:
        InputError: if the file exists and may not be overwritten, or cannot be written there.
    """
    start_ns = scene.wearers[0].start_ns
    prefixes = wearer_topics([one.subject.name for one in scene.wearers])
    with atomic_open(path, "wb", overwrite) as file, MessageWriter(file) as writer:
        info = SceneInfo(name=scene.name, wearer_topics=prefixes, has_camera=scene.camera is not None)
        writer.write(INFO, info, start_ns)
        streams: list[Iterable[TimedMessage]] = []
        if scene.camera is not None:
            streams += _camera_messages(writer, scene.camera, scene.truth, start_ns, Path(path))
        for prefix, recording in zip(prefixes, scene.wearers, strict=True):
            streams += recording_messages(writer, recording, prefix)
        writer.flush()
        writer.add_in_order(*streams)


def wearer_topics(names: Sequence[str], single: str = "", several: str = WEARER) -> list[str]:
    """What the topics of each wearer begin with."""
    if len(names) == 1:
        return [single]
    return [several + name.replace("%", "%25").replace("/", "%2F") for name in names]


def _camera_messages(
    writer: MessageWriter, camera: Camera, truth: SceneTruth | None, start_ns: int, path: Path
) -> list[Iterable[TimedMessage]]:
    writer.write(CAMERA_INFO, camera_info_message(camera, path), start_ns)
    writer.write(INTRINSICS, intrinsics_message(camera.model, camera.name, start_ns), start_ns)
    streams: list[Iterable[TimedMessage]] = [
        detection_messages(writer, DETECTIONS, camera, truth, start_ns),
        image_messages(writer, IMAGE, camera, start_ns),
    ]
    if camera.known_path is not None:
        streams.append(path_messages(writer, CAMERA_POSE, camera.known_path, start_ns))
    if camera.mount is not None:
        streams.append(sample_messages(writer, CAMERA_IMU, camera.mount.imu, start_ns))
    if truth is not None:
        has_pixels = truth.pixels is not None
        told = CameraTruth(time_offset_s=truth.time_offset, poses=len(truth.camera), has_pixels=has_pixels)
        writer.write(TRUTH_INFO, told, start_ns)
        if truth.camera_calibration is not None:
            one = calibration_message({camera.name: truth.camera_calibration})
            writer.write(TRUTH_CALIBRATION, one, start_ns)
        streams.append(path_messages(writer, TRUTH_POSE, truth.camera, start_ns))
    return streams


def read_scene(path: str | os.PathLike[str]) -> Scene:
    """Read a scene, or a plain recording as a scene of one wearer without a camera.

    Of a file that was cut off, every whole message is read; a warning and the wearers' notes say up to where.

    Raises:
        InputError: if there is no such file.
        FileFormatError: if it is no MCAP file, holds nothing of a recording, or its camera is incomplete.
        RecordingError: if its samples are unusable.
    """
    contents = read_contents(path, _wanted)
    messages = list(contents.messages.values())
    infos = of_topic(contents.path, messages, INFO, SceneInfo)
    with naming(contents.path):
        wearers = _wearers(contents, messages, infos[-1] if infos else None)
        if not wearers:
            raise FileFormatError(f"expected a scene; found topics {', '.join(contents.topics)}, no wearer among them")
        start_ns = wearers[0].start_ns
        camera, known = None, None
        if any(one.channel.topic.startswith("/camera/") for one in messages) or (infos and infos[-1].has_camera):
            camera, known = _camera(contents.path, messages, start_ns)
        whole = not infos or len(infos[-1].wearer_topics) == len(wearers)  # the truth counts the wearers
        truth = _truth(contents.path, messages, start_ns, known) if whole else None
        return Scene(infos[-1].name if infos else wearers[0].name, wearers, camera, truth)


def _wanted(channel: McapChannel) -> bool:
    beyond = channel.topic.startswith(BEYOND) and channel.encoding == "protobuf"
    return beyond or (is_ours(channel) and not channel.topic.startswith(ESTIMATE))


def _wearers(contents: McapContents, messages: Sequence[McapMessages], info: SceneInfo | None) -> tuple[Recording, ...]:
    found = {
        "/".join(one.channel.topic.split("/")[:3]): None for one in messages if one.channel.topic.startswith(WEARER)
    }
    prefixes = list(info.wearer_topics) if info is not None else list(found) or [""]
    for one in prefixes:
        if one and one not in found:
            warn(contents.path, f"nothing of wearer {one.removeprefix(WEARER)} is left")
            found.pop(one, None)
    return tuple(recording_of(contents, messages, one) for one in prefixes if not one or one in found)


def _camera(path: Path, messages: Sequence[McapMessages], start_ns: int) -> tuple[Camera | None, DetectionTruth | None]:
    from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
    from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage

    infos = of_topic(path, messages, CAMERA_INFO, CameraInfo)
    intrinsics = of_topic(path, messages, INTRINSICS, CameraCalibration)
    if not infos or not intrinsics:
        found = CAMERA_INFO if infos else INTRINSICS if intrinsics else "neither"
        warn(path, f"the camera is left out: expected topics {CAMERA_INFO} and {INTRINSICS}, found {found}")
        return None, None
    info = infos[-1]
    seen = of_topic(path, messages, DETECTIONS, Detections2D)
    if len(seen) < info.frames:
        warn(path, f"camera '{info.name}': {len(seen)} of {info.frames} video frames are left")
    detections, known = detections_of(info, seen)
    images = of_topic(path, messages, IMAGE, CompressedImage)
    camera = Camera(
        name=info.name,
        model=intrinsics_of(intrinsics[-1]),
        detections=detections,
        moving=info.moving,
        mount=_mount(path, messages, info, start_ns),
        known_path=path_of(path, messages, CAMERA_POSE, start_ns),
        time_offset=info.time_offset_s,
        video=video_of(info.video, images, path) if info.HasField("video") else None,
    )
    return camera, known


def _mount(path: Path, messages: Sequence[McapMessages], info: CameraInfo, start_ns: int) -> CameraMount | None:
    if not info.HasField("mount"):
        return None
    streams = read_streams(path, [one for one in messages if one.channel.topic == CAMERA_IMU], start_ns)
    if info.mount.imu not in streams:
        warn(path, f"camera '{info.name}': no sample of its sensor '{info.mount.imu}' is left")
        return None
    return mount_of(info.mount, streams[info.mount.imu])


def _truth(
    path: Path, messages: Sequence[McapMessages], start_ns: int, known: DetectionTruth | None
) -> SceneTruth | None:
    infos = of_topic(path, messages, TRUTH_INFO, CameraTruth)
    if not infos or known is None:
        return None
    poses = path_of(path, messages, TRUTH_POSE, start_ns)
    if poses is None:
        warn(path, f"no pose is left on {TRUTH_POSE}: the truth of the camera is left out")
        return None
    if len(poses) < infos[-1].poses:
        warn(path, f"{len(poses)} of {infos[-1].poses} true poses of the camera are left")
    calibrations = of_topic(path, messages, TRUTH_CALIBRATION, CalibrationEstimate)
    calibration = next(iter(calibration_of(calibrations[-1]).values()), None) if calibrations else None
    pixels = known.pixels if infos[-1].has_pixels else None
    return SceneTruth(poses, known.wearer, pixels, calibration, infos[-1].time_offset_s)
