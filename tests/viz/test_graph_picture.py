"""The picture of a factor graph says all that is in it, stays on the page, and takes kinds it has never heard of."""

import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.viz.graph_description import (
    FactorKind,
    FrameFactors,
    FrameVariable,
    GraphDescription,
    VariableKind,
)
from vip_factors.viz.graph_frame import WIDTH, places_of
from vip_factors.viz.graph_picture import graph_picture
from vip_factors.viz.graph_symbols import RADIUS, Symbols
from vip_factors.viz.svg import Svg

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


def texts_of(svg: str) -> list[str]:
    return [element.text or "" for element in ElementTree.fromstring(svg) if element.tag.endswith("text")]


def test_every_kind_appears_with_its_count() -> None:
    graph = described()
    texts = texts_of(graph_picture(graph))
    for one in (*graph.variable_kinds, *graph.factor_kinds):
        assert one.kind in texts
        assert f"{one.count:,}".replace(",", " ") in texts
    assert "Factor graph of “walk & talk”" in texts


def test_all_variables_and_factors_of_the_frame_are_drawn() -> None:
    graph = described()
    root, symbols = ElementTree.fromstring(graph_picture(graph)), Symbols(Svg(1, 1), graph)
    squares = [one.get("fill") for one in root if one.tag.endswith("rect")]
    circles = [(one.get("stroke"), one.get("r")) for one in root if one.tag.endswith("circle")]
    assert circles.count((symbols.variable_colour("joint rotation"), "8")) == 24
    # Beside the legend (square and strip) and the four frames of the chain.
    assert squares.count(symbols.factor_colour("orientation")) == 13 + 2 + 4
    assert squares.count(symbols.factor_colour("reprojection")) == 13 + 3 + 4
    rings = [one for one in circles if one[0] == symbols.factor_colour("joint limit")]
    assert len(rings) == 23 + 1


@pytest.mark.parametrize("graph", [described(), described(True), described(frame=0), described(frame=FRAMES - 1)])
def test_nothing_leaves_the_page(graph: GraphDescription) -> None:
    root = ElementTree.fromstring(graph_picture(graph))
    width, height = (float(value) for value in root.attrib["viewBox"].split()[2:])
    assert width == 1600
    for x, y in (point for element in root for point in corners(element)):
        assert 0 <= x <= width
        assert 0 <= y <= height


def corners(element: ElementTree.Element) -> list[tuple[float, float]]:
    """The outermost points of an element; of text at the usual width of letters."""
    number = {name: float(value) for name, value in element.attrib.items() if re.fullmatch(r"-?[\d.]+", value)}
    if element.tag.endswith("rect"):
        x, y = number["x"], number["y"]
        return [(x, y), (x + number["width"], y + number["height"])]
    if element.tag.endswith("circle"):
        x, y, r = number["cx"], number["cy"], number["r"]
        return [(x - r, y - r), (x + r, y + r)]
    if element.tag.endswith("path"):
        values = [float(value) for value in re.findall(r"-?[\d.]+", element.attrib["d"])]
        return list(zip(values[::2], values[1::2], strict=True))
    size, text = number["font-size"], element.text or ""
    begin = {"start": 0.0, "middle": 0.5, "end": 1.0}[element.attrib["text-anchor"]]
    left, width = number["x"], 0.57 * size * len(text)
    return [(left - begin * width, number["y"] - size), (left + (1 - begin) * width, number["y"])]


def test_words_do_not_cover_each_other() -> None:
    root = ElementTree.fromstring(graph_picture(described(True)))
    boxes = []
    for element in root:
        if element.tag.endswith("text") and element.get("stroke") is None:
            (left, top), (right, bottom) = corners(element)
            boxes.append((element.text, left, top + 3, right, bottom))
    for number, (text, left, top, right, bottom) in enumerate(boxes):
        for other, x, y, end, low in boxes[:number]:
            assert right <= x or end <= left or bottom <= y or low <= top, f"'{text}' covers '{other}'"


def test_new_kinds_are_drawn_like_any_other() -> None:
    graph = described()
    new = replace(
        graph,
        variable_kinds=(*graph.variable_kinds, VariableKind("wind", 1, True)),
        factor_kinds=(*graph.factor_kinds, FactorKind("drag", 19, 1, ("root translation", "wind"), ((0, 49),))),
        variables=(*graph.variables, FrameVariable("wind", "ann", shared=True)),
        factors=(*graph.factors, FrameFactors("drag", (ROOT, len(graph.variables)), 1)),
    )
    svg = graph_picture(new)
    colour = Symbols(Svg(1, 1), new).factor_colour("drag")
    assert {"wind", "drag", "19"} <= set(texts_of(svg))
    assert svg.count(f'fill="{colour}"') == 1 + 2 + 4  # frame, legend, chain
    assert svg.count(f'stroke="{colour}"') == 2 + 4


def test_more_wearers_are_mentioned() -> None:
    texts = texts_of(graph_picture(replace(described(), wearers=("ann", "bob"))))
    assert any("and 1 more wearer" in text for text in texts)


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
    at = np.array([layout.at[number] for number, one in enumerate(graph.variables) if one.kind != "keypoint"])
    apart = np.linalg.norm(at[:, None] - at, axis=2) + 1e3 * np.eye(len(at))
    assert apart.min() > 2 * RADIUS
    assert np.all((at[:, 0] > RADIUS) & (at[:, 0] < WIDTH - RADIUS))
    assert len({layout.at[number] for number, one in enumerate(graph.variables) if one.kind == "keypoint"}) == 1
