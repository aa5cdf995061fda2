"""Messages of cameras: Foxglove's for intrinsics, poses and images, ours for the rest."""

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vip_factors.body.keypoints import KEYPOINT_SETS, KeypointSet
from vip_factors.errors import FileFormatError
from vip_factors.geometry.quaternions import Order, matrix_from_quaternion, quaternion_from_matrix
from vip_factors.geometry.rotations import Array
from vip_factors.io.codec import CALIBRATION, NS_PER_S, Codec, set_timestamp, time_ns_of
from vip_factors.io.mcap_frames import columns, read_streams, sample_messages
from vip_factors.io.mcap_messages import MessageWriter, TimedMessage, Topics, warn
from vip_factors.io.schemas.camera_info_pb2 import CameraInfo
from vip_factors.io.schemas.detections_2d_pb2 import Detections2D
from vip_factors.io.schemas.imu_sample_pb2 import ImuSample
from vip_factors.sensors.camera import CameraModel, CameraPath, VideoClock
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.scene import Camera, CameraMount, CameraTruth, Video

if TYPE_CHECKING:
    from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
    from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame

WORLD = "world"
IMAGE_FORMATS = {b"\xff\xd8": "jpeg", b"\x89P": "png", b"RI": "webp"}  # by their first two bytes


def intrinsics_message(model: CameraModel, name: str, time_ns: int) -> "CameraCalibration":
    """``foxglove.CameraCalibration`` of a camera, logged at an absolute time."""
    from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration

    kind = {0: "", 4: "plumb_bob", 5: "plumb_bob", 8: "rational_polynomial"}[len(model.distortion)]
    message = CameraCalibration(
        frame_id=name,
        width=model.width,
        height=model.height,
        distortion_model=kind,
        D=model.distortion,
        K=model.K.ravel(),
        R=np.eye(3).ravel(),
        P=np.hstack([model.K, np.zeros((3, 1))]).ravel(),
    )
    set_timestamp(message.timestamp, time_ns)
    return message


def intrinsics_of(message: "CameraCalibration") -> CameraModel:
    """The camera of a message."""
    if len(message.K) != 9:
        raise FileFormatError(f"camera matrix K has {len(message.K)} numbers: expected 9")
    fx, _, cx, _, fy, cy, *_ = message.K
    return CameraModel(message.width, message.height, (fx, fy), (cx, cy), tuple(message.D))


def path_messages(writer: MessageWriter, topic: str, path: CameraPath) -> Iterator[TimedMessage]:
    """The poses of a camera as ``foxglove.PoseInFrame``, serialised, in the order of time."""
    from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame

    xyzw = quaternion_from_matrix(path.R_world_camera, Order.XYZW).tolist()

    def messages() -> Iterator[PoseInFrame]:
        message = PoseInFrame(frame_id=WORLD)
        turn, position = message.pose.orientation, message.pose.position
        for q, p in zip(xyzw, path.p_world_camera.tolist(), strict=True):
            turn.x, turn.y, turn.z, turn.w = q
            position.x, position.y, position.z = p
            yield message

    return writer.stamped(topic, PoseInFrame, path.time, messages())


def path_of(poses: "Sequence[PoseInFrame]", start_ns: int) -> CameraPath | None:
    """The path of ``foxglove.PoseInFrame``, times to the nanosecond; None if there are none."""
    if not poses:
        return None
    time = np.array([(time_ns_of(pose.timestamp) - start_ns) / NS_PER_S for pose in poses])
    R_world_camera = matrix_from_quaternion(columns(poses, "pose.orientation", "xyzw"), Order.XYZW)
    return CameraPath(time, R_world_camera, columns(poses, "pose.position", "xyz"))


def _detection_messages(detections: Detections, truth: CameraTruth | None) -> Iterator[Detections2D]:
    """One message a video frame."""
    flat, colours = (len(detections), 2 * len(detections.keypoints)), detections.torso_colour
    pixels = detections.pixels.reshape(flat)
    true_pixels = None if truth is None or truth.pixels is None else truth.pixels.reshape(flat)
    for frame, seconds in enumerate(detections.time.tolist()):
        message = Detections2D(frame=frame, seconds=seconds)
        rows = detections.of_frame(frame)
        for row in range(rows.start, rows.stop):
            person = message.people.add(pixels=pixels[row], confidence=detections.confidence[row])
            if colours is not None and np.all(np.isfinite(colours[row])):
                person.torso_colour.extend(colours[row])
            if truth is not None:
                person.truth_wearer = int(truth.wearer[row])
            if true_pixels is not None:
                person.truth_pixels.extend(true_pixels[row])
        yield message


