"""The body is found where a camera sees it: somebody whose limbs are not those of their stature."""

from dataclasses import replace

import numpy as np
from filmed_gestures import QUICK

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.skeleton import Skeleton
from vip_factors.body.variation import LENGTHS, BodyVariation
from vip_factors.evaluate.scene import evaluate_scene
from vip_factors.pipeline import smooth_scene
from vip_factors.sensors.placement import preset
from vip_factors.sensors.recording import Subject
from vip_factors.sensors.scene import Scene
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.scene import Performer, simulate_scene
from vip_factors.simulate.scene_settings import SceneSettings

STATURE = 1.75
LIMBS = ("left_knee", "left_ankle", "left_elbow", "left_wrist")
CHANGES = {"thigh": 0.03, "shank": -0.025, "upper arm": -0.03, "forearm": 0.02}


def filmed() -> tuple[Scene, Skeleton]:
    """A scene of which only the stature is told, and the true body."""
    usual = skeleton_from_stature(STATURE)
    lengths = np.array([CHANGES.get(name, 0.0) for name in LENGTHS])
    body = BodyVariation.of(usual).varied(usual, lengths)
    motion = replace(gestures(4.0), skeleton=body)
    performer = Performer("anna", motion, preset("tnt10", body))
    scene = simulate_scene([performer], SceneSettings.realistic(camera="fixed"), seed=2)
    wearers = tuple(replace(one, subject=Subject("anna", STATURE)) for one in scene.wearers)
    return replace(scene, wearers=wearers), body


def limbs(skeleton: Skeleton) -> np.ndarray:
    return np.array([skeleton.bone_length(end) for end in LIMBS])


def test_limbs_come_near_to_what_they_are() -> None:
    scene, body = filmed()
    estimate = smooth_scene(scene, QUICK)
    usual, found = skeleton_from_stature(STATURE), estimate.wearers[0].motion.skeleton
    before, after = (np.abs(limbs(one) - limbs(body)).mean() for one in (usual, found))
    assert after < 0.75 * before
    held = smooth_scene(scene, replace(QUICK, calibration=replace(QUICK.calibration, estimate_body=False)))
    np.testing.assert_array_equal(held.wearers[0].motion.skeleton.p_parent_joint, usual.p_parent_joint)
    assert evaluate_scene(estimate, scene)["mpjpe"] < evaluate_scene(held, scene)["mpjpe"]


def test_a_body_that_is_given_stays_as_it_is() -> None:
    scene, body = filmed()
    wearers = tuple(replace(one, subject=Subject("anna", STATURE, skeleton=body)) for one in scene.wearers)
    found = smooth_scene(replace(scene, wearers=wearers), QUICK).wearers[0].motion.skeleton
    np.testing.assert_array_equal(found.p_parent_joint, body.p_parent_joint)
