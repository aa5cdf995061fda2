"""The body is found where a camera sees it: somebody whose limbs are not those of their stature."""

from dataclasses import replace
from functools import cache

import numpy as np
from filmed_gestures import HASTY, QUICK

from vip_factors.body.anthropometry import LengthPrior, likely_body, skeleton_from_stature
from vip_factors.body.joint_priors import HINGE_OF, HingeEstimate
from vip_factors.body.keypoints import OFFSET_KEYPOINTS
from vip_factors.body.lengths import LENGTHS, lengths_of
from vip_factors.body.skeleton import Skeleton
from vip_factors.estimate import Estimate, WearerEstimate
from vip_factors.evaluate.evaluation import evaluate_scene
from vip_factors.pipeline import smooth
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.frames import resample
from vip_factors.sensors.recording import Subject
from vip_factors.sensors.scene import Scene
from vip_factors.settings import LiveSettings
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording
from vip_factors.simulate.scene import Performer, simulate_scene
from vip_factors.simulate.settings import SceneSettings, SimulateSettings
from vip_factors.stages.inertial import inertial_tracker
from vip_factors.stages.solver import Solver

STATURE = 1.75
LIMBS = ("left_knee", "left_ankle", "left_elbow", "left_wrist")
CHANGES = {"thigh": 0.03, "shank": -0.025, "upper arm": -0.03, "forearm": 0.02}


@cache
def filmed() -> tuple[Scene, Skeleton]:
    """A scene of which only the stature is told, and the true body."""
    usual = skeleton_from_stature(STATURE)
    lengths = np.array([CHANGES.get(name, 0.0) for name in LENGTHS])
    body = likely_body(STATURE).variation.varied(usual, lengths)
    motion = replace(gestures(5.0), skeleton=body)
    performer = Performer("anna", motion, preset("tnt10", body))
    scene = simulate_scene([performer], SceneSettings(camera="fixed"), seed=2)
    wearers = tuple(replace(wearer, subject=Subject("anna", STATURE)) for wearer in scene.wearers)
    return replace(scene, wearers=wearers), body


def limbs(skeleton: Skeleton) -> np.ndarray:
    return np.array([skeleton.bone_length(end) for end in LIMBS])


def test_limbs_come_near_to_what_they_are() -> None:
    scene, body = filmed()
    estimate = smooth(scene, QUICK)
    usual, found = skeleton_from_stature(STATURE), estimate.wearers[0].motion.skeleton
    before, after = (np.abs(limbs(one) - limbs(body)).mean() for one in (usual, found))
    assert after < 0.75 * before
    held = smooth(scene, replace(QUICK, calibration=replace(QUICK.calibration, estimate_body=False)))
    np.testing.assert_array_equal(held.wearers[0].motion.skeleton.p_parent_joint, usual.p_parent_joint)
    assert held.wearers[0].body is not None
    assert held.wearers[0].body.names == ()  # of the body only hinges were looked for
    assert evaluate_scene(estimate, scene)["mpjpe"] < evaluate_scene(held, scene)["mpjpe"]
    what_was_found_is_told_with_its_sigmas(estimate.wearers[0], usual)
    places_on_the_bones_are_told_with_their_sigmas(estimate, scene)
    what_was_found_is_where_the_next_recording_starts(scene, estimate.wearers[0])


def what_was_found_is_told_with_its_sigmas(estimate: WearerEstimate, usual: Skeleton) -> None:
    told = estimate.body
    assert told is not None
    assert told.names == LENGTHS
    np.testing.assert_allclose(told.posterior, lengths_of(estimate.motion.skeleton))
    np.testing.assert_allclose(told.prior, lengths_of(usual) + likely_body(usual.stature).variation.mean, atol=1e-9)
    seen = [LENGTHS.index(name) for name in CHANGES]
    assert np.all(told.sigma[seen] < 0.9 * told.prior_sigma[seen])
    assert np.all(told.sigma < 1.001 * told.prior_sigma)
    assert [hinge.joint for hinge in told.hinges] == ["left_elbow", "right_elbow", "left_knee", "right_knee"]
    assert all(np.all((hinge.sigma > 0) & (hinge.sigma < 0.1)) for hinge in told.hinges)