def detections_of(
    keypoints: KeypointSet, messages: Sequence[Detections2D]
) -> tuple[Detections, np.ndarray | None, Array | None]:
    """Detections of messages, their true wearers ``(N,)`` (−1 for nobody) and true pixels ``(N, K, 2)``, where known.

    Frames lost in between become frames without people.
    """
    K = len(keypoints)
    last_frame, most_frames = max((message.frame for message in messages), default=0), 20_000_000  # 9 h at 600 Hz
    if last_frame > most_frames:
        raise FileFormatError(
            f"detections: video frame {last_frame}: expected at most {most_frames:,}; is the file damaged?"
        )
    frames = np.array([message.frame for message in messages], dtype=int)
    if np.any(np.diff(frames) <= 0):
        frame = int(frames[1:][np.diff(frames) <= 0][0])
        raise FileFormatError(f"detections: video frame {frame} comes twice or late: expected increasing frame numbers")
    time = _filled(frames, np.array([message.seconds for message in messages]))
    people = [(message.frame, person) for message in messages for person in message.people]
    for frame, person in people:
        if len(person.pixels) != 2 * K or len(person.confidence) != K:
            raise FileFormatError(
                f"video frame {frame}: a person with {len(person.pixels) // 2} keypoints and {len(person.confidence)} "
                f"confidences: expected {K} of each, as keypoint set {keypoints.name} has"
            )
    detections = Detections(
        keypoints,
        time,
        np.array([frame for frame, _ in people], dtype=int),
        np.array([person.pixels for _, person in people], dtype=float).reshape(-1, K, 2),
        np.array([person.confidence for _, person in people], dtype=float).reshape(-1, K),
        _torso_colours([person for _, person in people]),
    )
    if not all(person.HasField("truth_wearer") for _, person in people):
        return detections, None, None
    wearer = np.array([person.truth_wearer for _, person in people], dtype=int)
    if any(len(person.truth_pixels) != 2 * K for _, person in people):
        return detections, wearer, None
    pixels = np.array([person.truth_pixels for _, person in people], dtype=float)
    return detections, wearer, pixels.reshape(-1, K, 2)


def _torso_colours(people: Sequence[Detections2D.Person]) -> Array | None:
    """Shares ``(N, B)``, NaN without an observation; None if nobody has any."""
    sizes = {len(person.torso_colour) for person in people} - {0}
    if not sizes:
        return None
    if len(sizes) > 1:
        raise FileFormatError(f"detections: torsos with {' and '.join(map(str, sorted(sizes)))} colours: expected one")
    unseen = np.full(sizes.pop(), np.nan)
    return np.array([person.torso_colour if person.torso_colour else unseen for person in people], dtype=float)


def keypoint_set_of(info: CameraInfo) -> KeypointSet:
    """The keypoints that a camera's detector answers with."""
    declared = KEYPOINT_SETS.get(info.keypoint_set)
    if declared is not None and declared.keypoints == tuple(info.keypoints):
        return declared
    return KeypointSet(info.keypoint_set, tuple(info.keypoints))


def _filled(frames: np.ndarray, time: Array) -> Array:
    """Times of all frames; lost ones are interpolated, or precede the first at the same rate."""
    if not len(frames) or len(frames) == frames[-1] + 1:
        return time
    every = np.arange(frames[-1] + 1)
    step = float(np.median(np.diff(time) / np.diff(frames))) if len(frames) > 1 else 1.0
    inside = np.interp(every, frames, time)
    return np.where(every < frames[0], time[0] - (frames[0] - every) * step, inside)


MOUNT = Codec(CameraInfo.Mount, CameraMount, {"mounting_wxyz": "R_camera_imu"})
"""A sensor on a camera by its name; in memory it has its samples."""


def clock_fields(value: Any) -> dict[str, float]:
    """The clock of a video as fields of a message."""
    return {"time_offset_s": value.clock.offset, "time_drift": value.clock.drift}


