"""Joints and keypoints have names and links in Rerun, read back from what was logged."""

from dataclasses import replace

import numpy as np
import pytest
import rerun as rr
from live_answers import live_scene, setup_of
from scene_sample import estimate_of, scene_sample

from vip_factors.body.keypoints import keypoint_set
from vip_factors.body.skeleton import JOINT_COUNT, JOINT_NAMES
from vip_factors.findings import bare
from vip_factors.sensors.detections import Detections
from vip_factors.simulate.gestures import gestures
from vip_factors.viz.drawn_scene import drawn_scene
from vip_factors.viz.rerun_body import cut_skin, log_detections, log_image_style, log_poses, see_through
from vip_factors.viz.rerun_layout import KEPT, live_summary, scene_summary


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


def test_keypoints_have_names_and_dots_their_numbers() -> None:
    stream, keypoints = Heard(), keypoint_set("openpose18")
    log_image_style(stream, "image", scene_sample(0.1).camera.model, keypoints, ["ann"])
    (described,) = stream.logged["image"].context.as_arrow_array().to_pylist()[0]
    labels = {one["id"]: one["label"] for one in described["class_description"]["keypoint_annotations"]}
    assert labels[keypoints.keypoints.index("left_knee")] == "left knee"
    assert {"image/body/ann/limbs", "image/detected/nobody\\'s/points", "image/border"} <= set(stream.logged)
    pixels, confidence = np.full((3, 18, 2), np.nan), np.zeros((3, 18))
    for person, points in enumerate(([3, 5], [17], [4])):
        pixels[person, points], confidence[person, points] = 1.0, 0.9
    detections = Detections(keypoints, np.array([0.0, 0.1]), np.array([0, 1, 1]), pixels, confidence)
    log_detections(stream, "p", detections, np.array([0, 0, -1]), ["ann"])
    for entity, expected in (("p/detected/ann", [[3, 5], [17]]), ("p/detected/nobody\\'s", [[], [4]])):
        columns = stream.columns[f"{entity}/points"]
        assert next(one for name, one in columns.items() if "keypoint_ids" in name).to_pylist() == expected


@pytest.mark.parametrize("frames", [1, 4])
def test_bones_are_where_they_are_drawn(frames: int) -> None:
    stream, motion = Heard(), gestures(0.5).frames(slice(0, frames))
    log_poses(stream, "/world/ann", motion)
    columns = {name.partition(":")[2].split(" ")[0]: one for name, one in stream.columns["/world/ann"].items()}
    bones = [one[0] for one in columns["child_frame"].to_pylist()]
    assert bones == [f"tf#/world/ann/{joint}" for joint in JOINT_NAMES] * frames
    translation = np.array(columns["translation"].to_pylist()).reshape(frames, JOINT_COUNT, 3)
    np.testing.assert_allclose(translation, motion.state.p_world_joint, atol=1e-6)


def test_findings_are_a_list_and_names_are_no_markup() -> None:
    scene = scene_sample(0.3)
    text = scene_summary(drawn_scene(scene, replace(estimate_of(scene), findings=(bare("odd"), bare("[a](b)\n| <c>")))))
    assert "- **verdict**: CARE, usable with care: Something else was noticed\n- **care**: odd\n" in text
    assert "- **care**: \\[a\\](b) \\| \\<c\\>\n" in text
    assert "- **ann** is orange;" in text
    assert "- **bob** is blue;" in text


def test_a_streams_text_says_what_is_newest_and_what_is_smoothed() -> None:
    setup = setup_of(live_scene(0.1))
    text = live_summary(setup, [(float(one), bare(f"finding {one}")) for one in range(60)], apart=False)
    assert "- **ann**, newest: orange" in text
    assert "Smoothed" in text
    assert text.index("finding 59") < text.index("finding 58")
    assert text.count("finding ") == KEPT
    assert "- **verdict**: CARE, usable with care" in text


def test_pieces_of_the_skin_cover_the_body() -> None:
    skin = cut_skin(gestures(0.1).skeleton)
    whole = {tuple(face) for face in skin.mesh.faces}
    assert sum(len(one) for one in skin.once) == len(whole)
    for pieces in (skin.once, skin.lapped):
        assert {tuple(face) for one in pieces for face in one} == whole
    assert len(see_through("world/ann")) == 24
