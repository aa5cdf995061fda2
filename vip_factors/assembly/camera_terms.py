"""The terms on the camera and the sensor on it."""

from collections.abc import Iterator

import numpy as np

from vip_factors.assembly.equations import DenseEquations, Part
from vip_factors.assembly.evaluation import CameraEvaluation
from vip_factors.assembly.registry import Term
from vip_factors.geometry.rotations import inverse_right_jacobian
from vip_factors.problem.blocks import DETECTOR
from vip_factors.terms.acceleration import acceleration_by_heading, acceleration_residual
from vip_factors.terms.camera_orientation import camera_orientation_jacobians, camera_orientation_residual
from vip_factors.terms.camera_velocity import camera_velocity_jacobians, camera_velocity_residual
from vip_factors.terms.heading_prior import heading_prior_residual
from vip_factors.terms.robust import SQUARE
from vip_factors.terms.rotation_prior import rotation_prior_residual


def camera_orientation(at: CameraEvaluation, first: slice) -> Iterator[DenseEquations]:
    """One factor a frame."""
    imu, settings = at.problem.imu, at.problem.settings.orientation
    if imu is None:
        return
    sigma = settings.sigma / float(np.sqrt(at.problem.orientation_weight(at.step)))
    poses, mounting = at.poses(first), at.state.R_camera_imu
    error = camera_orientation_residual(poses, mounting, at.state.heading, imu.R_inertial_sensor[first, 0])

    def parts() -> tuple[Part, ...]:
        by_pose, by_heading, by_mounting = (J / sigma for J in camera_orientation_jacobians(poses, mounting, error))
        return (
            Part(at.owner, "poses", by_pose[:, None]),
            Part(at.owner, "heading", by_heading[:, None, :, None]),
            Part(at.owner, "R_camera_imu", by_mounting[:, None]),
        )

    seen = imu.orientation_valid[first]
    yield DenseEquations("camera orientation", first.start, error[:, None] / sigma, seen, settings.loss, parts)


def _is_path(at: CameraEvaluation) -> bool:
    """Whether each frame has a pose of its own that moves."""
    return at.problem.moving and at.problem.free_pose


def camera_acceleration(at: CameraEvaluation, first: slice) -> Iterator[DenseEquations]:
    """One factor over three frames, and on the heading of the camera's sensor."""
    imu, settings = at.problem.imu, at.problem.settings.acceleration
    if imu is None or not _is_path(at):
        return
    poses, centre = at.poses(slice(first.start, first.stop + 2)), slice(first.start + 1, first.stop + 1)
    place, heading, force = at.problem.p_camera_imu, at.state.heading, imu.specific_force_inertial[centre, 0]
    p, step, count = poses.point(place), at.step, first.stop - first.start
    residual = acceleration_residual(p[:-2], p[1:-1], p[2:], step, heading, force) / settings.sigma

    def parts() -> tuple[Part, ...]:
        by_pose = poses.point_jacobian(place)[:, None] / (step**2 * settings.sigma)
        by_heading = acceleration_by_heading(heading, force)[:, None, :, None] / settings.sigma
        frames = (
            Part(at.owner, "poses", c * by_pose[ahead : ahead + count], ahead=ahead)
            for ahead, c in enumerate((1.0, -2.0, 1.0))
        )
        return (*frames, Part(at.owner, "heading", by_heading))

    seen = imu.acceleration_valid[centre]
    yield DenseEquations("camera acceleration", first.start, residual[:, None], seen, settings.loss, parts)


def camera_velocity(at: CameraEvaluation, first: slice) -> Iterator[DenseEquations]:
    """One factor for each frame and its next."""
    settings = at.problem.settings.velocity
    if not _is_path(at):
        return
    now, after = at.poses(first), at.poses(slice(first.start + 1, first.stop + 1))
    residual = camera_velocity_residual(now, after, at.step)

    def parts() -> tuple[Part, ...]:
        jacobians = camera_velocity_jacobians(now, after, residual, at.step)
        whitened = (J[:, None] / settings.sigmas[:, None] for J in jacobians)
        return tuple(Part(at.owner, "poses", J, ahead=ahead) for ahead, J in enumerate(whitened))

    yield DenseEquations(
        "camera velocity", first.start, (residual / settings.sigmas)[:, None], 1.0, settings.loss, parts
    )


