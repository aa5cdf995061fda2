"""Recordings in MCAP files: one message a sample, so that Foxglove and Rerun plot it (data_schemas/README.md)."""

import os
from collections.abc import Iterable, Sequence
from pathlib import Path

from vip_factors.atomic import atomic_open
from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.errors import FileFormatError
from vip_factors.io.codec import CALIBRATION, MOTION, Codec
from vip_factors.io.mcap_camera import CameraTopics, camera_messages, camera_of
from vip_factors.io.mcap_frames import motion_of, pose_messages, read_streams, sample_messages
from vip_factors.io.mcap_messages import (
    PACKAGE,
    PROTOBUF,
    MessageWriter,
    TimedMessage,
    Topics,
    is_ours,
    naming,
    warn,
)
from vip_factors.io.mcap_reader import McapChannel, McapContents, read_contents
from vip_factors.io.ros2 import is_imu
from vip_factors.io.schemas.body_pose_pb2 import BodyPose
from vip_factors.io.schemas.calibration_estimate_pb2 import CalibrationEstimate
from vip_factors.io.schemas.imu_sample_pb2 import ImuSample
from vip_factors.io.schemas.recording_info_pb2 import RecordingInfo, SceneInfo
from vip_factors.sensors.calibration import Placement
from vip_factors.sensors.recording import Recording, Subject, Truth
from vip_factors.sensors.scene import Camera, Scene

INFO, IMU = "/recording/info", "/imu/"
TRUTH_POSE, TRUTH_CALIBRATION = "/truth/pose", "/truth/calibration"
ESTIMATE = "/estimate/"  # the topics of an estimate that was appended
WEARER = "/wearer/"  # the topics of one of several wearers
BEYOND = ("/scene/", "/camera/", "/truth/camera/")  # of a scene, beyond the wearers'
SCENE_INFO, FIRST_CAMERA = "/scene/info", CameraTopics()
READ = (ImuSample, RecordingInfo, BodyPose, CalibrationEstimate)

HEAD = Codec(RecordingInfo, Recording, {"start": "start_ns", "truth": "true_motion"})
"""A recording without samples, and its true motion without frames."""


def recording_messages(writer: MessageWriter, recording: Recording, prefix: str = "") -> list[Iterable[TimedMessage]]:
    """Write the messages without a time, and return samples and poses as streams, to be interleaved with others.

    Args:
        writer: of the file.
        recording: one wearer's.
        prefix: of its topics.
    """
    truth, true_motion = recording.truth, None
    if truth is not None:
        true_motion = MOTION.encode(truth.motion, known_bones=sorted(truth.known_bones or ()))
    info = HEAD.encode(recording, sensors=list(recording.imus), true_motion=true_motion)
    writer.write(prefix + INFO, info)
    streams: list[Iterable[TimedMessage]] = [
        sample_messages(writer, prefix + IMU + stream.name, stream) for stream in recording.imus.values()
    ]
    if truth is not None:
        if truth.calibration is not None:
            writer.write(prefix + TRUTH_CALIBRATION, CALIBRATION.encode(truth.calibration))
        streams.append(pose_messages(writer, prefix + TRUTH_POSE, truth.motion))
    return streams


def recording_of(contents: McapContents, prefix: str = "", has_truth: bool = True) -> Recording:
    """One wearer's recording, from the messages below the topic ``prefix``; the rest of a scene is ignored.

    Args:
        contents: of a file.
        prefix: of the wearer's topics.
        has_truth: whether the frames of a truth were read; without them it is left out.
    """
    left_out = (ESTIMATE,) if prefix else (ESTIMATE, WEARER, *BEYOND)
    mine = [
        messages
        for messages in contents.messages.values()
        if messages.channel.topic.startswith(f"{prefix}/" if prefix else "")
        and not messages.channel.topic.startswith(left_out)
    ]
    readable = [messages for messages in mine if any(is_ours(messages.channel, kind) for kind in READ)]
    foreign = [messages.channel for messages in mine if messages not in readable]
    if foreign:
        named = ", ".join(
            f"{channel.topic} ({channel.schema_name or channel.encoding or 'no schema'})" for channel in foreign
        )
        warn(contents.path, f"channels ignored, because they belong to no recording: {named}")
    if not readable:
        raise FileFormatError(_nothing_here(contents))
    topics, path = Topics(contents, prefix), contents.path
    info = topics.last(INFO, RecordingInfo)
    if info is None:
        warn(path, f"there is no RecordingInfo on {INFO}: the file's name is used, without an initial pose")
        info = RecordingInfo(name=path.stem)
    head = HEAD.values(info)
    if not info.HasField("subject"):
        warn(path, f"there is no subject on {INFO}: a person of average stature is assumed")
        head["subject"] = Subject()
    if not info.HasField("placement"):
        warn(path, f"there is no placement on {INFO}: no sensor has a place")
        head["placement"] = Placement()
    head["initial_pose"] = head["initial_pose"] or "none"
    head["notes"] = "\n".join([*filter(None, [head["notes"]]), *contents.damage])
    samples = [messages for messages in readable if is_ours(messages.channel, ImuSample)]
    truth = _truth(topics, info) if has_truth else None
    return Recording(imus=read_streams(path, samples, head["start_ns"]), truth=truth, **head)


