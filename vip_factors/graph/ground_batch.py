"""The ground contacts of one wearer before one camera, evaluated for all frames at once."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from vip_factors.body.kinematics import BodyState
from vip_factors.factors.camera_pose import CameraPoses
from vip_factors.factors.ground_contact import (
    Foot,
    GroundContactSettings,
    ground_contact_jacobians,
    ground_contact_residual,
)
from vip_factors.geometry.rotations import Array
from vip_factors.graph.reprojection_batch import ReprojectionEquations
from vip_factors.graph.scene_model import GroundView
from vip_factors.graph.scene_state import CAMERA, POSE
from vip_factors.graph.terms import FRAME, ROOT


@dataclass(frozen=True)
class _Standing:
    """One foot in the ``n`` frames in which it stands."""

    foot: Foot
    frames: np.ndarray
    ray: Array
    whitening: Array
    body: BodyState
    camera: CameraPoses
    height: Array
    residual: Array  # whitened


def ground_cost(ground: GroundView, poses: CameraPoses, body: BodyState, settings: GroundContactSettings) -> float:
    """Sum of the losses."""
    norms = (np.linalg.norm(one.residual, axis=1) for one in _standing(ground, poses, body))
    return float(sum(np.sum(settings.loss.cost(norm)) for norm in norms))


def ground_equations(
    ground: GroundView, poses: CameraPoses, body: BodyState, settings: GroundContactSettings
) -> ReprojectionEquations:
    """The normal equations of all frames."""
    T, width = len(ground.stands), FRAME + CAMERA
    H, g = np.zeros((T, width, width)), np.zeros((T, width))
    for one in _standing(ground, poses, body):
        root = np.sqrt(settings.loss.weight(np.linalg.norm(one.residual, axis=1)))
        W = root[:, None, None] * one.whitening
        by_height, by_camera = ground_contact_jacobians(one.height, one.camera, one.ray)
        chain, by_joints, of_height = one.foot.ankle_jacobian(one.body)
        blocks = W[:, None] @ (by_joints + by_height[:, None, :, None] * of_height[:, :, None])
        J = np.zeros((len(one.frames), 3, width))
        for number, joint in enumerate(chain):
            J[:, :, 3 * joint : 3 * joint + 3] = blocks[:, number]
        J[:, :, ROOT:FRAME] = W
        J[:, :, FRAME + POSE.start : FRAME + POSE.stop] = W @ by_camera
        transposed = J.swapaxes(1, 2)
        H[one.frames] += transposed @ J
        g[one.frames] += (transposed @ (root[:, None] * one.residual)[..., None])[..., 0]
    return ReprojectionEquations(H, g)


def _standing(ground: GroundView, poses: CameraPoses, body: BodyState) -> Iterator[_Standing]:
    for number, foot in enumerate(ground.feet):
        frames = np.flatnonzero(ground.stands[:, number])
        part = BodyState(body.R_world_bone[frames], body.p_world_joint[frames])
        camera = CameraPoses(poses.R_world_camera[frames], poses.p_world_camera[frames])
        ray, W = ground.rays[frames, number], ground.whitening[frames, number]
        p, height = foot.ankle(part)
        residual = (W @ ground_contact_residual(p, height, camera, ray)[..., None])[..., 0]
        yield _Standing(foot, frames, ray, W, part, camera, height, residual)
