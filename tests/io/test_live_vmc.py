"""VMC messages of a tracker's answers, as an OSC server hears them: python-osc's own, over UDP on this machine."""

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from live_answers import LAG, answer, answers, live_scene
from pythonosc.dispatcher import Dispatcher
from pythonosc.osc_server import BlockingOSCUDPServer
from scipy.spatial.transform import Rotation

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.kinematics import forward_kinematics
from vip_factors.body.skeleton import joint_index
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array
from vip_factors.io.live_vmc import DATAGRAM, LiveVmcSink, check_vmc
from vip_factors.io.motions.skeleton_maps import UNITY_BONES
from vip_factors.io.settings import SentPose
from vip_factors.live_estimate import LivePose
from vip_factors.sensors.live import stream_head

# Unity's humanoid: every bone that we send and the one that it hangs on.
UNITY_PARENTS = {
    "Hips": "root", "Spine": "Hips", "Chest": "Spine", "UpperChest": "Chest", "Neck": "UpperChest", "Head": "Neck",
} | {
    f"{side}{bone}": parent if parent == "Hips" or parent == "UpperChest" else f"{side}{parent}"
    for side in ("Left", "Right")
    for bone, parent in {
        "UpperLeg": "Hips", "LowerLeg": "UpperLeg", "Foot": "LowerLeg", "Toes": "Foot", "Shoulder": "UpperChest",
        "UpperArm": "Shoulder", "LowerArm": "UpperArm", "Hand": "LowerArm",
    }.items()
}  # fmt: skip


class Marionette:
    """Listens on a port of its own."""

    def __init__(self, port: int = 0) -> None:
        self.heard: list[tuple[str, tuple[Any, ...]]] = []
        dispatcher = Dispatcher()
        dispatcher.set_default_handler(lambda address, *values: self.heard.append((address, values)))
        self._server = BlockingOSCUDPServer(("127.0.0.1", port), dispatcher)
        self.port: int = self._server.server_address[1]
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.01,), daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()

    def wait(self, messages: int) -> list[tuple[str, tuple[Any, ...]]]:
        until = time.monotonic() + 10
        while len(self.heard) < messages and time.monotonic() < until:
            time.sleep(0.005)
        return self.heard

    def transforms(self) -> dict[str, Array]:
        """The newest world matrix ``(4, 4)`` of every bone, in Unity's axes."""
        local = {}
        for address, values in self.heard:
            if address in ("/VMC/Ext/Root/Pos", "/VMC/Ext/Bone/Pos"):
                T = np.eye(4)
                # Unity's quaternions turn its left-handed axes by the formula that everybody uses.
                T[:3, :3], T[:3, 3] = Rotation.from_quat(values[4:8]).as_matrix(), values[1:4]
                local[values[0]] = T
        world = {"root": local["root"]}
        for bone, parent in UNITY_PARENTS.items():
            world[bone] = world[parent] @ local[bone]
        return world


@contextmanager
def marionettes(count: int = 1) -> Iterator[list[Marionette]]:
    """On ports that follow each other."""
    for _ in range(50):
        opened = [Marionette()]
        try:
            opened += [Marionette(opened[0].port + number) for number in range(1, count)]
        except OSError:
            opened[0].close()
            continue
        try:
            yield opened
        finally:
            for one in opened:
                one.close()
        return
    pytest.fail("no free ports beside each other")


def estimate_axes(p_unity: Array) -> Array:
    x, y, z = p_unity
    return np.array([-x, -z, y])


def check_joints(heard: Marionette, pose: LivePose, skeleton: Any) -> None:
    known = forward_kinematics(skeleton, pose.R_parent_child[None], pose.p_world_pelvis[None])
    world = heard.transforms()
    for joint, bone in UNITY_BONES.items():
        found = estimate_axes(world[bone][:3, 3])
        assert np.linalg.norm(found - known.p_world_joint[0, joint_index(joint)]) < 1e-5, bone


MESSAGES = 3 + len(UNITY_BONES)


@pytest.mark.parametrize("kind", list(SentPose))
def test_joints_lie_where_the_estimate_has_them(kind: SentPose) -> None:
    scene = live_scene(0.5)
    with marionettes(2) as heard:
        sink = LiveVmcSink(f"127.0.0.1:{heard[0].port}", stream_head(scene), kind)
        assert list(sink.ports.values()) == [one.port for one in heard]
        for estimate in answers(scene):
            sink.write(estimate)
        frames = 31 if kind is SentPose.NEWEST else 31 - LAG
        for number, one in enumerate(heard):
            assert len(one.wait(frames * MESSAGES)) == frames * MESSAGES
            check_joints(one, getattr(estimate.wearers[number], kind.value), scene.wearers[number].subject.body())
        times = [values[0] for address, values in heard[0].heard if address == "/VMC/Ext/T"]
        assert times == pytest.approx(np.arange(frames) / 60, abs=1e-6)
        assert sink.close() == ()


