"""The drawings of the documentation show what the package takes for true."""

import runpy
import xml.etree.ElementTree as ET
from pathlib import Path

import cv2
import numpy as np
import pytest

from vip_factors.sensors.calibration import SITES

DOCS = Path(__file__).parents[2] / "docs"
DRAWINGS = runpy.run_path(str(DOCS / "draw.py"))["DRAWINGS"]


def texts(svg: str) -> list[str]:
    return [one.text or "" for one in ET.fromstring(svg).iter("{http://www.w3.org/2000/svg}text")]


def test_every_site_is_drawn_on_one_side_at_least() -> None:
    drawn = set(texts(DRAWINGS["sites.svg"]()))
    for name in SITES:
        mirrored = name.replace("left_", "right_") if name.startswith("left_") else name.replace("right_", "left_")
        assert drawn & {name, mirrored}, f"{name} is not in the picture"


def test_the_checkerboard_has_the_corners_that_its_caption_tells() -> None:
    image = np.full((210, 297), 255, np.uint8)
    for one in ET.fromstring(DRAWINGS["checkerboard.svg"]()).iter("{http://www.w3.org/2000/svg}rect"):
        if one.get("fill") == "#000000":
            x, y, width, height = (float(one.get(key, "")) for key in ("x", "y", "width", "height"))
            assert width == height == 25
            image[round(y) : round(y + height), round(x) : round(x + width)] = 0
    found, corners = cv2.findChessboardCorners(cv2.resize(image, None, fx=3, fy=3), (9, 6))
    assert found
    assert len(corners) == 54
    assert any("--checkerboard 9x6 --square-m 0.025" in one for one in texts(DRAWINGS["checkerboard.svg"]()))


@pytest.mark.parametrize("name", DRAWINGS)
def test_drawings_of_the_documentation_are_there(name: str) -> None:
    assert set(texts((DOCS / name).read_text(encoding="utf-8"))) == set(texts(DRAWINGS[name]()))
