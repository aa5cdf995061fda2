"""Tracking carried over to a calibration found anew: the frames of the lag, as the new calibration has them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vip_factors.body.kinematics import forward_kinematics
from vip_factors.geometry.rotations import Array, log, mean_rotation, rotation_z, transpose, yaw_of
from vip_factors.live.placing import places_in
from vip_factors.live.predict import turned_to
from vip_factors.live.smoother import LagSmoother
from vip_factors.live.start import Started
from vip_factors.live.state import FrameState
from vip_factors.sensors.live import LiveCamera, VideoFrame

WRONG_DEG = 25.0  # of a bone against the others: more than a start is usually off


def continued(
    found: Started, at_find: FrameState, before: LagSmoother, cameras: Sequence[LiveCamera],
    video: Sequence[tuple[int, VideoFrame]],
) -> Started | None:  # fmt: skip
    """Where tracking goes on: the frames that ``before`` holds, not yet looked at, in the world that was ``found``.

    Bones are turned from the last found frame as their sensors were. Wearers are where the video of these frames shows
    them; without cameras they, and a camera that moves, went from there as they had been tracked.

    Args:
        found: from frames up to some time ago.
        at_find: the last of those frames as it was tracked.
        before: the smoother that has tracked since.
        cameras: all.
        video: of late, each frame with its number.

    Returns:
        None if the video shows no wearer, though a camera was found to.
    """
    last, state = found.frames[-1], found.states[-1]
    problem, shared = found.problem, found.shared
    yaw = yaw_of(state.R_parent_child[:, 0] @ transpose(at_find.R_parent_child[:, 0]))  # of each wearer
    frames, states = [], []
    for number in before.numbers:
        frame, tracked = before.frame(number), before.state(number)
        contacts = [np.zeros(len(wearer.contacts)) for wearer in problem.wearers]
        frames.append(replace(frame, views=[None] * (1 + len(problem.further)), contacts=contacts))
        R = turned_to(problem, last, state, frame, shared)
        gone = (rotation_z(yaw) @ (tracked.p_world_pelvis - at_find.p_world_pelvis)[..., None])[..., 0]
        states.append(FrameState(R, state.p_world_pelvis + gone, *_camera(float(yaw[0]), state, at_find, tracked)))
    if found.filmed:
        camera = next(one for one in cameras if one.name == found.associated[0].camera.name)
        own = [(number, one) for number, one in video if one.camera == camera.name and number in before.numbers]
        placed = _placed(found, states, before.numbers[0], camera, own)
        if placed is None:
            return None
        states = placed
    problem.begin_at(states[0].p_world_pelvis)
    return replace(found, frames=frames, states=states)


def _placed(
    found: Started, states: Sequence[FrameState], first: int, camera: LiveCamera,
    video: Sequence[tuple[int, VideoFrame]],
) -> list[FrameState] | None:  # fmt: skip
    """The frames from ``first`` on with the wearers where the camera saw them; None if it did not see any."""
    skeletons = [wearer.skeleton for wearer in found.problem.wearers]
    standing = found.shared.camera.poses
    seen: list[list[tuple[int, Array]]] = [[] for _ in skeletons]
    for number, one in video:
        state = states[number - first]
        pose = state.R_world_camera, state.p_world_camera
        if len(standing):
            pose = standing.R_world_camera[0], standing.p_world_camera[0]
        bodies = [
            forward_kinematics(skeleton, state.R_parent_child[w : w + 1], state.p_world_pelvis[w : w + 1])
            for w, skeleton in enumerate(skeletons)
        ]
        for places, p in zip(seen, places_in(camera, pose, bodies, skeletons, one), strict=True):
            if p is not None:
                places.append((number - first, p))
    if not any(seen):
        return None
    p_world_pelvis = np.stack([state.p_world_pelvis for state in states])
    for w, places in enumerate(seen):
        if places:
            at, p = np.array([t for t, _ in places]), np.stack([one for _, one in places])
            line = np.polyfit(at, p, min(1, len(np.unique(at)) - 1))  # one frame's depth is off by a tenth
            p_world_pelvis[:, w] = np.stack([np.polyval(line[:, axis], np.arange(len(states))) for axis in range(3)], 1)
    return [replace(state, p_world_pelvis=p) for state, p in zip(states, p_world_pelvis, strict=True)]


def _camera(yaw: float, state: FrameState, at_find: FrameState, tracked: FrameState) -> tuple[Array, Array]:
    """The camera, moved in the first wearer's new world as it was in the old one; a standing one stays."""
    turn = rotation_z(yaw)
    step = tracked.p_world_camera - at_find.p_world_camera
    R = turn @ tracked.R_world_camera @ at_find.R_world_camera.T @ turn.T @ state.R_world_camera
    return np.asarray(R), np.asarray(state.p_world_camera + turn @ step)


def corrections(before: LagSmoother, after: LagSmoother, seconds: float) -> list[str]:
    """Sentences on the bones that were shown wrong until now."""
    found, number = list[str](), after.numbers[-1]
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
        wrong = [f"'{new.frames.sensors[s]}' by {turned[s]:.0f}°" for s in np.flatnonzero(turned > WRONG_DEG)]
        if wrong:
            found.append(
                f"{seconds:.0f} s of data show what less could not: until now the bones of {', '.join(wrong)} were "
                "turned wrong"
            )
    return found
