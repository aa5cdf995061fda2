"""Camera acceleration: the second difference of its IMU's position against what the accelerometer says.

Three rows, m/s², world axes (thesis eqs. 4.27–4.29). Residual and derivative by the heading are those of
:mod:`~vip_factors.terms.acceleration`, of the IMU's place ``q`` on the camera: ``p + R q``. By a step ``(ω, v)`` of
a pose it moves by ``R (v − hat(q) ω)``, times the coefficient of that frame
(:meth:`~vip_factors.problem.state.CameraPoses.point_jacobian`).
"""

from collections.abc import Iterator

from vip_factors.terms.acceleration import SECOND_DIFFERENCE, acceleration_by_heading, acceleration_residual
from vip_factors.terms.equations import DenseEquations, JacobianBlock, Term
from vip_factors.terms.evaluation import CameraEvaluation


def equations(at: CameraEvaluation, first: slice) -> Iterator[DenseEquations]:
    """One factor over three frames, and on the heading of the camera's sensor."""
    imu = at.problem.imu
    if imu is None or not at.is_path:
        return
    settings = at.problem.settings.acceleration
    poses, centre = at.poses(slice(first.start, first.stop + 2)), slice(first.start + 1, first.stop + 1)
    place, heading, force = at.problem.p_camera_imu, at.state.heading, imu.specific_force_inertial[centre, 0]
    p, step, count = poses.point(place), at.step, first.stop - first.start
    residual = acceleration_residual(p[:-2], p[1:-1], p[2:], step, heading, force) / settings.sigma

    def blocks() -> tuple[JacobianBlock, ...]:
        by_pose = poses.point_jacobian(place)[:, None] / (step**2 * settings.sigma)
        by_heading = acceleration_by_heading(heading, force)[:, None, :, None] / settings.sigma
        frames = (
            JacobianBlock(at.owner, "poses", c * by_pose[ahead : ahead + count], ahead=ahead)
            for ahead, c in enumerate(SECOND_DIFFERENCE)
        )
        return (*frames, JacobianBlock(at.owner, "heading", by_heading))

    yield DenseEquations(first.start, residual[:, None], imu.acceleration_valid[centre], settings.loss, blocks)


CAMERA_ACCELERATION = Term("camera acceleration", 2, equations)
