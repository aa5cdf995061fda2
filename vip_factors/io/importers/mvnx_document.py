"""The content of an MVNX file as arrays, read as a stream: frames are dropped as soon as their numbers are taken."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from vip_factors.errors import FileFormatError
from vip_factors.geometry.rotations import Array

# What is read of a frame: the element, and how many numbers each segment or sensor has in it.
SEGMENT_CHANNELS = {"orientation": 4, "position": 3}
SENSOR_CHANNELS = {
    "sensorOrientation": 4,
    "sensorFreeAcceleration": 3,
    "sensorAcceleration": 3,
    "sensorAngularVelocity": 3,
}

FULL_BODY = "FullBody"  # MVN's configuration in which every limb carries a sensor


class MvnxFrame(NamedTuple):
    """One frame: its attributes, and the numbers of the channels it has, one row per segment or sensor."""

    attributes: dict[str, str]
    channels: dict[str, Array]


@dataclass
class MvnxDocument:
    """An MVNX file, version 3 or 4.

    Attributes:
        path: of the file.
        version: of the format, as written.
        software: version of MVN, as written.
        frame_rate: Hz.
        configuration: which sensors the subject wears, in MVN's words.
        segments, sensors: labels, in the order of the rows of every channel.
        points: (segment, point) → metres, in the segment's axes in the T-pose (x forward, y left, z up).
        joints: pairs of (segment, point), parent first, that coincide.
        samples: frames of the recording, in order.
        calibration_poses: frames before it: identity, T-pose, N-pose …
        truncated: what is wrong with the end of the file, if it breaks off.
    """

    path: Path
    version: str = "?"
    software: str = "?"
    frame_rate: float = 0.0
    configuration: str = FULL_BODY
    segments: list[str] = field(default_factory=list)
    sensors: list[str] = field(default_factory=list)
    points: dict[tuple[str, str], Array] = field(default_factory=dict)
    joints: list[tuple[tuple[str, str], tuple[str, str]]] = field(default_factory=list)
    samples: list[MvnxFrame] = field(default_factory=list)
    calibration_poses: list[MvnxFrame] = field(default_factory=list)
    truncated: str = ""

    def channel(self, name: str) -> Array | None:
        """One channel of all samples, ``(N, rows, width)``, NaN where a sample lacks it; None if all do."""
        labels, width = _channel_shape(self, name)
        if not any(name in sample.channels for sample in self.samples):
            return None
        empty = np.full((len(labels), width), np.nan)
        return np.stack([sample.channels.get(name, empty) for sample in self.samples])


def read_document(path: Path) -> MvnxDocument:
    """Parse an MVNX file of any size; one that breaks off gives the frames it holds.

    Raises:
        FileFormatError: if the file is not MVNX, has no samples, or a frame's numbers do not fit the labels.
    """
    document = MvnxDocument(path)
    try:
        for tag, element in _elements(path):
            _take(document, tag, element)
    except (ET.ParseError, LookupError, ValueError) as error:  # the latter two: an encoding that is none
        if isinstance(error, FileFormatError):
            raise
        if not document.samples:
            raise FileFormatError(f"{path}: not readable as XML ({error}): expected an MVNX file") from error
        document.truncated = str(error)
    if not document.samples:
        raise FileFormatError(f"{path}: no frame of type 'normal': expected an MVNX recording with frames")
    if not document.frame_rate > 0:
        raise FileFormatError(f"{path}: <subject> gives no frameRate: expected frames per second")
    return document


def _elements(path: Path) -> Iterator[tuple[str, ET.Element]]:
    """Elements at their end (the subject at its start), tags without namespace; read frames are forgotten."""
    frames = None
    for event, element in ET.iterparse(path, events=("start", "end")):
        tag = element.tag.rpartition("}")[2]
        if event == "start":
            frames = element if tag == "frames" else frames
            if tag in ("mvnx", "subject"):
                yield tag, element
        elif tag in ("mvn", "segment", "sensor", "joint", "frame"):
            yield tag, element
            if tag == "frame" and frames is not None:
                frames.clear()


def _take(document: MvnxDocument, tag: str, element: ET.Element) -> None:
    if tag == "mvnx":
        document.version = element.get("version", "?")
    elif tag == "mvn":
        document.software = element.get("version", "?")
    elif tag == "subject":
        document.configuration = element.get("configuration", FULL_BODY)
        rate = element.get("frameRate", "0")
        try:
            document.frame_rate = float(rate)
        except ValueError as error:
            raise FileFormatError(f"{document.path}: frameRate = '{rate}': expected a number") from error
    elif tag == "segment":
        label = element.get("label", "?")
        document.segments.append(label)
        for point in element.iter():
            if point.tag.rpartition("}")[2] == "point" and len(point):
                document.points[label, point.get("label", "?")] = _numbers(document.path, point[0], "a point", 3)
    elif tag == "sensor":
        document.sensors.append(element.get("label", "?"))
    elif tag == "joint":
        ends = [tuple((end.text or "").strip().split("/", 1)) for end in element]
        if len(ends) == 2 and all(len(end) == 2 for end in ends):
            document.joints.append((ends[0], ends[1]))  # type: ignore[arg-type]
    elif tag == "frame":
        is_sample = element.get("type", "normal") == "normal"
        (document.samples if is_sample else document.calibration_poses).append(_frame(document, element))


def _frame(document: MvnxDocument, element: ET.Element) -> MvnxFrame:
    channels = {}
    for child in element:
        name = child.tag.rpartition("}")[2]
        if name in SEGMENT_CHANNELS or name in SENSOR_CHANNELS:
            labels, width = _channel_shape(document, name)
            where = f"<{name}> of frame {element.get('index', len(document.samples))}"
            channels[name] = _numbers(document.path, child, where, len(labels) * width).reshape(-1, width)
    return MvnxFrame(dict(element.attrib), channels)


def _channel_shape(document: MvnxDocument, name: str) -> tuple[list[str], int]:
    if name in SEGMENT_CHANNELS:
        return document.segments, SEGMENT_CHANNELS[name]
    return document.sensors, SENSOR_CHANNELS[name]


def _numbers(path: Path, element: ET.Element, where: str, count: int) -> Array:
    try:
        numbers = np.array((element.text or "").split(), dtype=float)
    except ValueError as error:
        raise FileFormatError(f"{path}: {where}: {error}: expected {count} numbers") from error
    if len(numbers) != count:
        raise FileFormatError(f"{path}: {where} has {len(numbers)} numbers: expected {count}")
    return numbers
