"""Joints and keypoints have names and links in Rerun, read back from what was logged."""

from dataclasses import replace

import numpy as np
import pytest
import rerun as rr
from live_answers import live_scene, setup_of
from scene_sample import estimate_of, scene_sample

from vip_factors.body.keypoints import keypoint_set
from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import JOINT_COUNT
from vip_factors.findings import bare
from vip_factors.geometry.rotations import rotation_z
from vip_factors.simulate.gestures import gestures
from vip_factors.viz import rerun_body
from vip_factors.viz.charts import colour_legend, pixels
from vip_factors.viz.colours import sensor_colours
from vip_factors.viz.drawn_scene import drawn_scene
from vip_factors.viz.rerun_body import cut_skin, see_through
from vip_factors.viz.rerun_camera import log_image_style, log_people
from vip_factors.viz.rerun_layout import NEAREST_M, abreast, centre_path, eye, forward_of, span_axis, span_of, spread_of
from vip_factors.viz.summaries import KEPT, live_summary, scene_summary


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
    log_people(stream, "p", time, frames, pixels, keypoints, lines=False)
    ids = next(one for name, one in stream.columns["p/points"].items() if "keypoint_ids" in name)
    assert ids.to_pylist() == [[3, 5], [17]]
    assert "p/limbs" not in stream.columns


def test_detections_in_an_image_are_of_their_wearers_class() -> None:
    stream, keypoints = Heard(), keypoint_set("openpose18")
    log_image_style(stream, "image", scene_sample(0.1).camera.model, keypoints, ["ann"])
    classes = {
        name: stream.logged[f"image/detected/{name}/points"].class_ids.as_arrow_array().to_pylist()
        for name in ("ann", "nobody\\'s")
    }
    assert classes == {"ann": [1], "nobody\\'s": [0]}
    assert "image/body/ann/limbs" in stream.logged
    assert "image/border" in stream.logged


@pytest.mark.parametrize("frames", [1, 4])
def test_joints_are_logged_frame_by_frame(frames: int) -> None:
    stream, motion = Heard(), gestures(0.5).frames(slice(0, frames))
    rerun_body.log_joints(stream, "j", motion)
    points = next(iter(stream.columns["j"].values())).to_pylist()
    assert [len(one) for one in points] == [JOINT_COUNT] * frames
    np.testing.assert_allclose(points[0], motion.state.p_world_joint[0], atol=1e-6)


def stepped(motion: Motion, x: float, y: float) -> Motion:
    return replace(motion, p_world_pelvis=motion.p_world_pelvis + np.array([x, y, 0.0]))


def test_the_eye_is_near_one_person_and_farther_from_many() -> None:
    body = gestures(0.5)
    alone, pair = [body], [body, stepped(body, 0.0, 4.0)]
    for shown in (alone, pair):
        target = centre_path(shown)[1][0]
        controls = eye(target, forward_of(body), spread_of(shown), 2.0, None)
        distance = np.linalg.norm(np.asarray(controls.position.as_arrow_array().to_pylist()[0]) - target)
        expected = NEAREST_M if len(shown) == 1 else (2.0 + 0.55) / 1.03 + 2.0
        assert distance == pytest.approx(expected, abs=0.02)


def test_people_in_a_row_are_not_looked_at_along_it() -> None:
    body = gestures(0.5)
    for turn in np.deg2rad([0, 30, 90, 140]):
        step = rotation_z(turn) @ [2.0, 0.0, 0.0]
        shown = [body, stepped(body, step[0], step[1])]
        ahead = abreast(shown, np.array([1.0, 0.0, 0.0]))
        towards = rotation_z(0.68) @ ahead
        assert abs(step @ towards) / 2 < np.cos(np.deg2rad(30))


def test_plots_span_the_recording() -> None:
    scene = scene_sample(0.5)
    drawn = drawn_scene(scene, estimate_of(scene))
    start, end = span_of(drawn)
    assert (start, end) == pytest.approx((0.0, 0.5), abs=0.05)
    nanoseconds = span_axis((0.5, 2.0)).view_range.as_arrow_array().to_pylist()[0]
    assert (nanoseconds["start"], nanoseconds["end"]) == (500_000_000, 2_000_000_000)


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


def test_the_legend_shows_every_sensors_colour() -> None:
    colours = sensor_colours([f"sensor_{index}" for index in range(13)])
    picture = pixels(colour_legend(colours)).astype(int)
    for colour in colours.values():
        assert (np.abs(picture - colour).max(axis=-1) < 3).sum() > 200


def test_pieces_of_the_skin_cover_the_body() -> None:
    skin = cut_skin(gestures(0.1).skeleton)
    whole = {tuple(face) for face in skin.mesh.faces}
    assert sum(len(one) for one in skin.once) == len(whole)
    for pieces in (skin.once, skin.lapped):
        assert {tuple(face) for one in pieces for face in one} == whole
    assert cut_skin(gestures(0.2).skeleton) is skin
    assert len(see_through("world/ann")) == 24
