"""Predicted states of frames: bones turn with their sensors, positions and the camera continue.

The next frame is predicted in this way, and the frames of the lag are carried over to a new calibration; there, video
of a standing camera locates wearers whose poses are known.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from vip_factors.body.kinematics import BodyState, forward_kinematics, local_rotations
from vip_factors.body.skeleton import PARENTS, Skeleton, contact_points
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array, exp, log, mean_rotation, rotation_z, transpose, yaw_of
from vip_factors.live.association_evidence import NEAREST_M, people_of, stack_people
from vip_factors.live.frames import FrameState, LagProblem, LiveFrame, stacked
from vip_factors.live.smoother import LagSmoother
from vip_factors.live.start import TrackingStart
from vip_factors.problem.state import CameraPoses, SceneState
from vip_factors.problem.wearer import BodyPoints
from vip_factors.sensors.live import VideoFrame
from vip_factors.sensors.scene import Camera
from vip_factors.stages.views import points_on_body
from vip_factors.terms.acceleration import GRAVITY

# Share of the camera's velocity that remains after a frame without an IMU: hands change direction within 0.3 s.
CAMERA_VELOCITY_SHARE = 0.95


def predict_frame(
    problem: LagProblem,
    previous_frames: Sequence[tuple[LiveFrame, FrameState]],
    frame: LiveFrame,
    shared: SceneState,
    knocked: Sequence[int] = (),
) -> FrameState:
    """Predict a frame from the one or two frames before it, oldest first, and its measured orientations.

    Turns of ``knocked`` sensors (columns) are ignored.
    """
    last_frame, state = previous_frames[-1]
    older = previous_frames[-2][1] if len(previous_frames) > 1 else state
    R_parent_child = np.empty_like(state.R_parent_child)
    for number, wearer in enumerate(problem.wearers):
        bones = [sensor.bone for sensor in wearer.sensors]
        turns, measured = _turns(last_frame, frame, problem.sensors[number], shared.wearers[number].headings, knocked)
        R = np.stack([older.R_parent_child[number], state.R_parent_child[number]])
        R_world_bone = forward_kinematics(wearer.skeleton, R, np.zeros((2, 3))).R_world_bone
        went = R_world_bone[1, bones] @ transpose(R_world_bone[0, bones])
        turns = exp((log(turns) + log(went)) / 2)  # mean with the last turn: a single measurement is noisy
        R_parent_child[number] = _with_turned_bones(R_world_bone[1], bones, turns, measured)
    pushed = [_acceleration_step(problem, number, frame, shared) for number in range(len(problem.wearers))]
    p_world_pelvis = 2 * state.p_world_pelvis - older.p_world_pelvis + pushed
    for number, wearer in enumerate(problem.wearers):
        if not wearer.use_acceleration:
            sole = wearer.settings.sole.of(shared.wearers[number].sole)
            R = np.stack([state.R_parent_child[number], R_parent_child[number]])
            p = state.p_world_pelvis[number]
            p_world_pelvis[number] = _on_standing_foot(wearer.skeleton, sole, R, p, problem.has_views)
    cameras = _predicted_cameras(problem, older, state, last_frame, frame, shared)
    return FrameState(R_parent_child, p_world_pelvis, *cameras)


def _acceleration_step(problem: LagProblem, number: int, frame: LiveFrame, shared: SceneState) -> Array:
    """Second difference ``(3,)`` of a wearer's path in metres, by the accelerometer on the pelvis; zero without one."""
    pelvis = 0  # bone
    bones = [sensor.bone for sensor in problem.wearers[number].sensors]
    if pelvis not in bones:
        return np.zeros(3)
    sensor = bones.index(pelvis)
    column = problem.sensors[number][sensor]
    if not frame.acceleration_valid_before[column]:
        return np.zeros(3)
    heading, force = shared.wearers[number].headings[sensor], frame.specific_force_before[column]
    return np.asarray(problem.step**2 * (rotation_z(heading) @ force + GRAVITY))


