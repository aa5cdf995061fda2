"""Where trackers' motions do not show who is who, calibrated ones do; whoever looks like the pictures is begun with."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from filmed_gestures import QUICK, filmed_gestures, without_detections

from vip_factors.associate.associate import Association
from vip_factors.body.skeleton import joint_index
from vip_factors.geometry.rotations import exp
from vip_factors.sensors.scene import Scene
from vip_factors.sensors.sources import SceneInMemory
from vip_factors.stages import association as stage
from vip_factors.stages.inertial import InertialSolution, inertial_trackers
from vip_factors.stages.reporting import association_cues
from vip_factors.stages.solver import Solver
from vip_factors.stages.windows import plan_scene

SOLVER = Solver(QUICK.solve, lambda stage, fraction: None)


@cache
def scene() -> Scene:
    return filmed_gestures(people=("anna", "bob"), backwards=True, azimuth_deg=20.0)


def track(scene: Scene) -> tuple[InertialSolution, ...]:
    time = plan_scene(SceneInMemory(scene), QUICK).all_coarse_time
    return inertial_trackers(scene, time, QUICK, SOLVER)


@cache
def tracked() -> tuple[InertialSolution, ...]:
    return track(scene())


def bent(one: InertialSolution, degrees: float) -> InertialSolution:
    """With limbs that are turned as by a wrong start."""
    R = one.state.R_parent_child.copy()
    for number, name in enumerate(("left_hip", "right_hip", "left_knee", "left_shoulder", "right_shoulder", "spine1")):
        R[:, joint_index(name)] = R[:, joint_index(name)] @ exp(np.deg2rad(degrees) * np.eye(3)[number % 3])
    return replace(one, state=replace(one.state, R_parent_child=R))


def calibration_as(to: InertialSolution, calls: list[InertialSolution]) -> Callable[..., InertialSolution]:
    def calibrate_inertial(one: InertialSolution, *_: object) -> InertialSolution:
        calls.append(one)
        return to

    return calibrate_inertial


def test_who_is_found_is_left_as_tracked(monkeypatch: pytest.MonkeyPatch) -> None:
    alone = filmed_gestures(seconds=2.0, azimuth_deg=20.0)
    before, calls = track(alone), list[InertialSolution]()
    monkeypatch.setattr(stage, "calibrate_inertial", calibration_as(before[0], calls))
    wearers, associated = stage.first_association(alone, before, QUICK, SOLVER)
    assert not calls
    assert wearers == before
    assert stage.visible_share(associated, 0) > 0.9


def test_who_is_not_found_is_calibrated_and_looked_for_again(monkeypatch: pytest.MonkeyPatch) -> None:
    (anna, bob), calls = tracked(), list[InertialSolution]()
    monkeypatch.setattr(stage, "calibrate_inertial", calibration_as(anna, calls))
    wearers, associated = stage.first_association(scene(), (bent(anna, 70.0), bob), QUICK, SOLVER)
    assert any(np.array_equal(call.state.R_parent_child, bent(anna, 70.0).state.R_parent_child) for call in calls)
    np.testing.assert_array_equal(wearers[0].state.R_parent_child, anna.state.R_parent_child)
    assert stage.visible_share(associated, 0) > 0.75  # Bob hides her at times
    truth = scene().camera.truth
    assert truth is not None
    given = associated[0].association.wearer == 0
    assert np.mean(truth.wearer[given] == 0) > 0.99


def test_a_calibration_that_looks_less_alike_is_not_begun_with(monkeypatch: pytest.MonkeyPatch) -> None:
    anna, bob = tracked()
    monkeypatch.setattr(stage, "calibrate_inertial", calibration_as(bent(anna, 12.0), []))
    hidden = without_detections(scene(), 0.0, 1.0, wearer=0)
    wearers, associated = stage.first_association(hidden, (anna, bob), QUICK, SOLVER)
    assert wearers[0] is anna
    (look,) = [stage._hypothesis_cameras(each, 0, anna) for each in associated]
    np.testing.assert_array_equal(associated[0].sightings[0].R_camera_world, look.R_camera_world)


def association(wearer: list[int], by_place: list[bool], by_clothes: bool) -> Association:
    N = len(wearer)
    R, p = np.tile(np.eye(3), (N, 1, 1)), np.zeros((N, 3))
    return Association(np.array(wearer), np.ones(N), R, p, np.zeros(N), (), np.array(by_place, bool), by_clothes)


def test_motion_place_and_clothes_are_told_apart() -> None:
    told = association_cues(["anna", "ben"], association([0, 0, 0, 1, -1], [False, True, True, False, False], True))
    assert told[0] == "anna was identified by motion in 1 detections and by place in 2; clothes counted"
    assert "ben was identified by motion in 1 detections and by place in 0" in told[1]


def test_without_a_known_camera_motion_alone_tells() -> None:
    assert association_cues(["anna"], association([0, 0], [], False)) == (
        "anna was identified by motion in 2 detections and by place in 0; clothes did not",
    )
