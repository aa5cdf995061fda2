"""Texts beside what Rerun draws, and pieces of the skin."""

from dataclasses import replace

from live_answers import live_scene, setup_of
from scene_sample import estimate_of, scene_sample

from vip_factors.findings import bare
from vip_factors.simulate.gestures import gestures
from vip_factors.viz.drawn_scene import drawn_scene
from vip_factors.viz.rerun_body import cut_skin
from vip_factors.viz.rerun_layout import MOST_SHOWN, live_summary, scene_summary


def test_findings_are_a_list_and_names_are_no_markup() -> None:
    scene = scene_sample(0.3)
    text = scene_summary(drawn_scene(scene, replace(estimate_of(scene), findings=(bare("odd"), bare("[a](b)\n| <c>")))))
    assert "- **verdict**: CARE, usable with care: Other remark\n- **care**: odd\n" in text
    assert "- **care**: \\[a\\](b) \\| \\<c\\>\n" in text
    assert "- **ann** is orange;" in text
    assert "- **bob** is blue;" in text


def test_a_streams_text_says_what_is_newest_and_what_is_smoothed() -> None:
    setup = setup_of(live_scene(0.1))
    text = live_summary(setup, [(float(one), bare(f"finding {one}")) for one in range(60)], has_separate_worlds=False)
    assert "- **ann**, newest: orange" in text
    assert "Smoothed" in text
    assert text.index("finding 59") < text.index("finding 58")
    assert text.count("finding ") == MOST_SHOWN
    assert "- **verdict**: CARE, usable with care" in text


def test_pieces_of_the_skin_cover_the_body() -> None:
    skin = cut_skin(gestures(0.1).skeleton)
    whole = {tuple(face) for face in skin.mesh.faces}
    assert sum(len(one) for one in skin.once) == len(whole)
    for pieces in (skin.once, skin.lapped):
        assert {tuple(face) for one in pieces for face in one} == whole
