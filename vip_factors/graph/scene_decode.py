"""From the solved scene to an estimate."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.body.kinematics import forward_kinematics
from vip_factors.estimate import CameraEstimate, Estimate, PoseCovariance
from vip_factors.factors.reprojection import reprojection_residual
from vip_factors.geometry.rotations import Array, wrap_angle
from vip_factors.graph.decode import decode, pose_covariance
from vip_factors.graph.scene_batch import SceneObjective
from vip_factors.graph.scene_model import SceneModel
from vip_factors.graph.scene_state import HEADING, MOUNTING, SceneState
from vip_factors.graph.terms import heading_column, mounting_columns
from vip_factors.sensors.calibration import SensorCalibration
from vip_factors.sensors.camera_path import CameraPath


@dataclass(frozen=True)
class SceneCovariance:
    """How sure poses are: of each wearer, and ``(T, 6, 6)`` of the camera's pose (None if that is kept)."""

    wearers: tuple[PoseCovariance, ...]
    camera: Array | None

    def at(self, frames: np.ndarray) -> "SceneCovariance":
        """The covariance at some frames, by index ``(n,)``; a camera that stands still has one for all."""
        wearers = tuple(PoseCovariance(one.joints[frames], one.root[frames]) for one in self.wearers)
        moving = self.camera is not None and len(self.camera) > 1
        return SceneCovariance(wearers, self.camera[frames] if self.camera is not None and moving else self.camera)


def scene_covariance(objective: SceneObjective, marginals: Mapping[int, Array]) -> SceneCovariance:
    """The covariance of all poses, out of the marginals of all variables."""
    wearers = tuple(pose_covariance(wearer, marginals) for wearer in objective.wearers)
    if not objective.model.camera.free_pose:
        return SceneCovariance(wearers, None)
    if objective.camera.frame_width:
        return SceneCovariance(wearers, np.stack([marginals[key] for key in objective.camera.frame_keys]))
    return SceneCovariance(wearers, marginals[objective.camera.static_key][None, :6, :6])


def decode_wearers(
    names: Sequence[str], method: str, model: SceneModel, state: SceneState, covariance: SceneCovariance | None
) -> list[Estimate]:
    """Each wearer's estimate."""
    estimates = []
    for number, name in enumerate(names):
        wearer, own = model.wearers[number], state.wearers[number]
        poses = covariance.wearers[number] if covariance is not None else None
        estimates.append(decode(name, method, wearer, own, poses, ()))
    return estimates


def decode_camera(
    name: str, model: SceneModel, state: SceneState, covariance: SceneCovariance | None, time_offset: float
) -> CameraEstimate:
    """The camera's estimate; ``time_offset`` in seconds is what the video's clock was put forward already."""
    poses, time = state.camera.poses, model.wearers[0].frames.time
    calibration = None
    if model.camera.imu is not None:
        calibration = SensorCalibration(float(wrap_angle(state.camera.heading)), state.camera.R_camera_imu)
    return CameraEstimate(
        name,
        model.camera.model,
        CameraPath(time[: len(poses)], poses.R_world_camera, poses.p_world_camera),
        calibration,
        covariance.camera if covariance is not None else None,
        reprojection_rms(model, state),
        time_offset + state.camera.clock,
    )


def reprojection_rms(model: SceneModel, state: SceneState) -> Array:
    """Root mean square reprojection error in pixels, ``(T, wearers)``; NaN where a wearer was not seen."""
    poses, columns = state.camera.at_frames(slice(0, model.frames)), []
    for wearer, own, view in zip(model.wearers, state.wearers, model.views, strict=True):
        body = forward_kinematics(wearer.skeleton, own.R_parent_child, own.p_world_pelvis)
        points = np.stack([point.of(body) for point in view.points], axis=1)
        residual, _ = reprojection_residual(points, poses, model.camera.model, view.pixels)
        squares = np.where(view.seen, np.sum(residual**2, axis=2), 0.0)
        count = view.seen.sum(axis=1)
        columns.append(np.where(count > 0, np.sqrt(squares.sum(axis=1) / np.maximum(count, 1)), np.nan))
    return np.stack(columns, axis=1)


def with_sigmas(estimate: Estimate, model: SceneModel, number: int, marginals: Mapping[int, Array] | None) -> Estimate:
    """The estimate with standard deviations of its calibration, where those are variables of ``model``."""
    objective, wearer = SceneObjective(model).wearers[number], model.wearers[number]
    if marginals is None or objective.static_key not in marginals:
        return estimate
    sigma, S = np.sqrt(np.diag(marginals[objective.static_key])), len(wearer.sensors)
    place = {int(column): index for index, column in enumerate(objective.static_columns)}
    calibration: dict[str, SensorCalibration] = {}
    for s, sensor in enumerate(wearer.frames.sensors):
        heading = place.get(heading_column(s))
        mounting = [place[column] for column in mounting_columns(s, S) if column in place]
        one = estimate.calibration[sensor]
        calibration[sensor] = replace(
            one,
            heading_sigma=float(sigma[heading]) if heading is not None else one.heading_sigma,
            mounting_sigma=sigma[mounting] if mounting else one.mounting_sigma,
        )
    return replace(estimate, calibration=calibration)


def camera_with_sigmas(
    estimate: CameraEstimate, model: SceneModel, marginals: Mapping[int, Array] | None
) -> CameraEstimate:
    """The camera's estimate with standard deviations of its IMU's calibration."""
    objective = SceneObjective(model).camera
    if marginals is None or objective.static_key not in marginals or estimate.calibration is None:
        return estimate
    sigma = np.sqrt(np.diag(marginals[objective.static_key]))
    place = {int(column): index for index, column in enumerate(objective.columns[objective.frame_width :])}
    if HEADING not in place:
        return estimate
    mounting = sigma[[place[column] for column in range(MOUNTING.start, MOUNTING.stop)]]
    calibration = replace(estimate.calibration, heading_sigma=float(sigma[place[HEADING]]), mounting_sigma=mounting)
    return replace(estimate, calibration=calibration)