def _on_standing_foot(
    skeleton: Skeleton, sole: float, R_parent_child: Array, p_world_pelvis: Array, has_views: bool
) -> Array:
    """The root ``(3,)`` that keeps the lowest foot where it was; without a camera, on the floor.

    Where frames are estimated independently, nothing else ties one root to the next, and a velocity would run away.
    Joint rotations ``(2, 24, 3, 3)`` are those of the last frame and the next one, ``p_world_pelvis`` is the last root.
    """
    body = forward_kinematics(skeleton, R_parent_child, np.zeros((2, 3)))
    points = np.stack([body.point(bone, p) for bone, p in contact_points(skeleton, sole)], axis=1)
    lowest = np.argmin(points[0, :, 2])
    p = p_world_pelvis + points[0, lowest] - points[1, lowest]
    if not has_views:
        p[2] = -points[1, :, 2].min()
    return np.asarray(p)


def _turns(
    last_frame: LiveFrame, frame: LiveFrame, columns: np.ndarray, headings: Array, knocked: Sequence[int] = ()
) -> tuple[Array, np.ndarray]:
    """Turn of each sensor since the last frame in the world ``(S, 3, 3)``, and whether it was measured ``(S,)``."""
    measured = last_frame.orientation_valid[columns] & frame.orientation_valid[columns]
    if len(knocked):
        measured &= ~np.isin(columns, knocked)
    turns = frame.R_inertial_sensor[columns] @ last_frame.R_inertial_sensor[columns].swapaxes(1, 2)
    R = rotation_z(headings)
    return R @ turns @ R.swapaxes(1, 2), measured


def _with_turned_bones(R_world_bone: Array, bones: Sequence[int], turns: Array, measured: np.ndarray) -> Array:
    """Joint rotations ``(24, 3, 3)`` with ``measured`` bones turned in the world; others turn with the nearest
    measured bone above them.
    """
    turn_of_bone = {bone: number for number, bone in enumerate(bones) if measured[number]}
    turned_by: list[int] = []
    for joint, parent in enumerate(PARENTS):
        turned_by.append(turn_of_bone.get(joint, turned_by[parent] if parent >= 0 else len(turns)))
    turned = local_rotations(np.concatenate([turns, np.eye(3)[None]])[turned_by] @ R_world_bone)
    # Renormalised: along a chain of sensors rounding errors grow with every frame.
    return turned @ (3 * np.eye(3) - transpose(turned) @ turned) / 2


def _predicted_cameras(
    problem: LagProblem,
    older: FrameState,
    newer: FrameState,
    last_frame: LiveFrame,
    frame: LiveFrame,
    shared: SceneState,
) -> tuple[Array, Array]:
    """Rotations and positions of carried cameras, which continue, turned with their IMUs if they have some."""
    R, p = newer.R_world_camera.copy(), newer.p_world_camera.copy()
    for m, number in enumerate(problem.carried):
        if not problem.cameras[number].free_pose:
            continue
        p[m] = newer.p_world_camera[m] + CAMERA_VELOCITY_SHARE * (newer.p_world_camera[m] - older.p_world_camera[m])
        turn, measured = np.eye(3), False
        if problem.cameras[number].imu is not None:
            heading = np.array([shared.cameras[number].heading])
            (turn,), (measured,) = _turns(last_frame, frame, problem.camera_sensors(number), heading)
        if not measured:
            turn = exp(CAMERA_VELOCITY_SHARE * log(newer.R_world_camera[m] @ older.R_world_camera[m].T))
        R[m] = turn @ newer.R_world_camera[m]
    return R, p


# Largest median error of the keypoints of a detection that fits a wearer, in heights of the person in the image: 5 %
# with a good calibration, 20 % in somebody else's pose.
FITS = 0.10
MOST_STEPS, LEAST_STEP_M = 20, 1e-4  # of a fit


