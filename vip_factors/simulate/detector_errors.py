"""What a detector does wrong with one person at a time: keypoints off their place, unsure, or missed."""

from dataclasses import dataclass

import numpy as np

from vip_factors.body.keypoints import KeypointSet
from vip_factors.geometry.rotations import Array
from vip_factors.simulate.chance import lasting_chance
from vip_factors.simulate.detector_settings import ROOT_AREA_PER_HEIGHT, DetectorSettings
from vip_factors.simulate.detector_view import View
from vip_factors.simulate.noise import gauss_markov


@dataclass
class Found:
    """``P`` people as the detector has them in ``F`` frames.

    Attributes:
        pixels: ``(P, F, K, 2)``.
        confidence: ``(P, F, K)``, 0 where a keypoint is not found.
    """

    pixels: Array
    confidence: Array

    def joined(self, others: "Found") -> "Found":
        """These people and others."""
        return Found(np.concatenate([self.pixels, others.pixels]), np.concatenate([self.confidence, others.confidence]))


def single_people(
    view: View, keypoints: KeypointSet, step: float, settings: DetectorSettings, random: np.random.Generator
) -> Found:
    """Everybody, as if nobody could be taken for somebody else."""
    P, F, K = view.hidden.shape
    one = keypoints.sigmas * ROOT_AREA_PER_HEIGHT * view.height[..., None]

    def per_point(sigma: float, time_constant: float, axes: int) -> Array:
        """Gauss–Markov processes ``(P, F, K, axes)``."""
        return gauss_markov(random, F, step, sigma, time_constant, P * K * axes).reshape(F, P, K, axes).swapaxes(0, 1)

    mean = np.where(view.hidden, settings.hidden_doubt, settings.plain_doubt)
    mean = np.where(view.behind, settings.behind_doubt, mean)
    doubt = np.maximum(mean + per_point(settings.doubt_spread, settings.doubt_time_s, 1)[..., 0], 0.0)
    error = per_point(settings.drift_error, settings.drift_time_s, 2)
    error += per_point(settings.slow_error, settings.slow_time_s, 2)
    error += settings.white_error * random.standard_normal((P, F, K, 2))
    error *= 1 + settings.doubt_error * doubt[..., None]
    pixels = view.aimed + error * one[..., None]
    sure = settings.confidence + per_point(settings.confidence_spread, settings.slow_time_s, 1)[..., 0]
    confidence = np.clip(sure * np.exp(-doubt), 1e-3, 1.0)

    share = np.where(view.hidden, settings.hidden_missed, settings.missed)
    share = np.where(view.behind, settings.behind_missed, share)
    missed = lasting_chance(random, F, step, settings.event_time_s, axes=P * K).reshape(F, P, K).swapaxes(0, 1) < share
    # A point is found only where it is in the image itself: nobody's detector points beside the picture.
    there = np.all(np.isfinite(view.pixels), axis=3) & np.all(np.isfinite(pixels), axis=3) & ~missed
    return Found(np.where(there[..., None], pixels, np.nan), np.where(there, confidence, 0.0))
