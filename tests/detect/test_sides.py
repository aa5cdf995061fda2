"""Left and right that change from frame to frame are put right; somebody who turns about is left alone."""

import numpy as np
import pytest

from vip_factors.body.keypoints import keypoint_set
from vip_factors.detect.sides import confused

KEYPOINTS = keypoint_set("coco17")
REACH = 8


def walking(turned: np.ndarray) -> np.ndarray:
    """Pixels ``(F, 17, 2)`` of somebody who is turned about the vertical by so much in each frame, radians."""
    random = np.random.default_rng(1)
    half = {"shoulder": 40.0, "hip": 25.0}
    width = np.array([half.get(name.split("_")[-1], 20.0) for name in KEYPOINTS.keypoints])
    width *= [1 if name.startswith("left") else -1 if name.startswith("right") else 0 for name in KEYPOINTS.keypoints]
    height = {"shoulder": 100.0, "hip": 200.0}
    y = np.array([height.get(name.split("_")[-1], 150.0) for name in KEYPOINTS.keypoints])
    pixels = np.zeros((len(turned), 17, 2))
    pixels[..., 0] = 500 + width * np.cos(turned)[:, None] + 5 * np.sin(np.arange(len(turned)) / 5)[:, None]
    pixels[..., 1] = y
    return pixels + random.normal(0, 2.0, pixels.shape)


CONFIDENCE = np.full((60, 17), 0.9)


@pytest.mark.parametrize("wrong", [[20], [20, 21, 22, 23], range(20, 45), [5, 6, 30, 31, 50], [0, 1]])
def test_exchanged_frames_are_found(wrong: list[int]) -> None:
    pixels = walking(np.zeros(60))
    pixels[list(wrong)] = pixels[list(wrong)][:, KEYPOINTS.mirrored]
    assert np.flatnonzero(confused(KEYPOINTS, pixels, CONFIDENCE, REACH)).tolist() == list(wrong)


@pytest.mark.parametrize("frames", [15, 20, 30, 40])
def test_somebody_who_turns_about_keeps_the_sides(frames: int) -> None:
    turned = np.clip((np.arange(60) - 10) / frames, 0, 1) * np.pi
    assert not np.any(confused(KEYPOINTS, walking(turned), CONFIDENCE, REACH))


def test_a_frame_in_between_does_not_part_what_hangs_together() -> None:
    pixels = walking(np.zeros(60))
    pixels[20:30] = pixels[20:30][:, KEYPOINTS.mirrored]
    pixels[[20, 30]] = (pixels[[20, 30]] + pixels[[20, 30]][:, KEYPOINTS.mirrored]) / 2  # neither of both
    found = confused(KEYPOINTS, pixels, CONFIDENCE, REACH)
    assert found[21:30].all()
    assert not found[:20].any()
    assert not found[31:].any()


def test_somebody_seen_from_the_side_is_left_alone() -> None:
    assert not np.any(confused(KEYPOINTS, walking(np.full(60, np.pi / 2)), CONFIDENCE, REACH))


def test_one_frame_and_no_confidence_tell_nothing() -> None:
    assert not confused(KEYPOINTS, walking(np.zeros(1)), CONFIDENCE[:1], REACH).any()
    assert not confused(KEYPOINTS, walking(np.zeros(60)), 0 * CONFIDENCE, REACH).any()
