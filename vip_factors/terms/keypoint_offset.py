"""Keypoint offset: where on the bone a detector's "hip", "shoulder", "knee" … lies, against where its table has it.

``r = k − k₀`` in bone axes, metres, mirrored on the right side; linear; ``k₀`` is zero unless it was learnt. A detector
errs in its own way in every frame alike: taken for the skeleton's, that error bends the body, the mountings and the
camera.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.problem.variables import DETECTOR
from vip_factors.terms.equations import DenseEquations, JacobianBlock, Term, prior_equations
from vip_factors.terms.evaluation import CameraEvaluation


def equations(at: CameraEvaluation) -> Iterator[DenseEquations]:
    """One factor on all offsets of the keypoints, with the first camera: all cameras share the detector."""
    if at.free_offsets and at.offsets is not None and at.number == 0:
        prior = at.problem.prior_offsets
        sigmas = prior.sigma.ravel()
        block = JacobianBlock(DETECTOR, "keypoint_offsets", np.diag(1 / sigmas)[None, None])
        yield from prior_equations(block, ((at.offsets - prior.mean).ravel() / sigmas)[None])


KEYPOINT_OFFSET_PRIOR = Term.prior("keypoint offset prior", equations)
