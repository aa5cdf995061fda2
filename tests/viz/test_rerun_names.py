"""Joints and keypoints have names and links in Rerun, read back from what was logged."""

import numpy as np
import pytest
import rerun as rr

from vip_factors.body.keypoints import keypoint_set
from vip_factors.body.skeleton import JOINT_COUNT
from vip_factors.simulate.gestures import gestures
from vip_factors.viz import rerun_body
from vip_factors.viz.colours import UNCLAIMED
from vip_factors.viz.rerun_camera import log_people


class Heard(rr.RecordingStream):
    """A stream that keeps what it was given."""

    def __init__(self) -> None:
        super().__init__("test")
        self.logged: dict[str, object] = {}
        self.columns: dict[str, dict[str, object]] = {}

    def log(self, entity: str, what: object, **_: object) -> None:
        self.logged[entity] = what

    def send_columns(self, entity: str, indexes: object, columns: object) -> None:
        self.columns[entity] = {str(one.component_descriptor()): one.as_arrow_array() for one in columns}


def test_every_wearer_is_a_class_with_named_and_linked_joints() -> None:
    stream = Heard()
    rerun_body.log_joint_names(stream, "world", ["ann", "bob"])
    told = stream.logged["world"].context.as_arrow_array().to_pylist()[0]
    classes = {one["class_id"]: one["class_description"] for one in told}
    assert {key: one["info"]["label"] for key, one in classes.items()} == {1: "ann", 2: "bob"}
    assert len(classes[1]["keypoint_annotations"]) == JOINT_COUNT
    assert len(classes[1]["keypoint_connections"]) == JOINT_COUNT - 1
    assert classes[1]["keypoint_annotations"][4]["label"] == "left knee"


def test_links_of_a_detector_are_of_wearers_and_not_of_nobody() -> None:
    stream, keypoints = Heard(), keypoint_set("openpose18")
    rerun_body.log_keypoint_names(stream, "image", keypoints, ["ann"])
    told = stream.logged["image"].context.as_arrow_array().to_pylist()[0]
    nobody, ann = (one["class_description"] for one in told)
    assert (len(nobody["keypoint_annotations"]), len(nobody["keypoint_connections"])) == (18, 0)
    named = {one["id"]: one["label"] for one in ann["keypoint_annotations"]}
    links = {(named[one["keypoint0"]], named[one["keypoint1"]]) for one in ann["keypoint_connections"]}
    assert ("left hip", "left knee") in links


def test_dots_carry_the_numbers_of_the_keypoints_that_were_seen() -> None:
    stream, keypoints = Heard(), keypoint_set("openpose18")
    pixels = np.full((2, 18, 2), np.nan)
    pixels[0, [3, 5]], pixels[1, 17] = 1.0, 2.0
    time, frames = np.array([0.0, 0.1]), np.array([0, 1])
    log_people(stream, "p", time, frames, pixels, keypoints, UNCLAIMED, line=0.0, dot=2.0, order=1.0, names=1)
    ids = next(one for name, one in stream.columns["p/points"].items() if "keypoint_ids" in name)
    assert ids.to_pylist() == [[3, 5], [17]]
    assert "p/limbs" not in stream.columns
    assert stream.logged["p/points"].class_ids.as_arrow_array().to_pylist() == [1]


@pytest.mark.parametrize("frames", [1, 4])
def test_joints_are_logged_frame_by_frame(frames: int) -> None:
    stream, motion = Heard(), gestures(0.5).frames(slice(0, frames))
    rerun_body.log_joints(stream, "j", motion)
    points = next(iter(stream.columns["j"].values())).to_pylist()
    assert [len(one) for one in points] == [JOINT_COUNT] * frames
    np.testing.assert_allclose(points[0], motion.state.p_world_joint[0], atol=1e-6)
