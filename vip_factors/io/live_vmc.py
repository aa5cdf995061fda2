"""Poses of the fixed-lag tracker as VMC messages, for avatars.

VMC is OSC over UDP, which avatars in Unity, Unreal and Blender follow: https://protocol.vmc.info, marionette
specification 2.0. Its axes are Unity's: left-handed, y up, an avatar at rest facing z, its right along x; metres,
quaternions w last. Bones turn against their parents, from a T-pose.
"""

import socket
from collections.abc import Iterator, Mapping
from typing import Any
from urllib.parse import urlsplit

import numpy as np

from vip_factors.body.skeleton import Skeleton, joint_index
from vip_factors.errors import InputError
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import Array
from vip_factors.io.motions.skeleton_maps import UNITY_BONES
from vip_factors.io.settings import SentPose
from vip_factors.live_estimate import LiveEstimate, LivePose
from vip_factors.sensors.scene import Scene

DATAGRAM = 1400  # bytes: a larger one is cut up on its way, and lost with any of its pieces


class LiveVmcSink:
    """Sends the poses of every frame: the first wearer to the given port, each further wearer to the next port.

    The root follows the path over the floor; ``Hips`` have height and rotation. Messages that cannot be sent are
    counted, and reported at the end.

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
            family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        except OSError as error:
            raise InputError(f"{target}: host '{host}' was not found ({error.strerror})") from error
        self._skeletons = [wearer.subject.body() for wearer in setup.wearers]
        self._names = [wearer.subject.name for wearer in setup.wearers]
        self._pose = pose
        self._lost, self._reason = 0, ""
        self._address: tuple[Any, ...] = address
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    @property
    def ports(self) -> Mapping[str, int]:
        """Port of each wearer."""
        return {name: self._address[1] + number for number, name in enumerate(self._names)}

    def write(self, estimate: LiveEstimate) -> None:
        """Send the messages of one frame; a wearer without a pose has none."""
        for number, wearer in enumerate(estimate.wearers):
            pose = wearer.newest if self._pose is SentPose.NEWEST else wearer.smoothed
            if pose is None or not np.isfinite(pose.p_world_pelvis).all():
                continue
            for datagram in _bundles(_messages(pose, wearer.skeleton or self._skeletons[number])):
                self._send(datagram, number)

    def close(self) -> tuple[str, ...]:
        """Close the socket; return sentences for the user."""
        self._socket.close()
        return (f"{self._lost} VMC messages could not be sent: {self._reason}",) if self._lost else ()

    def _send(self, datagram: bytes, number: int) -> None:
        host, port, *scope = self._address
        try:
            self._socket.sendto(datagram, (host, port + number, *scope))
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
