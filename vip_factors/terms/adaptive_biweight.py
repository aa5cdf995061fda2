"""The adaptive biweight: keypoints far from where the body was expected count less (Kaichi et al. 2020, eq. 7)."""

from dataclasses import dataclass

import numpy as np

from vip_factors.geometry.rotations import Array

K_OF_SIGMA = 2.0  # COCO's fall-off constants k are twice its OKS sigmas
PAPERS_WIDTH = 1920.0  # of the image in which the paper's scale is given


@dataclass(frozen=True)
class AdaptiveBiweightSettings:
    """How far from its prediction a keypoint is still believed."""

    use: bool = False
    reach: float = 2.0  # β_d: no weight beyond so many standard deviations
    # s in pixels of an image 1920 wide (the paper: 140, for people about 330 pixels tall); none: each person's own size
    scale_px: float | None = None


def adaptive_biweight(
    pixels: Array, predicted: Array, oks: Array, scale: Array, image_width: float, settings: AdaptiveBiweightSettings
) -> Array:
    """Weights in [0, 1], ``(..., K)``: ``exp(−d² / 2 s² k²)`` within ``β_d s k``, else zero.

    Args:
        pixels: ``(..., K, 2)`` as detected; NaN has no weight.
        predicted: ``(..., K, 2)`` where the body before (the last frame's, or the last solve's) would be seen; a
            keypoint of which nothing is known is NaN there, and has its full weight.
        oks: ``(K,)`` OKS sigmas.
        scale: ``(...)`` square root of the person's area in pixels.
        image_width: pixels.
        settings: of the weight.
    """
    fixed = settings.scale_px
    s = np.asarray(scale if fixed is None else np.full(np.shape(scale), fixed * image_width / PAPERS_WIDTH))
    away = np.linalg.norm(pixels - predicted, axis=-1) / (s[..., None] * K_OF_SIGMA * oks)
    with np.errstate(invalid="ignore"):
        weight = np.where(away <= settings.reach, np.exp(-0.5 * away**2), 0.0)
    return np.where(np.all(np.isfinite(predicted), axis=-1), weight, np.all(np.isfinite(pixels), axis=-1))
