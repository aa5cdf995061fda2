"""Where the next frame is, before it is solved for: bones turn as their sensors did, and the rest goes on."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vip_factors.body.kinematics import forward_kinematics
from vip_factors.body.skeleton import PARENTS, Skeleton
from vip_factors.geometry.rotations import Array, exp, log, rotation_z, transpose
from vip_factors.initialise.root_path import contact_points
from vip_factors.live.problem import LagFrame, LagProblem
from vip_factors.live.state import FrameState
from vip_factors.problem.state import SceneState
from vip_factors.terms.acceleration import GRAVITY

# Of the camera's velocity that is left one frame later, without an IMU on it: hands change their mind in 0.3 s.
CAMERA_KEEPS = 0.95
PELVIS = 0  # bone


def predicted(
    problem: LagProblem, before: Sequence[tuple[LagFrame, FrameState]], frame: LagFrame, shared: SceneState,
    knocked: Sequence[int] = (),
) -> FrameState:  # fmt: skip
    """A frame from the one or two ``before`` it, oldest first, and its own measured orientations.

    What ``knocked`` sensors (columns) say of their turn is not believed.
    """
    last, state = before[-1]
    older = before[-2][1] if len(before) > 1 else state
    turned = replace(state, R_parent_child=state.R_parent_child.copy())
    for number, wearer in enumerate(problem.wearers):
        bones = [sensor.bone for sensor in wearer.sensors]
        turns = _turns(last, frame, problem.sensors[number], shared.wearers[number].headings, knocked)
        R = np.stack([older.R_parent_child[number], state.R_parent_child[number]])
        R_world_bone = forward_kinematics(wearer.skeleton, R, np.zeros((2, 3))).R_world_bone
        turns = _steadied(turns, R_world_bone[1, bones] @ transpose(R_world_bone[0, bones]))
        turned.R_parent_child[number] = _with_turned_bones(R[1], R_world_bone[1], bones, turns)
    pushed = [_pushed(problem, number, last, shared) for number in range(len(problem.wearers))]
    turned = replace(turned, p_world_pelvis=2 * state.p_world_pelvis - older.p_world_pelvis + pushed)
    for number, wearer in enumerate(problem.wearers):
        if not wearer.use_acceleration:
            turned.p_world_pelvis[number] = _on_standing_foot(
                wearer.skeleton,
                wearer.settings.sole.of(shared.wearers[number].sole),
                state,
                turned,
                number,
                problem.filmed,
            )
    return _with_camera(problem, turned, older, state, last, frame, shared) if problem.moving else turned


def turned_to(
    problem: LagProblem, last: LagFrame, state: FrameState, frame: LagFrame, shared: SceneState
) -> Array:  # fmt: skip
    """Joint rotations ``(W, 24, 3, 3)`` of a ``frame`` after the ``last`` one: bones turned as their sensors."""
    R_parent_child = state.R_parent_child.copy()
    for number, wearer in enumerate(problem.wearers):
        R, bones = state.R_parent_child[number], [sensor.bone for sensor in wearer.sensors]
        turns = _turns(last, frame, problem.sensors[number], shared.wearers[number].headings)
        R_world_bone = forward_kinematics(wearer.skeleton, R[None], np.zeros((1, 3))).R_world_bone[0]
        R_parent_child[number] = _with_turned_bones(R, R_world_bone, bones, turns)
    return R_parent_child


def _pushed(problem: LagProblem, number: int, last: LagFrame, shared: SceneState) -> Array:
    """Second difference ``(3,)`` of a wearer's path in metres, by the accelerometer on the pelvis; zero without one."""
    bones = [sensor.bone for sensor in problem.wearers[number].sensors]
    if PELVIS not in bones:
        return np.zeros(3)
    sensor = bones.index(PELVIS)
    column = problem.sensors[number][sensor]
    if not last.acceleration_valid[column]:
        return np.zeros(3)
    heading, force = shared.wearers[number].headings[sensor], last.specific_force_inertial[column]
    return np.asarray(problem.step**2 * (rotation_z(heading) @ force + GRAVITY))


