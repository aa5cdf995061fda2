"""Where the viewer looks from, what its plots span, and what its texts and legends say."""

from dataclasses import replace

import numpy as np
import pytest
from live_answers import live_scene, setup_of
from scene_sample import estimate_of, scene_sample

from vip_factors.body.kinematics import Motion
from vip_factors.geometry.rotations import rotation_z
from vip_factors.simulate.gestures import gestures
from vip_factors.viz.charts import colour_legend, pixels
from vip_factors.viz.colours import sensor_colours
from vip_factors.viz.drawn_scene import drawn_scene
from vip_factors.viz.rerun_body import cut_skin, see_through
from vip_factors.viz.rerun_layout import NEAREST_M, abreast, centre_path, eye, forward_of, span_axis, span_of, spread_of
from vip_factors.viz.summaries import KEPT, finding_lines, live_summary, paragraphs, scene_summary


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


def test_notes_are_a_list_and_lines_stay_lines() -> None:
    assert finding_lines(["a", "b"]) == ["## Notes", "", "- a", "- b", ""]
    assert finding_lines([]) == []
    assert paragraphs("one\ntwo\n\nthree") == ["one", "", "two", "", "three", ""]
    scene = scene_sample(0.3)
    text = scene_summary(drawn_scene(scene, replace(estimate_of(scene), findings=("odd",))))
    assert "\n\n- odd\n\n" in text
    assert "- **ann** is orange;" in text
    assert "- **bob** is blue;" in text


def test_a_streams_text_says_what_is_newest_and_what_is_smoothed() -> None:
    setup = setup_of(live_scene(0.1))
    text = live_summary(setup, [(float(one), f"finding {one}") for one in range(60)], apart=False)
    assert "- **ann**, newest: orange" in text
    assert "Smoothed" in text
    assert text.index("finding 59") < text.index("finding 58")
    assert text.count("finding") == KEPT


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
