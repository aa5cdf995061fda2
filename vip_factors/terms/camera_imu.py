"""The IMU on a camera: orientation and acceleration, as :mod:`~vip_factors.terms.orientation` and
:mod:`~vip_factors.terms.acceleration` with the camera as the bone.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.terms.acceleration import SECOND_DIFFERENCE, acceleration_by_heading, acceleration_residual
from vip_factors.terms.equations import DenseEquations, JacobianBlock, Term
from vip_factors.terms.evaluation import CameraEvaluation
from vip_factors.terms.orientation import orientation_jacobians, orientation_residual


def orientation_equations(camera: CameraEvaluation, stretch: slice) -> Iterator[DenseEquations]:
    """Camera orientation: one factor in each frame on the camera's pose and the attitude estimate of its IMU.

    ``r = Log(E)`` with ``E = R R_camera_imu (Rz(γ) R_inertial_imu)ᵀ``, rad, world axes (thesis eq. 4.22). A step ``ω``
    of the camera acts on the left of the error, ``Exp(R ω) E``, so ``∂r/∂ω = J_l⁻¹(r) R``.
    """
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


def acceleration_equations(camera: CameraEvaluation, stretch: slice) -> Iterator[DenseEquations]:
    """Camera acceleration: one factor on three successive poses and the heading of the camera's IMU.

    The residual is the second difference of the IMU's position ``p + R q`` minus the accelerometer's measurement, m/s²,
    world axes (thesis eqs. 4.27–4.29), with ``q`` in the camera's frame. A step ``(ω, v)`` of a pose moves it by ``R (v
    − hat(q) ω)``, times the coefficient of that frame
    (:meth:`~vip_factors.problem.state.CameraPoses.point_jacobian`).
    """
    imu = camera.problem.imu
    if imu is None or not camera.is_path:
        return
    settings = camera.problem.settings.acceleration
    poses, centre = camera.poses(slice(stretch.start, stretch.stop + 2)), slice(stretch.start + 1, stretch.stop + 1)
    p_camera_imu, heading = camera.problem.p_camera_imu, camera.state.heading
    force = imu.specific_force_inertial[centre, 0]
    p, step, count = poses.point(p_camera_imu), camera.step, stretch.stop - stretch.start
    residual = acceleration_residual(p[:-2], p[1:-1], p[2:], step, heading, force) / settings.sigma

    def blocks() -> tuple[JacobianBlock, ...]:
        by_pose = poses.point_jacobian(p_camera_imu)[:, None] / (step**2 * settings.sigma)
        by_heading = acceleration_by_heading(heading, force)[:, None, :, None] / settings.sigma
        frames = (
            JacobianBlock(camera.owner, "poses", c * by_pose[ahead : ahead + count], ahead=ahead)
            for ahead, c in enumerate(SECOND_DIFFERENCE)
        )
        return (*frames, JacobianBlock(camera.owner, "heading", by_heading))

    yield DenseEquations(stretch.start, residual[:, None], imu.acceleration_valid[centre], settings.loss, blocks)


CAMERA_ORIENTATION = Term("camera orientation", 0, orientation_equations)
CAMERA_ACCELERATION = Term("camera acceleration", 2, acceleration_equations)
