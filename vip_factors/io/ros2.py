"""``sensor_msgs/msg/Imu`` messages of a ROS 2 recording in MCAP (``ros2 bag record``'s default) as IMU streams.

The message has one fixed layout in CDR, so its numbers are taken straight from the bytes: fast, and whether the
file describes its messages as .msg or as IDL.
"""

import posixpath
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from functools import cached_property
from pathlib import Path

import numpy as np

from vip_factors.errors import FileFormatError
from vip_factors.geometry.quaternions import Order
from vip_factors.geometry.rotations import Array
from vip_factors.io.importers.shared import ImportedLog, default_sites, merge_notes, stream_of_quantities
from vip_factors.io.mcap_frames import rotations_where_finite
from vip_factors.io.mcap_messages import naming, warn
from vip_factors.io.mcap_reader import McapChannel, McapMessages, read_contents
from vip_factors.sensors.imu_stream import ImuStream

IMU_TYPES = ("sensor_msgs/msg/Imu", "sensor_msgs/Imu")
NUMBERS = 37  # float64: orientation 4, its covariance 9, angular velocity 3 and 9, linear acceleration 3 and 9
ORIENTATION, RATE, FORCE = slice(0, 4), slice(13, 16), slice(25, 28)
ORIENTATION_COVARIANCE, RATE_COVARIANCE, FORCE_COVARIANCE = 4, 16, 28  # first elements: -1 says "not measured"


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
    """The IMU streams of a ROS 2 recording, a file or a bag's folder: a sensor for each ``frame_id``, or for each topic
    where frames are empty or shared.

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
        raw = _samples_by_frame(path, messages)
        start_ns = min(int(samples.time_ns.min()) for samples in raw)
        sensors = dict(zip(_names(raw), raw, strict=True))
        streams = (
            samples.stream(name, start_ns, notes, other) for name, samples, other in _with_gyroscopes(sensors, notes)
        )
        imus = {stream.name: stream for stream in streams if stream is not None}
        if not imus:
            raise FileFormatError("no IMU topic has orientation or acceleration")
    return ImportedLog("ros2", imus, default_sites(list(imus)), start_ns=start_ns, notes=merge_notes(notes))


def _with_gyroscopes(
    sensors: Mapping[str, "_Samples"], notes: list[str]
) -> Iterator[tuple[str, "_Samples", "_Samples | None"]]:
    """Each sensor, and beside one of angular rate alone that of acceleration alone whose topic's name is most alike."""
    alone = {
        quantity: [name for name, samples in sensors.items() if samples.measured == {quantity}]
        for quantity in ("acceleration", "angular rate")
    }
    partner = dict[str, str]()
    for gyroscope in alone["angular rate"]:
        free = [name for name in alone["acceleration"] if name not in partner.values()]
        if free:
            partner[gyroscope] = max(free, key=lambda name: SequenceMatcher(None, name, gyroscope).ratio())
    for name, samples in sensors.items():
        if name in partner:
            accelerometer = partner[name]
            joined = posixpath.commonpath([name, accelerometer]) or name
            notes.append(f"{joined}: the acceleration of {accelerometer} is put onto the times of {name}")
            yield joined, samples, sensors[accelerometer]
        elif name not in partner.values():
            yield name, samples, None


def _names(raw: Sequence["_Samples"]) -> list[str]:
    frames, topics = [samples.frame_id for samples in raw], [samples.topic.lstrip("/") for samples in raw]
    if all(frames) and len(set(frames)) == len(frames):
        return frames
    if len(set(topics)) == len(topics):
        return topics
    return [
        f"{topic}/{frame}" if topics.count(topic) > 1 else topic for topic, frame in zip(topics, frames, strict=True)
    ]


def _samples_by_frame(path: Path, topics: Sequence[McapMessages]) -> list["_Samples"]:
    """The samples of each sensor: a topic, or a ``frame_id`` of a topic that has several."""
    rows = dict[tuple[str, str], list[_Row]]()
    for messages in topics:
        topic = messages.channel.topic
        for row, (data, log_time) in enumerate(zip(messages.data, messages.log_times, strict=True)):
            try:
                stamp_ns, frame_id, numbers = _parse(data)
            except (struct.error, UnicodeDecodeError, IndexError) as error:
                raise FileFormatError(f"message {row} of topic {topic} is no sensor_msgs/msg/Imu") from error
            rows.setdefault((topic, frame_id), []).append((stamp_ns, log_time, numbers))
    return [_Samples.of(path, *key, sensor_rows) for key, sensor_rows in rows.items()]


