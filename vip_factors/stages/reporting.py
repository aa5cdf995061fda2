"""The last stage: the estimate of a scene, with how sure it is and what is odd about it."""

from collections.abc import Iterator, Sequence, Set
from dataclasses import replace

import numpy as np

from vip_factors.associate.associate import Association
from vip_factors.body.joint_priors import HingeEstimate, hinge_estimates
from vip_factors.body.keypoints import OFFSET_KEYPOINTS
from vip_factors.body.kinematics import forward_kinematics
from vip_factors.body.lengths import LENGTHS, lengths_of
from vip_factors.body.model_errors import FILMED, UNFILMED, ModelErrors
from vip_factors.body.skeleton import JOINT_NAMES, LIMBS, SIDES, joint_index, worn_limbs
from vip_factors.estimate import (
    BodyEstimate,
    DetectorEstimate,
    Estimate,
    PoseCovariance,
    SensorPlaceEstimate,
    WearerEstimate,
)
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array
from vip_factors.problem.layout import Owner, OwnerId
from vip_factors.problem.state import SceneState
from vip_factors.problem.variables import DETECTOR
from vip_factors.sensors.calibration import Calibration as SensorCalibrations
from vip_factors.sensors.frames import ImuFrames
from vip_factors.settings import Settings, flatten
from vip_factors.stages.calibrate import Calibration
from vip_factors.stages.calibration_start import start_choice
from vip_factors.stages.decode import (
    SceneCovariance,
    SharedCovariance,
    camera_with_sigmas,
    decode,
    decode_cameras,
    decode_wearers,
    scene_covariance,
    with_sigmas,
)
from vip_factors.stages.drift import clock_findings, drift_findings, slip_findings
from vip_factors.stages.findings import film_findings, in_picture_of, posture_findings, quality_checks, who_is_who
from vip_factors.stages.fusion import FusionSolution
from vip_factors.stages.inertial_model import method_of, with_contacts, with_inflated_contact_sigma
from vip_factors.stages.pauses import jump_findings
from vip_factors.stages.solver import Solver
from vip_factors.tables import count
from vip_factors.terms.heading_prior import GAUGE_SIGMA
from vip_factors.terms.registry import unfilmed_problem
from vip_factors.terms.sensor_position import sensor_position_whitening


def calibrated_estimate(calibration: Calibration, settings: Settings) -> Estimate:
    """The estimate of the frames that calibrate."""
    return (filmed_estimate if calibration.is_filmed else unfilmed_estimate)(calibration, settings)


def filmed_estimate(
    calibration: Calibration, settings: Settings, frames: Sequence[ImuFrames] | None = None
) -> Estimate:
    """The estimate of a filmed scene: motions and camera on ``frames`` of the full rate, or on the calibrating ones.

    Bodies, and how sure what is shared is, are of the calibrating frames.
    """
    solution, solver = calibration.solution, calibration.solver
    scene, coarse, associated = solution.scene, solution.fusion, solution.associated
    fine = coarse if frames is None else solution.at_full_rate(frames, settings, solver)
    covariance = full_rate_covariance(coarse, fine, solver) if settings.covariance and frames is not None else None
    shared = SharedCovariance.at(coarse.model, coarse.state) if covariance is None else covariance.shared
    wearers = tuple(
        replace(
            with_sigmas(estimate, number, shared),
            body=body_estimate(coarse, number, shared),
            sensor_positions=sensor_position_estimates(coarse, number, shared),
            start=start_choice(estimate.sensors, solution.wearers[number].starts),
        )
        for number, estimate in enumerate(decode_wearers(fine, covariance))
    )
    cameras = tuple(
        camera_with_sigmas(camera, number, shared)
        for number, camera in enumerate(decode_cameras(associated, fine, covariance))
    )
    findings = [
        *who_is_who(scene, associated),
        *_undetermined(shared, "all headings, mountings and the camera"),
        *coarse.findings,
        *quality_checks(scene, associated, fine, wearers),
        *(
            finding
            for coarse_model, wearer in zip(coarse.model.wearers, wearers, strict=True)
            for finding in jump_findings(coarse_model.name, wearer.calibration, coarse_model.restarts)
        ),
        *(
            in_picture_of(video.camera, scene, finding)
            for video, camera in zip(associated, cameras, strict=True)
            for finding in clock_findings(video.camera, camera)
        ),
    ]
    findings = [
        *calibration.sensor_findings,
        *solution.floor_findings,
        *dict.fromkeys(findings),
        *solution.start_findings(),
    ]
    return Estimate(
        scene.name,
        "VIP",
        wearers,
        cameras,
        tuple(solver.reports),
        (*film_findings(scene, findings), *findings),
        flatten(settings),
        detector_estimate(coarse, shared),
        association_cues(scene.names, associated[0].association),
    )


