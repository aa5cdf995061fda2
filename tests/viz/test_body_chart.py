"""The picture of a body: what was found beside what was likely, wherever it lies."""

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.figure import Figure

from vip_factors.body.anthropometry import likely_body, skeleton_from_stature
from vip_factors.body.hinges import HingePrior
from vip_factors.body.lengths import LENGTHS, lengths_of
from vip_factors.estimate import BodyEstimate
from vip_factors.viz.charts import AXIS, body_figure, svg

USUAL = skeleton_from_stature(1.75)


def body(changes: dict[str, float], sigma: float = 0.01) -> BodyEstimate:
    prior, covariance = lengths_of(USUAL), likely_body(1.75).variation.covariance
    hinges = HingePrior().hinges()
    found = prior + [changes.get(name, 0.0) for name in LENGTHS]
    return BodyEstimate(LENGTHS, prior, found, covariance, sigma**2 * np.eye(len(LENGTHS)), hinges, hinges)


def dots(figure: Figure) -> list[float]:
    """How far right of what was likely each found value is drawn, in pixels, panel by panel and row by row."""
    found = []
    for axes in figure.axes:
        (line,) = (one for one in axes.lines if one.get_label() == "found")
        x = axes.transData.transform(np.column_stack([line.get_xdata(), line.get_ydata()]))[:, 0]
        found += (x - axes.transData.transform((0, 0))[0]).tolist()
    return found


def test_what_is_longer_is_drawn_further_right_by_as_much() -> None:
    before, after = (dots(body_figure("Ada", body({"forearm": change}), {})) for change in (0.02, 0.04))
    row = LENGTHS.index("forearm")
    assert after[row] == pytest.approx(2 * before[row], abs=0.2)
    assert before[LENGTHS.index("thigh")] == pytest.approx(0.0, abs=1e-6)
    assert len(before) == len(LENGTHS) + 4


def test_what_is_far_off_stays_on_the_page() -> None:
    far = body({"thigh": -0.3}, sigma=0.2)
    half = (AXIS[1] - AXIS[0]) / 2
    assert all(abs(x) <= half for x in dots(body_figure("Ada", far, {"thigh": 0.9})))
    root = ElementTree.fromstring(svg(body_figure("Ada", far, {"thigh": 0.9})))
    assert "900" in {element.text for element in root.iter() if element.tag.endswith("text")}  # the truth in numbers


def test_what_is_not_known_is_left_out() -> None:
    unsure = replace(body({}), covariance=np.full((len(LENGTHS),) * 2, np.nan), hinges=(), prior_hinges=())
    picture = svg(body_figure("Ada", unsure, {}))
    assert "nan" not in picture
    assert "Carrying angles" not in picture
    nothing, square = np.zeros(0), np.zeros((0, 0))
    hinges = HingePrior().hinges()
    only = svg(body_figure("Ada", BodyEstimate((), nothing, nothing, square, square, hinges, hinges), {}))
    assert "Lengths" not in only
    assert only.count("left knee") == 1
