"""From the fusion to what lies where on the bones: sensors, and what a detector calls hip, shoulder, knee …"""

from collections.abc import Mapping

import numpy as np

from vip_factors.assembly.objective import SceneObjective
from vip_factors.body.keypoints import OFFSET_KEYPOINTS
from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.estimate import DetectorEstimate, SensorPlaceEstimate
from vip_factors.geometry.rotations import Array
from vip_factors.problem.blocks import DETECTOR
from vip_factors.problem.layout import Owner, OwnerId
from vip_factors.stages.fusion import Fused
from vip_factors.stages.scene_decode import static_covariance


def sensor_places(fused: Fused, number: int, marginals: Mapping[int, Array] | None) -> tuple[SensorPlaceEstimate, ...]:
    """Of one wearer's sensors; none if they were no variables.

    Args:
        fused: whose bodies were found and are the problem's.
        number: of the wearer.
        marginals: of what all frames share, by key; None if the data do not determine it.
    """
    model = fused.model.wearers[number]
    if not model.free_places:
        return ()
    points, found = model.sensor_points, fused.state.wearers[number].sensor_places
    sigmas = _sigmas(fused, OwnerId(Owner.WEARER, number), "sensor_places", found.shape, marginals)
    whitening = np.linalg.inv(model.place_whitening)
    prior_sigmas = np.sqrt(np.einsum("sij,sij->si", whitening, whitening))
    return tuple(
        SensorPlaceEstimate(sensor, JOINT_NAMES[bone], prior, prior + change, prior_sigma, sigma)
        for sensor, bone, prior, change, prior_sigma, sigma in zip(
            model.frames.sensors, points.bones, points.p_bone_point, found, prior_sigmas, sigmas, strict=True
        )
    )


def detector_estimate(fused: Fused, marginals: Mapping[int, Array] | None) -> DetectorEstimate | None:
    """The detector's keypoint offsets; None if they were no variables. ``marginals`` as in :func:`sensor_places`."""
    if not fused.model.free_keypoints:
        return None
    found = fused.state.detector.keypoint_offsets
    prior = fused.model.camera.prior_offsets
    sigma = _sigmas(fused, DETECTOR, "keypoint_offsets", found.shape, marginals)
    return DetectorEstimate(OFFSET_KEYPOINTS, prior.mean, found, prior.sigma, sigma)


def _sigmas(
    fused: Fused, owner: OwnerId, block: str, shape: tuple[int, ...], marginals: Mapping[int, Array] | None
) -> Array:
    """Standard deviations of a static block in its shape; NaN if not known."""
    known = None if marginals is None else static_covariance(SceneObjective(fused.model), owner, block, marginals)
    return np.full(shape, np.nan) if known is None else np.sqrt(np.diag(known)).reshape(shape)
