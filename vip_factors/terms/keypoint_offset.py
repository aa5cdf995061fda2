"""Keypoint offset: position of a detector's "hip", "shoulder", "knee" … on the bone, relative to the skeleton's.

``r = k − k₀`` in bone axes, metres, mirrored on the right side; linear; ``k₀`` is zero unless it was learnt. Without
these variables the constant bias of a detector would distort the body, the mountings and the camera.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.problem.variables import DETECTOR
from vip_factors.terms.equations import DenseEquations, JacobianBlock, Term, prior_equations
from vip_factors.terms.evaluation import CameraEvaluation


def equations(camera: CameraEvaluation) -> Iterator[DenseEquations]:
    """One factor on all keypoint offsets, counted with the first camera: all cameras share the detector."""
    if camera.free_offsets and camera.offsets is not None and camera.number == 0:
        prior = camera.problem.prior_offsets
        sigmas = prior.sigma.ravel()
        block = JacobianBlock(DETECTOR, "keypoint_offsets", np.diag(1 / sigmas)[None, None])
        yield from prior_equations(block, ((camera.offsets - prior.mean).ravel() / sigmas)[None])


KEYPOINT_OFFSET_PRIOR = Term.prior("keypoint offset prior", equations)
