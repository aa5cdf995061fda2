"""Random processes, one value per sample of an evenly sampled stream."""

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

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
    """Second-order Gauss–Markov process ``(count, axes)``, whose paths have a velocity.

    Autocorrelation ``sigma² (1 + |Δt|/T) exp(−|Δt|/T)``, with ``T = time_constant / 2`` so that it decays about as
    fast as a first-order process of that time constant.
    """
    keep = np.exp(-2 * step / time_constant)
    settle = int(np.ceil(5 * time_constant / step))
    drive = random.standard_normal((settle + count, axes))
    path = lfilter([1.0], [1.0, -2 * keep, keep**2], drive, axis=0)[settle:]
    variance = (1 + keep**2) / (1 - keep**2) ** 3  # stationary, of the double pole under unit white noise
    return np.asarray(sigma) * path / np.sqrt(variance)


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
