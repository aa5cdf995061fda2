"""The least-squares problem of one wearer, and its variants for each stage."""

from dataclasses import fields, replace
from typing import Any

import numpy as np

from vip_factors.body.joint_priors import load_joint_limits, load_pose_prior
from vip_factors.body.kinematics import forward_kinematics
from vip_factors.body.skeleton import contact_points, held_pose
from vip_factors.factor_settings import FootContactSettings
from vip_factors.initialise.calibration import InitialCalibration, contact_confidence, standing_path
from vip_factors.problem.state import WearerState
from vip_factors.problem.wearer import BodyPoint, InitialPose, WearerProblem
from vip_factors.sensors.frames import ImuFrames
from vip_factors.sensors.recording import Recording
from vip_factors.settings import CalibrationSettings, CommonSettings

# rad, for mountings computed from a declared pose: wide, because the pose has a factor of its own.
DECLARED_MOUNTING_SIGMA = np.pi / 3
HEADING_STEP_S = 10.0  # interval of a drifting heading; shorter ones follow soft tissue
FEW_SENSORS = 6  # up to this number acceleration alone determines some limbs, and IT is called SOP in the literature


def inertial_model(
    recording: Recording, frames: ImuFrames, calibration: InitialCalibration, settings: CommonSettings
) -> WearerProblem:
    """Build the problem of a wearer, with all variables free that the settings free."""
    sites = [recording.placement.site(name) for name in frames.sensors]
    declared = recording.initial_pose != "none"
    factors = settings.factors
    if len(sites) <= FEW_SENSORS:
        sparse = replace(factors.acceleration, sigma=factors.acceleration.sparse_sigma)
        factors = replace(factors, acceleration=sparse)
    variation = recording.subject.variation()
    if variation is not None and recording.subject.length_prior is None:  # a table's, not an earlier estimate's
        variation = replace(variation, whitening=variation.whitening / factors.length_scale)
    return WearerProblem(
        skeleton=recording.subject.body(),
        prior=load_pose_prior(),
        limits=load_joint_limits(),
        frames=frames,
        sensors=tuple(BodyPoint(site.bone_index, site.p_bone_sensor) for site in sites),
        prior_headings=calibration.headings,
        heading_sigma=calibration.heading_sigma,
        prior_R_bone_sensor=calibration.R_bone_sensor,
        mounting_sigma=np.array([DECLARED_MOUNTING_SIGMA if declared else site.mounting_sigma for site in sites]),
        settings=factors,
        initial_pose=declared_pose(recording, frames, settings),
        free_headings=settings.calibration.estimate_headings,
        free_mountings=settings.calibration.estimate_mountings,
        free_pose_mean=True,
        free_hinges=settings.calibration.estimate_hinges,
        hinge_prior=recording.subject.hinge_prior(),
        use_acceleration=settings.acceleration,
        variation=variation,
        gauge_sensor=gauge_sensor([site.bone_index for site in sites]),
        name=recording.subject.name,
    )


def declared_pose(recording: Recording, frames: ImuFrames, settings: CommonSettings) -> InitialPose | None:
    """Pose that the wearer is declared to hold in the first frames, if any."""
    if recording.initial_pose == "none":
        return None
    declared = settings.factors.initial_pose
    frame_count = max(1, round(declared.seconds / frames.step))
    return InitialPose(held_pose(recording.initial_pose, declared.nominal), min(frame_count, len(frames)))


def gauge_sensor(bones: list[int]) -> int:
    """Index of the sensor whose heading defines the world: the pelvis's, or the first."""
    return bones.index(0) if 0 in bones else 0


def frame_by_frame(model: WearerProblem) -> WearerProblem:
    """Return the model of the inertial tracker: independent frames, fixed calibration."""
    return replace(with_fixed_calibration(model), use_acceleration=False)


def with_fixed_calibration(model: WearerProblem) -> WearerProblem:
    """Return the model with all shared variables fixed."""
    free = [field.name for field in fields(model) if field.name.startswith("free_") and field.name != "free_body"]
    fixed: dict[str, Any] = dict.fromkeys(free, False)
    return replace(model, **fixed)


def with_heading_times(model: WearerProblem, calibration: CalibrationSettings) -> WearerProblem:
    """Return the model with headings that step every ten seconds, or the model itself if headings are constant.

    Headings also step at every restart and between stretches.
    """
    least, frames = calibration.heading_drift_from_s, model.frames
    seconds, restarts = float(frames.time[-1] - frames.time[0]), len(model.restarts)
    if not model.free_headings or (not restarts and (least is None or seconds < least)):
        return model
    behind = np.searchsorted(frames.time, model.restarts.mean(axis=1))
    begins = np.unique(np.concatenate([frames.beginnings, behind]))
    step_s = seconds if least is None else min(HEADING_STEP_S, seconds / 4)
    every, times = max(1, round(step_s / frames.step)), list[float]()
    for stretch in np.split(np.arange(len(frames)), begins[1:]):
        steps = np.array_split(stretch, max(1, round(len(stretch) / every)))
        times += [float(frames.time[step[[0, -1]]].mean()) for step in steps]
    return replace(model, heading_times=np.array(times)) if len(times) > 1 else model


def with_inflated_contact_sigma(model: WearerProblem) -> WearerProblem:
    """Return the model with a larger contact sigma, for the estimation of mountings."""
    inflation = 2.0  # a shoe biases every step alike, and mountings would absorb the bias
    contact = model.settings.foot_contact
    return with_foot_contact(model, replace(contact, sigma=inflation * contact.sigma))


def with_foot_contact(model: WearerProblem, settings: FootContactSettings) -> WearerProblem:
    """Return the model with other foot contact settings."""
    return replace(model, settings=replace(model.settings, foot_contact=settings))


def on_frames_with_fixed_calibration(model: WearerProblem, frames: ImuFrames) -> WearerProblem:
    """Return the model on other frames, with all shared variables fixed."""
    return replace(with_fixed_calibration(model), frames=frames, initial_pose=None)


def place_on_floor(model: WearerProblem, state: WearerState) -> WearerState:
    """Return the state with a root path on which the lowest foot stands still."""
    body = forward_kinematics(model.skeleton, state.R_parent_child, np.zeros_like(state.p_world_pelvis))
    points = contact_points(model.skeleton, model.settings.sole.of(state.sole))
    return replace(state, p_world_pelvis=standing_path(body, points))


def with_contacts(model: WearerProblem, state: WearerState, path_known: bool = False) -> WearerProblem:
    """Return the model with the foot contacts detected in a motion.

    Without a known path (such as a camera's) contacts are detected from the pose alone, for drift would hide them.
    """
    points = contact_points(model.skeleton) if model.settings.foot_contact.use else ()
    grounded = state if path_known else place_on_floor(model, state)
    body = forward_kinematics(model.skeleton, state.R_parent_child, grounded.p_world_pelvis)
    confidence = contact_confidence(body, points, model.frames.step) if points else np.zeros((len(model.frames), 0))
    return replace(
        model,
        p_world_start=state.p_world_pelvis[model.frames.beginnings].squeeze(),
        contacts=tuple(BodyPoint(bone, p) for bone, p in points),
        contact_confidence=confidence,
    )


def method_of(model: WearerProblem, settings: CommonSettings) -> str:
    """Name of the method in the literature for these sensors and settings."""
    if settings.acceleration:
        return "SIP"
    return "SOP" if len(model.sensors) <= FEW_SENSORS else "IT"
