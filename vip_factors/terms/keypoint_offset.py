"""Keypoint offset: where on the bone a detector's "hip", "shoulder", "knee" … lies, against where its table has it.

``r = k − k₀`` in bone axes, metres, mirrored on the right side; linear; ``k₀`` is zero unless it was learnt. A detector
errs in its own way in every frame alike: taken for the skeleton's, that error bends the body, the mountings and the
camera.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vip_factors.body.keypoints import OFFSET_KEYPOINTS
from vip_factors.geometry.rotations import Array
from vip_factors.problem.variables import DETECTOR
from vip_factors.terms.equations import DenseEquations, JacobianBlock, Term, prior_equations
from vip_factors.terms.evaluation import CameraEvaluation


@dataclass(frozen=True)
class KeypointOffsetSettings:
    """How well it is known what a detector calls a joint."""

    # m about each axis. Detectors lie 1–3 cm beside markers, all axes together; with 15 mm offsets took up what is the
    # skeleton's, whose joint centres are less certain still (foreign scenes: 28.4 mm against 27.1).
    sigma: float = 0.010
    elbow_wrist_sigma: float = 0.008  # m, of elbows and wrists, where a limb is thin and the joint shows
    hip_sigma: float = 0.020  # m: nobody sees a hip, detectors put it up to 4 cm above the joint

    # File with a detector's own means and sigmas instead (docs/same-person.md).
    learned: Path | None = None

    @property
    def sigmas(self) -> Array:
        """Of each keypoint and axis ``(K, 3)``, metres."""
        sigmas = np.full((len(OFFSET_KEYPOINTS), 3), self.sigma)
        sigmas[OFFSET_KEYPOINTS.index("hip")] = self.hip_sigma
        for name in ("elbow", "wrist"):
            sigmas[OFFSET_KEYPOINTS.index(name)] = self.elbow_wrist_sigma
        return sigmas


def equations(at: CameraEvaluation) -> Iterator[DenseEquations]:
    """One factor on all offsets of the detector's keypoints."""
    if at.free_offsets and at.offsets is not None:
        prior = at.problem.prior_offsets
        sigmas = prior.sigma.ravel()
        block = JacobianBlock(DETECTOR, "keypoint_offsets", np.diag(1 / sigmas)[None, None])
        yield from prior_equations(block, ((at.offsets - prior.mean).ravel() / sigmas)[None])


KEYPOINT_OFFSET_PRIOR = Term.prior("keypoint offset prior", equations)