def test_an_avatar_faces_as_the_wearer_does_and_left_is_left() -> None:
    scene = live_scene(0.1, 1)
    with marionettes() as (heard,):
        sink = LiveVmcSink(f"localhost:{heard.port}", stream_head(scene))
        T_pose = np.tile(np.eye(3), (24, 1, 1))
        T_pose[0] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]  # upright in our world, facing -y
        estimate = answer(scene, 0)
        pose = LivePose(0.0, T_pose, np.array([0.3, 0.5, 1.0]))
        sink.write(replace(estimate, wearers=(replace(estimate.wearers[0], newest=pose),)))
        heard.wait(MESSAGES)
        quaternions = [values[4:] for address, values in heard.heard if address == "/VMC/Ext/Bone/Pos"]
        assert np.allclose(quaternions, [0, 0, 0, 1], atol=1e-7)  # a VRM avatar at rest: T-pose, facing z
        world = heard.transforms()
        assert world["LeftHand"][0, 3] < world["Hips"][0, 3] < world["RightHand"][0, 3]
        assert world["LeftToes"][2, 3] > world["LeftFoot"][2, 3]
        assert world["root"][:3, 3] == pytest.approx([-0.3, 0, -0.5])
        sink.close()


def test_a_body_that_was_found_replaces_the_one_supposed() -> None:
    scene = live_scene(0.1, 1)
    tall = skeleton_from_stature(2.0)
    estimate = answer(scene, 3)
    estimate = replace(estimate, wearers=(replace(estimate.wearers[0], skeleton=tall),))
    with marionettes() as (heard,):
        sink = LiveVmcSink(f"127.0.0.1:{heard.port}", stream_head(scene))
        sink.write(estimate)
        heard.wait(MESSAGES)
        check_joints(heard, estimate.wearers[0].newest, tall)
        sink.close()


def test_the_messages_are_those_of_the_protocol_in_datagrams_that_travel_whole() -> None:
    scene = live_scene(0.1, 1)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ear:
        ear.bind(("127.0.0.1", 0))
        ear.settimeout(10)
        sink = LiveVmcSink(f"127.0.0.1:{ear.getsockname()[1]}", stream_head(scene))
        sink.write(answer(scene, 0))
        datagrams = [ear.recv(65536) for _ in range(2)]
        sink.close()
    assert all(datagram.startswith(b"#bundle\0") and len(datagram) <= DATAGRAM for datagram in datagrams)
    assert b"/VMC/Ext/OK\0,i\0\0\0\0\0\1" in datagrams[0]
    assert b"/VMC/Ext/T\0\0,f\0\0" in datagrams[0]
    assert b"/VMC/Ext/Root/Pos\0\0\0,sfffffff\0\0\0root\0\0\0\0" in datagrams[0]
    assert b"/VMC/Ext/Bone/Pos\0\0\0,sfffffff\0\0\0Hips\0\0\0\0" in datagrams[0]


def test_nobody_need_listen_and_what_cannot_be_sent_is_told_at_the_end() -> None:
    scene = live_scene(0.1)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
    sink = LiveVmcSink(f"127.0.0.1:{port}", stream_head(scene))
    for estimate in answers(scene):
        sink.write(estimate)
    assert sink.close() == ()
    sink = LiveVmcSink("255.255.255.255:39539", stream_head(scene))  # a broadcast, which is refused
    sink.write(answer(scene, 0))
    assert sink.close() == ("4 VMC messages could not be sent: Permission denied",)


@pytest.mark.parametrize(
    "target", ["", "39539", "host", "host:", ":39539", "host:port", "host:99999", "udp://a:1", "a:0"]
)
def test_a_target_is_a_host_and_a_port(target: str) -> None:
    with pytest.raises(InputError, match="host:port"):
        check_vmc(target)


def test_each_wearer_needs_a_port() -> None:
    assert check_vmc("[::1]:39539", 3) == ("::1", 39539)
    with pytest.raises(InputError, match="65535"):
        check_vmc("127.0.0.1:65535", 2)