def locate_wearers(
    camera: Camera,
    pose: tuple[Array, Array],
    bodies: Sequence[BodyState],
    skeletons: Sequence[Skeleton],
    video: Sequence[VideoFrame],
) -> Array:
    """Locate wearers in ``F`` video frames: root positions ``(F, W, 3)``, metres; NaN for a wearer who is not visible.

    Args:
        camera: the camera of the frames.
        pose: its rotations ``(F, 3, 3)`` and positions ``(F, 3)`` in the world.
        bodies: the wearers' bodies in those frames, anywhere.
        skeletons: the wearers' skeletons.
        video: the frames.
    """
    least_keypoints = 6
    people = stack_people([people_of(frame.pixels, frame.confidence, camera.model) for frame in video])
    cost, place = np.empty((len(video), len(bodies), people.is_person.shape[1])), list[Array]()
    for wearer, (body, skeleton) in enumerate(zip(bodies, skeletons, strict=True)):
        used, points = points_on_body(camera.keypoints, skeleton)
        o_camera = (BodyPoints.of(points).on(body) - body.p_world_joint[:, :1]) @ pose[0]
        visible = people.weight[..., used] > 0
        error, p_camera = _fit(o_camera[:, None], people.rays[..., used, :], visible)
        fits = (visible.sum(axis=-1) >= least_keypoints) & (error < 10 * FITS)
        cost[:, wearer] = np.where(fits, error, 10 * FITS)
        place.append(pose[1][:, None] + p_camera @ transpose(pose[0]))
    p_world_pelvis = np.full((len(video), len(bodies), 3), np.nan)
    for f, cost_of_frame in enumerate(cost):
        for wearer, person in np.transpose(linear_sum_assignment(cost_of_frame)).tolist():
            if cost_of_frame[wearer, person] < FITS:
                p_world_pelvis[f, wearer] = place[wearer][f, person]
    return p_world_pelvis


