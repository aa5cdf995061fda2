"""Things that happen now and then, and then last for a while."""

import numpy as np
from scipy.stats import norm

from vip_factors.geometry.rotations import Array
from vip_factors.simulate.noise import smooth_process


def lasting_chance(random: np.random.Generator, count: int, step: float, lasts_s: float, axes: int = 1) -> Array:
    """Numbers ``(count, axes)``, each uniform in [0, 1] but changing slowly: what has chance ``p`` happens at ``< p``.

    With a chance of a few per cent, what happens lasts for about ``0.8 lasts_s`` on average: so long does a smooth
    Gaussian process (:func:`~vip_factors.simulate.noise.smooth_process`) stay beyond two sigmas (Rice's formula).
    """
    return np.asarray(norm.cdf(smooth_process(random, count, step, 1.0, lasts_s, axes)))