def _on_standing_foot(
    skeleton: Skeleton, sole: float, before: FrameState, now: FrameState, wearer: int, filmed: bool
) -> Array:
    """The root ``(3,)`` with which the foot that was the lowest stays where it was; without a camera, on the floor.

    Where frames are estimated each by itself nothing else ties one root to the next, and a velocity would run away.
    """
    R = np.stack([before.R_parent_child[wearer], now.R_parent_child[wearer]])
    body = forward_kinematics(skeleton, R, np.zeros((2, 3)))
    points = np.stack([body.point(bone, p) for bone, p in contact_points(skeleton, sole)], axis=1)
    lowest = np.argmin(points[0, :, 2])
    p = before.p_world_pelvis[wearer] + points[0, lowest] - points[1, lowest]
    if not filmed:
        p[2] = -points[1, :, 2].min()
    return np.asarray(p)


def _turns(
    last: LagFrame, frame: LagFrame, columns: np.ndarray, headings: Array, knocked: Sequence[int] = ()
) -> list[Array | None]:
    """How each sensor has turned since the last frame, in the world; None where that was not measured."""
    both = last.orientation_valid[columns] & frame.orientation_valid[columns] & ~np.isin(columns, knocked)
    turns = frame.R_inertial_sensor[columns] @ last.R_inertial_sensor[columns].swapaxes(1, 2)
    R = rotation_z(headings)
    turns = R @ turns @ R.swapaxes(1, 2)
    return [turn if seen else None for turn, seen in zip(turns, both, strict=True)]


def _steadied(turns: Sequence[Array | None], before: Array) -> list[Array | None]:
    """Turns ``(S, 3, 3)`` half as measured and half as they were ``before``: one measurement trembles."""
    known = [number for number, turn in enumerate(turns) if turn is not None]
    steadied = list(turns)
    if known:
        measured = np.stack([turn for turn in turns if turn is not None])
        for number, turn in zip(known, exp((log(measured) + log(before[known])) / 2), strict=True):
            steadied[number] = turn
    return steadied


def _with_turned_bones(
    R_parent_child: Array, R_world_bone: Array, bones: Sequence[int], turns: Sequence[Array | None]
) -> Array:
    """Joint rotations ``(24, 3, 3)`` with sensed bones turned in the world, all others as they are to their parents."""
    turn_of = {bone: turn for bone, turn in zip(bones, turns, strict=True) if turn is not None}
    after: list[Array] = []
    result = R_parent_child.copy()
    for joint, parent in enumerate(PARENTS):
        if joint in turn_of:
            after.append(turn_of[joint] @ R_world_bone[joint])
            result[joint] = after[joint] if parent < 0 else after[parent].T @ after[joint]
        else:
            after.append(R_parent_child[joint] if parent < 0 else after[parent] @ R_parent_child[joint])
    return result


def _with_camera(
    problem: LagProblem, state: FrameState, older: FrameState, newer: FrameState, last: LagFrame, frame: LagFrame,
    shared: SceneState,
) -> FrameState:  # fmt: skip
    """The camera goes on; turned as its IMU was, if it has one."""
    if not problem.camera.free_pose:
        return state
    p = newer.p_world_camera + CAMERA_KEEPS * (newer.p_world_camera - older.p_world_camera)
    turn = None
    if problem.camera.imu is not None:
        turn = _turns(last, frame, problem.sensors[-1], np.array([shared.camera.heading]))[0]
    if turn is None:
        spin = CAMERA_KEEPS * log(newer.R_world_camera @ older.R_world_camera.T)
        turn = exp(spin)
    return replace(state, R_world_camera=turn @ newer.R_world_camera, p_world_camera=p)
