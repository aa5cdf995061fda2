"""The triangular average of a few samples: what the batch takes from a spline through the whole stream."""

import numpy as np

from vip_factors.geometry.rotations import Array


def triangular_average_of_samples(time: Array, values: Array, half_width: float) -> Array:
    """Average of ``S`` piecewise linear signals under the triangle of the given half-width ``h`` about time zero.

    With the window's second antiderivative, ``G'' = triangle``, partial integration leaves one term for each piece
    between samples: its slope times the increase of G. So ``f(end) G'(end) − Σ slope · ΔG`` is exact; it equals
    :func:`vip_factors.sensors.frames.triangular_average`. Where the samples do not reach the window's ends, the first
    and the last piece go on.

    Args:
        time: ``(S, m)`` seconds from the middle of the window, increasing; the last sample may be repeated.
        values: ``(S, m, D)`` at these times; at least two different ones each.
        half_width: seconds.

    Returns:
        ``(S, D)``.
    """
    h = half_width
    G = _second_antiderivative(time, h)
    step = np.diff(time, axis=1)
    real = step > 0
    slope = np.diff(values, axis=1) / np.where(real, step, 1.0)[..., None]
    average = values[:, -1] - np.einsum("sm,smd->sd", np.diff(G, axis=1), slope)

    last = slope[np.arange(len(time)), real.sum(axis=1) - 1]
    before = G[:, 0]  # what the window holds before the first sample; zero if nothing
    after = (h - time[:, -1]) - (h - G[:, -1])
    return average - before[:, None] * slope[:, 0] + after[:, None] * last


def _second_antiderivative(time: Array, h: float) -> Array:
    """Of the triangle of area one over ``[−h, h]``; zero before it, ``time`` itself behind it."""
    t = np.clip(time, -h, h)
    inside = ((t + h) ** 3 - 2 * np.maximum(t, 0.0) ** 3) / (6 * h * h)
    return inside + np.maximum(time - h, 0.0)
