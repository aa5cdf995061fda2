"""Where frames are before they are solved for: bones turn as their sensors did, and the rest goes on.

So the next frame is predicted, and so the frames of the lag are carried over to a calibration found anew; there a video
frame of a known camera shows where wearers stand whose poses are known.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from vip_factors.body.kinematics import BodyState, forward_kinematics, local_rotations
from vip_factors.body.skeleton import PARENTS, Skeleton, contact_points
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array, exp, log, mean_rotation, rotation_z, transpose, yaw_of
from vip_factors.live.association_evidence import NEAREST_M, people_of, together
from vip_factors.live.measurement import LiveFrame
from vip_factors.live.problem import FrameState, LagProblem
from vip_factors.live.smoother import LagSmoother
from vip_factors.live.start import TrackingStart
from vip_factors.problem.state import CameraPoses, SceneState
from vip_factors.problem.wearer import BodyPoints
from vip_factors.sensors.live import VideoFrame
from vip_factors.sensors.scene import Camera
from vip_factors.stages.views import points_on_body
from vip_factors.terms.acceleration import GRAVITY

# Of the camera's velocity that is left one frame later, without an IMU on it: hands change their mind in 0.3 s.
CAMERA_KEEPS = 0.95


def predicted(
    problem: LagProblem, before: Sequence[tuple[LiveFrame, FrameState]], frame: LiveFrame, shared: SceneState,
    knocked: Sequence[int] = (),
) -> FrameState:  # fmt: skip
    """A frame from the one or two ``before`` it, oldest first, and its own measured orientations.

    What ``knocked`` sensors (columns) say of their turn is not believed.
    """
    last, state = before[-1]
    older = before[-2][1] if len(before) > 1 else state
    R_parent_child = np.empty_like(state.R_parent_child)
    R = np.stack([older.R_parent_child, state.R_parent_child], axis=1)
    for number, wearer in enumerate(problem.wearers):
        bones = [sensor.bone for sensor in wearer.sensors]
        turns, seen = _turns(last, frame, problem.sensors[number], shared.wearers[number].headings, knocked)
        R_world_bone = forward_kinematics(wearer.skeleton, R[number], np.zeros((2, 3))).R_world_bone
        went = R_world_bone[1, bones] @ transpose(R_world_bone[0, bones])
        turns = exp((log(turns) + log(went)) / 2)  # half as measured and half as they went: one measurement trembles
        R_parent_child[number] = _with_turned_bones(R_world_bone[1], bones, turns, seen)
    pushed = [_pushed(problem, number, frame, shared) for number in range(len(problem.wearers))]
    p_world_pelvis = 2 * state.p_world_pelvis - older.p_world_pelvis + pushed
    turned = FrameState(R_parent_child, p_world_pelvis, state.R_world_camera, state.p_world_camera)
    for number, wearer in enumerate(problem.wearers):
        if not wearer.use_acceleration:
            turned.p_world_pelvis[number] = _on_standing_foot(
                wearer.skeleton,
                wearer.settings.sole.of(shared.wearers[number].sole),
                state,
                turned,
                number,
                problem.has_views,
            )
    return _with_camera(problem, turned, older, state, last, frame, shared) if problem.moving else turned


def turned_to(
    problem: LagProblem, last: LiveFrame, state: FrameState, frame: LiveFrame, shared: SceneState
) -> Array:  # fmt: skip
    """Joint rotations ``(W, 24, 3, 3)`` of a ``frame`` after the ``last`` one: bones turned as their sensors."""
    R_parent_child = state.R_parent_child.copy()
    for number, wearer in enumerate(problem.wearers):
        R, bones = state.R_parent_child[number], [sensor.bone for sensor in wearer.sensors]
        turns = _turns(last, frame, problem.sensors[number], shared.wearers[number].headings)
        R_world_bone = forward_kinematics(wearer.skeleton, R[None], np.zeros((1, 3))).R_world_bone[0]
        R_parent_child[number] = _with_turned_bones(R_world_bone, bones, *turns)
    return R_parent_child


def _pushed(problem: LagProblem, number: int, frame: LiveFrame, shared: SceneState) -> Array:
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
    skeleton: Skeleton, sole: float, before: FrameState, now: FrameState, wearer: int, has_views: bool
) -> Array:
    """The root ``(3,)`` with which the foot that was the lowest stays where it was; without a camera, on the floor.

    Where frames are estimated each by itself nothing else ties one root to the next, and a velocity would run away.
    """
    R = np.stack([before.R_parent_child[wearer], now.R_parent_child[wearer]])
    body = forward_kinematics(skeleton, R, np.zeros((2, 3)))
    points = np.stack([body.point(bone, p) for bone, p in contact_points(skeleton, sole)], axis=1)
    lowest = np.argmin(points[0, :, 2])
    p = before.p_world_pelvis[wearer] + points[0, lowest] - points[1, lowest]
    if not has_views:
        p[2] = -points[1, :, 2].min()
    return np.asarray(p)


def _turns(
    last: LiveFrame, frame: LiveFrame, columns: np.ndarray, headings: Array, knocked: Sequence[int] = ()
) -> tuple[Array, np.ndarray]:
    """How each sensor has turned since the last frame ``(S, 3, 3)``, in the world, and whether that was measured."""
    both = last.orientation_valid[columns] & frame.orientation_valid[columns]
    if len(knocked):
        both &= ~np.isin(columns, knocked)
    turns = frame.R_inertial_sensor[columns] @ last.R_inertial_sensor[columns].swapaxes(1, 2)
    R = rotation_z(headings)
    return R @ turns @ R.swapaxes(1, 2), both


def _with_turned_bones(R_world_bone: Array, bones: Sequence[int], turns: Array, seen: np.ndarray) -> Array:
    """Joint rotations ``(24, 3, 3)`` with ``seen`` bones turned in the world, all others as they are to their parents.

    These turn in the world as the nearest seen bone above them.
    """
    own = {bone: number for number, bone in enumerate(bones) if seen[number]}
    turned_by: list[int] = []
    for joint, parent in enumerate(PARENTS):
        turned_by.append(own.get(joint, turned_by[parent] if parent >= 0 else len(turns)))
    turned = local_rotations(np.concatenate([turns, np.eye(3)[None]])[turned_by] @ R_world_bone)
    # A step back to the nearest rotations: along a chain of sensors rounding grows by a share with every frame.
    return turned @ (3 * np.eye(3) - transpose(turned) @ turned) / 2


def _with_camera(
    problem: LagProblem, state: FrameState, older: FrameState, newer: FrameState, last: LiveFrame, frame: LiveFrame,
    shared: SceneState,
) -> FrameState:  # fmt: skip
    """The camera goes on; turned as its IMU was, if it has one."""
    carried = problem.carried
    if carried is None or not problem.cameras[carried].free_pose:
        return state
    p = newer.p_world_camera + CAMERA_KEEPS * (newer.p_world_camera - older.p_world_camera)
    turn, measured = np.eye(3), False
    if problem.cameras[carried].imu is not None:
        heading = np.array([shared.cameras[carried].heading])
        (turn,), (measured,) = _turns(last, frame, problem.camera_sensors(carried), heading)
    if not measured:
        spin = CAMERA_KEEPS * log(newer.R_world_camera @ older.R_world_camera.T)
        turn = exp(spin)
    return replace(state, R_world_camera=turn @ newer.R_world_camera, p_world_camera=p)


# Median error of the keypoints, in heights of the person in the image, with which a detection may show a wearer: a
# joint is 5 % off with a calibration that is found, and 20 % in somebody else's pose.
FITS = 0.10
MOST_STEPS, LEAST_STEP_M = 20, 1e-4  # of a fit


def locate_wearers(
    camera: Camera, pose: tuple[Array, Array], bodies: Sequence[BodyState], skeletons: Sequence[Skeleton],
    video: Sequence[VideoFrame],
) -> Array:  # fmt: skip
    """Root positions ``(F, W, 3)`` of the wearers, metres, as ``F`` video frames show them; NaN of one unseen.

    Args:
        camera: that gave the frames.
        pose: its rotations ``(F, 3, 3)`` and positions ``(F, 3)`` in the world.
        bodies: of the wearers in those frames, anywhere.
        skeletons: of them.
        video: the frames.
    """
    least_keypoints = 6
    people = together([people_of(one.pixels, one.confidence, camera.model) for one in video])
    cost, place = np.empty((len(video), len(bodies), people.there.shape[1])), list[Array]()
    for wearer, (body, skeleton) in enumerate(zip(bodies, skeletons, strict=True)):
        used, points = points_on_body(camera.keypoints, skeleton)
        o_camera = (BodyPoints.of(points).on(body) - body.p_world_joint[:, :1]) @ pose[0]
        seen = people.weight[..., used] > 0
        error, p_camera = _fit(o_camera[:, None], people.rays[..., used, :], seen)
        fits = (seen.sum(axis=-1) >= least_keypoints) & (error < 10 * FITS)
        cost[:, wearer] = np.where(fits, error, 10 * FITS)
        place.append(pose[1][:, None] + p_camera @ transpose(pose[0]))
    found = np.full((len(video), len(bodies), 3), np.nan)
    for f, own in enumerate(cost):
        for wearer, person in np.transpose(linear_sum_assignment(own)).tolist():
            if own[wearer, person] < FITS:
                found[f, wearer] = place[wearer][f, person]
    return found


def _fit(o_camera: Array, rays: Array, seen: np.ndarray) -> tuple[Array, Array]:
    """Median errors ``(F, N)`` in heights of the persons, and the root's places ``(F, N, 3)`` where a body fits them.

    The point nearest to all rays would be the linear way; pose errors draw it towards the camera, by half the depth.

    Args:
        o_camera: ``(F, 1, K, 3)`` of its keypoints, from the root.
        rays, seen: ``(F, N, K, 2)`` and ``(F, N, K)`` of all persons' keypoints.
    """
    least_height = 1e-3  # of a person in the image, at depth one: a pixel or two
    known, count = seen[..., None], np.maximum(seen.sum(axis=-1), 1)[..., None]
    height = np.maximum(_span(rays, known).max(axis=-1), least_height)[..., None, None]
    tall = np.maximum(_span(o_camera[..., 1:2], known), NEAREST_M)
    way = np.concatenate([(rays * known).sum(axis=-2) / count, np.ones_like(count)], axis=-1)
    p = tall / height[..., 0] * way - (o_camera * known).sum(axis=-2) / count
    J = np.zeros((*rays.shape, 3))
    for _ in range(MOST_STEPS):
        in_front = p[..., None, :] + o_camera
        per_metre = 1 / np.maximum(in_front[..., 2:], NEAREST_M)
        flat, by_point = in_front[..., :2] * per_metre, per_metre / height
        error = (flat - rays) / height
        J[..., 0, 0] = J[..., 1, 1] = by_point[..., 0]
        J[..., 2] = -flat * by_point
        weight = known / np.sqrt(1 + (error / FITS) ** 2)  # of a loss that is quadratic first and linear then
        rows = J.reshape(*J.shape[:-3], -1, 3)
        pushed = transpose(weight.reshape(*rows.shape[:-1], 1) * rows)
        square = pushed @ rows + least_height**2 * np.eye(3)
        step = np.linalg.solve(square, pushed @ error.reshape(*rows.shape[:-1], 1))[..., 0]
        p = p - step
        if np.abs(step).max(initial=0.0) < LEAST_STEP_M:
            break
    off = np.sort(np.where(seen, np.sqrt(np.sum(error**2, axis=-1)), np.inf), axis=-1)
    middle = np.concatenate([(count - 1) // 2, count // 2], axis=-1)
    return np.take_along_axis(off, middle, axis=-1).mean(axis=-1), p


def _span(values: Array, known: np.ndarray) -> Array:
    """From the least to the greatest ``(..., c)`` of the known values ``(..., K, c)``; below nought of none."""
    return np.asarray(np.where(known, values, -np.inf).max(axis=-2) - np.where(known, values, np.inf).min(axis=-2))


def continued(
    start: TrackingStart, before: LagSmoother, cameras: Sequence[Camera], video: Sequence[VideoFrame]
) -> TrackingStart | None:
    """Where tracking goes on: the frames that ``before`` holds, not yet looked at, in the world they were tracked in.

    Bones are turned from the last found frame as their sensors were. Wearers are where the video of these frames shows
    them; without cameras they, and a camera that moves, went from there as they had been tracked.

    Args:
        start: from a calibration found in frames up to some time ago, the last of which was tracked.
        before: the smoother that has tracked since.
        cameras: all.
        video: of late.

    Returns:
        None if the video shows no wearer, though a camera was found to.
    """
    at_find = start.tracked
    assert at_find is not None
    start = _in_tracked_world(start, at_find)
    last, state = start.frames[-1], start.states[-1]
    problem, shared = start.problem, start.shared
    yaw = yaw_of(state.R_parent_child[:, 0] @ transpose(at_find.R_parent_child[:, 0]))  # of each wearer
    frames, states = [], []
    stands = start.has_views and not problem.moving
    for number in before.numbers:
        frame, tracked = before.frame(number), before.state(number)
        contacts = [
            own if len(own) == len(wearer.contacts) and not stands else np.zeros(len(wearer.contacts))
            for own, wearer in zip(frame.contacts, problem.wearers, strict=True)
        ]
        frames.append(replace(frame, views=[None] * len(problem.cameras), contacts=contacts))
        R = turned_to(problem, last, state, frame, shared)
        gone = (rotation_z(yaw) @ (tracked.p_world_pelvis - at_find.p_world_pelvis)[..., None])[..., 0]
        states.append(FrameState(R, state.p_world_pelvis + gone, *_camera(float(yaw[0]), state, at_find, tracked)))
    if start.has_views:
        placed = None
        for number, each in enumerate(start.associated):
            camera = start.with_lens(next(one for one in cameras if one.name == each.camera.name))
            own = [frame for frame in video if frame.camera == camera.name and frame.frame in before.numbers]
            placed = placed or _placed(start, states, before.numbers[0], number, camera, own)
        if placed is None:
            return None
        states = placed
    problem.begin_at(states[0].p_world_pelvis)
    return replace(start, frames=frames, states=states)


def _in_tracked_world(start: TrackingStart, at_find: FrameState) -> TrackingStart:
    """The same start with the first wearer where they were tracked to be: what is found anew has a world of its own."""
    problem, state, shared = start.problem, start.states[-1], start.shared
    if start.has_views and not all(camera.free_pose for camera in problem.cameras):
        return start
    angle = float(yaw_of(at_find.R_parent_child[0, 0] @ state.R_parent_child[0, 0].T))
    turn = rotation_z(angle)
    shift = at_find.p_world_pelvis[0] - turn @ state.p_world_pelvis[0]
    if problem.wearers[0].has_floor:
        shift[2] = 0.0  # the floor is known better than before

    def moved(p: Array) -> Array:
        return np.asarray(p @ turn.T + shift)

    def moved_frame(one: FrameState) -> FrameState:
        R = one.R_parent_child.copy()
        R[:, 0] = turn @ R[:, 0]
        return FrameState(R, moved(one.p_world_pelvis), turn @ one.R_world_camera, moved(one.p_world_camera))

    cameras = tuple(
        replace(
            camera,
            poses=CameraPoses(turn @ camera.poses.R_world_camera, moved(camera.poses.p_world_camera)),
            heading=camera.heading + angle,
        )
        for camera in shared.cameras
    )
    wearers = tuple(one.turned(angle, shift) for one in shared.wearers)
    problem.turn_headings(angle)
    return replace(
        start,
        shared=replace(shared, wearers=wearers, cameras=cameras),
        states=[moved_frame(one) for one in start.states],
    )


def _placed(
    start: TrackingStart, states: Sequence[FrameState], first: int, number: int, camera: Camera,
    video: Sequence[VideoFrame],
) -> list[FrameState] | None:  # fmt: skip
    """The frames from ``first`` on with the wearers where the camera of a number saw them; None if it saw nobody."""
    if not video:
        return None
    skeletons, standing = [wearer.skeleton for wearer in start.problem.wearers], start.shared.cameras[number].poses
    at = np.array([frame.frame - first for frame in video])
    R, p = (np.stack([getattr(states[t], name) for t in at]) for name in ("R_parent_child", "p_world_pelvis"))
    bodies = [forward_kinematics(skeleton, R[:, w], p[:, w]) for w, skeleton in enumerate(skeletons)]
    pose = [np.stack([getattr(states[t], name) for t in at]) for name in ("R_world_camera", "p_world_camera")]
    if len(standing):
        pose = [np.stack([one] * len(at)) for one in (standing.R_world_camera[0], standing.p_world_camera[0])]
    places = locate_wearers(camera, (pose[0], pose[1]), bodies, skeletons, video)
    seen, p_world_pelvis = np.isfinite(places[..., 0]), np.stack([state.p_world_pelvis for state in states])
    if not seen.any():
        return None
    for w in np.flatnonzero(seen.any(axis=0)):
        own = at[seen[:, w]]
        line = np.polyfit(own, places[seen[:, w], w], min(1, len(np.unique(own)) - 1))  # one depth is off by a tenth
        p_world_pelvis[:, w] = np.vander(np.arange(len(states)), len(line)) @ line
    return [replace(state, p_world_pelvis=p) for state, p in zip(states, p_world_pelvis, strict=True)]


def _camera(yaw: float, state: FrameState, at_find: FrameState, since: FrameState) -> tuple[Array, Array]:
    """The camera, moved in the first wearer's new world as it was in the old one; a standing one stays."""
    turn = rotation_z(yaw)
    step = since.p_world_camera - at_find.p_world_camera
    R = turn @ since.R_world_camera @ at_find.R_world_camera.T @ turn.T @ state.R_world_camera
    return np.asarray(R), np.asarray(state.p_world_camera + turn @ step)


def corrections(seconds: float, before: LagSmoother, after: LagSmoother) -> list[Finding]:
    """The bones that were shown wrong in the last frame that had no calibration of so many seconds."""
    wrong_deg = 25.0  # of a bone against the others: more than a start is usually off
    found, number = list[Finding](), before.numbers[-1]
    for old, new, R_old, R_new in zip(
        before.problem.wearers, after.problem.wearers,
        before.state(number).R_parent_child, after.state(number).R_parent_child, strict=True,
    ):  # fmt: skip
        bones = [sensor.bone for sensor in new.sensors]
        R = [
            forward_kinematics(wearer.skeleton, own[None], np.zeros((1, 3))).R_world_bone[0, bones]
            for wearer, own in ((old, R_old), (new, R_new))
        ]
        relative = R[1] @ transpose(R[0])
        turned = np.rad2deg(np.linalg.norm(log(relative @ mean_rotation(relative).T), axis=1))
        wrong = {new.frames.sensors[s]: float(turned[s]) for s in np.flatnonzero(turned > wrong_deg)}
        if wrong:
            found.append(Finding("calibration corrected", numbers=wrong, words={"seconds": f"{seconds:.0f}"}))
    return found
