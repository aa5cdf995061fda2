"""JSON lines of a tracker's answers, and the schema that says what is in them."""

import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from live_answers import LAG, answer, answers, live_scene

from vip_factors.body.joint_angles import joint_angles
from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.geometry.quaternions import Order, matrix_from_quaternion
from vip_factors.io.live_json import LiveJsonSink
from vip_factors.sensors.calibration import SensorCalibration
from vip_factors.sensors.scene import Scene

DATA_SCHEMAS = Path(__file__).parents[2] / "data_schemas"


def lines_of(scene: Scene, *estimates: object) -> list[dict]:
    stream = io.StringIO()
    sink = LiveJsonSink(stream, scene)
    for estimate in estimates:
        sink.write(estimate)
    assert stream.getvalue().endswith("\n")
    return [json.loads(line) for line in stream.getvalue().splitlines()]


def of_joints(pose: dict, key: str) -> np.ndarray:
    assert tuple(pose["joints"]) == JOINT_NAMES
    return np.array([joint[key] for joint in pose["joints"].values()])


def test_there_is_a_line_a_frame_with_joints_by_name() -> None:
    scene = live_scene(0.5)
    given = list(answers(scene))
    lines = lines_of(scene, *given)
    assert [(line["version"], line["frame"]) for line in lines] == [(1, number) for number in range(len(given))]
    assert [one["name"] for one in lines[0]["wearers"]] == ["ann", "bob"]
    assert lines[0]["wearers"][0]["smoothed"] is None
    motions = [wearer.truth.motion for wearer in scene.wearers]
    angles = [joint_angles(motion) for motion in motions]
    for line, estimate in zip(lines[LAG:], given[LAG:], strict=True):
        for number, (told, wearer) in enumerate(zip(line["wearers"], estimate.wearers, strict=True)):
            for kind, frame in (("newest", estimate.frame), ("smoothed", estimate.frame - LAG)):
                pose, state = getattr(wearer, kind), motions[number].state
                for key, R in (
                    ("rotation_wxyz", pose.R_parent_child), ("orientation_wxyz", state.R_world_bone[frame])
                ):  # fmt: skip
                    found = matrix_from_quaternion(of_joints(told[kind], key), Order.WXYZ)
                    np.testing.assert_allclose(found, R, atol=5e-5)
                np.testing.assert_allclose(of_joints(told[kind], "position"), state.p_world_joint[frame], atol=1e-4)
                assert told[kind]["time"] == pytest.approx(pose.time, abs=1e-6)
                np.testing.assert_allclose(np.deg2rad(of_joints(told[kind], "sigma_deg")), np.sqrt(1e-3), atol=1e-4)
                off = [told[kind]["angles_deg"][name] for name in angles[number].names] - angles[number].degrees[frame]
                assert np.abs((off + 180) % 360 - 180).max() < 0.01
        R = matrix_from_quaternion(np.array(line["cameras"][0]["smoothed"]["orientation_wxyz"]), Order.WXYZ)
        np.testing.assert_allclose(R, estimate.cameras[0].smoothed.R_world_camera, atol=5e-5)
        assert line["cameras"][0]["smoothed"]["sigma_deg"] == pytest.approx(3 * [np.rad2deg(0.01)], abs=0.01)
        assert line["cameras"][0]["smoothed"]["position_sigma"] == pytest.approx(3 * [0.03])
        assert line["update_ms"] == 5.0
    assert [line["preliminary"] for line in lines] == [one.preliminary for one in given]


def test_every_answer_is_whole() -> None:
    scene = live_scene(0.1, 1)
    first = answer(scene, 0)
    for line in lines_of(scene, first, first):
        assert len(line["wearers"][0]["headings_deg"]) == 13
        assert line["verdict"] == "care"
        assert line["findings"] == [{"kind": "text", "severity": "care", "text": "the stream has begun"}]


def test_what_is_not_known_is_null_or_absent_and_every_line_is_json() -> None:
    scene = live_scene(0.1, 1, filmed=False)
    bare = answer(scene, 0, covariance=False)
    wearer = bare.wearers[0]
    unknown = {"head": SensorCalibration(np.deg2rad(400.0), np.eye(3))}  # NaN: its sigma is not estimated
    nowhere = replace(wearer.newest, p_world_pelvis=np.full(3, np.nan))
    given = replace(bare, wearers=(replace(wearer, newest=nowhere, calibration=unknown, detection=None),))
    line = lines_of(scene, given)[0]
    assert line["cameras"] == []
    told = line["wearers"][0]
    assert told["headings_deg"] == {"head": {"heading": 40.0, "sigma": None}}
    assert told["newest"]["joints"]["head"]["position"] == [None, None, None]
    assert "sigma_deg" not in told["newest"]["joints"]["head"]
    assert told["detection"] is None


def test_the_schema_is_that_of_the_lines() -> None:
    jsonschema = pytest.importorskip("jsonschema", reason="needs the extra dev")
    schema = json.loads((DATA_SCHEMAS / "live_answer.schema.json").read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator.check_schema(schema)
    for one in schema["$defs"].values():
        one["additionalProperties"] = False  # readers let new keys pass; here all have to be declared
    validator = jsonschema.Draft202012Validator(schema)
    full, bare = live_scene(0.3), live_scene(0.3, 1, filmed=False)
    for scene, covariance in ((full, True), (bare, False)):
        for line in lines_of(scene, answer(scene, 0, covariance), answer(scene, LAG + 1, covariance)):
            validator.validate(line)
    wrong = lines_of(full, answer(full, 0))[0]
    del wrong["wearers"][0]["newest"]["joints"]["left_knee"]
    assert not validator.is_valid(wrong)


def test_a_line_is_there_before_the_next_frame(tmp_path: Path) -> None:
    scene = live_scene(0.1, 1)
    with (tmp_path / "lines").open("w") as stream:
        LiveJsonSink(stream, scene).write(answer(scene, 0))
        assert (tmp_path / "lines").read_text().endswith("\n")
