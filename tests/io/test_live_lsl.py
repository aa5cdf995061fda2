"""The outlet of the Lab Streaming Layer, heard by its own library."""

from dataclasses import replace

import numpy as np
import pytest
from live_answers import LAG, answer, live_scene

from vip_factors.body.joint_angles import ANGLE_DEFINITIONS, joint_angles
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.io.settings import SentPose
from vip_factors.sensors.live import stream_head

try:
    import pylsl
except (ImportError, RuntimeError):
    pytest.skip("needs the extra lsl", allow_module_level=True)

from vip_factors.io.live_lsl import LiveLslSink


def test_samples_arrive_by_the_names_of_their_channels() -> None:
    scene = live_scene(0.5)
    sink = LiveLslSink("vip_factors test", stream_head(scene), 60.0, SentPose.SMOOTHED)
    found = pylsl.resolve_byprop("name", "vip_factors test", timeout=20.0)
    inlet = pylsl.StreamInlet(found[0])
    inlet.open_stream(timeout=20.0)
    for frame, clocks_apart in ((LAG - 1, 100.2), (LAG, 100.0), (LAG + 1, 100.1)):
        given = answer(scene, frame)  # before the lag is over without a smoothed pose: nothing is sent
        sink._clock = lambda now=given.time + clocks_apart: now
        sink.write(given)
    for minutes, clocks_apart in ((1, 100.3), (2, 100.3)):  # clocks that drift: the least of long ago counts no more
        given = answer(scene, LAG)
        given = replace(given, time=given.time + 60 * minutes)
        sink._clock = lambda now=given.time + clocks_apart: now
        sink.write(given)
    (values, first), (_, second) = inlet.pull_sample(timeout=20.0), inlet.pull_sample(timeout=20.0)
    (_, third), (_, fourth) = inlet.pull_sample(timeout=20.0), inlet.pull_sample(timeout=20.0)
    info = inlet.info(timeout=20.0)
    inlet.close_stream()
    assert (info.type(), info.nominal_srate(), info.channel_count()) == (
        "MoCap",
        60.0,
        2 * (24 * 7 + len(ANGLE_DEFINITIONS)),
    )
    named = dict(zip(info.get_channel_labels(), values, strict=True))
    motion = scene.wearers[1].truth.motion
    knee = [named[f"bob left_knee position {axis}"] for axis in "xyz"]
    np.testing.assert_allclose(knee, motion.state.p_world_joint[0, 4], atol=1e-4)
    turn = [named[f"bob left_knee orientation {axis}"] for axis in "wxyz"]
    np.testing.assert_allclose(turn, quaternion_from_matrix(motion.state.R_world_bone[0, 4], Order.WXYZ), atol=1e-4)
    assert named["bob left_knee_flexion"] == pytest.approx(joint_angles(motion).of("left_knee_flexion")[0], abs=0.01)
    times = [wearer.smoothed.time for wearer in (answer(scene, frame).wearers[0] for frame in (LAG, LAG + 1))]
    np.testing.assert_allclose([first, second], np.add(times, 100.0), atol=1e-6)  # the least delay is taken for none
    np.testing.assert_allclose([third, fourth], [times[0] + 100.0, times[0] + 100.3], atol=1e-6)
