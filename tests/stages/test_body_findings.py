"""Bodies that their prior holds for unlikely are told."""

from dataclasses import replace

import numpy as np
import pytest

from vip_factors.body.anthropometry import likely_body, skeleton_from_stature
from vip_factors.body.kinematics import Motion
from vip_factors.body.lengths import LENGTHS, lengths_of
from vip_factors.body.skeleton import JOINT_COUNT, joint_index
from vip_factors.estimate import BodyEstimate
from vip_factors.geometry.rotations import rotation_x
from vip_factors.stages.body_findings import body_findings, common_scale, knee_findings

USUAL = skeleton_from_stature(1.75)


def found(changes: dict[str, float], scale: float = 0.0) -> BodyEstimate:
    variation, prior = likely_body(USUAL.stature).variation, lengths_of(USUAL)
    covariance = np.linalg.inv(variation.whitening.T @ variation.whitening)
    lengths = (1 + scale) * prior + [changes.get(name, 0.0) for name in LENGTHS]
    return BodyEstimate(LENGTHS, prior, lengths, covariance, covariance / 4)


def test_what_is_expected_is_not_told() -> None:
    assert not list(body_findings("Ada", found({"thigh": 0.02, "trunk": -0.02}), 1.75))
    given = replace(found({}), names=(), prior=np.zeros(0), found=np.zeros(0))
    assert not list(body_findings("Ada", given, 1.75))


def test_a_length_that_is_far_from_expected_is_named() -> None:
    [told, *_] = body_findings("Ada", found({"forearm": -0.05}), 1.75)
    assert "stature and pictures disagree about forearm 2" in told
    assert "thigh" not in told


def test_a_common_scale_is_told_as_one() -> None:
    body = found({}, scale=0.06)
    assert common_scale(body)[0] == pytest.approx(0.06)
    told = list(body_findings("Ada", body, 1.75))
    assert any("all lengths together ask for a body 6 % larger than one of 1.75 m" in one for one in told)
    assert not list(body_findings("Ada", found({}, scale=0.015), 1.75))


def test_knees_that_bend_backwards_are_a_finding() -> None:
    R = np.broadcast_to(np.eye(3), (40, JOINT_COUNT, 3, 3)).copy()
    R[:15, joint_index("left_knee")] = rotation_x(-0.4)
    R[:5, joint_index("right_knee")] = rotation_x(-0.4)
    motion = Motion(USUAL, R, np.zeros((40, 3)), 30.0)
    (sentence,) = knee_findings("wearer 'Ada'", motion)
    assert "left knee bends backwards in 38 %" in sentence


def test_what_is_in_order_but_for_the_scale_is_not_told_one_by_one() -> None:
    [told] = body_findings("Ada", found({}, scale=0.15), 1.75)
    assert "15 % larger" in told
    assert "check the stature" in told
    scale, length = body_findings("Ada", found({"forearm": -0.07}, scale=0.15), 1.75)
    assert "all lengths together" in scale
    assert "forearm" in length
    assert "thigh" not in length
    assert "the wearer is built so" in length