def _fit(o_camera: Array, rays: Array, visible: np.ndarray) -> tuple[Array, Array]:
    """Median errors ``(F, N)`` in heights of the persons, and root positions ``(F, N, 3)`` at which a body fits them.

    The linear solution, the point nearest to all rays, is biased towards the camera by pose errors, by half the depth.

    Args:
        o_camera: ``(F, 1, K, 3)`` keypoints of the body from the root.
        rays, visible: ``(F, N, K, 2)`` and ``(F, N, K)`` of all persons' keypoints.
    """
    least_height = 1e-3  # of a person in the image, at depth one
    mask, count = visible[..., None], np.maximum(visible.sum(axis=-1), 1)[..., None]
    height = np.maximum(_span(rays, mask).max(axis=-1), least_height)[..., None, None]
    tall = np.maximum(_span(o_camera[..., 1:2], mask), NEAREST_M)
    direction = np.concatenate([(rays * mask).sum(axis=-2) / count, np.ones_like(count)], axis=-1)
    p = tall / height[..., 0] * direction - (o_camera * mask).sum(axis=-2) / count
    J = np.zeros((*rays.shape, 3))
    for _ in range(MOST_STEPS):
        in_front = p[..., None, :] + o_camera
        per_metre = 1 / np.maximum(in_front[..., 2:], NEAREST_M)
        flat, by_point = in_front[..., :2] * per_metre, per_metre / height
        error = (flat - rays) / height
        J[..., 0, 0] = J[..., 1, 1] = by_point[..., 0]
        J[..., 2] = -flat * by_point
        weight = mask / np.sqrt(1 + (error / FITS) ** 2)  # of a loss that is quadratic near zero and linear beyond
        rows = J.reshape(*J.shape[:-3], -1, 3)
        pushed = transpose(weight.reshape(*rows.shape[:-1], 1) * rows)
        square = pushed @ rows + least_height**2 * np.eye(3)
        step = np.linalg.solve(square, pushed @ error.reshape(*rows.shape[:-1], 1))[..., 0]
        p = p - step
        if np.abs(step).max(initial=0.0) < LEAST_STEP_M:
            break
    off = np.sort(np.where(visible, np.sqrt(np.sum(error**2, axis=-1)), np.inf), axis=-1)
    middle = np.concatenate([(count - 1) // 2, count // 2], axis=-1)
    return np.take_along_axis(off, middle, axis=-1).mean(axis=-1), p


def _span(values: Array, mask: np.ndarray) -> Array:
    """Range ``(..., c)`` of the values ``(..., K, c)`` under a mask; negative where the mask is empty."""
    return np.asarray(np.where(mask, values, -np.inf).max(axis=-2) - np.where(mask, values, np.inf).min(axis=-2))


def continued_start(
    start: TrackingStart, smoother: LagSmoother, cameras: Sequence[Camera], video: Sequence[VideoFrame]
) -> TrackingStart | None:
    """Continue tracking with a new calibration: a start on the frames of a smoother, in the world they were tracked in.

    Bones turn from the last frame of ``start`` with their sensors. Wearers are located in the video of these frames;
    without cameras they, and a moving camera, move as they were tracked.

    Args:
        start: a calibration from frames up to some time ago, the last of which was tracked.
        smoother: the smoother that has tracked since.
        cameras: all cameras of the stream.
        video: recent video frames.

    Returns:
        None if the video shows no wearer although a camera is used.
    """
    at_find = start.tracked_state
    assert at_find is not None
    start = _in_tracked_world(start, at_find)
    last_frame, state = start.frames[-1], start.states[-1]
    problem, shared = start.problem, start.shared
    yaw = yaw_of(state.R_parent_child[:, 0] @ transpose(at_find.R_parent_child[:, 0]))  # of each wearer
    bodies = [
        forward_kinematics(wearer.skeleton, R[None], np.zeros((1, 3)))
        for wearer, R in zip(problem.wearers, state.R_parent_child, strict=True)
    ]
    frames, states = [], []
    stands = start.has_views and not problem.carried
    for number in smoother.numbers:
        frame, tracked = smoother.frame(number), smoother.state(number)
        contacts = [
            confidence if len(confidence) == len(wearer.contacts) and not stands else np.zeros(len(wearer.contacts))
            for confidence, wearer in zip(frame.contacts, problem.wearers, strict=True)
        ]
        frames.append(replace(frame, views=[None] * len(problem.cameras), contacts=contacts))
        R = np.empty_like(state.R_parent_child)
        for w, wearer in enumerate(problem.wearers):
            turns = _turns(last_frame, frame, problem.sensors[w], shared.wearers[w].headings)
            R[w] = _with_turned_bones(bodies[w].R_world_bone[0], [sensor.bone for sensor in wearer.sensors], *turns)
        moved_by = (rotation_z(yaw) @ (tracked.p_world_pelvis - at_find.p_world_pelvis)[..., None])[..., 0]
        p = state.p_world_pelvis + moved_by
        states.append(FrameState(R, p, *_carried_poses(float(yaw[0]), state, at_find, tracked)))
    if start.has_views:
        recent = [frame for frame in video if frame.frame in smoother.numbers]
        every = (_placed(start, states, smoother.numbers[0], camera, recent) for camera in cameras)
        placed = next((states_by_camera for states_by_camera in every if states_by_camera is not None), None)
        if placed is None:
            return None
        states = placed
    problem.begin_at(states[0].p_world_pelvis)
    return replace(start, frames=frames, states=states)


def _in_tracked_world(start: TrackingStart, at_find: FrameState) -> TrackingStart:
    """The start in the world of the tracked frames: moved so that the first wearer is where they were tracked."""
    problem, state, shared = start.problem, start.states[-1], start.shared
    if start.has_views and not all(camera.free_pose for camera in problem.cameras):
        return start
    angle = float(yaw_of(at_find.R_parent_child[0, 0] @ state.R_parent_child[0, 0].T))
    turn = rotation_z(angle)
    shift = at_find.p_world_pelvis[0] - turn @ state.p_world_pelvis[0]
    if problem.wearers[0].has_floor:
        shift[2] = 0.0  # the floor is better known now than before

    def moved(R: Array, p: Array) -> tuple[Array, Array]:
        return turn @ R, p @ turn.T + shift

    cameras = tuple(
        replace(
            camera,
            poses=CameraPoses(*moved(camera.poses.R_world_camera, camera.poses.p_world_camera)),
            heading=camera.heading + angle,
        )
        for camera in shared.cameras
    )
    wearers = tuple(wearer.turned(angle, shift) for wearer in shared.wearers)
    problem.turn_headings(angle)
    R = state.R_parent_child.copy()
    R[:, 0], p = moved(R[:, 0], state.p_world_pelvis)
    moved_state = FrameState(R, p, *moved(state.R_world_camera, state.p_world_camera))
    return replace(start, shared=replace(shared, wearers=wearers, cameras=cameras), states=[moved_state])


def _placed(
    start: TrackingStart, states: Sequence[FrameState], first_number: int, camera: Camera, video: Sequence[VideoFrame]
) -> list[FrameState] | None:
    """States from ``first_number`` on with the wearers located by one camera; None if it shows nobody."""
    used = [associated.camera.name for associated in start.associated]
    video = [frame for frame in video if frame.camera == camera.name]
    if camera.name not in used or not video:
        return None
    skeletons = [wearer.skeleton for wearer in start.problem.wearers]
    index = np.array([frame.frame - first_number for frame in video])
    scene = stacked([states[t] for t in index], start.shared)
    bodies = [
        forward_kinematics(skeleton, wearer.R_parent_child, wearer.p_world_pelvis)
        for skeleton, wearer in zip(skeletons, scene.wearers, strict=True)
    ]
    poses = scene.cameras[used.index(camera.name)].at_frames(slice(0, len(index)))
    pose = poses.R_world_camera, poses.p_world_camera
    places = locate_wearers(start.with_lens(camera), pose, bodies, skeletons, video)
    visible, p_world_pelvis = np.isfinite(places[..., 0]), np.stack([state.p_world_pelvis for state in states])
    if not visible.any():
        return None
    for w in np.flatnonzero(visible.any(axis=0)):
        index_of_wearer = index[visible[:, w]]
        line = np.polyfit(
            index_of_wearer, places[visible[:, w], w], min(1, len(np.unique(index_of_wearer)) - 1)
        )  # a single depth is off by a tenth
        p_world_pelvis[:, w] = np.vander(np.arange(len(states)), len(line)) @ line
    return [replace(state, p_world_pelvis=p) for state, p in zip(states, p_world_pelvis, strict=True)]


def _carried_poses(yaw: float, state: FrameState, at_find: FrameState, state_after: FrameState) -> tuple[Array, Array]:
    """Poses of the carried cameras, moved in the first wearer's new world as in the old one.

    Where other cameras are carried than before, they stay.
    """
    if not len(state.p_world_camera) == len(at_find.p_world_camera) == len(state_after.p_world_camera):
        return state.R_world_camera, state.p_world_camera
    turn, step = rotation_z(yaw), state_after.p_world_camera - at_find.p_world_camera
    R = turn @ state_after.R_world_camera @ transpose(at_find.R_world_camera) @ turn.T @ state.R_world_camera
    return np.asarray(R), np.asarray(state.p_world_camera + step @ turn.T)


def correction_findings(seconds: float, old_smoother: LagSmoother, new_smoother: LagSmoother) -> list[Finding]:
    """Findings about bones that were wrong in the last frame before a calibration from so many seconds."""
    wrong_deg = 25.0  # of a bone against the others; a start is usually off by less
    findings, number = list[Finding](), old_smoother.numbers[-1]
    for old, new, R_old, R_new in zip(
        old_smoother.problem.wearers,
        new_smoother.problem.wearers,
        old_smoother.state(number).R_parent_child,
        new_smoother.state(number).R_parent_child,
        strict=True,
    ):
        bones = [sensor.bone for sensor in new.sensors]
        R = [
            forward_kinematics(wearer.skeleton, R_parent_child[None], np.zeros((1, 3))).R_world_bone[0, bones]
            for wearer, R_parent_child in ((old, R_old), (new, R_new))
        ]
        relative = R[1] @ transpose(R[0])
        turned = np.rad2deg(np.linalg.norm(log(relative @ mean_rotation(relative).T), axis=1))
        wrong = {new.frames.sensors[s]: float(turned[s]) for s in np.flatnonzero(turned > wrong_deg)}
        if wrong:
            findings.append(Finding("calibration corrected", numbers=wrong, words={"seconds": f"{seconds:.0f}"}))
    return findings
