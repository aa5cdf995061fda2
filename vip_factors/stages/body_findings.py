"""What is odd about a body that was found: one that its prior holds for unlikely."""

from collections.abc import Iterator

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.body.pose_prior import joint_vector
from vip_factors.body.skeleton import joint_index
from vip_factors.estimate import BodyEstimate

UNLIKELY = 3.0  # sigmas of the prior
# Knees stretch over by 5° at most; how straight a straight one is leaves as much again, and nobody walks like that.
BACKWARDS_DEG, BACKWARDS_SHARE = -10.0, 0.25
LEAST_SCALE = 0.02  # of a body: less is within what a stature, told by its wearer, is off


def body_findings(who: str, body: BodyEstimate, stature_m: float | None) -> Iterator[str]:
    """Sentences about a wearer ``who`` of whom a stature was told."""
    if not body.names:
        return
    scale, sigma = common_scale(body)
    if abs(scale) > max(UNLIKELY * sigma, LEAST_SCALE):
        usual = "an adult's" if stature_m is None else f"one of {stature_m:.2f} m"
        yield (
            f"{who}: stature and pictures disagree: all lengths together ask for a body {abs(100 * scale):.0f} % "
            f"{'larger' if scale > 0 else 'smaller'} than {usual}: check the stature, and the camera's calibration "
            "(another zoom?)"
        )
    else:
        scale = 0.0
    expected = (1 + scale) * body.prior
    unlikely = [
        f"{name} {1e3 * found:.0f} mm (expected {1e3 * prior:.0f} ± {1e3 * sigma:.0f})"
        for name, found, prior, sigma in zip(body.names, body.found, expected, body.prior_sigma, strict=True)
        if abs(found - prior) > UNLIKELY * sigma
    ]
    if unlikely:  # a wrong stature or zoom changes all lengths alike
        yield (
            f"{who}: stature and pictures disagree about {', '.join(unlikely)}: either the wearer is built so, or the "
            "sensors there sit elsewhere than the placement has them"
        )


def knee_findings(who: str, motion: Motion) -> Iterator[str]:
    """A sentence about knees that bend backwards through much of a motion."""
    for side in ("left", "right"):
        bend = np.rad2deg(joint_vector(motion.R_parent_child))[:, 3 * (joint_index(f"{side}_knee") - 1)]
        share = float(np.mean(bend < BACKWARDS_DEG))
        if share > BACKWARDS_SHARE:
            yield (
                f"{who}: the {side} knee bends backwards in {100 * share:.0f} % of the frames: are the sensors of "
                "thigh and shank where the placement has them, and was the declared pose held?"
            )


def common_scale(body: BodyEstimate) -> tuple[float, float]:
    """By which share all lengths are larger than the prior's mean (least squares under the prior), and its sigma."""
    weighed = np.linalg.solve(body.prior_covariance, body.prior)
    variance = 1 / float(weighed @ body.prior)
    return variance * float(weighed @ (body.found - body.prior)), float(np.sqrt(variance))