def with_clock(message: Any, read: dict[str, Any]) -> dict[str, Any]:
    """Attributes of a camera with the clock of its video."""
    return read | {"clock": VideoClock(message.time_offset_s, message.time_drift)}


_NAMES = {"mount": "mounting", "video": "images"}
HEAD = Codec(CameraInfo, Camera, _NAMES, encode_hook=clock_fields, decode_hook=with_clock)
"""Everything but intrinsics, detections, samples and images."""
TRUTH = Codec(CameraInfo, CameraTruth, encode_hook=clock_fields, decode_hook=with_clock)


def camera_info_message(camera: Camera, **attributes: Any) -> CameraInfo:
    """The message about a camera and the keypoints of its detector; ``attributes`` complete or replace its own."""
    poses = 0 if camera.known_path is None else len(camera.known_path)
    attributes["mounting"] = None if camera.mount is None else MOUNT.encode(camera.mount, imu=camera.mount.imu.name)
    keypoints = camera.keypoints
    return HEAD.encode(
        camera, known_poses=poses, keypoint_set=keypoints.name, keypoints=keypoints.keypoints, **attributes
    )


def mount_of(message: CameraInfo.Mount, imu: ImuStream) -> CameraMount:
    """The mount of a message, with the samples that belong to it."""
    return CameraMount(**MOUNT.values(message) | {"imu": imu})


def image_messages(writer: MessageWriter, topic: str, camera: Camera) -> Iterator[TimedMessage]:
    """The embedded frames as ``foxglove.CompressedImage``, serialised, in the order of their index."""
    from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage

    images = dict(sorted(camera.video.images.items())) if camera.video is not None else {}
    if not images:
        return iter(())
    times = camera.clock.at(frame_times(camera.detections.time, np.array(list(images))))
    messages = (
        CompressedImage(frame_id=camera.name, data=data, format=IMAGE_FORMATS.get(data[:2], ""))
        for data in images.values()
    )
    return writer.stamped(topic, CompressedImage, times, messages)


def frame_times(time: Array, index: np.ndarray) -> Array:
    """Seconds of video frames by index; those after the last known one follow at the video's rate."""
    if len(time) == 0:
        return np.asarray(index, float)
    step = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    excess = np.maximum(index - (len(time) - 1), 0)
    return time[np.minimum(index, len(time) - 1)] + excess * step


@dataclass(frozen=True)
class CameraTopics:
    """Topics of a camera: below ``/camera`` for the first, ``/camera/<name>`` for the others."""

    prefix: str = "/camera"

    @classmethod
    def of(cls, name: str) -> "CameraTopics":
        """Topics of a further camera."""
        return cls("/camera/" + name.replace("%", "%25").replace("/", "%2F"))

    def __call__(self, leaf: str) -> str:
        """The topic of info, calibration, detections, imu, pose, odometry or image."""
        return f"{self.prefix}/{leaf}"

    def truth(self, leaf: str) -> str:
        """The topic of the true info, intrinsics, pose or calibration."""
        return f"/truth{self.prefix}/{leaf}"


def camera_messages(
    writer: MessageWriter, topics: CameraTopics, camera: Camera, path: Path
) -> list[Iterable[TimedMessage]]:
    """Write the messages without a time, and return those of samples and frames."""
    video = None
    if camera.video is not None:
        stored_path = ""
        if camera.video.path is not None:  # relative to a folder that holds both, so that they can move together
            folder, absolute = Path(os.path.abspath(path)).parent, Path(os.path.abspath(camera.video.path))
            is_inside = absolute.is_relative_to(folder)
            stored_path = absolute.relative_to(folder).as_posix() if is_inside else str(absolute)
        video = CameraInfo.Video(path=stored_path, image_frames=sorted(camera.video.images))
    info = camera_info_message(camera, frames=len(camera.detections.time), images=video)
    writer.write(topics("info"), info)
    writer.write(topics("calibration"), intrinsics_message(camera.model, camera.name, writer.start_ns))
    detections = _detection_messages(camera.detections, camera.truth)
    streams: list[Iterable[TimedMessage]] = [
        writer.stamped(topics("detections"), Detections2D, camera.timed_detections.time, detections),
        image_messages(writer, topics("image"), camera),
    ]
    for topic, camera_path in (("pose", camera.known_path), ("odometry", camera.odometry)):
        if camera_path is not None:
            streams.append(path_messages(writer, topics(topic), camera_path))
    if camera.mount is not None:
        streams.append(sample_messages(writer, topics("imu"), camera.mount.imu))
    truth = camera.truth
    if truth is not None:
        head = TRUTH.encode(truth, known_poses=len(truth.path), has_true_pixels=truth.pixels is not None)
        writer.write(topics.truth("info"), head)
        if truth.model is not None:
            writer.write(topics.truth("intrinsics"), intrinsics_message(truth.model, camera.name, writer.start_ns))
        if truth.calibration is not None:
            writer.write(topics.truth("calibration"), CALIBRATION.encode({camera.name: truth.calibration}))
        streams.append(path_messages(writer, topics.truth("pose"), truth.path))
    return streams


