"""The body that was found, as a message and back (data_schemas/vip_factors/body_estimate.proto)."""

from collections.abc import Iterable, Sequence

import numpy as np

from vip_factors.body.hinges import HingeEstimate
from vip_factors.errors import FileFormatError
from vip_factors.estimate import BodyEstimate
from vip_factors.geometry.rotations import Array
from vip_factors.io.mcap_messages import vector_message
from vip_factors.io.schemas.body_estimate_pb2 import BodyEstimate as BodyEstimateMessage


def body_message(body: BodyEstimate) -> BodyEstimateMessage:
    """Lengths and hinges, with what was taken for likely beforehand."""
    return BodyEstimateMessage(
        lengths=body.names,
        prior_m=body.prior,
        found_m=body.found,
        prior_covariance_m2=body.prior_covariance.ravel(),
        covariance_m2=body.covariance.ravel(),
        hinges=hinge_messages(body.hinges),
        prior_hinges=hinge_messages(body.prior_hinges),
    )


def hinge_messages(hinges: Iterable[HingeEstimate]) -> list[BodyEstimateMessage.Hinge]:
    """Hinges one by one."""
    return [
        BodyEstimateMessage.Hinge(
            joint=one.joint,
            axis=vector_message(one.axis),
            tilt_sigma_rad=one.sigma,
            carrying_angle_rad=one.carrying_angle,
            carrying_sigma_rad=one.carrying_sigma,
            variables_rad=one.variables,
            covariance_rad2=one.covariance.ravel(),
        )
        for one in hinges
    ]


def body_of(message: BodyEstimateMessage) -> BodyEstimate:
    """The body of a message.

    Raises:
        FileFormatError: if it has not as many numbers as lengths.
        InputError: for a joint that is no hinge.
    """
    names = tuple(message.lengths)
    B = len(names)
    return BodyEstimate(
        names,
        _numbers("prior lengths", message.prior_m, (B,)),
        _numbers("lengths", message.found_m, (B,)),
        _numbers("the prior's covariance", message.prior_covariance_m2, (B, B)),
        _numbers("the lengths' covariance", message.covariance_m2, (B, B)),
        hinges_of(message.hinges),
        hinges_of(message.prior_hinges),
    )


def hinges_of(messages: Iterable[BodyEstimateMessage.Hinge]) -> tuple[HingeEstimate, ...]:
    """The hinges of messages.

    Raises:
        FileFormatError: if one has not as many covariances as variables.
        InputError: for a joint that is no hinge.
    """
    found = []
    for one in messages:
        count = len(one.variables_rad)
        covariance = _numbers(f"the covariance of {one.joint}", one.covariance_rad2, (count, count))
        found.append(HingeEstimate(one.joint, np.array(one.variables_rad, float), covariance))
    return tuple(found)


def _numbers(what: str, values: Sequence[float], shape: tuple[int, ...]) -> Array:
    if len(values) != int(np.prod(shape)):
        raise FileFormatError(f"the body has {len(values)} numbers of {what}: expected {int(np.prod(shape))}")
    return np.array(values, float).reshape(shape)
