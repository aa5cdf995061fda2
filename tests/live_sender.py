"""What a sender of live messages does: a scene's header and samples as messages, in a delimited stream of bytes."""

import time
from collections import Counter
from collections.abc import Iterator
from typing import BinaryIO

import numpy as np

from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.io.codec import NS_PER_S, set_timestamp
from vip_factors.io.live_messages import header_message
from vip_factors.io.live_open import when_due
from vip_factors.io.mcap_frames import fill_sample
from vip_factors.io.schemas.live_message_pb2 import LiveMessage
from vip_factors.sensors.live import LiveSample, VideoFrame, live_samples, stream_head
from vip_factors.sensors.scene import Scene


def delimited(message: bytes) -> bytes:
    """A serialised message with its length before it."""
    length, head = len(message), bytearray()
    while length > 0x7F:
        head.append(length & 0x7F | 0x80)
        length >>= 7
    head.append(length)
    return bytes(head) + message


def sample_message(sample: LiveSample, start_ns: int = 0, frame: int = 0) -> LiveMessage:
    """The message of one sample; ``frame`` counts the frames of a camera."""
    message = LiveMessage(carrier=sample.camera if isinstance(sample, VideoFrame) else sample.carrier)
    content = message.detections if isinstance(sample, VideoFrame) else message.imu
    content.seconds = sample.time
    if np.isfinite(sample.time):
        set_timestamp(content.timestamp, start_ns + round(sample.time * NS_PER_S))
    if isinstance(sample, VideoFrame):
        message.detections.frame = frame
        for pixels, confidence in zip(sample.pixels, sample.confidence, strict=True):
            message.detections.people.add(pixels=pixels.ravel(), confidence=confidence)
        return message
    message.imu.sensor = sample.sensor
    R = sample.R_inertial_sensor
    wxyz = None if R is None else quaternion_from_matrix(R, Order.WXYZ).tolist()
    force, rate = (None if one is None else one.tolist() for one in (sample.specific_force, sample.angular_rate))
    fill_sample(message.imu, force, wxyz, rate)
    return message


def live_messages(scene: Scene, real_time: bool = False) -> Iterator[bytes]:
    """The header and then every sample, serialised.

    Args:
        scene: with the samples.
        real_time: whether each sample comes when it is due; else as fast as it goes.
    """
    setup = stream_head(scene)
    yield header_message(setup).SerializeToString()
    frames: Counter[str] = Counter()
    samples = live_samples(scene)
    for sample in when_due(samples, time.sleep) if real_time else samples:
        number = 0
        if isinstance(sample, VideoFrame):
            number = frames[sample.camera]
            frames[sample.camera] += 1
        yield sample_message(sample, setup.start_ns, number).SerializeToString()


def write_messages(scene: Scene, stream: BinaryIO, real_time: bool = False) -> int:
    """Send a scene as a delimited stream; how many messages that were.

    Args:
        scene: to be sent.
        stream: that a live source reads at its other end.
        real_time: as in :func:`live_messages`.
    """
    count = 0
    for message in live_messages(scene, real_time):
        count += 1
        stream.write(delimited(message))
        if real_time:
            stream.flush()
    stream.flush()
    return count