def camera_heading_prior(at: CameraEvaluation, first: slice) -> Iterator[DenseEquations]:
    """One factor on the heading of the camera's sensor."""
    problem = at.problem
    if problem.imu is None or not _begins(at, first):
        return
    sigma = np.deg2rad(problem.settings.heading_sigma_deg)
    residual = heading_prior_residual(np.array(at.state.heading), np.array(problem.prior_heading)) / sigma
    part = Part(at.owner, "heading", np.ones((1, 1, 1, 1)) / sigma)
    yield DenseEquations("camera heading prior", 0, residual.reshape(1, 1, 1), 1.0, SQUARE, lambda: (part,))


def keypoint_offset_prior(at: CameraEvaluation, first: slice) -> Iterator[DenseEquations]:
    """One factor on all offsets of the detector's keypoints; linear."""
    if not at.free_offsets or at.offsets is None or not _begins(at, first):
        return
    prior = at.problem.prior_offsets
    sigmas = prior.sigma.ravel()
    part = Part(DETECTOR, "keypoint_offsets", np.diag(1 / sigmas)[None, None])
    residual = ((at.offsets - prior.mean).ravel() / sigmas)[None, None]
    yield DenseEquations("keypoint offset prior", 0, residual, 1.0, SQUARE, lambda: (part,))


def camera_mounting_prior(at: CameraEvaluation, first: slice) -> Iterator[DenseEquations]:
    """One factor on how that sensor sits."""
    problem, sigma = at.problem, at.problem.mounting_sigma
    if problem.imu is None or not _begins(at, first):
        return
    error = rotation_prior_residual(at.state.R_camera_imu, problem.prior_R_camera_imu)
    yield DenseEquations(
        "camera mounting prior", 0, error[None, None] / sigma, 1.0, SQUARE,
        lambda: (Part(at.owner, "R_camera_imu", inverse_right_jacobian(error)[None, None] / sigma),),
    )  # fmt: skip


def clock_prior(at: CameraEvaluation, first: slice) -> Iterator[DenseEquations]:
    """One factor on the offset of the video's clock; linear."""
    if at.problem.free_clock and _begins(at, first):
        sigma = at.problem.settings.clock.offset_sigma
        yield _number_prior(at, "clock prior", "clock", at.state.clock, sigma)


def clock_drift_prior(at: CameraEvaluation, first: slice) -> Iterator[DenseEquations]:
    """One factor on its drift; linear."""
    if at.problem.free_clock and _begins(at, first):
        sigma = at.problem.settings.clock.drift_sigma
        yield _number_prior(at, "clock drift prior", "clock_drift", at.state.clock_drift, sigma)


def _number_prior(at: CameraEvaluation, kind: str, block: str, value: float, sigma: float) -> DenseEquations:
    part = Part(at.owner, block, np.ones((1, 1, 1, 1)) / sigma)
    return DenseEquations(kind, 0, np.full((1, 1, 1), value / sigma), 1.0, SQUARE, lambda: (part,))


def _begins(at: CameraEvaluation, first: slice) -> bool:
    return at.problem.is_beginning and first.start == 0


CAMERA_TERMS: tuple[Term[CameraEvaluation], ...] = (
    Term("camera orientation", 0, camera_orientation),
    Term("camera acceleration", 2, camera_acceleration),
    Term("camera velocity", 1, camera_velocity),
    Term("camera heading prior", 0, camera_heading_prior, every_frame=False),
    Term("camera mounting prior", 0, camera_mounting_prior, every_frame=False),
    Term("clock prior", 0, clock_prior, every_frame=False),
    Term("clock drift prior", 0, clock_drift_prior, every_frame=False),
    Term("keypoint offset prior", 0, keypoint_offset_prior, every_frame=False),
)