def _truth(topics: Topics, info: RecordingInfo) -> Truth | None:
    poses = topics.all(TRUTH_POSE, BodyPose)
    if not info.HasField("truth"):
        if poses:
            warn(topics.path, f"topic {TRUTH_POSE} without a truth in {INFO}: the truth is left out")
        return None
    motion, _ = motion_of(topics.path, info.truth, poses)
    known_bones = frozenset(info.truth.known_bones) & set(JOINT_NAMES) or None
    return Truth(motion, topics.object(TRUTH_CALIBRATION, CALIBRATION), known_bones)


def _nothing_here(contents: McapContents) -> str:
    topics = contents.topics
    if topics and all(topic.startswith(ESTIMATE) for topic in topics):
        return f"{contents.path} is an estimate: expected a recording; give the one that it was made from"
    topics_found = f"found topics {', '.join(topics)}" if topics else "it has no topics"
    if any(is_imu(messages.channel) for messages in contents.messages.values()):
        topics_found += "; it has sensor_msgs/msg/Imu: bring it into a recording with vip-factors convert"
    damage = f" ({contents.damage[0]})" if contents.damage else ""
    return f"{contents.path}: expected a recording, with messages such as {PACKAGE}ImuSample{damage}; {topics_found}"


def write_recording(content: Recording | Scene, path: str | os.PathLike[str], overwrite: bool = False) -> None:
    """Write a recording or a scene, its truth included; rotations become quaternions, and times of camera paths are
    kept to 1 ns; everything else is kept to the bit.
    """
    with atomic_open(path, "wb", overwrite) as file, MessageWriter(file, content.start_ns) as writer:
        if isinstance(content, Recording):
            streams = recording_messages(writer, content)
        else:
            streams = _scene_messages(writer, content, Path(path))
        writer.flush()
        writer.add_in_order(*streams)


def _scene_messages(writer: MessageWriter, scene: Scene, path: Path) -> list[Iterable[TimedMessage]]:
    prefixes = wearer_topics(scene.names)
    info = SceneInfo(name=scene.name, wearer_topics=prefixes, has_camera=bool(scene.cameras))
    topics = [CameraTopics.of(camera.name) if number else FIRST_CAMERA for number, camera in enumerate(scene.cameras)]
    info.further_camera_topics.extend(camera.prefix for camera in topics[1:])
    writer.write(SCENE_INFO, info)
    streams: list[Iterable[TimedMessage]] = []
    for camera_topics, camera in zip(topics, scene.cameras, strict=True):
        streams += camera_messages(writer, camera_topics, camera, path)
    for prefix, recording in zip(prefixes, scene.wearers, strict=True):
        streams += recording_messages(writer, recording, prefix)
    return streams


def wearer_topics(names: Sequence[str], single: str = "", several: str = WEARER) -> list[str]:
    """Prefixes of the wearers' topics."""
    if len(names) == 1:
        return [single]
    return [several + name.replace("%", "%25").replace("/", "%2F") for name in names]


def read_scene(path: str | os.PathLike[str] | McapContents) -> Scene:
    """Read a scene from a file or its contents; a plain recording is a scene of one wearer without a camera.

    Of a file that was cut off, every whole message is read; a warning and the wearers' notes say up to where.

    Raises:
        FileFormatError: if it is no MCAP file, holds nothing of a recording, or its camera is incomplete.
        RecordingError: if its samples are unusable.
    """
    contents = read_contents(path, is_read)
    topics = Topics(contents)
    info = topics.last(SCENE_INFO, SceneInfo)
    with naming(contents.path):
        wearers = tuple(recording_of(contents, prefix) for prefix in wearer_prefixes(contents, info))
        if not wearers:
            raise FileFormatError(f"expected a scene; found topics {', '.join(contents.topics)}, no wearer among them")
        has_truth = info is None or len(info.wearer_topics) <= len(wearers)  # a camera's counts the wearers
        cameras = _cameras(topics, info, wearers[0].start_ns, has_truth)
        return Scene(wearers[0].name if info is None else info.name, wearers, cameras)


def is_read(channel: McapChannel) -> bool:
    """Whether a channel may be of a recording or a scene."""
    is_of_scene = channel.topic.startswith(BEYOND) and channel.encoding == PROTOBUF
    return is_of_scene or (is_ours(channel) and not channel.topic.startswith(ESTIMATE))


def wearer_prefixes(contents: McapContents, info: SceneInfo | None) -> list[str]:
    """Prefixes of the topics of wearers with messages; a warning names the others."""
    remaining = {"/".join(topic.split("/")[:3]): None for topic in contents.topics if topic.startswith(WEARER)}
    prefixes = list(info.wearer_topics) if info is not None else list(remaining) or [""]
    for prefix in prefixes:
        if prefix and prefix not in remaining:
            warn(contents.path, f"nothing of wearer {prefix.removeprefix(WEARER)} is left")
            remaining.pop(prefix, None)
    return [prefix for prefix in prefixes if not prefix or prefix in remaining]


def _cameras(topics: Topics, info: SceneInfo | None, start_ns: int, has_truth: bool) -> tuple[Camera, ...]:
    has_camera = any(topic.startswith(f"{FIRST_CAMERA.prefix}/") for topic in topics.contents.topics)
    if not has_camera and not (info is not None and info.has_camera):
        return ()
    topics_of = [FIRST_CAMERA, *map(CameraTopics, () if info is None else info.further_camera_topics)]
    cameras = (camera_of(topics, topic_of, start_ns, has_truth) for topic_of in topics_of)
    return tuple(camera for camera in cameras if camera is not None)
