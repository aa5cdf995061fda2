"""One wearer's least-squares problem from a recording, and the forms that it takes from stage to stage."""

from dataclasses import fields, replace
from typing import Any

import numpy as np

from vip_factors.body.kinematics import forward_kinematics
from vip_factors.body.lengths import BodyVariation
from vip_factors.body.pose_prior import load_joint_limits, load_pose_prior
from vip_factors.body.skeleton import contact_points, held_pose
from vip_factors.factor_settings import FootContactSettings
from vip_factors.initialise.calibration import InitialCalibration, contact_confidence, standing_path
from vip_factors.problem.state import WearerState
from vip_factors.problem.wearer import BodyPoint, InitialPose, WearerProblem
from vip_factors.sensors.frames import ImuFrames
from vip_factors.sensors.recording import Recording, Subject
from vip_factors.settings import CalibrationSettings, CommonSettings

# rad, of mountings that were read off a declared pose: what the pose says of them, it says by itself, and not twice.
DECLARED_MOUNTING_SIGMA = np.pi / 3
HEADING_STEP_S = 10.0  # that a heading is constant for where it drifts: with shorter steps it follows tissue, too
FEW_SENSORS = 6  # with so few, acceleration is all that some limbs have, and the papers' IT is called SOP


def inertial_model(
    recording: Recording, frames: ImuFrames, calibration: InitialCalibration, settings: CommonSettings
) -> WearerProblem:
    """The whole problem, everything free that the settings free."""
    sites = [recording.placement.site(name) for name in frames.sensors]
    declared = recording.initial_pose != "none"
    factors = settings.factors
    if len(sites) <= FEW_SENSORS:
        sparse = replace(factors.acceleration, sigma=factors.acceleration.sparse_sigma)
        factors = replace(factors, acceleration=sparse)
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
        variation=_variation(recording.subject, factors.length_scale),
        gauge_sensor=gauge_sensor([site.bone_index for site in sites]),
        name=recording.subject.name,
    )


def declared_pose(recording: Recording, frames: ImuFrames, settings: CommonSettings) -> InitialPose | None:
    """The pose that the wearer declared to hold in the first frames, if any."""
    if recording.initial_pose == "none":
        return None
    declared = settings.factors.initial_pose
    held = max(1, round(declared.seconds / frames.step))
    return InitialPose(held_pose(recording.initial_pose, declared.nominal), min(held, len(frames)))


def _variation(subject: Subject, scale: float) -> BodyVariation | None:
    """What is open about a body; a table's spread is widened, one that was found before is taken as it is."""
    variation = subject.variation()
    if variation is None or subject.length_prior is not None:
        return variation
    return replace(variation, whitening=variation.whitening / scale)


def gauge_sensor(bones: list[int]) -> int:
    """The sensor whose heading defines the world's: the pelvis's, or the first."""
    return bones.index(0) if 0 in bones else 0


def frame_by_frame(model: WearerProblem) -> WearerProblem:
    """The model of the inertial tracker: every frame by itself, the calibration kept."""
    return replace(with_fixed_calibration(model), use_acceleration=False)


def with_fixed_calibration(model: WearerProblem) -> WearerProblem:
    """The model with what all frames share kept as it is."""
    free = [one.name for one in fields(model) if one.name.startswith("free_") and one.name != "free_body"]
    fixed: dict[str, Any] = dict.fromkeys(free, False)
    return replace(model, **fixed)


def with_heading_times(model: WearerProblem, calibration: CalibrationSettings) -> WearerProblem:
    """The model whose headings step every ten seconds of its frames; as it is, if they are to be constant.

    They step at every restart and between stretches.
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
        parts = np.array_split(stretch, max(1, round(len(stretch) / every)))
        times += [float(frames.time[part[[0, -1]]].mean()) for part in parts]
    return replace(model, heading_times=np.array(times)) if len(times) > 1 else model


def with_inflated_contact_sigma(model: WearerProblem) -> WearerProblem:
    """The model for finding mountings: contacts are believed less."""
    inflation = 2.0  # a shod foot is off in the same way at every step, and mountings would bend to make up for it
    contact = model.settings.foot_contact
    return with_foot_contact(model, replace(contact, sigma=inflation * contact.sigma))


def with_foot_contact(model: WearerProblem, settings: FootContactSettings) -> WearerProblem:
    """The model with foot contacts of other settings."""
    return replace(model, settings=replace(model.settings, foot_contact=settings))


def on_frames_with_fixed_calibration(model: WearerProblem, frames: ImuFrames) -> WearerProblem:
    """The model over other frames, with headings, mountings and mean pose kept as they are."""
    return replace(with_fixed_calibration(model), frames=frames, initial_pose=None)


def placed_on_floor(model: WearerProblem, state: WearerState) -> WearerState:
    """The state with a root path on which whichever foot stands lowest stands still."""
    body = forward_kinematics(model.skeleton, state.R_parent_child, np.zeros_like(state.p_world_pelvis))
    points = contact_points(model.skeleton, model.settings.sole.of(state.sole))
    return replace(state, p_world_pelvis=standing_path(body, points))


def with_contacts(model: WearerProblem, state: WearerState, path_known: bool = False) -> WearerProblem:
    """The model with the foot contacts that a first motion shows.

    Without a known path, of a camera say, contact shows in the pose alone: one that has drifted would hide it.
    """
    points = contact_points(model.skeleton) if model.settings.foot_contact.use else ()
    grounded = state if path_known else placed_on_floor(model, state)
    body = forward_kinematics(model.skeleton, state.R_parent_child, grounded.p_world_pelvis)
    confidence = contact_confidence(body, points, model.frames.step) if points else np.zeros((len(model.frames), 0))
    return replace(
        model,
        p_world_start=state.p_world_pelvis[model.frames.beginnings].squeeze(),
        contacts=tuple(BodyPoint(bone, p) for bone, p in points),
        contact_confidence=confidence,
    )


def method_of(model: WearerProblem, settings: CommonSettings) -> str:
    """What papers call a tracker of these sensors and settings."""
    if settings.acceleration:
        return "SIP"
    return "SOP" if len(model.sensors) <= FEW_SENSORS else "IT"
