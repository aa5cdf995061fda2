"""Headings from the motion itself: all sensors of one wearer ride along the same path.

Below a third of a hertz, limbs do not accelerate on their own: what is left of each sensor's horizontal acceleration
is the wearer setting off, turning and stopping, the same for all. In each sensor's inertial frame it appears turned
by that sensor's heading, whatever the mounting.
"""

from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, sosfiltfilt

from vip_factors.geometry.rotations import Array, wrap_angle
from vip_factors.sensors.frames import ImuFrames

CUTOFF_HZ = 0.3  # below a slow step (0.5 Hz per foot), above the drift of attitude filters
LEAST_COHERENCE = 0.5  # below it the limbs' own motion, or standing still, leaves no common acceleration to see
INFLATION = 2.0  # of the error that the coherence promises: what limbs do in step with the body is no white noise
PAD_PERIODS = 3  # recordings shorter than this many periods of the cut-off say nothing


@dataclass(frozen=True)
class HeadingEvidence:
    """Angles in radians and their standard deviations (infinite where there is no evidence), ``(S,)`` each."""

    headings: Array
    sigma: Array

    def combined(self, other: "HeadingEvidence") -> "HeadingEvidence":
        """Both, weighted by their information, the short way round the circle."""
        own, others = self.sigma**-2.0, other.sigma**-2.0
        share = others / (own + others)
        headings = self.headings + share * wrap_angle(other.headings - self.headings)
        return HeadingEvidence(headings, (own + others) ** -0.5)


def headings_from_acceleration(frames: ImuFrames, reference: int) -> HeadingEvidence:
    """Heading of every sensor less that of the reference sensor, from low-passed horizontal acceleration.

    The reference itself, and sensors without acceleration or without common motion, have infinite sigma.
    """
    S = len(frames.sensors)
    none = HeadingEvidence(np.zeros(S), np.full(S, np.inf))
    whole = frames.acceleration_valid
    use = np.any(whole, axis=0)
    rows = np.flatnonzero(np.all(whole[:, use], axis=1))
    duration = len(rows) * frames.step
    if not use[reference] or duration * CUTOFF_HZ < PAD_PERIODS or 2 * CUTOFF_HZ * frames.step >= 1:
        return none
    force = frames.specific_force_inertial[rows]
    low_pass = butter(2, CUTOFF_HZ, fs=1 / frames.step, output="sos")
    smooth = sosfiltfilt(low_pass, force[..., :2], axis=0)
    z = smooth[..., 0] + 1j * smooth[..., 1]
    z = z - z.mean(axis=0)
    cross = np.conj(z).T @ z[:, reference]  # turned from each sensor's frame to the reference's
    power = np.sqrt(np.sum(np.abs(z) ** 2, axis=0))
    product = power * power[reference]
    coherence = np.where(product > 0, np.abs(cross) / np.where(product > 0, product, 1.0), 0.0)
    coherence = np.clip(coherence, 0.0, 0.999)
    samples = 2 * CUTOFF_HZ * duration
    clear = coherence > LEAST_COHERENCE
    safe = np.where(clear, coherence, 1.0)
    sigma = np.where(clear, INFLATION * np.sqrt((1 - safe**2) / (2 * safe**2 * samples)), np.inf)
    sigma[reference] = np.inf
    return HeadingEvidence(np.where(np.isfinite(sigma), np.angle(cross), 0.0), sigma)
