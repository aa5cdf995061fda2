"""Errors of the lengths of bodies."""

from dataclasses import replace

import numpy as np
import pytest

from vip_factors.body.anthropometry import likely_body
from vip_factors.body.joint_priors import HingePrior
from vip_factors.body.kinematics import Motion
from vip_factors.body.lengths import LENGTHS, lengths_of
from vip_factors.body.model_errors import LENGTH
from vip_factors.estimate import BodyEstimate, WearerEstimate
from vip_factors.evaluate.evaluation import evaluate
from vip_factors.sensors.recording import Truth
from vip_factors.simulate.gestures import gestures


@pytest.fixture(scope="module")
def truth() -> Motion:
    return gestures(4.0, rate=30.0)


def with_body(motion: Motion, changes: dict[str, float], sigma: float = 0.01) -> WearerEstimate:
    """The motion on a body that is off by changes in metres."""
    usual = motion.skeleton
    varied = likely_body(usual.stature).variation.varied(usual, np.array([changes.get(name, 0.0) for name in LENGTHS]))
    square = sigma**2 * np.eye(len(LENGTHS))
    body = BodyEstimate(LENGTHS, lengths_of(usual), lengths_of(varied), 9 * square, square, HingePrior().hinges())
    return WearerEstimate("walk", "VIP", replace(motion, skeleton=varied), {}, body=body)


def test_lengths_are_compared_one_by_one(truth: Motion) -> None:
    found = evaluate(with_body(truth, {"thigh": 0.02, "forearm": -0.01}), Truth(truth))
    assert found.lengths["thigh"]["error_mm"] == pytest.approx(20.0)
    assert found.lengths["forearm"]["error_mm"] == pytest.approx(-10.0)
    assert found.lengths["shank"]["error_mm"] == pytest.approx(0.0, abs=1e-9)
    assert found["length_error"] == pytest.approx((20 + 10) / 7)
    assert "| thigh |" in found.to_table()


def test_honest_lengths_have_a_nees_of_one(truth: Motion) -> None:
    names = ("thigh", "shank", "upper arm", "forearm", "hip width", "shoulder width")
    found = evaluate(with_body(truth, dict.fromkeys(names, float(np.hypot(0.01, LENGTH)))), Truth(truth))
    assert found["nees_lengths"] == pytest.approx(1.0, rel=1e-6)


def test_without_a_body_that_was_found_there_is_no_honesty(truth: Motion) -> None:
    found = evaluate(replace(with_body(truth, {}), body=None), Truth(truth))
    assert "nees_lengths" not in found.metrics
    assert found["length_error"] == pytest.approx(0.0, abs=1e-9)
