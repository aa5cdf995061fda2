"""Camera orientation: the camera's pose minus the attitude estimate of its IMU.

The residual is that of :mod:`~vip_factors.terms.orientation` with the camera as the bone: ``r = Log(E)`` with
``E = R R_camera_imu (Rz(γ) R_inertial_imu)ᵀ``, rad, world axes (thesis eq. 4.22). A step ``ω`` of the camera acts on
the left of the error, ``Exp(R ω) E``, so ``∂r/∂ω = J_l⁻¹(r) R``.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.terms.equations import DenseEquations, JacobianBlock, Term
from vip_factors.terms.evaluation import CameraEvaluation
from vip_factors.terms.orientation import orientation_jacobians, orientation_residual


def equations(camera: CameraEvaluation, stretch: slice) -> Iterator[DenseEquations]:
    """One factor in each frame."""
    imu = camera.problem.imu
    if imu is None:
        return
    settings = camera.problem.settings.orientation
    sigma = settings.sigma(camera.problem.orientation_weight(camera.step))
    R, mounting = camera.poses(stretch).R_world_camera, camera.state.R_camera_imu
    error = orientation_residual(R, mounting, camera.state.heading, imu.R_inertial_sensor[stretch, 0])

    def blocks() -> tuple[JacobianBlock, ...]:
        by_turn, by_mounting, by_heading = (J / sigma for J in orientation_jacobians(R, mounting, error))
        by_pose = np.concatenate([by_turn @ R, np.zeros_like(R)], axis=2)
        return (
            JacobianBlock(camera.owner, "poses", by_pose[:, None]),
            JacobianBlock(camera.owner, "heading", by_heading[:, None, :, None]),
            JacobianBlock(camera.owner, "R_camera_imu", by_mounting[:, None]),
        )

    yield DenseEquations(stretch.start, error[:, None] / sigma, imu.orientation_valid[stretch], settings.loss, blocks)


CAMERA_ORIENTATION = Term("camera orientation", 0, equations)
