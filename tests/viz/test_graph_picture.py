"""The picture of a factor graph says all that is in it, stays on the page, and takes kinds it has never heard of."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.axes import Axes

from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.viz.graph_picture import (
    MARGIN,
    PANEL,
    RADIUS,
    FactorKind,
    FrameFactors,
    FrameVariable,
    GraphDescription,
    VariableKind,
    graph_axes,
    graph_picture,
    places_of,
)

FRAMES = 50
BONES = (0, 9, 15, 16, 17, 18, 19, 1, 2, 4, 5, 7, 8)
ROOT, CAMERA = 24, 25
HEADINGS = range(26, 26 + len(BONES))


def described(moving: bool = False, frame: int = 25) -> GraphDescription:
    """A wearer with thirteen sensors, and a camera."""
    joints = [FrameVariable("joint rotation", "ann", name.replace("_", " "), j) for j, name in enumerate(JOINT_NAMES)]
    camera = FrameVariable("camera pose", "camera", shared=not moving, of_the_body=False)
    headings = [FrameVariable("heading", "ann", f"sensor {bone}", bone=bone, shared=True) for bone in BONES]
    variables = (*joints, FrameVariable("root translation", "ann"), camera, *headings)
    factors = (
        *(FrameFactors("orientation", (bone, h)) for bone, h in zip(BONES, HEADINGS, strict=True)),
        *(FrameFactors("joint limit", (joint,)) for joint in range(1, 24)),
        FrameFactors("pose prior", tuple(range(1, 24))),
        *(FrameFactors("reprojection", (bone, CAMERA), 2) for bone in BONES),
        *(FrameFactors("heading prior", (h,)) for h in HEADINGS),
    )
    return GraphDescription(
        "walk & talk", ("ann",), FRAMES, 1.63, frame, frame / 30,
        (
            VariableKind("joint rotation", 24 * FRAMES, False), VariableKind("root translation", FRAMES, False),
            VariableKind("camera pose", FRAMES if moving else 1, not moving), VariableKind("heading", 13, True),
        ),
        (
            FactorKind("orientation", 641, 1, ("joint rotation", "heading"), ((0, 49),)),
            FactorKind("joint limit", 1150, 1, ("joint rotation",), ((0, 49),)),
            FactorKind("pose prior", 52, 1, ("joint rotation",), ((0, 49),)),
            FactorKind("reprojection", 1274, 1, ("joint rotation", "camera pose"), ((0, 20), (24, 49))),
            FactorKind("smoothness", 49, 2, ("joint rotation",), ((0, 48),)),
            FactorKind("acceleration", 618, 3, ("joint rotation", "root translation", "heading"), ((0, 47),)),
            FactorKind("heading prior", 17, 0, ("heading",)),
        ),
        variables,
        factors,
    )  # fmt: skip


def texts_of(axes: Axes) -> list[str]:
    return [text.get_text() for text in axes.texts]


def marks_of(axes: Axes) -> Counter[str | None]:
    return Counter(line.get_gid() for line in axes.lines)


def test_every_kind_appears_with_its_count() -> None:
    graph = described()
    texts = texts_of(graph_axes(graph))
    for one in (*graph.variable_kinds, *graph.factor_kinds):
        assert one.kind in texts
        assert f"{one.count:,}".replace(",", "\N{NARROW NO-BREAK SPACE}") in texts
    assert "Factor graph of “walk & talk”" in texts


def test_all_variables_and_factors_of_the_frame_are_drawn() -> None:
    marks = marks_of(graph_axes(described()))
    # Beside the frame the legend, and what factors see.
    assert marks["variable joint rotation"] == 24 + 1 + 6
    # Beside the table's first column, four frames.
    assert marks["factor orientation"] == 13 + 1 + 4
    assert marks["factor reprojection"] == 13 + 1 + 4
    assert marks["factor smoothness"] == 1 + 3
    assert marks["factor acceleration"] == 1 + 2
    assert marks["ring joint limit"] == 23 + 1


@pytest.mark.parametrize("graph", [described(), described(True), described(frame=0), described(frame=FRAMES - 1)])
def test_nothing_leaves_the_page_and_no_word_covers_another(graph: GraphDescription) -> None:
    axes = graph_axes(graph)
    page = axes.figure.bbox
    boxes = [(text.get_text(), text.get_window_extent()) for text in axes.texts if text.get_text()]
    for number, (text, box) in enumerate(boxes):
        for other, taken in boxes[:number]:
            assert not box.overlaps(taken), f"'{text}' covers '{other}'"
    for _, box in (*boxes, *((None, line.get_window_extent()) for line in axes.lines)):
        assert page.x0 <= box.x0 <= box.x1 <= page.x1
        assert page.y0 <= box.y0 <= box.y1 <= page.y1


def test_new_kinds_are_drawn_like_any_other() -> None:
    graph = described()
    new = replace(
        graph,
        variable_kinds=(*graph.variable_kinds, VariableKind("wind", 1, True)),
        factor_kinds=(*graph.factor_kinds, FactorKind("drag", 19, 1, ("root translation", "wind"), ((0, 49),))),
        variables=(*graph.variables, FrameVariable("wind", "ann", shared=True)),
        factors=(*graph.factors, FrameFactors("drag", (ROOT, len(graph.variables)), 1)),
    )
    axes = graph_axes(new)
    assert {"wind", "drag", "19"} <= set(texts_of(axes))
    assert marks_of(axes)["factor drag"] == 1 + 1 + 4
    assert marks_of(axes)["variable wind"] == 1 + 1 + 1


def test_more_wearers_are_mentioned() -> None:
    assert "and 1 more wearer alike" in graph_picture(replace(described(), wearers=("ann", "bob")))


def test_variables_of_today_do_not_lie_on_each_other() -> None:
    graph = described()
    mountings = [FrameVariable("mounting", "ann", f"sensor {bone}", bone=bone, shared=True) for bone in BONES]
    places = [FrameVariable("place of a sensor", "ann", f"sensor {bone}", bone=bone, shared=True) for bone in BONES]
    single = [
        FrameVariable(kind, "ann", shared=True) for kind in ("sole", "axes of elbows and knees", *["keypoint"] * 6)
    ]
    clocks = [FrameVariable(kind, "camera", shared=True, of_the_body=False) for kind in ("clock offset", "clock drift")]
    graph = replace(graph, variables=(*graph.variables, *mountings, *places, *single, *clocks))
    layout = places_of(graph)
    at = np.array([layout[number] for number, one in enumerate(graph.variables) if one.kind != "keypoint"])
    apart = np.linalg.norm(at[:, None] - at, axis=2) + 1e3 * np.eye(len(at))
    assert apart.min() > 2 * RADIUS
    assert np.all((at[:, 0] > RADIUS) & (at[:, 0] < PANEL + MARGIN))
    assert len({layout[number] for number, one in enumerate(graph.variables) if one.kind == "keypoint"}) == 1
