"""A fixed-lag tracker's estimates for other programs: VMC for avatars, a Lab Streaming Layer stream for labs.

VMC is OSC over UDP, which avatars in Unity, Unreal and Blender follow: https://protocol.vmc.info, marionette
specification 2.0. Its axes are Unity's: left-handed, y up, an avatar at rest facing z, its right along x; metres,
quaternions w last. Bones turn against their parents, from a T-pose.

Labs record the Lab Streaming Layer beside EEG or force plates: https://labstreaminglayer.org. One outlet for all
wearers; channels are named, and described as XDF's meta-data for motion capture have it (type, unit, object, marker).
"""

import json
import os
import socket
from collections.abc import Callable, Iterator, Mapping
from typing import Any
from urllib.parse import urlsplit

import numpy as np

from vip_factors.body.skeleton import JOINT_NAMES, Skeleton, joint_index
from vip_factors.errors import InputError
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import Array
from vip_factors.io.live_json import ANGLE_NAMES, LiveJsonEncoder, PoseAnswer, as_text
from vip_factors.io.motions.skeleton_maps import UNITY_BONES
from vip_factors.io.settings import SentPose
from vip_factors.live_estimate import LiveEstimate, LivePose
from vip_factors.sensors.scene import Scene

OWN_CONFIGURATION = "LSLAPICFG"  # environment variable by which somebody sets up the library otherwise
# Found by programs on this machine alone; warnings, and what is worse, on stderr.
CONFIGURATION = "[multicast]\nResolveScope = machine\n[log]\nlevel = -1\n"

FORGET_S = 60.0  # in which clocks drift apart by a few milliseconds, and some answer is quick
DATAGRAM = 1400  # bytes: a larger one is cut up on its way, and lost with any of its pieces


