"""``sensor_msgs/msg/Imu`` messages of a ROS 2 recording in MCAP (``ros2 bag record``'s default) as IMU streams.

The message has one fixed layout in CDR, so its numbers are taken straight from the bytes: fast, and whether the
file describes its messages as .msg or as IDL.
"""

import posixpath
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from pathlib import Path

import numpy as np

from vip_factors.errors import FileFormatError
from vip_factors.geometry.quaternions import Order
from vip_factors.geometry.rotations import Array
from vip_factors.io.importers.shared import ImportedLog, default_sites, merge_notes, stream_of_quantities
from vip_factors.io.mcap_messages import naming, warn
from vip_factors.io.mcap_reader import McapChannel, McapMessages, read_contents
from vip_factors.sensors.imu_stream import ImuStream, rotations_of

IMU_TYPES = ("sensor_msgs/msg/Imu", "sensor_msgs/Imu")
NUMBERS = 37  # float64: orientation 4, its covariance 9, angular velocity 3 and 9, linear acceleration 3 and 9
# Columns of each quantity, and the first element of its covariance: -1 there says that it was not measured.
ORIENTATION, RATE, FORCE = (slice(0, 4), 4), (slice(13, 16), 16), (slice(25, 28), 28)


def is_imu(channel: McapChannel) -> bool:
    """Whether a channel carries ROS 2 IMU messages."""
    return channel.schema_name in IMU_TYPES and channel.encoding == "cdr"


def matches(path: Path) -> bool:
    """Whether a path is the folder of a recording, as ``ros2 bag record`` makes it."""
    return path.is_dir() and bool(_files_of_bag(path) or list(path.glob("*.db3")))


def _files_of_bag(path: Path) -> list[Path]:
    """The MCAP files of a bag's folder, in the order of its parts: ``walk_0.mcap``, ``walk_1.mcap`` …"""
    files = [file for file in path.glob("*.mcap") if not file.name.startswith(".")]
    return sorted(files, key=lambda file: [int(part) if part.isdecimal() else 0 for part in file.stem.split("_")[-1:]])


def read(path: Path) -> ImportedLog:
    """Read the IMU streams of a ROS 2 recording, a file or a bag's folder.

    Each ``frame_id`` is a sensor, or each topic where frames are empty or shared.

    ``header.stamp`` is the time, from the earliest stamp; a sensor without stamps takes log times.
    ``linear_acceleration`` is taken as specific force, as REP 145 demands (a sensor at rest reads +9.81 upwards),
    ``orientation`` as R_inertial_sensor; each unless its covariance begins with -1 or all of it is zero, and the
    orientation unless it never changes. Topics of acceleration and of angular rate alone, as depth cameras have them,
    are one sensor on the gyroscope's times.

    Raises:
        FileFormatError: for a bag in SQLite, or without messages of IMUs.
    """
    files = _files_of_bag(path) if path.is_dir() else [path]
    if not files:
        raise FileFormatError(
            f"{path}: the bag is stored in SQLite (.db3): expected MCAP; write out.yaml with the lines "
            "'output_bags:', '- uri: walk_mcap', '  storage_id: mcap', '  all: true' and convert it by "
            f"'ros2 bag convert -i {path} -o out.yaml'"
        )
    parts = [read_contents(file, is_imu) for file in files]
    messages = [
        topic for contents in parts for topic in contents.messages.values() if is_imu(topic.channel) and topic.data
    ]
    if not messages:
        topic_names = ", ".join(topic for contents in parts for topic in contents.topics) or "none"
        raise FileFormatError(f"{path} has no messages of sensor_msgs/msg/Imu: topics found are {topic_names}")
    notes = [note for contents in parts for note in contents.damage]
    with naming(path):
        raw = _sensors(path, messages)
        start_ns = min(int(sensor.time_ns[0]) for sensor in raw)
        sensors = dict(zip(_names(raw), raw, strict=True))
        partners, imus = _partners(sensors), dict[str, ImuStream]()
        for name, sensor in sensors.items():
            if name in partners:
                name, accelerometer = posixpath.commonpath([name, partners[name]]) or name, sensors[partners[name]]
                notes.append(
                    f"{name}: the acceleration of {accelerometer.topic} is put onto the times of {sensor.topic}"
                )
            elif name in partners.values():
                continue
            else:
                accelerometer = sensor
            stream = _stream(path, name, sensor, accelerometer, start_ns, notes)
            if stream is not None:
                imus[name] = stream
        if not imus:
            raise FileFormatError("no IMU topic has orientation or acceleration")
    return ImportedLog("ros2", imus, default_sites(list(imus)), start_ns=start_ns, notes=merge_notes(notes))


@dataclass(frozen=True)
class _Sensor:
    """A sensor's messages in the order of time, rows ``(N, …)``; a quantity that was not measured is None."""

    topic: str
    frame_id: str
    time_ns: np.ndarray
    force: Array | None
    rate: Array | None
    xyzw: Array | None


