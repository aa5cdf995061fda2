"""Which feet stand on the ground in one frame of the lag."""

from collections.abc import Sequence

import numpy as np

from vip_factors.body.kinematics import BodyState
from vip_factors.geometry.rotations import Array
from vip_factors.live.problem import LagFrame
from vip_factors.problem.wearer import WearerProblem
from vip_factors.stages.ground import foot_acceleration_confidence, free_accelerations, joint_state_confidence
from vip_factors.terms.ground_contact import ContactFrom, Foot, GroundContactSettings

ACCELERATION_HOLDS = 3  # frames: that of the newest frame is measured by the next one, so the last known one counts


def standing_feet(
    wearer: WearerProblem, sensors: np.ndarray, feet: tuple[Foot, ...], body: BodyState, frames: Sequence[LagFrame],
    at: int, settings: GroundContactSettings,
) -> Array:  # fmt: skip
    """How surely each foot stands, ``(G,)``, as :func:`~vip_factors.stages.ground.standing_confidence` has it.

    Args:
        wearer: the problem.
        sensors: its columns among all carriers' sensors.
        feet: to tell of.
        body: over a few frames.
        frames: measured in them.
        at: which of them is meant.
        settings: of the factor.
    """
    if settings.contact_from is ContactFrom.JOINT_STATE:
        return joint_state_confidence(wearer.skeleton, body, feet, wearer.frames.step)[at]
    last = frames[max(0, at + 1 - ACCELERATION_HOLDS) : at + 1]
    force = np.stack([one.specific_force_inertial[sensors] for one in last])
    valid = np.stack([one.acceleration_valid[sensors] for one in last])
    newest = np.full(len(feet), np.nan)
    for free in free_accelerations(wearer.sensors, feet, force, valid):
        newest = np.where(np.isnan(free), newest, free)
    return foot_acceleration_confidence(body.at(slice(at, at + 1)), feet, newest[None], settings)[0]
