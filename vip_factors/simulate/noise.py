"""Random processes, one value per sample of an evenly sampled stream, and events that last for a while."""

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.stats import norm

from vip_factors.geometry.rotations import Array


def gauss_markov(
    random: np.random.Generator, count: int, step: float, sigma: Array | float, time_constant: float, axes: int = 3
) -> Array:
    """First-order Gauss–Markov process ``(count, axes)``: autocorrelation ``sigma² exp(−|Δt|/time_constant)``.

    It starts in its stationary distribution. ``step`` and ``time_constant`` in seconds; ``sigma`` per axis.
    """
    keep = np.exp(-step / time_constant)
    drive = random.standard_normal((count, axes)) * np.sqrt(1 - keep**2)
    drive[:1] /= np.sqrt(1 - keep**2)
    return np.asarray(sigma) * lfilter([1.0], [1.0, -keep], drive, axis=0)


def smooth_process(
    random: np.random.Generator, count: int, step: float, sigma: Array | float, time_constant: float, axes: int = 3
) -> Array:
    """Matérn-5/2 process ``(count, axes)``: its paths have a velocity and an acceleration of finite variance.

    Autocorrelation ``sigma² (1 + x + x²/3) exp(−x)`` with ``x = √5 |Δt| / time_constant``; a first-order process,
    used as a position, would shake with an acceleration that grows without bound with the sampling rate.
    """
    keep = np.exp(-np.sqrt(5) * step / time_constant)
    pole = [1.0, -3 * keep, 3 * keep**2, -(keep**3)]
    settle = int(np.ceil(6 * time_constant / step))
    response = lfilter([1.0], pole, np.eye(1, settle)[0])
    drive = random.standard_normal((settle + count, axes))
    path = lfilter([1.0], pole, drive, axis=0)[settle:]
    return np.asarray(sigma) * path / np.linalg.norm(response)


def random_walk(random: np.random.Generator, count: int, step: float, sigma_per_root_minute: float) -> Array:
    """Random walk ``(count,)`` from zero; after a minute its standard deviation is ``sigma_per_root_minute``."""
    moves = random.standard_normal(count) * sigma_per_root_minute * np.sqrt(step / 60)
    moves[:1] = 0.0
    return np.cumsum(moves)


def received(
    random: np.random.Generator, count: int, rate: float, packet_loss: float, gap_s: float
) -> NDArray[np.bool_]:
    """Which of ``count`` samples arrive, ``(count,)`` bool: single losses and one longer gap, never the ends."""
    arrives = random.random(count) >= packet_loss
    length = round(gap_s * rate)
    start = random.random()  # drawn always, so that one setting does not shift the draws of another
    if 0 < length < count - 2:
        first = 1 + int(start * (count - 2 - length))
        arrives[first : first + length] = False
    arrives[[0, -1]] = True
    return arrives


def lasting_chance(random: np.random.Generator, count: int, step: float, lasts_s: float, axes: int = 1) -> Array:
    """Numbers ``(count, axes)``, each uniform in [0, 1] but changing slowly: what has chance ``p`` happens at ``< p``.

    With a chance of a few per cent, what happens lasts for about ``0.8 lasts_s`` on average: so long does a smooth
    Gaussian process (:func:`~vip_factors.simulate.noise.smooth_process`) stay beyond two sigmas (Rice's formula).
    """
    return np.asarray(norm.cdf(smooth_process(random, count, step, 1.0, lasts_s, axes)))