def camera_of(topics: Topics, topic_of: CameraTopics, start_ns: int, has_truth: bool = True) -> Camera | None:
    """The camera of a file; None, and a warning, if too little of it is left."""
    from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
    from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
    from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame

    path = topics.path
    info = topics.last(topic_of("info"), CameraInfo)
    intrinsics = topics.last(topic_of("calibration"), CameraCalibration)
    if info is None or intrinsics is None:
        expected = topic_of("info"), topic_of("calibration")
        present = expected[0] if info is not None else expected[1] if intrinsics is not None else "neither"
        warn(path, f"the camera is left out: expected topics {' and '.join(expected)}, found {present}")
        return None
    frames = topics.all(topic_of("detections"), Detections2D)
    if len(frames) < info.frames:
        warn(path, f"camera '{info.name}': {len(frames)} of {info.frames} video frames are left")
    detections, wearer, pixels = detections_of(keypoint_set_of(info), frames)
    video = None
    if info.HasField("video"):
        video_path = path.parent / info.video.path if info.video.path else None  # an absolute path stays as it is
        images = zip(info.video.image_frames, topics.all(topic_of("image"), CompressedImage), strict=False)
        video = Video(video_path, {int(index): image.data for index, image in images})
    return Camera(
        model=intrinsics_of(intrinsics),
        detections=detections,
        mount=_mount_left(topics, topic_of, info, start_ns),
        known_path=path_of(topics.all(topic_of("pose"), PoseInFrame), start_ns),
        odometry=path_of(topics.all(topic_of("odometry"), PoseInFrame), start_ns),
        video=video,
        truth=None if not has_truth or wearer is None else _truth_of(topics, topic_of, start_ns, wearer, pixels),
        **HEAD.values(info),
    )


def _mount_left(topics: Topics, topic_of: CameraTopics, info: CameraInfo, start_ns: int) -> CameraMount | None:
    if not info.HasField("mount"):
        return None
    streams = read_streams(topics.path, topics.channels(topic_of("imu"), ImuSample), start_ns)
    if info.mount.imu not in streams:
        warn(topics.path, f"camera '{info.name}': no sample of its sensor '{info.mount.imu}' is left")
        return None
    return mount_of(info.mount, streams[info.mount.imu])


def _truth_of(
    topics: Topics, topic_of: CameraTopics, start_ns: int, wearer: np.ndarray, pixels: Array | None
) -> CameraTruth | None:
    """A camera's truth with the true wearer of each detection; None if the file has none, or not enough of it."""
    from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
    from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame

    info = topics.last(topic_of.truth("info"), CameraInfo)
    if info is None:
        return None
    poses = path_of(topics.all(topic_of.truth("pose"), PoseInFrame), start_ns)
    if poses is None:
        warn(topics.path, f"no pose is left on {topic_of.truth('pose')}: the truth of the camera is left out")
        return None
    if len(poses) < info.known_poses:
        warn(topics.path, f"{len(poses)} of {info.known_poses} true poses of the camera are left")
    calibration = topics.object(topic_of.truth("calibration"), CALIBRATION) or {}
    intrinsics = topics.last(topic_of.truth("intrinsics"), CameraCalibration)
    return CameraTruth(
        poses,
        wearer,
        pixels if info.has_true_pixels else None,
        next(iter(calibration.values()), None),
        model=None if intrinsics is None else intrinsics_of(intrinsics),
        **TRUTH.values(info),
    )
