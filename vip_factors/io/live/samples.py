"""Single samples to and from their messages. The way in is written for speed: thousands come a second."""

import numpy as np

from vip_factors.errors import FileFormatError
from vip_factors.geometry.quaternions import UNIT_TOLERANCE, Order, quaternion_from_matrix
from vip_factors.geometry.rotations import Array
from vip_factors.io.mcap_messages import set_timestamp, time_ns_of
from vip_factors.io.mcap_writer import NS_PER_S
from vip_factors.io.schemas.detections_2d_pb2 import Detections2D
from vip_factors.io.schemas.geometry_pb2 import QuaternionWxyz
from vip_factors.io.schemas.imu_sample_pb2 import ImuSample as ImuMessage
from vip_factors.io.schemas.live_message_pb2 import LiveMessage
from vip_factors.sensors.camera_model import VideoClock
from vip_factors.sensors.live import ImuSample, LiveSample, VideoFrame


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
    imu = message.imu
    imu.sensor = sample.sensor
    if sample.specific_force is not None:
        force = imu.specific_force
        force.x, force.y, force.z = sample.specific_force.tolist()
        force.SetInParent()  # present even if all zero
    if sample.R_inertial_sensor is not None:
        turn = imu.orientation_wxyz
        turn.w, turn.x, turn.y, turn.z = quaternion_from_matrix(sample.R_inertial_sensor, Order.WXYZ).tolist()
    return message


def imu_sample_of(message: ImuMessage, carrier: str, start_ns: int, sensor: str = "") -> ImuSample:
    """One sample; ``sensor`` counts where the message names none. Values are passed on as they are.

    Raises:
        FileFormatError: if it has no time, or its orientation is no unit quaternion.
    """
    name = message.sensor or sensor
    if message.HasField("seconds"):
        time = message.seconds
    elif message.HasField("timestamp"):
        time = (time_ns_of(message.timestamp) - start_ns) / NS_PER_S
    else:
        raise FileFormatError(f"'{carrier}', sensor '{name}': a sample has no time: expected seconds or a timestamp")
    R = force = None
    if message.HasField("orientation_wxyz"):
        R = rotation_of(message.orientation_wxyz)
        if R is None:
            raise FileFormatError(
                f"'{carrier}', sensor '{name}': a sample's orientation at {time:.3f} s is no unit quaternion (within "
                f"{UNIT_TOLERANCE:.0%}): it is left out"
            )
    if message.HasField("specific_force"):
        v = message.specific_force
        force = np.array((v.x, v.y, v.z))
    return ImuSample(carrier, name, time, R, force)


def rotation_of(message: QuaternionWxyz) -> Array | None:
    """``(3, 3)``, normalised first; None if it is no unit quaternion.

    The same as :func:`~vip_factors.geometry.quaternions.matrix_from_quaternion` of one, at a tenth of its time.
    """
    w, x, y, z = message.w, message.x, message.y, message.z
    square = w * w + x * x + y * y + z * z
    if not abs(square**0.5 - 1) < UNIT_TOLERANCE:
        return None
    s = 2 / square
    xx, yy, zz, xy, xz, yz = s * x * x, s * y * y, s * z * z, s * x * y, s * x * z, s * y * z
    wx, wy, wz = s * w * x, s * w * y, s * w * z
    return np.array(((1 - yy - zz, xy - wz, xz + wy), (xy + wz, 1 - xx - zz, yz - wx), (xz - wy, yz + wx, 1 - xx - yy)))


def video_frame_of(
    message: Detections2D, camera: str, start_ns: int, keypoints: int | None = None, clock: VideoClock | None = None
) -> VideoFrame:
    """One video frame.

    Args:
        message: of the frame; where its ``seconds`` are zero, the timestamp counts if there is one.
        camera: its name.
        start_ns: absolute time of t = 0.
        keypoints: of every person; None if that is not known.
        clock: what lies between the video's clock and the IMUs'; None: nothing.

    Raises:
        FileFormatError: if a person has another number of keypoints.
    """
    if message.seconds == 0 and message.HasField("timestamp"):
        time = (time_ns_of(message.timestamp) - start_ns) / NS_PER_S
    else:
        time = message.seconds + (0.0 if clock is None else clock.late(message.seconds))
    people = message.people
    K = keypoints if keypoints is not None else (len(people[0].confidence) if people else 0)
    for person in people:
        if len(person.pixels) != 2 * K or len(person.confidence) != K:
            raise FileFormatError(
                f"camera '{camera}': a person at {time:.3f} s has {len(person.pixels) // 2} keypoints and "
                f"{len(person.confidence)} confidences: expected {K} of each; this video frame is left out"
            )
    pixels = np.array([person.pixels for person in people], dtype=float).reshape(len(people), K, 2)
    confidence = np.array([person.confidence for person in people], dtype=float).reshape(len(people), K)
    return VideoFrame(camera, time, pixels, confidence)