def _partners(sensors: Mapping[str, _Sensor]) -> dict[str, str]:
    """By sensor of angular rate alone, the one of acceleration alone whose name is most alike."""
    accelerometers = [n for n, s in sensors.items() if s.force is not None and s.rate is None and s.xyzw is None]
    partners = dict[str, str]()
    for name, sensor in sensors.items():
        if accelerometers and sensor.rate is not None and sensor.force is None and sensor.xyzw is None:
            partners[name] = max(accelerometers, key=lambda other: SequenceMatcher(None, other, name).ratio())
            accelerometers.remove(partners[name])
    return partners


def _names(sensors: Sequence[_Sensor]) -> list[str]:
    frames, topics = [sensor.frame_id for sensor in sensors], [sensor.topic.lstrip("/") for sensor in sensors]
    if all(frames) and len(set(frames)) == len(frames):
        return frames
    if len(set(topics)) == len(topics):
        return topics
    return [
        f"{topic}/{frame}" if topics.count(topic) > 1 else topic for topic, frame in zip(topics, frames, strict=True)
    ]


def _sensors(path: Path, topics: Sequence[McapMessages]) -> list[_Sensor]:
    """The sensors: a topic each, or a ``frame_id`` of a topic that has several. Repeated stamps are left out."""
    rows = dict[tuple[str, str], list[tuple[int, int, tuple[float, ...]]]]()
    for messages in topics:
        topic = messages.channel.topic
        for row, (data, log_time) in enumerate(zip(messages.data, messages.log_times, strict=True)):
            try:
                stamp_ns, frame_id, numbers = _parse(data)
            except (struct.error, UnicodeDecodeError, IndexError) as error:
                raise FileFormatError(f"message {row} of topic {topic} is no sensor_msgs/msg/Imu") from error
            rows.setdefault((topic, frame_id), []).append((stamp_ns, log_time, numbers))
    sensors = []
    for (topic, frame_id), sensor_rows in rows.items():
        stamps, log_times, numbers = zip(*sensor_rows, strict=True)
        if not any(stamps):
            warn(path, f"topic {topic} has no time stamps: its log times are used")
            stamps = log_times
        time_ns, order = np.unique(np.array(stamps, dtype=np.int64), return_index=True)
        if repeats := len(stamps) - len(order):
            warn(path, f"topic {topic}: {repeats} samples repeat a time stamp: left out")
        values = np.array(numbers)
        force, rate, xyzw = (_measured(values, *columns) for columns in (FORCE, RATE, ORIENTATION))
        ordered = (None if quantity is None else quantity[order] for quantity in (force, rate, xyzw))
        sensors.append(_Sensor(topic, frame_id, time_ns, *ordered))
    return sensors


def _measured(values: Array, columns: slice, covariance: int) -> Array | None:
    """A quantity ``(N, n)``; None if its covariance says that it was not measured, or all of it is zero."""
    is_absent = values[:, covariance] == -1
    quantity = values[:, columns].copy()
    if np.all(is_absent) or not np.any(quantity):
        return None
    quantity[is_absent] = np.nan
    return quantity


def _stream(
    path: Path, name: str, sensor: _Sensor, accelerometer: _Sensor, start_ns: int, notes: list[str]
) -> ImuStream | None:
    """The stream; None if it has neither orientation nor acceleration."""
    xyzw = sensor.xyzw
    if xyzw is not None and len(xyzw) > 1 and np.all(xyzw == xyzw[0]):
        xyzw = None
        notes.append(f"{name}: the orientation never changes: it was not measured, and is not used")
    R = None
    if xyzw is not None:
        xyzw[np.all(xyzw == 0, axis=1)] = np.nan  # some drivers send zeros for no orientation
        R = rotations_of(xyzw, Order.XYZW) if np.any(np.all(np.isfinite(xyzw), axis=1)) else None
    if accelerometer.force is None and R is None:
        warn(path, f"topic {sensor.topic} has neither orientation nor acceleration: left out")
        return None
    time = np.asarray((sensor.time_ns - start_ns) / 1e9, float)
    is_shared = accelerometer is sensor
    force_time = time if is_shared else np.asarray((accelerometer.time_ns - start_ns) / 1e9, float)
    return stream_of_quantities(
        name,
        None if accelerometer.force is None else (force_time, accelerometer.force),
        None if R is None else (time, R),
        None if sensor.rate is None else (time, sensor.rate),
    )


def _parse(data: bytes) -> tuple[int, str, tuple[float, ...]]:
    """Stamp in nanoseconds, frame and the 37 numbers of one message in CDR, of either byte order."""
    order = "<" if data[1] & 1 else ">"
    seconds, nanoseconds, length = struct.unpack_from(order + "iII", data, 4)
    end = 16 + length
    frame_id = str(data[16:end], "utf-8").rstrip("\0")
    # Doubles stand on multiples of 8 (of 4 in XCDR2, encapsulations 6 and up), counted after the 4 bytes of the head.
    alignment = 8 if data[1] < 6 else 4
    start = 4 + -(-(end - 4) // alignment) * alignment
    return seconds * 1_000_000_000 + nanoseconds, frame_id, struct.unpack_from(f"{order}{NUMBERS}d", data, start)
