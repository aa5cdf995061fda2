"""Camera acceleration: second difference of its IMU's position minus the accelerometer's measurement.

Three rows, m/s², world axes (thesis eqs. 4.27–4.29). Residual and derivative by the heading are those of
:mod:`~vip_factors.terms.acceleration` for the IMU's position ``p + R q``, with ``q`` in the camera's frame. A step
``(ω, v)`` of a pose moves it by ``R (v − hat(q) ω)``, times the coefficient of that frame
(:meth:`~vip_factors.problem.state.CameraPoses.point_jacobian`).
"""

from collections.abc import Iterator

from vip_factors.terms.acceleration import SECOND_DIFFERENCE, acceleration_by_heading, acceleration_residual
from vip_factors.terms.equations import DenseEquations, JacobianBlock, Term
from vip_factors.terms.evaluation import CameraEvaluation


def equations(camera: CameraEvaluation, stretch: slice) -> Iterator[DenseEquations]:
    """One factor on three successive poses and the heading of the camera's IMU."""
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


CAMERA_ACCELERATION = Term("camera acceleration", 2, equations)
