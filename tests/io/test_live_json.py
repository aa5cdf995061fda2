"""JSON lines of a tracker's answers."""

import io
import json
from dataclasses import replace

import numpy as np
import pytest
from live_answers import LAG, answer, answers, live_scene

from vip_factors.geometry.quaternions import Order, matrix_from_quaternion
from vip_factors.io.live_json import LiveJsonSink
from vip_factors.sensors.calibration import SensorCalibration


def lines_of(*estimates: object) -> list[dict]:
    stream = io.StringIO()
    sink = LiveJsonSink(stream)
    for one in estimates:
        sink.write(one)
    sink.close()
    assert stream.getvalue().endswith("\n")
    return [json.loads(line) for line in stream.getvalue().splitlines()]


def test_there_is_a_line_a_frame_with_the_poses_in_it() -> None:
    scene = live_scene(0.5)
    given = list(answers(scene))
    lines = lines_of(*given)
    assert [line["frame"] for line in lines] == list(range(len(given)))
    assert [one["name"] for one in lines[0]["wearers"]] == ["ann", "bob"]
    assert lines[0]["wearers"][0]["smoothed"] is None
    for line, estimate in zip(lines[LAG:], given[LAG:], strict=True):
        for told, wearer in zip(line["wearers"], estimate.wearers, strict=True):
            for kind in ("newest", "smoothed"):
                pose = getattr(wearer, kind)
                R = matrix_from_quaternion(np.array(told[kind]["rotations"]), Order.WXYZ)
                np.testing.assert_allclose(R, pose.R_parent_child, atol=5e-5)
                np.testing.assert_allclose(told[kind]["root"], pose.p_world_pelvis, atol=1e-4)
                assert told[kind]["time"] == pytest.approx(pose.time, abs=1e-6)
                np.testing.assert_allclose(np.deg2rad(told[kind]["sigma_deg"]), np.sqrt(1e-3), atol=1e-4)
        R = matrix_from_quaternion(np.array(line["camera"]["smoothed"]["rotation"]), Order.WXYZ)
        np.testing.assert_allclose(R, estimate.smoothed_camera.R_world_camera, atol=5e-5)
        assert line["update_ms"] == 5.0
    assert [line.get("preliminary", False) for line in lines] == [one.preliminary for one in given]


def test_headings_are_told_when_they_change() -> None:
    first = answer(live_scene(0.1, 1), 0)
    heard = [line["wearers"][0].get("headings_deg") for line in lines_of(first, first)]
    assert len(heard[0]) == 13
    assert heard[1] is None
    head = SensorCalibration(np.deg2rad(400.0), np.eye(3), np.deg2rad(2.0))
    turned = replace(first.wearers[0], calibration={**first.wearers[0].calibration, "head": head})
    assert lines_of(first, replace(first, wearers=(turned,)))[1]["wearers"][0]["headings_deg"] == {"head": [40.0, 2.0]}


def test_what_is_not_known_is_null_or_absent_and_every_line_is_json() -> None:
    bare = answer(live_scene(0.1, 1, filmed=False), 0, covariance=False)
    wearer = bare.wearers[0]
    unknown = {"head": SensorCalibration(0.0, np.eye(3))}  # NaN: its sigma is not estimated
    nowhere = replace(wearer.newest, p_world_pelvis=np.full(3, np.nan))
    line = lines_of(replace(bare, wearers=(replace(wearer, newest=nowhere, calibration=unknown, detection=None),)))[0]
    assert "camera" not in line
    told = line["wearers"][0]
    assert told["headings_deg"] == {"head": [0.0, None]}
    assert told["newest"]["root"] == [None, None, None]
    assert "sigma_deg" not in told["newest"]
    assert told["detection"] is None
    assert line["findings"] == ["the stream has begun"]