def unfilmed_estimate(calibration: Calibration, settings: Settings, fine: WearerEstimate | None = None) -> Estimate:
    """The estimate of a wearer whom no camera saw: ``fine`` of all frames, or that of the calibrating ones."""
    solution = calibration.solution
    (recording,), (shared,) = solution.scene.wearers, solution.wearers
    model, state = shared.model, shared.state
    if fine is None:
        fine = decode(method_of(model, settings), model, state, None, flatten(settings))
    bones = forward_kinematics(model.skeleton, state.R_parent_child, state.p_world_pelvis).R_world_bone
    name, mountings = recording.subject.name, model.prior_R_bone_sensor
    findings = (
        *calibration.sensor_findings,
        *slip_findings(name, recording, model.frames, bones, fine.calibration),
        *solution.start_findings(),
        *posture_findings(name, recording, fine.motion, fine.calibration, mountings),
        *drift_findings(name, fine.calibration, model.restarts.tolist()),
        *jump_findings(name, fine.calibration, model.restarts),
    )
    estimate = replace(
        fine,
        findings=findings,
        start=start_choice(fine.sensors, shared.starts),
        reports=(*calibration.solver.reports, *fine.reports),
    )
    if settings.acceleration:  # as the calibration was found: at the full rate headings and mountings are kept
        free = with_contacts(with_inflated_contact_sigma(model), state)
        sigmas = SharedCovariance.at(unfilmed_problem([free], calibration.solver.extra), SceneState.unfilmed([state]))
        undetermined = _undetermined(sigmas, "all headings and mountings")
        estimate = replace(with_sigmas(estimate, 0, sigmas), findings=(*findings, *undetermined))
    return Estimate.of_one(estimate)


def _undetermined(shared: SharedCovariance, subject: str) -> Iterator[Finding]:
    if shared.covariance is None:
        yield Finding("not settled", subject=subject, words={"reason": "in part they are guesses"})


def association_cues(names: Sequence[str], association: Association) -> tuple[str, ...]:
    """Describe for each wearer what identifies it in the picture."""
    by_place = association.by_place if len(association.by_place) else np.zeros(len(association.wearer), bool)
    clothes = "clothes counted" if association.by_clothes else "clothes did not"
    sentences = []
    for number, name in enumerate(names):
        is_labelled = association.wearer == number
        placed, moved = np.sum(is_labelled & by_place), np.sum(is_labelled & ~by_place)
        sentences.append(f"{name} was identified by motion in {moved} detections and by place in {placed}; {clothes}")
    return tuple(sentences)


def with_model_errors(estimate: Estimate) -> Estimate:
    """Add the models' share of the standard deviations to an estimate; no earlier stage sees it."""
    is_filmed = bool(estimate.cameras)
    errors = FILMED if is_filmed else UNFILMED
    wearers, findings = list[WearerEstimate](), list(estimate.findings)
    for wearer in estimate.wearers:
        bones = {sensor.bone for sensor in wearer.calibration.values()}
        limits = tuple(precision_findings(wearer.motion.name, bones, len(wearer.calibration), is_filmed))
        wearer = replace(wearer, findings=(*wearer.findings, *limits))
        wearers.append(_with_model_errors(wearer, errors))
        findings += limits
    return replace(estimate, wearers=tuple(wearers), findings=tuple(findings))