def places_on_the_bones_are_told_with_their_sigmas(estimate: Estimate, scene: Scene) -> None:
    places, placement = estimate.wearers[0].sensor_positions, scene.wearers[0].placement
    assert [place.sensor for place in places] == list(estimate.wearers[0].sensors)
    assert [place.bone for place in places] == [placement.site(place.sensor).bone for place in places]
    moved, sigmas, before = (
        np.array([getattr(place, name) for place in places]) for name in ("posterior", "sigma", "prior_sigma")
    )
    prior = np.array([place.prior for place in places])
    np.testing.assert_allclose(prior, [placement.site(place.sensor).p_bone_sensor for place in places], atol=0.04)
    assert np.all((sigmas > 0) & (sigmas < 1.001 * before))
    assert 0 < np.abs(moved - prior).max() < 3 * before.max()
    detector = estimate.detector
    assert detector is not None
    assert detector.keypoints == OFFSET_KEYPOINTS
    assert np.all((detector.sigma > 0) & (detector.sigma < 1.001 * detector.prior_sigma))
    assert np.all(np.abs(detector.posterior) < 3 * detector.prior_sigma)
    assert np.any(detector.posterior)


def what_was_found_is_where_the_next_recording_starts(scene: Scene, estimate: WearerEstimate) -> None:
    assert estimate.body is not None
    skeleton, prior = estimate.motion.skeleton, LengthPrior(LENGTHS, estimate.body.covariance)
    subject = Subject("anna", STATURE, skeleton=skeleton, length_prior=prior, hinges=estimate.body.hinges)
    again = smooth(replace(scene, wearers=(replace(scene.wearers[0], subject=subject),)), QUICK).wearers[0]
    assert again.body is not None
    np.testing.assert_allclose(again.body.prior, estimate.body.posterior, atol=1e-9)
    for before, prior_hinge, after in zip(
        estimate.body.hinges, again.body.prior_hinges, again.body.hinges, strict=True
    ):
        np.testing.assert_array_equal(prior_hinge.variables, before.variables)
        assert np.all(np.diag(after.covariance) < np.diag(prior_hinge.covariance))
        assert after.carrying_sigma < before.carrying_sigma
    np.testing.assert_allclose(again.body.prior_sigma, np.maximum(estimate.body.sigma, 0.003), rtol=0.1)
    assert np.all(np.abs(again.body.posterior - again.body.prior) < 3 * again.body.prior_sigma)


def test_a_body_that_is_given_stays_as_it_is() -> None:
    scene, body = filmed()
    wearers = tuple(replace(wearer, subject=Subject("anna", STATURE, skeleton=body)) for wearer in scene.wearers)
    estimate = smooth(replace(scene, wearers=wearers), HASTY).wearers[0]
    np.testing.assert_array_equal(estimate.motion.skeleton.p_parent_joint, body.p_parent_joint)
    assert estimate.body is not None
    assert estimate.body.names == ()


def test_hinges_that_are_no_variables_stay_as_they_were_found() -> None:
    motion, knee = gestures(1.0), HINGE_OF["right_knee"]
    found = HingeEstimate("right_knee", np.array([0.1, -0.05, 0.08, 0.02]), 0.01 * np.eye(4))
    recording = simulate_recording(motion, preset("sip6", motion.skeleton), SimulateSettings(), seed=1)
    recording = replace(recording, subject=replace(recording.subject, hinges=(found,)))
    settings = LiveSettings()
    solver = Solver(settings.solve, lambda stage, fraction: None)
    tracked = inertial_tracker(recording, resample(recording, 10.0), settings, solver)
    assert not tracked.model.free_hinges
    np.testing.assert_array_equal(tracked.state.hinges[knee.columns], found.variables)
