"""The body that was found, as a message and back (data_schemas/vip_factors/body_estimate.proto)."""

from collections.abc import Sequence

import numpy as np

from vip_factors.errors import FileFormatError
from vip_factors.estimate import BodyEstimate, HingeEstimate
from vip_factors.geometry.rotations import Array
from vip_factors.io.mcap_messages import vector, vector_message
from vip_factors.io.schemas.body_estimate_pb2 import BodyEstimate as BodyEstimateMessage


def body_message(body: BodyEstimate) -> BodyEstimateMessage:
    """Lengths and hinges, with what was taken for likely beforehand."""
    message = BodyEstimateMessage(
        lengths=body.names,
        prior_m=body.prior,
        found_m=body.found,
        prior_covariance_m2=body.prior_covariance.ravel(),
        covariance_m2=body.covariance.ravel(),
    )
    for hinge in body.hinges:
        message.hinges.add(
            joint=hinge.joint,
            axis=vector_message(hinge.axis),
            tilt_sigma_rad=hinge.sigma,
            carrying_angle_rad=hinge.carrying_angle,
            carrying_sigma_rad=hinge.carrying_sigma,
        )
    return message


def body_of(message: BodyEstimateMessage) -> BodyEstimate:
    """The body of a message.

    Raises:
        FileFormatError: if it has not as many numbers as lengths.
    """
    names = tuple(message.lengths)
    B = len(names)
    hinges = tuple(
        HingeEstimate(
            one.joint, vector(one.axis), _numbers(f"tilts of {one.joint}", one.tilt_sigma_rad, (2,)),
            one.carrying_angle_rad, one.carrying_sigma_rad,
        )
        for one in message.hinges
    )  # fmt: skip
    return BodyEstimate(
        names,
        _numbers("prior lengths", message.prior_m, (B,)),
        _numbers("lengths", message.found_m, (B,)),
        _numbers("the prior's covariance", message.prior_covariance_m2, (B, B)),
        _numbers("the lengths' covariance", message.covariance_m2, (B, B)),
        hinges,
    )


def _numbers(what: str, values: Sequence[float], shape: tuple[int, ...]) -> Array:
    if len(values) != int(np.prod(shape)):
        raise FileFormatError(f"the body has {len(values)} numbers of {what}: expected {int(np.prod(shape))}")
    return np.array(values, float).reshape(shape)
