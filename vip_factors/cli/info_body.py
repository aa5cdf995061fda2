"""What ``vip-factors info`` says of the body that was found."""

import numpy as np

from vip_factors.body.hinges import HingeEstimate
from vip_factors.cli.text_table import aligned, with_sigma
from vip_factors.estimate import BodyEstimate

KEPT = 0.8  # of the prior's sigma: what is no surer than this keeps its prior


def body_lines(body: BodyEstimate) -> list[str]:
    """A table of lengths, before and after, in millimetres, then the hinges in degrees."""
    lines = []
    if body.names:
        rows = [("length (mm)", "prior", "found", "")]
        values = zip(body.names, body.prior, body.prior_sigma, body.found, body.sigma, strict=True)
        for name, prior, prior_sigma, found, sigma in values:
            kept = "keeps its prior" if sigma > KEPT * prior_sigma else ""
            rows.append((name, with_sigma(1e3 * prior, 1e3 * prior_sigma), with_sigma(1e3 * found, 1e3 * sigma), kept))
        lines += aligned(rows, left=1)
    before = {one.joint: one for one in body.prior_hinges}
    for hinge in body.hinges:
        axis, sigmas = ", ".join(f"{value:.2f}" for value in hinge.axis), np.rad2deg(hinge.sigma)
        sure = f" ± {sigmas[0]:.1f}, {sigmas[1]:.1f}°" if np.all(np.isfinite(sigmas)) else ""
        supposed = f" (supposed {_carrying_angle(before[hinge.joint])})" if hinge.joint in before else ""
        name = hinge.joint.replace("_", " ")
        lines.append(f"{name}: carrying angle {_carrying_angle(hinge)}{supposed}, turns about ({axis}){sure}")
    return lines


def _carrying_angle(hinge: HingeEstimate) -> str:
    return f"{with_sigma(np.rad2deg(hinge.carrying_angle), np.rad2deg(hinge.carrying_sigma), 1)}°"
