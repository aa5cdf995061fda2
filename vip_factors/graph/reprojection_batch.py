"""The reprojection factors of one wearer evaluated for all frames at once."""

from dataclasses import dataclass

import numpy as np

from vip_factors.body.kinematics import BodyState
from vip_factors.factors.camera_pose import CameraPoses
from vip_factors.factors.reprojection import ReprojectionSettings, reprojection_jacobians, reprojection_residual
from vip_factors.geometry.rotations import Array
from vip_factors.graph.scene_model import CameraProblem, KeypointView
from vip_factors.graph.scene_state import CAMERA, CLOCK, POSE
from vip_factors.graph.terms import FRAME, ROOT


@dataclass(frozen=True)
class ReprojectionEquations:
    """Normal equations over a frame's own tangent and the camera's 11 columns: ``(T, 86, 86)`` and ``(T, 86)``."""

    hessian: Array
    gradient: Array

    @property
    def coupling(self) -> Array:
        """Blocks ``(T, 75, 11)`` of the wearer with the camera."""
        return self.hessian[:, :FRAME, FRAME:]


def reprojections(
    view: KeypointView, camera: CameraProblem, poses: CameraPoses, clock: float, body: BodyState
) -> tuple[Array, Array]:
    """Whitened residuals ``(T, K, 2)``, zero where not seen, and the points ``(T, K, 3)`` in the camera's frame."""
    points = np.stack([point.of(body) for point in view.points], axis=1)
    residual, p_camera = reprojection_residual(points, poses, camera.model, view.pixels)
    residual = residual + clock * view.pixels_per_second
    return np.where(view.seen[..., None], residual / view.sigma[..., None], 0.0), p_camera


def reprojection_cost(residual: Array, settings: ReprojectionSettings) -> float:
    """Sum of the losses; what was not seen costs nothing."""
    return float(np.sum(settings.loss.cost(np.linalg.norm(residual, axis=2))))


def reprojection_equations(
    view: KeypointView, camera: CameraProblem, poses: CameraPoses, clock: float, body: BodyState
) -> ReprojectionEquations:
    """The normal equations of all frames."""
    residual, p_camera = reprojections(view, camera, poses, clock, body)
    by_point, by_camera = reprojection_jacobians(p_camera, poses, camera.model)
    T, K = residual.shape[:2]
    J = np.zeros((T, K, 2, FRAME + CAMERA))
    for k, point in enumerate(view.points):
        chain, by_joints = body.point_jacobian(point.bone, point.p_bone_point)
        blocks = by_point[:, k, None] @ by_joints
        for number, joint in enumerate(chain):
            J[:, k, :, 3 * joint : 3 * joint + 3] = blocks[:, number]
    J[..., ROOT:FRAME] = by_point
    J[..., FRAME + POSE.start : FRAME + POSE.stop] = by_camera
    J[..., FRAME + CLOCK] = view.pixels_per_second
    weight = view.seen * camera.settings.reprojection.loss.weight(np.linalg.norm(residual, axis=2))
    root = np.sqrt(weight)[..., None]
    J *= (root / view.sigma[..., None])[..., None]
    rows = J.reshape(T, 2 * K, -1)
    transposed = rows.swapaxes(1, 2)
    gradient = transposed @ (root * residual).reshape(T, 2 * K, 1)
    return ReprojectionEquations(transposed @ rows, gradient[..., 0])
