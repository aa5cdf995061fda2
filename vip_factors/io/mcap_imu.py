"""The samples of IMU streams to and from their messages, quickly: a recording has a hundred thousand."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from vip_factors.errors import FileFormatError
from vip_factors.geometry.quaternions import Order, matrix_from_quaternion, quaternion_from_matrix
from vip_factors.geometry.rotations import Array
from vip_factors.io.mcap_contents import McapMessages
from vip_factors.io.mcap_messages import decode, set_timestamp, time_ns_of, warn
from vip_factors.io.mcap_writer import NS_PER_S, MessageWriter, TimedMessage, nanoseconds
from vip_factors.io.schemas.imu_sample_pb2 import ImuSample
from vip_factors.sensors.imu_stream import ImuStream


def sample_messages(writer: MessageWriter, topic: str, stream: ImuStream, start_ns: int) -> Iterator[TimedMessage]:
    """The samples of a stream, serialised, in the order of time."""
    channel = writer.channel(topic, ImuSample)
    absent: list[None] = [None] * len(stream)
    R = stream.R_inertial_sensor
    force = absent if stream.specific_force is None else stream.specific_force.tolist()
    wxyz = absent if R is None else quaternion_from_matrix(R, Order.WXYZ).tolist()
    rate = absent if stream.angular_rate is None else stream.angular_rate.tolist()
    times = nanoseconds(stream.time, start_ns)
    message = ImuSample(sensor=stream.name)  # one message, filled anew for every sample
    for time_ns, seconds, f, q, w in zip(times, stream.time.tolist(), force, wxyz, rate, strict=True):
        set_timestamp(message.timestamp, time_ns)
        message.seconds = seconds
        if f is not None:
            specific_force = message.specific_force
            specific_force.x, specific_force.y, specific_force.z = f
            specific_force.SetInParent()  # present even if all zero
        if q is not None:
            turn = message.orientation_wxyz
            turn.w, turn.x, turn.y, turn.z = q
        if w is not None:
            angular_rate = message.angular_rate
            angular_rate.x, angular_rate.y, angular_rate.z = w
            angular_rate.SetInParent()
        yield time_ns, channel, message.SerializeToString()


def read_streams(path: Path, channels: Sequence[McapMessages], start_ns: int) -> dict[str, ImuStream]:
    """The streams of all channels of samples, by sensor.

    Raises:
        FileFormatError: if a sensor has two topics or a topic two sensors.
        RecordingError: if the samples are unusable.
    """
    streams: dict[str, ImuStream] = {}
    for messages in channels:
        samples = decode(path, messages, ImuSample)
        if not samples:
            continue
        name = samples[0].sensor or messages.channel.topic.rpartition("/")[2]
        if name in streams or any(one.sensor not in ("", name) for one in samples):
            raise FileFormatError(
                f"{path}: sensor '{name}' and topic {messages.channel.topic}: expected one topic per sensor and one "
                "sensor per topic"
            )
        streams[name] = _stream(path, name, samples, start_ns)
    return streams


def _stream(path: Path, name: str, samples: Sequence[ImuSample], start_ns: int) -> ImuStream:
    time = np.array(
        [
            one.seconds if one.HasField("seconds") else (time_ns_of(one.timestamp) - start_ns) / NS_PER_S
            for one in samples
        ]
    )
    force = _measured(
        [one.HasField("specific_force") for one in samples],
        [(v.x, v.y, v.z) for v in (one.specific_force for one in samples)],
    )
    rate = _measured(
        [one.HasField("angular_rate") for one in samples],
        [(v.x, v.y, v.z) for v in (one.angular_rate for one in samples)],
    )
    wxyz = _measured(
        [one.HasField("orientation_wxyz") for one in samples],
        [(q.w, q.x, q.y, q.z) for q in (one.orientation_wxyz for one in samples)],
    )
    order = np.argsort(time, kind="stable")  # other writers may log out of order
    stream = ImuStream.from_samples(
        name, time[order], *(None if one is None else one[order] for one in (force, _rotations(wxyz), rate))
    )
    if len(stream) < len(samples):
        warn(path, f"sensor '{name}': {len(samples) - len(stream)} incomplete samples are left out")
    return stream


def _measured(present: list[bool], rows: list[tuple[float, ...]]) -> Array | None:
    """The rows as an array, NaN where a message lacks the field; None where all lack it."""
    if not any(present):
        return None
    values = np.array(rows)
    values[~np.array(present)] = np.nan
    return values


def _rotations(wxyz: Array | None) -> Array | None:
    if wxyz is None:
        return None
    good = np.all(np.isfinite(wxyz), axis=1)
    R = np.full((len(wxyz), 3, 3), np.nan)
    R[good] = matrix_from_quaternion(wxyz[good], Order.WXYZ)
    return R
