"""From the fusion to the body that it found: lengths and hinges, with how sure they are."""

from collections.abc import Mapping

import numpy as np

from vip_factors.assembly.objective import SceneObjective
from vip_factors.body.hinges import HingeEstimate, hinge_estimates
from vip_factors.body.lengths import LENGTHS, lengths_of
from vip_factors.estimate import BodyEstimate
from vip_factors.geometry.rotations import Array
from vip_factors.problem.layout import Owner, OwnerId
from vip_factors.stages.fusion import Fused
from vip_factors.stages.scene_decode import static_covariance


def body_estimate(fused: Fused, number: int, marginals: Mapping[int, Array] | None) -> BodyEstimate | None:
    """One wearer's body; None if nothing of it was a variable.

    Args:
        fused: whose bodies were found and are the problem's.
        number: of the wearer.
        marginals: of what all frames share, by key; None if the data do not determine it.
    """
    model, hinges = fused.model.wearers[number], fused.state.wearers[number].hinges
    objective, owner = SceneObjective(fused.model), OwnerId(Owner.WEARER, number)

    def covariance(block: str, size: int) -> Array:
        known = None if marginals is None else static_covariance(objective, owner, block, marginals)
        return np.full((size, size), np.nan) if known is None else known

    found, before = tuple[HingeEstimate, ...](), tuple[HingeEstimate, ...]()
    if model.free_hinges:
        found, before = hinge_estimates(hinges, covariance("hinges", len(hinges))), model.hinge_prior.hinges()
    if not model.body_moves or model.variation is None:
        nothing, square = np.zeros(0), np.zeros((0, 0))
        return BodyEstimate((), nothing, nothing, square, square, found, before) if found else None
    lengths, whitening = lengths_of(model.skeleton), model.variation.whitening
    prior = np.array(np.linalg.inv(whitening.T @ whitening), dtype=float)
    return BodyEstimate(
        LENGTHS,
        lengths + model.variation.mean,  # of what is left to change
        lengths,
        prior,
        covariance("body", len(LENGTHS)),
        found,
        before,
    )
