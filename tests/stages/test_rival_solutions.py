"""A solution that ended far from where it began is compared with one that began with that held; both may stand."""

from dataclasses import replace

import numpy as np
import pytest
from filmed_gestures import HASTY, filmed_gestures

from vip_factors.findings import sentences
from vip_factors.geometry.rotations import angle_between, exp
from vip_factors.sensors.sources import SceneInMemory
from vip_factors.stages.association import AssociatedCamera, associate_cameras, usable_cameras
from vip_factors.stages.fusion import FusionSolution, _reconsidered, _rival_findings, fuse
from vip_factors.stages.fusion_start import FusionStart, start_fusion
from vip_factors.stages.inertial import inertial_trackers
from vip_factors.stages.solver import Solver
from vip_factors.stages.windows import plan_scene

SOLVER = Solver(HASTY.solve, lambda stage, fraction: None)
THIGH = "left_thigh"

Fused = tuple[FusionStart, tuple[AssociatedCamera, ...], FusionSolution]


@pytest.fixture(scope="module")
def fused() -> Fused:
    scene = filmed_gestures(seconds=3.0, azimuth_deg=20.0)
    time = plan_scene(SceneInMemory(scene), HASTY, single_window=True).all_coarse_time
    inertial = inertial_trackers(scene, time, HASTY, SOLVER)
    associated = usable_cameras(associate_cameras(scene, inertial, HASTY, lambda fraction: None))
    initial = start_fusion(associated, inertial, HASTY)
    return initial, associated, fuse(initial, None, associated, HASTY, SOLVER)


def with_thigh_turned(solution: FusionSolution, degrees: float) -> FusionSolution:
    (own,), (model,) = solution.state.wearers, solution.model.wearers
    R, sensor = own.R_bone_sensor.copy(), model.frames.sensors.index(THIGH)
    R[sensor] = exp([0.0, np.deg2rad(degrees), 0.0]) @ R[sensor]
    return replace(solution, state=replace(solution.state, wearers=(replace(own, R_bone_sensor=R),)))


def test_what_is_near_its_start_is_not_reconsidered(fused: Fused) -> None:
    initial, associated, solution = fused
    assert _reconsidered(initial, solution, associated, HASTY, SOLVER) is solution


def test_the_likelier_of_two_is_kept_without_a_word(fused: Fused) -> None:
    initial, associated, solution = fused
    best = _reconsidered(initial, with_thigh_turned(solution, 90.0), associated, HASTY, SOLVER)
    (own,), (found,) = best.state.wearers, solution.state.wearers
    assert np.rad2deg(angle_between(own.R_bone_sensor, found.R_bone_sensor)).max() < 10
    assert best.findings == ()


def test_two_that_both_stand_are_told(fused: Fused) -> None:
    *_, solution = fused
    (told,) = sentences(_rival_findings(solution, with_thigh_turned(solution, 90.0), margin=1.0))
    assert "'anna'" in told
    assert f"{THIGH} by 90°" in told
    assert "2.7 times" in told
    assert "pelvis" not in told
    assert not list(_rival_findings(solution, with_thigh_turned(solution, 50.0), margin=1.0))