class LiveVmcSink:
    """Sends every frame's poses; the first wearer's to the port given, each further one's to the next port.

    The path over the floor is the root's, height and turning are those of ``Hips``. Nobody need listen: what cannot be
    sent is lost, and told at the end.

    Args:
        target: ``host:port``.
        setup: of the stream.
        pose: which of the poses to send.

    Raises:
        InputError: for a target that is no host and port, a host that is not known, or without the package for OSC.
    """

    def __init__(self, target: str, setup: Scene, pose: SentPose = SentPose.NEWEST) -> None:
        host, port = check_vmc(target, len(setup.wearers))
        try:
            found = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        except OSError as error:
            raise InputError(f"{target}: host '{host}' is not known ({error.strerror})") from error
        self._skeletons = [one.subject.body() for one in setup.wearers]
        self._names = [one.subject.name for one in setup.wearers]
        self._pose = pose
        self._lost, self._reason = 0, ""
        self._address: tuple[Any, ...] = found[4]
        self._socket = socket.socket(found[0], socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    @property
    def ports(self) -> Mapping[str, int]:
        """Where each wearer's messages go."""
        return {name: self._address[1] + number for number, name in enumerate(self._names)}

    def write(self, estimate: LiveEstimate) -> None:
        """The messages of one frame; none of a wearer whose pose is not known yet."""
        for number, wearer in enumerate(estimate.wearers):
            pose = wearer.newest if self._pose is SentPose.NEWEST else wearer.smoothed
            if pose is None or not np.isfinite(pose.p_world_pelvis).all():
                continue
            for datagram in _bundles(_messages(pose, wearer.skeleton or self._skeletons[number])):
                self._send(datagram, number)

    def close(self) -> tuple[str, ...]:
        """Sends no more; returns what there is to say."""
        self._socket.close()
        return (f"{self._lost} VMC messages could not be sent: {self._reason}",) if self._lost else ()

    def _send(self, datagram: bytes, number: int) -> None:
        host, port, *rest = self._address
        try:
            self._socket.sendto(datagram, (host, port + number, *rest))
        except OSError as error:
            self._lost, self._reason = self._lost + 1, str(error.strerror)


def check_vmc(target: str, wearers: int = 1) -> tuple[str, int]:
    """Host and port of ``host:port``, for so many wearers.

    Raises:
        InputError: for anything else, or without the package for OSC.
    """
    try:
        import pythonosc  # noqa: F401
    except ImportError as error:
        raise InputError("VMC messages need the package python-osc: pip install 'vip-factors[live]'") from error
    expected = "expected host:port, such as 127.0.0.1:39539"
    try:
        url = urlsplit(f"//{target}")
        host, port = url.hostname, url.port
    except ValueError as error:
        raise InputError(f"{target}: {error}: {expected}") from error
    if not host or not port or url.netloc != target or url.username is not None:
        raise InputError(f"{target}: {expected}")
    if port + wearers - 1 > 65535:
        raise InputError(f"{target}: {wearers} wearers need as many ports from there on, and the last one is 65535")
    return host, port


def _messages(pose: LivePose, skeleton: Skeleton) -> Iterator[Any]:
    yield _message("/VMC/Ext/OK", 1)
    yield _message("/VMC/Ext/T", float(pose.time))
    x, y, z = pose.p_world_pelvis
    yield _pose_message("Root", "root", np.array([-x, 0.0, -y]), np.array([0.0, 0.0, 0.0, 1.0]))
    R_parent_child = pose.R_parent_child.copy()
    R_parent_child[0] = R_parent_child[0][[0, 2, 1]] * [[1.0], [1.0], [-1.0]]  # of the world, Y up
    quaternions = quaternion_from_matrix(R_parent_child, Order.XYZW) * [1.0, -1.0, -1.0, 1.0]  # x is turned round
    positions = skeleton.p_parent_joint * [-1.0, 1.0, 1.0]
    positions[0] = (0.0, z, 0.0)
    for joint, bone in UNITY_BONES.items():
        yield _pose_message("Bone", bone, positions[joint_index(joint)], quaternions[joint_index(joint)])


def _pose_message(kind: str, name: str, position: Array, quaternion: Array) -> Any:
    return _message(f"/VMC/Ext/{kind}/Pos", name, *position.tolist(), *quaternion.tolist())


def _message(address: str, *values: str | int | float) -> Any:
    from pythonosc.osc_message_builder import OscMessageBuilder

    builder = OscMessageBuilder(address)
    for value in values:
        builder.add_arg(value)
    return builder.build()


def _bundles(messages: Iterator[Any]) -> Iterator[bytes]:
    """Datagrams: bundles of as many messages as fit."""
    from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder

    bundle, size = OscBundleBuilder(IMMEDIATELY), 16  # of a bundle's head
    for message in messages:
        if size + 4 + message.size > DATAGRAM:
            yield bundle.build().dgram
            bundle, size = OscBundleBuilder(IMMEDIATELY), 16
        bundle.add_content(message)
        size += 4 + message.size
    yield bundle.build().dgram


class LiveLslSink:
    """An outlet; samples have the time at which a pose was, on the layer's clock.

    That clock and the stream's are taken to differ by the least that was seen between them in the last minutes: what is
    more is delay, and clocks drift.

    Args:
        name: of the outlet.
        setup: of the stream.
        rate: frames per second of the tracker.
        pose: which of the poses to send.

    Raises:
        InputError: without the library.
    """

    def __init__(self, name: str, setup: Scene, rate: float, pose: SentPose = SentPose.NEWEST) -> None:
        lsl = checked_lsl()
        if OWN_CONFIGURATION not in os.environ:
            lsl.set_config_content(CONFIGURATION)
        channels = [one for wearer in setup.wearers for one in _channels(wearer.subject.name)]
        info = lsl.StreamInfo(name, "MoCap", len(channels), rate, lsl.cf_float32, f"vip_factors {setup.name} {name}")
        described = info.desc().append_child("channels")
        for keys in channels:
            channel = described.append_child("channel")
            for key, value in keys.items():
                channel.append_child_value(key, value)
        self._outlet = lsl.StreamOutlet(info)
        self._clock: Callable[[], float] = lsl.local_clock
        self._encoder, self._pose = LiveJsonEncoder(setup), pose
        # Seconds from the stream's clock to the layer's: the least so far, of a minute and of the one before it.
        self._least, self._least_before, self._minute = float("inf"), float("inf"), -float("inf")

    def write(self, estimate: LiveEstimate) -> None:
        """Send one sample; none before the first smoothed pose, if that is the one to be sent."""
        if estimate.time - self._minute >= FORGET_S:
            self._least, self._least_before, self._minute = float("inf"), self._least, estimate.time
        self._least = min(self._least, self._clock() - estimate.time)
        sample, time = list[float](), None
        for wearer in json.loads(as_text(*self._encoder.encode(estimate)))["wearers"]:
            pose = wearer["newest"] if self._pose is SentPose.NEWEST else wearer["smoothed"]
            time = pose["time"] if pose is not None else time
            sample += _values(pose)
        if time is not None:
            self._outlet.push_sample(sample, time + min(self._least, self._least_before))


def checked_lsl() -> Any:
    """The library.

    Raises:
        InputError: if it is not there.
    """
    try:
        import pylsl
    except (ImportError, RuntimeError) as error:  # the second: pylsl without the library in C that it calls
        raise InputError(
            f"Lab Streaming Layer needs the package pylsl, and its liblsl: pip install 'vip-factors[lsl]' ({error})"
        ) from error
    return pylsl


def _channels(wearer: str) -> Iterator[Mapping[str, str]]:
    """Descriptions of one wearer's channels."""
    for joint in JOINT_NAMES:
        for kind, axes, unit in (("Position", "XYZ", "meters"), ("Orientation", "WXYZ", "quaternion")):
            for axis in axes:
                label = f"{wearer} {joint} {kind.lower()} {axis.lower()}"
                yield {"label": label, "object": wearer, "marker": joint, "type": kind + axis, "unit": unit}
    for angle in ANGLE_NAMES:
        yield {"label": f"{wearer} {angle}", "object": wearer, "marker": angle, "type": "Angle", "unit": "degrees"}


def _values(pose: PoseAnswer | None) -> list[float]:
    """One wearer's values in the order of the channels; NaN where they are not known."""
    if pose is None:
        return [np.nan] * (7 * len(JOINT_NAMES) + len(ANGLE_NAMES))
    joints = pose["joints"].values()
    values = [value for joint in joints for value in (*joint["position"], *joint["orientation_wxyz"])]
    return [np.nan if value is None else value for value in (*values, *pose["angles_deg"].values())]
