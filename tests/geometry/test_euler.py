"""Angles about z, x and y."""

import numpy as np
import pytest

from vip_factors.geometry.euler import without_jumps, zxy_angles
from vip_factors.geometry.rotations import Array, exp, rotation_x, rotation_y, rotation_z


def turned(angles: Array) -> Array:
    z, x, y = np.moveaxis(angles, -1, 0)
    return rotation_z(z) @ rotation_x(x) @ rotation_y(y)


def test_angles_give_the_rotation_back() -> None:
    R = exp(np.random.default_rng(0).normal(0, 2, (500, 3)))
    assert np.allclose(turned(zxy_angles(R)), R, atol=1e-12)


@pytest.mark.parametrize("off", [0.0, 1e-12, 1e-9, 1e-7, 1e-4])
def test_also_where_the_middle_turn_is_a_right_angle(off: float) -> None:
    rng = np.random.default_rng(1)
    angles = np.stack([rng.uniform(-3, 3, 50), np.full(50, np.pi / 2 - off), rng.uniform(-3, 3, 50)], axis=-1)
    R = turned(angles)
    assert np.allclose(turned(zxy_angles(R)), R, atol=3e-7)


def test_without_jumps_angles_are_of_the_same_rotations_and_follow_each_other() -> None:
    time = np.linspace(0, 4 * np.pi, 400)
    steady = np.stack([1.5 * time, 2.2 * np.sin(time), 0.7 * time - 2], axis=-1)
    R = turned(steady)
    found = without_jumps(zxy_angles(R))
    assert np.allclose(turned(found), R, atol=1e-9)
    assert np.abs(np.diff(zxy_angles(R), axis=0)).max() > 3
    assert np.abs(np.diff(found, axis=0)).max() < 0.1