LEG_BONES = {"hip": "thighs", "knee": "shanks"}  # by the joint above


def precision_findings(wearer: str, bones: Set[str], sensors: int, is_filmed: bool) -> Iterator[Finding]:
    """Finding about a set-up whose accuracy, even without faults, is below what GOOD promises.

    Args:
        wearer: name of the wearer.
        bones: names of the bones that have a sensor.
        sensors: how many there are.
        is_filmed: whether a camera sees the wearer.
    """
    # M, what GOOD promises of where joints are: on the mean over those of the limbs, along each axis
    good_joints, errors = 0.03, FILMED if is_filmed else UNFILMED
    # Legs count if a leg has a sensor, arms if an arm has one; all limbs if none has. Trunk and tips are not promised.
    limbs = worn_limbs(bones) or LIMBS.values()
    joints = [joint_index(f"{side}_{joint}") for limb in limbs for joint in limb[1:-1] for side in SIDES]
    off = float(errors.positions(bones)[joints].mean())
    unmeasured = [name for joint, name in LEG_BONES.items() if not {f"left_{joint}", f"right_{joint}"} <= bones]
    determine, miss = ("determines", "misses") if sensors == 1 and not is_filmed else ("determine", "miss")
    limits = [f"{determine} joints only to ± {1e3 * off:.0f} mm"] if off > good_joints else []
    if unmeasured:
        limits.append(f"{miss} the flexion of knees without a sensor on the {' and the '.join(unmeasured)}")
    if limits:
        better = ["a camera"] * (not is_filmed) + ["a sensor on every limb's bone"] * (is_filmed or bool(unmeasured))
        words = {"limit": " and ".join(limits), "better": " and ".join(better)}
        subject = f"{count(sensors, 'sensor')} and {'a' if is_filmed else 'no'} camera"
        yield Finding("limited set-up", wearer, subject=subject, words=words)


def _with_model_errors(wearer: WearerEstimate, errors: ModelErrors) -> WearerEstimate:
    covariance = wearer.covariance
    if covariance is not None:
        joints = errors.joint[:, None, None] ** 2 * covariance.joints
        covariance = PoseCovariance(joints, errors.root**2 * covariance.root)
    return replace(wearer, calibration=calibration_with_model_errors(wearer.calibration, errors), covariance=covariance)


def calibration_with_model_errors(calibration: SensorCalibrations, errors: ModelErrors) -> SensorCalibrations:
    """Add the models' share to the standard deviations of headings and mountings."""
    by_convention = 1.5 * GAUGE_SIGMA  # as sure is only the world's own
    sensors = list(calibration.values())
    heading = np.array([sensor.heading_sigma for sensor in sensors])
    heading = np.hypot(heading, np.where(heading <= by_convention, 0.0, errors.heading)).tolist()
    bone_errors = errors.mounting[np.array([joint_index(sensor.bone) for sensor in sensors], int), None]
    mounting = np.hypot(np.array([sensor.mounting_sigma for sensor in sensors]).reshape(-1, 3), bone_errors)
    return {
        name: replace(sensor, heading_sigma=heading[s], mounting_sigma=mounting[s])
        for s, (name, sensor) in enumerate(calibration.items())
    }


def full_rate_covariance(coarse: FusionSolution, fine: FusionSolution, solver: Solver) -> SceneCovariance | None:
    """Covariance of the full-rate poses, that of the nearest coarse frame; None if not determined.

    There headings and mountings are free: at the full rate they are kept, as if they were known.
    """
    covariance = scene_covariance(coarse.model, coarse.state, solver)
    return None if covariance is None else at_nearest(covariance, coarse, fine.model.wearers[0].frames.time)


