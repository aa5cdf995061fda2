"""``sensor_msgs/msg/Imu`` messages of a ROS 2 recording in MCAP (``ros2 bag record``'s default) as IMU streams.

The message has one fixed layout in CDR, so its numbers are taken straight from the bytes: fast, and whether the
file describes its messages as .msg or as IDL.
"""

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vip_factors.errors import FileFormatError
from vip_factors.geometry.quaternions import Order
from vip_factors.geometry.rotations import Array
from vip_factors.io.importers.shared import ImportedLog, default_sites
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


def read(path: Path) -> ImportedLog:
    """The IMU streams of a ROS 2 recording, by ``frame_id``, or by topic where frames are empty or shared.

    ``header.stamp`` is the time, from the earliest stamp; a sensor without stamps takes log times.
    ``linear_acceleration`` is taken as specific force, as REP 145 demands (a sensor at rest reads +9.81 upwards),
    ``orientation`` as R_inertial_sensor; each unless its covariance begins with -1, and the orientation unless it is
    all zero.
    """
    contents = read_contents(path, is_imu)
    topics = [messages for messages in contents.messages.values() if is_imu(messages.channel) and messages.data]
    if not topics:
        topic_names = ", ".join(contents.topics) or "none"
        raise FileFormatError(f"{contents.path} has no messages of sensor_msgs/msg/Imu: topics found are {topic_names}")
    with naming(contents.path):
        raw = [_Samples(contents.path, messages) for messages in topics]
        start_ns = min(int(samples.time_ns.min()) for samples in raw)
        streams = {name: samples.stream(name, start_ns) for name, samples in zip(_names(raw), raw, strict=True)}
        imus = {name: stream for name, stream in streams.items() if stream is not None}
        if not imus:
            raise FileFormatError("no IMU topic has orientation or acceleration")
    return ImportedLog("ros2", imus, default_sites(list(imus)), start_ns=start_ns, notes=tuple(contents.damage))


def _names(raw: Sequence["_Samples"]) -> list[str]:
    frames = [samples.frame_id for samples in raw]
    unique = all(frames) and len(set(frames)) == len(frames)
    return frames if unique else [samples.topic.lstrip("/") for samples in raw]


class _Samples:
    """The numbers of one topic's messages."""

    def __init__(self, path: Path, messages: McapMessages) -> None:
        self.path, self.topic = path, messages.channel.topic
        stamps, rows = [], []
        for row, data in enumerate(messages.data):
            try:
                stamp_ns, frame_id, numbers = _parse(data)
            except (struct.error, UnicodeDecodeError, IndexError) as error:
                raise FileFormatError(f"message {row} of topic {self.topic} is no sensor_msgs/msg/Imu") from error
            stamps.append(stamp_ns)
            rows.append(numbers)
        self.frame_id = frame_id
        self.values = np.array(rows)
        self.time_ns = np.array(stamps, dtype=np.int64)
        if not np.any(self.time_ns):
            warn(path, f"topic {self.topic} has no time stamps: its log times stand for them")
            self.time_ns = np.array(messages.log_times, dtype=np.int64)

    def stream(self, name: str, start_ns: int) -> ImuStream | None:
        """The stream, in the order of time without repeated stamps; None if it has neither orientation nor force."""
        force, rate = self._unless(FORCE, FORCE_COVARIANCE), self._unless(RATE, RATE_COVARIANCE)
        R = _rotations(self._unless(ORIENTATION, ORIENTATION_COVARIANCE))
        if force is None and R is None:
            warn(self.path, f"topic {self.topic} has neither orientation nor acceleration: left out")
            return None
        time_ns, rows = np.unique(self.time_ns, return_index=True)
        if len(rows) < len(self.time_ns):
            warn(
                self.path, f"topic {self.topic}: {len(self.time_ns) - len(rows)} samples repeat a time stamp: left out"
            )
        return ImuStream.from_samples(
            name,
            np.asarray((time_ns - start_ns) / 1e9, float),
            *(None if values is None else values[rows] for values in (force, R, rate)),
        )

    def _unless(self, columns: slice, covariance: int) -> Array | None:
        absent = self.values[:, covariance] == -1
        if np.all(absent):
            return None
        values = self.values[:, columns].copy()
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
