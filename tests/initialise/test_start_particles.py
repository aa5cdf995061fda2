"""Candidates that wander: they find what lies between those of a grid, and keep valleys that differ."""

import numpy as np

from vip_factors.geometry.rotations import Array, angle_between, exp, rotation_y, wrap_angle
from vip_factors.initialise.start_candidates import Candidates
from vip_factors.initialise.start_particles import KEPT, Particles, about_best, likely_particles, wander

HEADINGS = np.array([0.0, 0.7])
MOUNTINGS = exp([[0.0, 0.0, 0.0], [0.3, -0.4, 0.2]])
OTHER = rotation_y(2.0) @ MOUNTINGS[1]  # a valley besides, two nats higher


def bowl(candidates: Candidates) -> list[Array]:
    costs = []
    for s, R in enumerate(candidates.R_bone_sensor):
        off = wrap_angle(candidates.headings[s] - HEADINGS[s])[:, None] ** 2
        own = off + angle_between(MOUNTINGS[s], R) ** 2
        costs.append(20 * (np.minimum(own, off + angle_between(OTHER, R) ** 2 + 0.1) if s else own))
    return costs


def first() -> Particles:
    return Particles(np.zeros((2, 1)), np.tile(np.eye(3), (2, 1, 1, 1)))


def test_particles_wander_into_the_valleys_and_the_root_keeps_its_heading() -> None:
    found = wander(first(), bowl, 0)
    np.testing.assert_array_equal(found.headings[0], 0.0)
    assert np.abs(found.headings[1, 0] - HEADINGS[1]) < np.deg2rad(4)
    assert angle_between(found.R_bone_sensor[1, 0], MOUNTINGS[1]) < np.deg2rad(4)
    assert angle_between(found.R_bone_sensor[1], OTHER).min() < np.deg2rad(15)


def test_likely_ones_differ_and_too_few_are_filled_up() -> None:
    several = Particles(np.zeros((1, 3)), exp([[[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [2.0, 0.0, 0.0]]]))
    chosen = likely_particles(several.candidates(), [np.array([[1.0], [0.0], [3.0]])])
    assert chosen.headings.shape == (1, KEPT)
    np.testing.assert_array_equal(chosen.R_bone_sensor[0, 0], several.R_bone_sensor[0, 1])
    np.testing.assert_array_equal(chosen.R_bone_sensor[0, 1], several.R_bone_sensor[0, 2])
    np.testing.assert_array_equal(chosen.R_bone_sensor[0, 2], chosen.R_bone_sensor[0, 0])


def test_headings_about_the_best_spare_the_root() -> None:
    near = about_best(first(), 0)
    np.testing.assert_array_equal(near.headings[0], 0.0)
    assert np.ptp(near.headings[1]) > np.deg2rad(30)
