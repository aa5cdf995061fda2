"""The picture of a body: what was found beside what was likely, wherever it lies."""

import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from vip_factors.body.anthropometry import likely_body, skeleton_from_stature
from vip_factors.body.hinges import HingePrior
from vip_factors.body.lengths import LENGTHS, lengths_of
from vip_factors.estimate import BodyEstimate
from vip_factors.viz.body_chart import AXIS, body_picture

USUAL = skeleton_from_stature(1.75)
FOUND = "#c44854"


def body(changes: dict[str, float], sigma: float = 0.01) -> BodyEstimate:
    prior, covariance = lengths_of(USUAL), likely_body(1.75).variation.covariance
    hinges = HingePrior().hinges()
    found = prior + [changes.get(name, 0.0) for name in LENGTHS]
    return BodyEstimate(LENGTHS, prior, found, covariance, sigma**2 * np.eye(len(LENGTHS)), hinges, hinges)


def dots(picture: str) -> list[float]:
    """Where what was found is drawn, from left to right in the picture, row by row; the legend's own left out."""
    circles = re.findall(rf'<circle cx="([\d.]+)" cy="[\d.]+" r="3.6" fill="{FOUND}"', picture)
    return [float(one) for one in circles][1:]


def test_what_is_longer_is_drawn_further_right_by_as_much() -> None:
    before, after = (dots(body_picture("Ada", body({"forearm": change}))) for change in (0.02, 0.04))
    middle, row = sum(AXIS) / 2, LENGTHS.index("forearm")
    assert after[row] - middle == pytest.approx(2 * (before[row] - middle), abs=0.2)
    assert before[LENGTHS.index("thigh")] == pytest.approx(middle)
    assert len(before) == len(LENGTHS) + 4


def test_what_is_far_off_stays_on_the_page() -> None:
    picture = body_picture("Ada", body({"thigh": -0.3}, sigma=0.2), {"thigh": 0.9})
    assert all(AXIS[0] <= x <= AXIS[1] for x in dots(picture))
    root = ElementTree.fromstring(picture)
    texts = {element.text for element in root.iter() if element.tag.endswith("text")}
    assert "900" in texts  # the truth in numbers
    numbers = [float(one) for one in re.findall(r"[ML] ([\d.-]+) ", picture)]
    assert min(numbers) >= 0
    assert max(numbers) <= float(root.attrib["width"])


def test_what_is_not_known_is_left_out() -> None:
    unsure = replace(body({}), covariance=np.full((len(LENGTHS),) * 2, np.nan), hinges=(), prior_hinges=())
    picture = body_picture("Ada", unsure)
    assert "nan" not in picture
    assert "Carrying angles" not in picture
    nothing, square = np.zeros(0), np.zeros((0, 0))
    hinges = HingePrior().hinges()
    only = body_picture("Ada", BodyEstimate((), nothing, nothing, square, square, hinges, hinges))
    assert "Lengths" not in only
    assert only.count("left knee") == 1