_Row = tuple[int, int, tuple[float, ...]]  # stamp and log time in nanoseconds, numbers


@dataclass(frozen=True)
class _Samples:
    """The numbers of one sensor's messages."""

    path: Path
    topic: str
    frame_id: str
    time_ns: np.ndarray
    values: Array

    @classmethod
    def of(cls, path: Path, topic: str, frame_id: str, rows: Sequence[_Row]) -> "_Samples":
        """From the sensor's rows; log times stand in for stamps that are all zero."""
        stamps, log_times, numbers = zip(*rows, strict=True)
        if not any(stamps):
            warn(path, f"topic {topic} has no time stamps: its log times stand for them")
            stamps = log_times
        return cls(path, topic, frame_id, np.array(stamps, dtype=np.int64), np.array(numbers))

    @cached_property
    def measured(self) -> set[str]:
        """The quantities that the sensor measured."""
        quantities = {
            "acceleration": self._unless(FORCE, FORCE_COVARIANCE),
            "angular rate": self._unless(RATE, RATE_COVARIANCE),
            "orientation": self._unless(ORIENTATION, ORIENTATION_COVARIANCE),
        }
        return {quantity for quantity, values in quantities.items() if values is not None}

    def stream(
        self, name: str, start_ns: int, notes: list[str], accelerometer: "_Samples | None" = None
    ) -> ImuStream | None:
        """The stream, in the order of time; None if it has neither orientation nor acceleration."""
        time, rows = self._in_order(start_ns)
        force, rate = self._unless(FORCE, FORCE_COVARIANCE), self._unless(RATE, RATE_COVARIANCE)
        xyzw = self._unless(ORIENTATION, ORIENTATION_COVARIANCE)
        if xyzw is not None and len(xyzw) > 1 and np.all(xyzw == xyzw[0]):
            xyzw = None
            notes.append(f"{name}: the orientation never changes: it was not measured, and is not used")
        R = _rotations(xyzw)
        sampled_force = None if force is None else (time, force[rows])
        if accelerometer is not None:
            other_time, other_rows = accelerometer._in_order(start_ns)
            other = accelerometer._unless(FORCE, FORCE_COVARIANCE)
            sampled_force = None if other is None else (other_time, other[other_rows])
        if sampled_force is None and R is None:
            warn(self.path, f"topic {self.topic} has neither orientation nor acceleration: left out")
            return None
        return stream_of_quantities(
            name,
            sampled_force,
            None if R is None else (time, R[rows]),
            None if rate is None else (time, rate[rows]),
        )

    def _in_order(self, start_ns: int) -> tuple[Array, np.ndarray]:
        """Seconds from a start, increasing, and the rows that have them: stamps that repeat are left out."""
        time_ns, rows = np.unique(self.time_ns, return_index=True)
        if len(rows) < len(self.time_ns):
            warn(
                self.path, f"topic {self.topic}: {len(self.time_ns) - len(rows)} samples repeat a time stamp: left out"
            )
        return np.asarray((time_ns - start_ns) / 1e9, float), rows

    def _unless(self, columns: slice, covariance: int) -> Array | None:
        """A quantity ``(N, n)``; None if its covariance says that it was not measured, or all of it is zero."""
        absent = self.values[:, covariance] == -1
        values = self.values[:, columns].copy()
        if np.all(absent) or not np.any(values):
            return None
        values[absent] = np.nan
        return values


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


def _rotations(xyzw: Array | None) -> Array | None:
    """Rotations; NaN for the zero quaternions that some drivers send without an orientation, None if all are."""
    if xyzw is None:
        return None
    xyzw[np.all(xyzw == 0, axis=1)] = np.nan
    return rotations_where_finite(xyzw, Order.XYZW) if np.any(np.all(np.isfinite(xyzw), axis=1)) else None
