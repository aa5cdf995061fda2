"""A scene as an MCAP file: the recordings of its wearers, and the cameras with what was detected in their frames.

One wearer's topics are those of a plain recording, so that each can be read as the other; several wearers' begin
with ``/wearer/<name>``, and those of cameras beside the first with ``/camera/<name>`` (data_schemas/README.md).
"""

import os
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from vip_factors.atomic import atomic_open
from vip_factors.errors import FileFormatError
from vip_factors.io.mcap_contents import McapChannel, McapContents, McapMessages, read_contents
from vip_factors.io.mcap_messages import is_ours, naming, of_topic, warn
from vip_factors.io.mcap_recording import BEYOND, ESTIMATE, WEARER, recording_messages, recording_of
from vip_factors.io.mcap_scene_camera import CameraTopics, camera_messages, camera_of, camera_truth_of
from vip_factors.io.mcap_writer import MessageWriter, TimedMessage
from vip_factors.io.schemas.scene_info_pb2 import SceneInfo
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Camera, Scene, SceneTruth

INFO, FIRST_CAMERA = "/scene/info", CameraTopics()


def write_scene(scene: Scene, path: str | os.PathLike[str], overwrite: bool = False) -> None:
    """Write a scene, its truth included; what is not kept to the bit: rotations, and times of camera paths (1 ns).

    Raises:
        InputError: if the file exists and may not be overwritten, or cannot be written there.
    """
    start_ns = scene.wearers[0].start_ns
    prefixes = wearer_topics([one.subject.name for one in scene.wearers])
    with atomic_open(path, "wb", overwrite) as file, MessageWriter(file) as writer:
        info = SceneInfo(name=scene.name, wearer_topics=prefixes, has_camera=scene.camera is not None)
        topics = [FIRST_CAMERA, *(CameraTopics.of(one.name) for one in scene.further_cameras)]
        info.further_camera_topics.extend(one.prefix for one in topics[1:])
        writer.write(INFO, info, start_ns)
        streams: list[Iterable[TimedMessage]] = []
        truths = (scene.truth, *scene.truth.further) if scene.truth is not None else [None] * len(topics)
        for own, camera, truth in zip(topics, scene.cameras, truths, strict=False):  # without a camera there is none
            streams += camera_messages(writer, own, camera, truth, start_ns, Path(path))
        for prefix, recording in zip(prefixes, scene.wearers, strict=True):
            streams += recording_messages(writer, recording, prefix)
        writer.flush()
        writer.add_in_order(*streams)


def wearer_topics(names: Sequence[str], single: str = "", several: str = WEARER) -> list[str]:
    """What the topics of each wearer begin with."""
    if len(names) == 1:
        return [single]
    return [several + name.replace("%", "%25").replace("/", "%2F") for name in names]


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
        camera, truth, further = _cameras(contents.path, messages, infos[-1] if infos else None, wearers[0].start_ns)
        if infos and len(infos[-1].wearer_topics) > len(wearers):
            truth = None  # it counts the wearers
        return Scene(infos[-1].name if infos else wearers[0].name, wearers, camera, truth, further)


def _wanted(channel: McapChannel) -> bool:
    beyond = channel.topic.startswith(BEYOND) and channel.encoding == "protobuf"
    return beyond or (is_ours(channel) and not channel.topic.startswith(ESTIMATE))


def _wearers(contents: McapContents, messages: Sequence[McapMessages], info: SceneInfo | None) -> tuple[Recording, ...]:
    prefixes = wearer_prefixes(contents, messages, info)
    return tuple(recording_of(contents, messages, one) for one in prefixes)


def wearer_prefixes(contents: McapContents, messages: Sequence[McapMessages], info: SceneInfo | None) -> list[str]:
    """What the topics of each wearer begin with of whom something is left; who has nothing is told."""
    found = {
        "/".join(one.channel.topic.split("/")[:3]): None for one in messages if one.channel.topic.startswith(WEARER)
    }
    prefixes = list(info.wearer_topics) if info is not None else list(found) or [""]
    for one in prefixes:
        if one and one not in found:
            warn(contents.path, f"nothing of wearer {one.removeprefix(WEARER)} is left")
            found.pop(one, None)
    return [one for one in prefixes if not one or one in found]


def _cameras(
    path: Path, messages: Sequence[McapMessages], info: SceneInfo | None, start_ns: int
) -> tuple[Camera | None, SceneTruth | None, tuple[Camera, ...]]:
    """The first camera, what is known, and further cameras."""
    there = any(one.channel.topic.startswith(f"{FIRST_CAMERA.prefix}/") for one in messages)
    if not there and not (info is not None and info.has_camera):
        return None, None, ()
    camera, known = camera_of(path, messages, FIRST_CAMERA, start_ns)
    truth = camera_truth_of(path, messages, FIRST_CAMERA, start_ns, known)
    further, truths = [], []
    for prefix in info.further_camera_topics if info is not None and camera is not None else ():
        topics = CameraTopics(prefix)
        one, known = camera_of(path, messages, topics, start_ns)
        if one is not None and one.known_path is None:
            warn(path, f"camera '{one.name}' is left out: its known pose on {topics('pose')} is not left")
        elif one is not None:
            further.append(one)
            truths.append(camera_truth_of(path, messages, topics, start_ns, known) if truth is not None else None)
    complete = tuple(one for one in truths if one is not None)
    if truth is not None:
        truth = replace(truth, further=complete) if len(complete) == len(further) else None
    return camera, truth, tuple(further)
