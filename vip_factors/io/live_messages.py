"""Live messages: their conversion to and from set-ups and samples, and the senders of one stream."""

import time
from collections.abc import Callable
from dataclasses import replace
from threading import Lock

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from google.protobuf.json_format import Parse, ParseError
from google.protobuf.message import DecodeError

from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.quaternions import UNIT_TOLERANCE
from vip_factors.geometry.rotations import Array
from vip_factors.io.codec import NS_PER_S, PLACEMENT, SUBJECT, Codec, time_ns_of
from vip_factors.io.live_source import FindingReporter, QueueItem
from vip_factors.io.mcap_camera import camera_info_message, intrinsics_message, intrinsics_of, keypoint_set_of, mount_of
from vip_factors.io.mcap_frames import camera_path_of, camera_poses
from vip_factors.io.schemas.detections_2d_pb2 import Detections2D
from vip_factors.io.schemas.geometry_pb2 import QuaternionWxyz
from vip_factors.io.schemas.imu_sample_pb2 import ImuSample as ImuMessage
from vip_factors.io.schemas.live_message_pb2 import LiveCamera, LiveHeader, LiveMessage, LiveWearer
from vip_factors.sensors.calibration import PRESETS, preset
from vip_factors.sensors.camera import VideoClock
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.live import ImuSample, LiveSample, VideoFrame, checked_head
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import CAMERA_MOUNTING_SIGMA, Camera, Scene

WEARER = Codec(LiveWearer, Recording)
HEADER = Codec(LiveHeader, Scene, {"start": "start_ns"})
INITIAL_POSES = ("t-pose", "n-pose", "none")
MOST_HELD = 4096  # samples of a sender that has not claimed the stream
LARGEST_MESSAGE = 16 << 20  # bytes: headers of ten skeletons and frames of fifty people have 30 kB


