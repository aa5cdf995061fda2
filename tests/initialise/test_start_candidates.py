"""Candidates of mountings: quarter turns of a strap, and what the vertical says of them."""

import numpy as np

from vip_factors.geometry.rotations import Array, angle_between, exp, rotation_y, transpose, wrap_angle
from vip_factors.initialise.start_candidates import (
    KEPT,
    Candidates,
    about_best,
    frame_cost,
    likely_candidates,
    placed_candidates,
    quarter_turns,
    refined_candidates,
    strap_cost,
)

PLACED = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # x up, z to the right
UP = np.array([0.0, 1.0, 0.0])


def test_quarter_turns_are_the_24_of_a_cube() -> None:
    turned = quarter_turns(PLACED)
    assert len(turned) == 24
    np.testing.assert_array_equal(turned[0], PLACED)
    apart = angle_between(turned[:, None], turned[None])[~np.eye(24, dtype=bool)]
    assert apart.min() > np.deg2rad(89)


def test_quarter_turns_that_lay_a_bone_down_are_left_out() -> None:
    candidates, tilted = placed_candidates(PLACED[None], UP[None], (transpose(PLACED) @ UP)[None])
    assert tilted == ()
    np.testing.assert_allclose(candidates.R_bone_sensor[0][0] @ transpose(PLACED) @ UP, np.tile(UP, (5, 1)), atol=1e-9)


def test_a_sensor_between_two_quarter_turns_is_righted() -> None:
    askew = exp([np.pi / 4, 0.0, 0.0]) @ exp([0.0, 0.0, np.pi / 4]) @ PLACED
    candidates, tilted = placed_candidates(PLACED[None], UP[None], (transpose(askew) @ UP)[None])
    assert tilted == (0,)
    np.testing.assert_allclose(candidates.R_bone_sensor[0][0] @ (transpose(askew) @ UP), np.tile(UP, (8, 1)), atol=1e-9)


def test_costs_are_densities_against_no_rule_at_all() -> None:
    """Over all headings, and all rotations, the densities add up to one."""
    headings = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    assert np.isclose(np.mean(np.exp(-frame_cost(headings, 1.0, 0.2, 0.05))), 1.0, atol=1e-3)
    angles = (np.arange(1000) + 0.5) * np.pi / 1000
    haar = (1 - np.cos(angles)) / np.pi * (np.pi / 1000)
    turned = rotation_y(angles)
    assert np.isclose(np.sum(haar * np.exp(-strap_cost(turned, np.eye(3), 0.3, 0.1))), 1.0, atol=0.03)


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


def first() -> Candidates:
    return Candidates(np.zeros((2, 1)), tuple(np.tile(np.eye(3), (2, 1, 1, 1, 1))))


def test_particles_wander_into_the_valleys_and_the_root_keeps_its_heading() -> None:
    found = refined_candidates(first(), bowl, 0)
    np.testing.assert_array_equal(found.headings[0], 0.0)
    assert np.abs(found.headings[1, 0] - HEADINGS[1]) < np.deg2rad(4)
    assert angle_between(found.R_bone_sensor[1][0, 0], MOUNTINGS[1]) < np.deg2rad(4)
    assert angle_between(found.R_bone_sensor[1], OTHER).min() < np.deg2rad(15)


def test_likely_ones_differ_and_too_few_are_filled_up() -> None:
    several = Candidates(np.zeros((1, 3)), (exp([[[0.0, 0.0, 0.0]], [[0.1, 0.0, 0.0]], [[2.0, 0.0, 0.0]]]),))
    chosen = likely_candidates(several, [np.array([[1.0], [0.0], [3.0]])])
    assert chosen.headings.shape == (1, KEPT)
    np.testing.assert_array_equal(chosen.R_bone_sensor[0][:2], several.R_bone_sensor[0][1:])
    np.testing.assert_array_equal(chosen.R_bone_sensor[0][2], chosen.R_bone_sensor[0][0])


def test_headings_about_the_best_spare_the_root() -> None:
    near = about_best(first(), 0)
    np.testing.assert_array_equal(near.headings[0], 0.0)
    assert np.ptp(near.headings[1]) > np.deg2rad(30)
