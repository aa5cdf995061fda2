"""The settings file of Kaichi's estimator has the paper's weights."""

from pathlib import Path

import numpy as np

from vip_factors.cli.options import read_settings
from vip_factors.settings import Settings
from vip_factors.terms.equations import robust_cost

FILE = Path(__file__).parent.parent / "docs" / "kaichi.toml"


def test_the_papers_weights_are_sigmas_and_losses() -> None:
    """``λ log(1 + (error / unit)²)`` beside ``Σ ‖ΔR‖²``, both divided by 4 σ², σ that of the orientations."""
    settings = read_settings(FILE, Settings())
    limit, pixel, ground = settings.factors.joint_limit, settings.camera.reprojection, settings.camera.ground_contact
    assert pixel.fixed_px is not None
    errors, sigma = np.array([0.001, 0.05, 2.0]), np.deg2rad(4.0)
    for weight, unit, ours, loss in (
        (0.01, 1.0, limit.sigma_deg, limit.loss),
        (5e-4, 1.0, pixel.fixed_px, pixel.loss),
        (5e-3, 0.01, ground.sigma, ground.loss),
    ):
        theirs = weight * np.log1p((errors / unit) ** 2) / (4 * sigma**2)
        np.testing.assert_allclose(robust_cost(loss, errors / ours), theirs, rtol=1e-9)
    assert settings.factors.orientation.sigma == sigma
    uses = (settings.acceleration, settings.calibration.estimate_headings, settings.calibration.estimate_mountings)
    assert uses == (False, False, False)
    assert (settings.fusion.use_camera, ground.use, pixel.biweight.use) == (True, True, True)
