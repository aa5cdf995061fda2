"""From the solved state to an estimate."""

from collections.abc import Mapping, Sequence

import numpy as np

from vip_factors.assembly.evaluation import WearerEvaluation
from vip_factors.assembly.wearer_terms import acceleration, orientation
from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.estimate import Estimate, PoseCovariance, SolveReport
from vip_factors.geometry.rotations import Array, wrap_angle
from vip_factors.problem.layout import FRAME, ROOT
from vip_factors.problem.state import WearerState
from vip_factors.problem.wearer import WearerProblem
from vip_factors.sensors.calibration import SensorCalibration


def decode(
    name: str,
    method: str,
    model: WearerProblem,
    state: WearerState,
    covariance: PoseCovariance | None,
    reports: tuple[SolveReport, ...],
    settings: Mapping[str, str] | None = None,
) -> Estimate:
    """The estimate that a state stands for."""
    frames = model.frames
    motion = motion_of(model, state, name)
    calibration = calibration_of(model, state)
    return Estimate(
        name, method, motion, calibration, covariance, residuals(model, state), frames.sensors, reports, settings or {}
    )


def calibration_of(model: WearerProblem, state: WearerState) -> dict[str, SensorCalibration]:
    """Headings and mountings of all sensors, by their names."""
    return {sensor: _calibration(model, state, s) for s, sensor in enumerate(model.frames.sensors)}


def _calibration(model: WearerProblem, state: WearerState, sensor: int) -> SensorCalibration:
    heading, R_bone_sensor = float(wrap_angle(state.headings[sensor])), state.R_bone_sensor[sensor]
    bone = JOINT_NAMES[model.sensors[sensor].bone]
    if not model.headings_walk:
        return SensorCalibration(heading, R_bone_sensor, bone=bone)
    path = state.heading_knots[:, sensor]
    return SensorCalibration(
        heading, R_bone_sensor, heading_time=model.heading_knots, heading_path=heading + path - path[0], bone=bone
    )


def motion_of(model: WearerProblem, state: WearerState, name: str = "wearer") -> Motion:
    """The motion that a state stands for."""
    frames = model.frames
    return Motion(
        model.skeleton, state.R_parent_child, state.p_world_pelvis, 1 / frames.step, float(frames.time[0]), name
    )


def residuals(model: WearerProblem, state: WearerState) -> dict[str, Array]:
    """Norms ``(T, S)`` of the misfit of every sensor in every frame, by kind; NaN where it measured nothing."""
    at, frames, settings = WearerEvaluation(0, model, state), model.frames, model.settings
    kinds = dict[str, Array]()
    for one in orientation(at, slice(0, len(frames))):
        misfit = np.rad2deg(settings.orientation.sigma * one.norm)
        kinds["orientation_deg"] = np.where(frames.orientation_valid, misfit, np.nan)
    for each in acceleration(at, slice(0, max(len(frames) - 2, 0))):
        misfit = np.full(frames.acceleration_valid.shape, np.nan)
        misfit[1:-1] = settings.acceleration.sigma * each.norm
        kinds["acceleration_m_s2"] = np.where(frames.acceleration_valid, misfit, np.nan)
    return kinds


def pose_covariance(keys: Sequence[int], marginals: Mapping[int, Array]) -> PoseCovariance:
    """The covariance of joints and root, out of the marginals of a wearer's frames."""
    covariance = np.stack([marginals[key] for key in keys])
    joints = np.stack([covariance[:, c : c + 3, c : c + 3] for c in range(0, ROOT, 3)], axis=1)
    return PoseCovariance(joints, covariance[:, ROOT:FRAME, ROOT:FRAME])
