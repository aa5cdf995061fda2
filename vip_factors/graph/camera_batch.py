"""The camera's factors evaluated for all frames at once, and their normal equations."""

from collections.abc import Iterator

import gtsam
import numpy as np

from vip_factors.factors.acceleration import acceleration_by_heading, acceleration_residual
from vip_factors.factors.camera_orientation import camera_orientation_jacobians, camera_orientation_residual
from vip_factors.factors.camera_velocity import camera_velocity_jacobians, camera_velocity_residual
from vip_factors.factors.heading_prior import heading_prior_residual
from vip_factors.factors.rotation_prior import rotation_prior_residual
from vip_factors.geometry.rotations import Array, inverse_right_jacobian, transpose
from vip_factors.graph.batch import STEP_ANGLE, STEP_LENGTH
from vip_factors.graph.motion import MotionFactors
from vip_factors.graph.residuals import MotionResiduals, Residuals
from vip_factors.graph.scene_model import CameraProblem
from vip_factors.graph.scene_state import CAMERA, CLOCK, HEADING, MOUNTING, POSE, CameraState
from vip_factors.graph.system import ChainSystem

STEP_CLOCK = 0.05  # s: one unit of damping is a prior of this size on a step of the clock


class CameraObjective:
    """Cost and linearisation of what concerns the camera alone."""

    def __init__(self, camera: CameraProblem, frames: int, step: float) -> None:
        self.camera, self.frames, self.step = camera, frames, step
        free = np.zeros(CAMERA, bool)
        free[POSE] = camera.free_pose
        free[HEADING] = camera.imu is not None
        free[MOUNTING] = camera.imu is not None
        free[CLOCK] = camera.free_clock
        self.columns: np.ndarray = np.flatnonzero(free)
        self.frame_width = 6 if camera.free_pose and camera.moving else 0
        self.frame_keys = [gtsam.symbol("c", t) for t in range(frames)]
        self.static_key = gtsam.symbol("k", 0)

    @property
    def _chained(self) -> bool:
        """Whether each frame has a pose of its own that moves."""
        return self.frame_width > 0

    # Cost

    def cost(self, state: CameraState) -> dict[str, float]:
        """Half the sum of squared whitened residuals, losses applied, by factor kind."""
        terms = [*self._orientation_residuals(state), *self.motion_residuals(state)]
        costs = {term.kind: term.cost for term in terms}
        for kind, residual, _, _ in self.static_rows(state):
            costs[kind] = 0.5 * float(residual @ residual)
        if self._chained:
            loss = self.camera.settings.velocity.loss
            costs["camera velocity"] = float(np.sum(loss.cost(np.linalg.norm(self._velocity(state), axis=1))))
        return costs

    def _orientation_residuals(self, state: CameraState) -> Iterator[Residuals]:
        imu, settings = self.camera.imu, self.camera.settings.orientation
        if imu is None:
            return
        poses, sigma = state.at_frames(slice(0, self.frames)), self._orientation_sigma
        residual = camera_orientation_residual(poses, state.R_camera_imu, state.heading, imu.R_inertial_sensor[:, 0])
        yield Residuals("camera orientation", residual[:, None] / sigma, imu.orientation_valid, settings.loss)

    @property
    def _orientation_sigma(self) -> float:
        return self.camera.settings.orientation.sigma / float(np.sqrt(self.camera.orientation_weight(self.step)))

    def orientation_rows(self, state: CameraState) -> tuple[Array, Array]:
        """Of the orientation factors, weighted: Jacobians ``(T, 3, 11)``, residuals ``(T, 3)``; zero without an IMU."""
        J, poses = np.zeros((self.frames, 3, CAMERA)), state.at_frames(slice(0, self.frames))
        for term in self._orientation_residuals(state):
            sigma, root, residual = self._orientation_sigma, np.sqrt(term.weight), term.residual[:, 0]
            parts = camera_orientation_jacobians(poses, state.R_camera_imu, residual * sigma)
            J[:, :, POSE], J[:, :, HEADING], J[:, :, MOUNTING] = parts
            return (root[..., None] / sigma) * J, root * residual
        return J, J[:, :, 0]

    def velocity_rows(self, state: CameraState) -> tuple[Array, Array, Array]:
        """Of the velocity factors, weighted: Jacobians ``(T − 1, 6, 6)`` by either pose, residuals ``(T − 1, 6)``."""
        settings = self.camera.settings.velocity
        now, after = state.at_frames(slice(0, self.frames - 1)), state.at_frames(slice(1, self.frames))
        residual = camera_velocity_residual(now, after, self.step)
        root = np.sqrt(settings.loss.weight(np.linalg.norm(residual / settings.sigmas, axis=1)))[:, None]
        root = root / settings.sigmas
        by_now, by_after = camera_velocity_jacobians(now, after, residual, self.step)
        return root[..., None] * by_now, root[..., None] * by_after, root * residual

    def motion_residuals(self, state: CameraState) -> Iterator[MotionResiduals]:
        """The acceleration factors, where each frame has a pose of its own."""
        imu, settings = self.camera.imu, self.camera.settings.acceleration
        if imu is None or not self._chained:
            return
        p, force = state.poses.point(self.camera.p_camera_imu), imu.specific_force_inertial[1:-1, 0]
        residual = acceleration_residual(p[:-2], p[1:-1], p[2:], self.step, state.heading, force) / settings.sigma
        by_heading = acceleration_by_heading(state.heading, force) / settings.sigma
        yield MotionResiduals(
            "camera acceleration", residual[:, None], imu.acceleration_valid[1:-1], settings.loss, 1,
            slice(0, 1), np.array([1.0, -2.0, 1.0]) / (self.step**2 * settings.sigma), by_heading[:, None],
        )  # fmt: skip

    def _velocity(self, state: CameraState) -> Array:
        """Whitened residuals ``(T − 1, 6)``."""
        now, after = state.at_frames(slice(0, self.frames - 1)), state.at_frames(slice(1, self.frames))
        return camera_velocity_residual(now, after, self.step) / self.camera.settings.velocity.sigmas

    def static_rows(self, state: CameraState) -> list[tuple[str, Array, np.ndarray, Array]]:
        """Kind, whitened residual, columns and Jacobian of the priors."""
        camera, rows = self.camera, list[tuple[str, Array, np.ndarray, Array]]()
        if not camera.is_beginning:
            return rows
        if camera.imu is not None:
            sigma = np.deg2rad(camera.settings.heading_sigma_deg)
            residual = heading_prior_residual(np.array([state.heading]), np.array([camera.prior_heading])) / sigma
            rows.append(("camera heading prior", residual, np.array([HEADING]), np.eye(1) / sigma))
            error = rotation_prior_residual(state.R_camera_imu, camera.prior_R_camera_imu) / camera.mounting_sigma
            J = inverse_right_jacobian(error * camera.mounting_sigma) / camera.mounting_sigma
            rows.append(("camera mounting prior", error, np.arange(MOUNTING.start, MOUNTING.stop), J))
        if camera.free_clock:
            sigma = camera.settings.clock_sigma
            rows.append(("clock prior", np.array([state.clock / sigma]), np.array([CLOCK]), np.eye(1) / sigma))
        return rows

    # Linearisation

    def linearise(self, state: CameraState) -> ChainSystem:
        """The normal equations at a state, without those of the reprojections."""
        system = ChainSystem.empty(
            self.frame_keys, self.static_key, self.frame_width, self.columns, self._damping(), tied=self._chained
        )
        everything = slice(0, self.frames)
        J, residual = self.orientation_rows(state)
        system.add_frames(everything, transpose(J) @ J, (transpose(J) @ residual[..., None])[..., 0])
        moving = list(self.motion_residuals(state))
        if moving:
            self._add_motion(system, MotionFactors(moving, self.frames), state)
        if self._chained:
            self._add_velocity(system, state)
        for _, residual, columns, J in self.static_rows(state):
            system.add_first(columns, J.T @ J, J.T @ residual)
        return system

    def _add_motion(self, system: ChainSystem, motion: MotionFactors, state: CameraState) -> None:
        assert system.following is not None
        everything, count = slice(0, self.frames), self.frames
        told = motion.information(everything, state.poses.point_jacobian(self.camera.p_camera_imu)[:, None])
        H, g = np.zeros((count, CAMERA, CAMERA)), np.zeros((count, CAMERA))
        H[:, POSE, POSE], g[:, POSE] = told.own[:, 0], told.force[:, 0]
        H[:, POSE, HEADING] = np.sum(told.by_heading, axis=0)[:, 0]
        H[:, HEADING, POSE] = H[:, POSE, HEADING]
        H[:, HEADING, HEADING], g[:, HEADING] = told.heading[:, 0], told.heading_force[:, 0]
        system.add_frames(everything, H, g)
        for ahead, information in enumerate(told.ahead):
            system.following[: len(information), ahead] += information[:, 0]

    def _add_velocity(self, system: ChainSystem, state: CameraState) -> None:
        assert system.following is not None
        by_now, by_after, residual = self.velocity_rows(state)
        system.following[:-1, 0] += transpose(by_now) @ by_after
        for part, J in ((slice(0, -1), by_now), (slice(1, None), by_after)):
            system.own[part, :6, :6] += transpose(J) @ J
            system.gradient[part, :6] += (transpose(J) @ residual[..., None])[..., 0]

    def _damping(self) -> Array:
        scale = np.full(CAMERA, STEP_ANGLE**-2.0)
        scale[3:6] = STEP_LENGTH**-2.0
        scale[CLOCK] = STEP_CLOCK**-2.0
        return scale[self.columns]

    def retract(self, state: CameraState, delta: gtsam.VectorValues) -> CameraState:
        """The state moved by a solution of the linear system."""
        static = np.zeros(CAMERA)
        if len(self.columns) > self.frame_width:
            static[self.columns[self.frame_width :]] = delta.at(self.static_key)
        if self._chained:
            return state.retract(np.array([delta.at(key) for key in self.frame_keys]), static)
        return state.retract(np.tile(static[POSE], (len(state.poses), 1)), static)
