"""The reprojection factors of one wearer evaluated for all frames at once."""

from dataclasses import dataclass

import numpy as np

from vip_factors.body.kinematics import BodyState
from vip_factors.factors.camera_pose import CameraPoses
from vip_factors.factors.reprojection import ReprojectionSettings, reprojection_linearised, reprojection_residual
from vip_factors.geometry.rotations import Array
from vip_factors.graph import twist
from vip_factors.graph.scene_model import CameraProblem, KeypointView
from vip_factors.graph.scene_state import CAMERA, CLOCK, POSE
from vip_factors.graph.terms import FRAME
from vip_factors.graph.wearer_residuals import Sites

_CAMERA = FRAME + np.array([*range(POSE.start, POSE.stop), CLOCK])  # what the picture sees of the camera


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
    residual, p_camera = reprojection_residual(Sites.of(view.points).on(body), poses, camera.model, view.pixels)
    residual = residual + clock * view.pixels_per_second
    return np.where(view.seen[..., None], residual / view.sigma[..., None], 0.0), p_camera


def reprojection_cost(residual: Array, settings: ReprojectionSettings) -> float:
    """Sum of the losses; what was not seen costs nothing."""
    return float(np.sum(settings.loss.cost(np.linalg.norm(residual, axis=2))))


def reprojection_equations(
    view: KeypointView, camera: CameraProblem, poses: CameraPoses, clock: float, body: BodyState
) -> ReprojectionEquations:
    """The normal equations of all frames."""
    sites, loss = Sites.of(view.points), camera.settings.reprojection.loss
    points = sites.on(body)
    residual, by_point, by_camera = reprojection_linearised(points, poses, camera.model, view.pixels)
    residual = (residual + clock * view.pixels_per_second) / view.sigma[..., None]
    weight = view.seen * loss.weight(np.sqrt(np.einsum("tki,tki->tk", residual, residual)))
    # Rows by the bone's twist, the camera's pose and the clock; the residual as one more column gives the gradient.
    by_twist = by_point @ body.point_twists(points)
    J = np.concatenate([by_twist, by_camera, view.pixels_per_second[..., None]], axis=3) / view.sigma[..., None, None]
    with_residual = np.concatenate([J, residual[..., None]], axis=3) * weight[..., None, None]
    blocks = J.swapaxes(2, 3) @ with_residual  # (T, K, 6 + 7, 6 + 7 + 1)
    bones = twist.carried(sites.bones, blocks[:, :, :6])
    width = FRAME + CAMERA
    hessian, gradient = np.zeros((len(J), width, width)), np.zeros((len(J), width))
    hessian[:, :FRAME, :FRAME] = twist.hessian(body.screws, bones[..., :6])
    beside = twist.coupling(body.screws, bones[..., 6:])
    hessian[:, :FRAME, _CAMERA] = beside[..., :-1]
    hessian[:, _CAMERA, :FRAME] = beside[..., :-1].swapaxes(1, 2)
    gradient[:, :FRAME] = beside[..., -1]
    alone = blocks[:, :, 6:, 6:].sum(axis=1)
    hessian[:, _CAMERA[:, None], _CAMERA], gradient[:, _CAMERA] = alone[..., :-1], alone[..., -1]
    return ReprojectionEquations(hessian, gradient)
