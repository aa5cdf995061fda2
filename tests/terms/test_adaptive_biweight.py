"""How much a keypoint counts by its distance from where the body was expected."""

import numpy as np
import pytest

from vip_factors.factor_settings import AdaptiveBiweightSettings
from vip_factors.terms.reprojection import adaptive_biweight

OKS = np.array([0.05, 0.1])
PREDICTED = np.array([[[100.0, 100.0], [200.0, 200.0]]])


def weights(away: list[float], settings: AdaptiveBiweightSettings, width: float = 1920.0) -> np.ndarray:
    pixels = PREDICTED + np.array(away)[:, None] * np.array([0.6, 0.8])
    return adaptive_biweight(pixels, PREDICTED, OKS, np.array([100.0]), width, settings)[0]


def test_it_falls_off_with_the_distance_and_ends_at_its_reach() -> None:
    own = AdaptiveBiweightSettings()  # standard deviations of 2 · 100 · σ: 10 and 20 px
    np.testing.assert_allclose(weights([0.0, 0.0], own), 1)
    np.testing.assert_allclose(weights([10.0, 20.0], own), np.exp(-0.5))
    np.testing.assert_allclose(weights([19.9, 40.1], own), [np.exp(-0.5 * 1.99**2), 0])


def test_a_given_scale_is_that_of_an_image_1920_wide() -> None:
    papers = AdaptiveBiweightSettings(scale_px=140.0)
    np.testing.assert_allclose(weights([14.0, 28.0], papers), np.exp(-0.5))
    np.testing.assert_allclose(weights([7.0, 14.0], papers, 960.0), np.exp(-0.5))


def test_what_is_not_predicted_counts_in_full_and_what_is_not_seen_not_at_all() -> None:
    pixels, predicted = PREDICTED.copy(), PREDICTED.copy()
    pixels[0, 0], predicted[0, 1] = np.nan, np.nan
    found = adaptive_biweight(pixels, predicted, OKS, np.array([100.0]), 1920.0, AdaptiveBiweightSettings())
    assert found[0].tolist() == pytest.approx([0.0, 1.0])
