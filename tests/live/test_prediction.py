"""The next frame before it is solved for: bones as measured, the root as pushed, the lowest foot on the floor."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from vip_factors.body.kinematics import forward_kinematics
from vip_factors.body.skeleton import contact_points, joint_index
from vip_factors.geometry.rotations import angle_between, rotation_x
from vip_factors.live.frames import FrameState, LagProblem, LiveFrame
from vip_factors.live.prediction import predict_frame
from vip_factors.problem.state import SceneState
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.frames import resample
from vip_factors.sensors.recording import Recording, Subject
from vip_factors.settings import LiveSettings, Settings
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording
from vip_factors.simulate.settings import SimulateSettings
from vip_factors.stages.inertial import InertialSolution, inertial_tracker
from vip_factors.stages.solver import Solver

RATE = 60.0


@cache
def recorded() -> tuple[Recording, InertialSolution]:
    motion = gestures(2.0, RATE)
    made = simulate_recording(motion, preset("tnt10", motion.skeleton), SimulateSettings.noise_free(), seed=1)
    made = replace(made, subject=Subject(skeleton=motion.skeleton))
    settings = Settings()
    return made, inertial_tracker(
        made, resample(made, 10.0), settings, Solver(settings.solve, lambda stage, done: None)
    )


def truth_at(time: float) -> FrameState:
    truth = recorded()[0].truth
    assert truth is not None
    R, p = truth.motion.poses_at(np.array([time]))
    return FrameState(R, p, np.eye(3)[None], np.zeros((1, 3)))


def problem_of(use_acceleration: bool = True) -> tuple[LagProblem, SceneState]:
    """With the true calibration."""
    made, solved = recorded()
    assert made.truth is not None
    assert made.truth.calibration is not None
    model = replace(solved.model, settings=Settings().factors, use_acceleration=use_acceleration)
    names = model.frames.sensors
    headings = np.array([made.truth.calibration[name].heading for name in names])
    state = SceneState.unfilmed([replace(solved.state, headings=headings)])
    columns = [np.arange(len(names)), np.zeros(0, int)]
    return LagProblem([model], (), (), columns, 1 / RATE, LiveSettings()), state


def frames_at(numbers: range) -> list[LiveFrame]:
    found = resample(recorded()[0], RATE)
    return [
        LiveFrame(
            t, found.time[t], found.R_inertial_sensor[t], found.orientation_valid[t],
            found.specific_force_inertial[t - 1], found.acceleration_valid[t - 1],
        )
        for t in numbers
    ]  # fmt: skip


def bones_of(problem: LagProblem, state: FrameState) -> np.ndarray:
    """World orientations of the bones with sensors."""
    (wearer,) = problem.wearers
    body = forward_kinematics(wearer.skeleton, state.R_parent_child[0][None], state.p_world_pelvis)
    return body.R_world_bone[0, [sensor.bone for sensor in wearer.sensors]]


def root_error(at: int, push: bool) -> float:
    """Metres by which the root is beside the truth in a frame predicted from true ones."""
    (problem, shared), (older, last, new) = problem_of(), frames_at(range(at - 2, at + 1))
    if not push:
        new = replace(new, acceleration_valid_before=np.zeros_like(new.acceleration_valid_before))
    before = [(one, truth_at(one.time)) for one in (older, last)]
    found = predict_frame(problem, before, new, shared)
    return float(np.linalg.norm(found.p_world_pelvis - truth_at(new.time).p_world_pelvis))


def test_the_pelvis_is_pushed_as_its_sensor_says() -> None:
    pushed, coasting = (np.mean([root_error(at, push) for at in range(30, 90, 6)]) for push in (True, False))
    assert pushed < 0.5 * coasting


def test_bones_turn_as_measured_and_as_they_went() -> None:
    """Half and half: where a bone goes on turning as it did neither is wrong, and of a change half is seen."""
    problem, shared = problem_of()
    last, new = frames_at(range(40, 42))
    state = truth_at(last.time)
    found = predict_frame(problem, [(last, state)], new, shared)  # as if all had rested before
    R = [bones_of(problem, one) for one in (state, found, truth_at(new.time))]
    moved, missing, whole = angle_between(R[0], R[1]), angle_between(R[1], R[2]), angle_between(R[0], R[2])
    assert moved == pytest.approx(whole / 2, abs=2e-4)
    assert missing == pytest.approx(whole / 2, abs=2e-4)


def test_without_a_camera_the_lowest_foot_is_on_the_floor_of_now() -> None:
    problem, shared = problem_of(use_acceleration=False)
    older, last, new = frames_at(range(38, 41))
    state, skeleton = truth_at(last.time), problem.wearers[0].skeleton
    R = state.R_parent_child.copy()
    for side in ("left", "right"):  # both knees bend: soles come nearer to the pelvis
        R[0, joint_index(f"{side}_knee")] = R[0, joint_index(f"{side}_knee")] @ rotation_x(0.3)
    before = replace(state, R_parent_child=R)
    found = predict_frame(problem, [(older, before), (last, state)], new, shared)
    body = forward_kinematics(skeleton, found.R_parent_child[0][None], found.p_world_pelvis)
    sole = problem.wearers[0].settings.sole.of(shared.wearers[0].sole)
    heights = [body.point(bone, p)[0, 2] for bone, p in contact_points(skeleton, sole)]
    assert min(heights) == pytest.approx(0.0, abs=1e-9)