def imu_sample_of(message: ImuMessage, carrier: str, start_ns: int, sensor: str = "") -> ImuSample:
    """Convert one IMU sample; ``sensor`` is its name where the message has none.

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
    R = rotation_of(message.orientation_wxyz) if message.HasField("orientation_wxyz") else None
    if R is None and message.HasField("orientation_wxyz"):
        raise FileFormatError(
            f"'{carrier}', sensor '{name}': a sample's orientation at {time:.3f} s is no unit quaternion (within "
            f"{UNIT_TOLERANCE:.0%}): it is left out"
        )
    force, rate = (
        np.array((vector.x, vector.y, vector.z)) if message.HasField(field) else None
        for field, vector in (("specific_force", message.specific_force), ("angular_rate", message.angular_rate))
    )
    return ImuSample(carrier, name, time, R, force, rate)


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
    """Convert one video frame.

    Args:
        message: of the frame; where its ``seconds`` are zero, the timestamp counts if there is one.
        camera: its name.
        start_ns: absolute time of t = 0.
        keypoints: number for every person; None if unknown.
        clock: offset and drift of the video clock against that of the IMUs; None for the same clock.

    Raises:
        FileFormatError: if a person has another number of keypoints.
    """
    if message.seconds == 0 and message.HasField("timestamp"):
        time = (time_ns_of(message.timestamp) - start_ns) / NS_PER_S
    else:
        time = message.seconds + (0.0 if clock is None else clock.late(message.seconds))
    people = message.people
    K = len(people[0].confidence) if keypoints is None and people else keypoints or 0
    for person in people:
        if len(person.pixels) != 2 * K or len(person.confidence) != K:
            raise FileFormatError(
                f"camera '{camera}': a person at {time:.3f} s has {len(person.pixels) // 2} keypoints and "
                f"{len(person.confidence)} confidences: expected {K} of each; this video frame is left out"
            )
    pixels = np.array([person.pixels for person in people], dtype=float).reshape(len(people), K, 2)
    confidence = np.array([person.confidence for person in people], dtype=float).reshape(len(people), K)
    return VideoFrame(camera, time, pixels, confidence)


def header_message(setup: Scene) -> LiveMessage:
    """Make the first message of a sender."""
    cameras = [
        LiveCamera(
            info=camera_info_message(camera),
            calibration=intrinsics_message(camera.model, camera.name, setup.start_ns).SerializeToString(),
            known_poses=() if camera.known_path is None else camera_poses(camera.known_path, setup.start_ns),
        )
        for camera in setup.cameras
    ]
    return LiveMessage(header=HEADER.encode(setup, cameras=cameras))


def setup_of(header: LiveHeader) -> Scene:
    """Make the set-up that a header describes.

    Raises:
        InputError: for what no wearer or camera can be, and for a name that two of them share.
    """
    wearers = tuple(_wearer(header.name, wearer, time_ns_of(header.start)) for wearer in header.wearers)
    return checked_head(Scene(header.name, wearers, tuple(map(_camera, header.cameras))))


def _wearer(name: str, message: LiveWearer, start_ns: int) -> Recording:
    """One wearer of a stream of this name; a preset without sites is fitted to the body."""
    wearer, placed = SUBJECT.decode(message.subject), PLACEMENT.decode(message.placement)
    body = wearer.body()
    if not placed.sites and placed.name in PRESETS:
        placed = preset(placed.name, body)
    pose = message.initial_pose or "none"
    if pose not in INITIAL_POSES:
        raise InputError(f"wearer '{wearer.name}': initial pose '{pose}': expected {', '.join(INITIAL_POSES)}")
    return Recording(name, wearer, {}, placed, pose, start_ns=start_ns)


def _camera(message: LiveCamera) -> Camera:
    info = message.info
    if not info.keypoints:
        raise FileFormatError(f"camera '{info.name}' names no keypoints: expected those of its detector, in order")
    try:
        model = intrinsics_of(CameraCalibration.FromString(message.calibration))
    except DecodeError as error:
        reason = f"its calibration is no foxglove.CameraCalibration ({error})"
        raise FileFormatError(f"camera '{info.name}': {reason}") from error
    mount = mount_of(info.mount, ImuStream(info.mount.imu, np.zeros(0))) if info.HasField("mount") else None
    if mount is not None and not mount.mounting_sigma:
        mount = replace(mount, mounting_sigma=CAMERA_MOUNTING_SIGMA)
    path = camera_path_of(message.known_poses) if message.known_poses else None
    detections = Detections.none(keypoint_set_of(info))
    return Camera(info.name, model, detections, info.moving, mount, path, focal_sigma=info.focal_sigma)


class ClientError(Exception):
    """A client that cannot be received any longer; the message is one clause with the reason."""


class Session:
    """State shared by the clients of one source: the set-up of the stream, and the client that is received.

    Args:
        put: gets the set-up, once, then samples and findings.
        silence_s: seconds without a message after which a client gives way to the next.

    Attributes:
        setup: of the stream; None until a client has claimed it.
    """

    def __init__(self, put: Callable[[QueueItem], None], silence_s: float = float("inf")) -> None:
        self.put, self._silence_s = put, silence_s
        self.setup: Scene | None = None
        self._described = b""
        self._lock = Lock()
        self._sender: Client | None = None

    def check(self, described: bytes) -> None:
        """Check the description of a set-up.

        Raises:
            ClientError: if it differs from the stream's.
        """
        if self.setup is not None and described != self._described:
            raise ClientError(
                "its header describes other wearers, sensors or cameras than this stream's: start a new stream"
            )

    def claim(self, client: "Client", setup: Scene, described: bytes) -> Scene:
        """Return the set-up of the stream: this one, with the client as its sender, unless another one was first.

        Raises:
            ClientError: if the stream has another set-up.
        """
        with self._lock:
            self.check(described)
            if self.setup is None:
                self._described, self.setup, self._sender = described, setup, client
                self.put(setup)
            return self.setup

    def admit(self, client: "Client", described: bytes) -> bool:
        """Return whether a client is received: no other sends, or that one has been silent for too long.

        Raises:
            ClientError: if it can never be, as the stream has another set-up.
        """
        with self._lock:
            if self.setup is None:
                return True
            self.check(described)
            is_free = self._sender is None or time.monotonic() - self._sender.received_at >= self._silence_s
            if is_free:
                self._sender = client
            return self._sender is client

    def release(self, client: "Client") -> None:
        """Let the next client send."""
        with self._lock:
            if self._sender is client:
                self._sender = None


class Client:
    """One sender's messages, from its header on.

    Args:
        session: that it takes part in.
        name: for findings.
        claim_s: seconds of samples that it has to send before the stream becomes its own; 0: its header is enough.

    Attributes:
        messages: how many have come.
        takes_part: whether samples of it were used.
        received_at: monotonic seconds of the last one.
        report: reports a finding about this client, those of one kind at most once a second.
    """

    def __init__(self, session: Session, name: str, claim_s: float = 0.0) -> None:
        self._session, self._claim_s = session, claim_s
        self._reporter = FindingReporter(name, session.put)
        self.report = self._reporter.report
        self._setup: Scene | None = None
        self._described = b""
        self._held: list[LiveSample] = []  # until the stream is claimed
        self._span = np.inf, -np.inf  # of their times
        self._shift = 0.0  # seconds from this client's clock to the stream's
        self.messages, self.takes_part = 0, False
        self.received_at = time.monotonic()

    @property
    def has_header(self) -> bool:
        """True once a valid header has come."""
        return self._setup is not None

    @property
    def is_to_wait(self) -> bool:
        """True while another client is received; raises as :meth:`Session.admit`."""
        return self._setup is not None and not self._session.admit(self, self._described)

    def take(self, data: bytes | str) -> None:
        """Take one LiveMessage, serialised or as JSON text; leave a sample that cannot be used out and report it.

        Raises:
            ClientError: if this client cannot be received any longer.
            FileFormatError: if it is no LiveMessage.
        """
        message = _parsed(data)
        content = message.WhichOneof("content")
        self.messages += 1
        self.received_at = time.monotonic()
        if content == "header":
            self._take_header(message.header)
        elif self._setup is None:
            raise ClientError("it sent something else before its header")
        elif content is None:
            self.report("empty", "a message has neither header nor sample: it is left out")
        else:
            try:
                self._put(_sample_of(message, content, self._setup), self._setup)
            except FileFormatError as error:
                self.report(content, str(error))

    def leave(self, sentence: str = "") -> None:
        """End the client, with a last sentence about it."""
        self._session.release(self)
        self._reporter.close(sentence)

    def _take_header(self, header: LiveHeader) -> None:
        if self._setup is not None:
            self.report("header", "a second header was sent: it is left out; the first one counts")
            return
        try:
            setup = setup_of(header)
        except InputError as error:
            raise ClientError(f"its header cannot be used: {error}") from error
        # Without values that may differ between two connections of one session.
        wearers = tuple(replace(wearer, start_ns=0) for wearer in setup.wearers)
        self._described = header_message(replace(setup, name="", wearers=wearers)).SerializeToString(deterministic=True)
        self._session.check(self._described)
        self._setup = setup
        if not self._claim_s:
            self._claim(setup)

    def _put(self, sample: LiveSample, setup: Scene) -> None:
        if self.takes_part:
            self._session.put(replace(sample, time=sample.time + self._shift) if self._shift else sample)
            return
        self._held.append(sample)
        self._span = min(self._span[0], sample.time), max(self._span[1], sample.time)
        is_enough = self._span[1] - self._span[0] >= self._claim_s or len(self._held) >= MOST_HELD
        if is_enough or self._session.setup is not None:
            self._claim(setup)

    def _claim(self, setup: Scene) -> None:
        """Claim the stream, and put the samples that were held."""
        stream = self._session.claim(self, setup, self._described)
        self.takes_part = True
        if stream.start_ns and setup.start_ns:
            self._shift = (setup.start_ns - stream.start_ns) / NS_PER_S
        for sample in self._held:
            self._put(sample, setup)
        self._held.clear()


def _parsed(data: bytes | str) -> LiveMessage:
    try:
        return Parse(data, LiveMessage()) if isinstance(data, str) else LiveMessage.FromString(data)
    except DecodeError as error:
        raise FileFormatError(f"{len(data)} bytes are no LiveMessage ({error})") from error
    except (ParseError, RecursionError) as error:
        reason = " ".join(str(error).split())
        raise FileFormatError(f"a text of {len(data)} characters is no LiveMessage as JSON ({reason})") from error


def _sample_of(message: LiveMessage, content: str, setup: Scene) -> LiveSample:
    if content == "imu":
        return imu_sample_of(message.imu, message.carrier or setup.wearers[0].subject.name, setup.start_ns)
    name = message.carrier or (setup.camera.name if setup.camera is not None else "")
    keypoints = next((len(camera.keypoints) for camera in setup.cameras if camera.name == name), None)
    return video_frame_of(message.detections, name, setup.start_ns, keypoints)
