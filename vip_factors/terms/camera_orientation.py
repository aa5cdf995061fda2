"""Camera orientation: the attitude estimate of the IMU on the camera against the camera's pose.

The residual is that of :mod:`~vip_factors.terms.orientation`, the camera in the place of the bone: ``r = Log(E)`` with
``E = R R_camera_imu (Rz(γ) R_inertial_imu)ᵀ``, rad, world axes (thesis eq. 4.22). A step ``ω`` of the camera is
``R Exp(ω) R_ci S = Exp(R ω) E``, on the error's left, so ``∂r/∂ω = J_l⁻¹(r) R``.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.terms.equations import DenseEquations, JacobianBlock, Term
from vip_factors.terms.evaluation import CameraEvaluation
from vip_factors.terms.orientation import orientation_jacobians, orientation_residual


def equations(at: CameraEvaluation, first: slice) -> Iterator[DenseEquations]:
    """One factor a frame."""
    imu = at.problem.imu
    if imu is None:
        return
    settings = at.problem.settings.orientation
    sigma = settings.sigma(at.problem.orientation_weight(at.step))
    R, mounting = at.poses(first).R_world_camera, at.state.R_camera_imu
    error = orientation_residual(R, mounting, at.state.heading, imu.R_inertial_sensor[first, 0])

    def blocks() -> tuple[JacobianBlock, ...]:
        by_turn, by_mounting, by_heading = (J / sigma for J in orientation_jacobians(R, mounting, error))
        by_pose = np.concatenate([by_turn @ R, np.zeros_like(R)], axis=2)
        return (
            JacobianBlock(at.owner, "poses", by_pose[:, None]),
            JacobianBlock(at.owner, "heading", by_heading[:, None, :, None]),
            JacobianBlock(at.owner, "R_camera_imu", by_mounting[:, None]),
        )

    yield DenseEquations(first.start, error[:, None] / sigma, imu.orientation_valid[first], settings.loss, blocks)


CAMERA_ORIENTATION = Term("camera orientation", 0, equations)