def at_nearest(covariance: SceneCovariance, coarse: FusionSolution, time: Array) -> SceneCovariance:
    """The covariance of the coarse frame that is nearest to each instant ``(T,)``."""
    coarse_time = coarse.model.wearers[0].frames.time
    return covariance.at(np.searchsorted((coarse_time[1:] + coarse_time[:-1]) / 2, time))


def body_estimate(solution: FusionSolution, number: int, shared: SharedCovariance) -> BodyEstimate | None:
    """One wearer's body; None if nothing of it was a variable.

    Args:
        solution: whose bodies were found and are the problem's.
        number: of the wearer.
        shared: how sure what all frames share is.
    """
    model, hinges = solution.model.wearers[number], solution.state.wearers[number].hinges

    def covariance(block: str, size: int) -> Array:
        marginals = shared.of(OwnerId(Owner.WEARER, number), block)
        return np.full((size, size), np.nan) if marginals is None else marginals

    hinge_axes, prior_hinges = tuple[HingeEstimate, ...](), tuple[HingeEstimate, ...]()
    if model.free_hinges:
        hinge_axes, prior_hinges = (
            hinge_estimates(hinges, covariance("hinges", len(hinges))),
            model.hinge_prior.hinges(),
        )
    if not model.body_moves or model.variation is None:
        nothing, square = np.zeros(0), np.zeros((0, 0))
        return BodyEstimate((), nothing, nothing, square, square, hinge_axes, prior_hinges) if hinge_axes else None
    lengths, whitening = lengths_of(model.skeleton), model.variation.whitening
    prior = np.array(np.linalg.inv(whitening.T @ whitening), dtype=float)
    return BodyEstimate(
        LENGTHS,
        lengths + model.variation.mean,  # of what is left to change
        lengths,
        prior,
        covariance("body", len(LENGTHS)),
        hinge_axes,
        prior_hinges,
    )


def sensor_position_estimates(
    solution: FusionSolution, number: int, shared: SharedCovariance
) -> tuple[SensorPlaceEstimate, ...]:
    """Estimated positions of one wearer's sensors; empty if they were not variables.

    Args:
        solution: whose bodies were found and are the problem's.
        number: of the wearer.
        shared: how sure what all frames share is.
    """
    model = solution.model.wearers[number]
    if not model.free_places:
        return ()
    points, positions = model.sensor_points, solution.state.wearers[number].sensor_positions
    sigmas = _shaped(shared.sigmas(OwnerId(Owner.WEARER, number), "sensor_positions"), positions)
    whitening = np.linalg.inv(sensor_position_whitening(model))
    prior_sigmas = np.sqrt(np.einsum("sij,sij->si", whitening, whitening))
    return tuple(
        SensorPlaceEstimate(sensor, JOINT_NAMES[bone], prior, prior + change, prior_sigma, sigma)
        for sensor, bone, prior, change, prior_sigma, sigma in zip(
            model.frames.sensors, points.bones, points.p_bone_point, positions, prior_sigmas, sigmas, strict=True
        )
    )


def detector_estimate(solution: FusionSolution, shared: SharedCovariance) -> DetectorEstimate | None:
    """The detector's keypoint offsets; None if they were no variables."""
    if not solution.model.free_keypoints:
        return None
    offsets = solution.state.detector.keypoint_offsets
    prior = solution.model.cameras[0].prior_offsets
    sigma = _shaped(shared.sigmas(DETECTOR, "keypoint_offsets"), offsets)
    return DetectorEstimate(OFFSET_KEYPOINTS, prior.mean, offsets, prior.sigma, sigma)


def _shaped(sigmas: Array | None, values: Array) -> Array:
    """Standard deviations in the shape of what they are of; NaN if not known."""
    return np.full(values.shape, np.nan) if sigmas is None else sigmas.reshape(values.shape)
