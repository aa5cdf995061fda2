"""A scene's GTSAM factors in the order in which a stream brings them: each with the last of the frames it touches.

It is what one would feed to GTSAM's own smoothers; they are the reference of the fixed-lag tracker.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import gtsam
import numpy as np

from vip_factors.factors.pose_prior import held_pose_prior_factor
from vip_factors.factors.rotation_prior import rotation_prior_factor
from vip_factors.graph.frame import motion_factors, pair_factors, pose_factors, static_factors
from vip_factors.graph.keys import (
    camera_heading_key,
    camera_key,
    camera_mounting_key,
    clock_key,
    frame_keys,
    heading_key,
    mounting_key,
    pose_mean_key,
)
from vip_factors.graph.scene_frame import camera_factors, camera_static_factors, view_factors
from vip_factors.graph.scene_model import SceneModel
from vip_factors.graph.scene_state import SceneState

HELD_SIGMA = 1e-4  # rad or m, of what the problem does not free: a thousandth of what anything else says of it


@dataclass(frozen=True)
class Arrival:
    """What one update brings.

    Attributes:
        newest: number of the newest frame.
        factors: that can exist now and could not before.
        values: where their new variables start.
        frames: numbers of the new variables' frames, by key.
        shared: keys of what frames share.
    """

    newest: int
    factors: gtsam.NonlinearFactorGraph
    values: gtsam.Values
    frames: dict[int, int]
    shared: tuple[int, ...]


def arrivals(model: SceneModel, state: SceneState, first: int) -> Iterator[Arrival]:
    """A scene, update by update: frames up to ``first`` at once, then each by itself.

    Headings must not walk within it. What the problem does not free is held by narrow priors; the pose prior's mean is
    no variable where it is not free.
    """
    everything = state.to_values()
    number_of = _numbers(model)
    shared = _shared(model)
    for begin, newest in [(0, first), *((t, t) for t in range(first + 1, model.frames))]:
        graph, keys = gtsam.NonlinearFactorGraph(), set[int]()
        for factor in _new(model, state, begin, newest):
            graph.push_back(factor)
            keys.update(int(key) for key in list(factor.keys()))
        frames = {key: number_of[key] for key in sorted(keys) if number_of.get(key, -1) >= begin}
        fresh = [*frames, *(shared if begin == 0 else ())]
        yield Arrival(newest, graph, everything.extract(fresh), frames, tuple(shared))


def _new(model: SceneModel, state: SceneState, begin: int, newest: int) -> Iterator[gtsam.NonlinearFactor]:
    """Factors that exist from the frames ``begin … newest`` on."""
    frames = range(begin, newest + 1)
    for number, wearer in enumerate(model.wearers):
        mean = pose_mean_key(number)
        for t in frames:
            for factor in pose_factors(wearer, t, number):
                if not wearer.free_pose_mean and mean in [int(key) for key in list(factor.keys())]:
                    factor = held_pose_prior_factor(
                        frame_keys(t, number), state.wearers[number].pose_mean, wearer.prior, wearer.settings.pose_prior
                    )
                yield factor
            yield from view_factors(model, number, t)
            if t >= 2:
                yield from motion_factors(wearer, t - 1, number)
            if t >= 1:
                yield from pair_factors(wearer, t - 1, number)
        if begin == 0:
            yield from static_factors(wearer, number)
    yield from _of_camera(model, frames)
    if begin == 0:
        yield from camera_static_factors(model)
        yield from _held(model, state)


def _of_camera(model: SceneModel, frames: range) -> Iterator[gtsam.NonlinearFactor]:
    """The camera's factors, each with its last frame."""
    number_of = _numbers(model)
    for t in range(max(0, frames.start - 1), min(frames.stop, model.frames)):
        for factor in camera_factors(model, t):
            last = max((number_of[int(key)] for key in list(factor.keys()) if int(key) in number_of), default=t)
            if last in frames:
                yield factor


def _numbers(model: SceneModel) -> dict[int, int]:
    """The frame of every variable that belongs to one."""
    found: dict[int, int] = {}
    for t in range(model.frames):
        for number in range(len(model.wearers)):
            keys = frame_keys(t, number)
            found.update(dict.fromkeys([*keys.joints.values(), keys.root], t))
        if model.camera.moving:
            found[camera_key(t)] = t
    return found


def _shared(model: SceneModel) -> list[int]:
    """Keys of what all frames share."""
    keys = []
    for number, wearer in enumerate(model.wearers):
        keys += [heading_key(s, number) for s in range(len(wearer.sensors))]
        keys += [mounting_key(s, number) for s in range(len(wearer.sensors))]
        keys += [pose_mean_key(number)] if wearer.free_pose_mean else []
    camera = model.camera
    keys += [] if camera.moving else [camera_key(0)]
    keys += [camera_heading_key(), camera_mounting_key()] if camera.imu is not None else []
    return keys + ([clock_key()] if camera.free_clock else [])


def _held(model: SceneModel, state: SceneState) -> Iterator[gtsam.NonlinearFactor]:
    """Narrow priors on what is not free."""
    one = gtsam.noiseModel.Isotropic.Sigma(1, HELD_SIGMA)
    for number, (wearer, own) in enumerate(zip(model.wearers, state.wearers, strict=True)):
        for s in range(len(wearer.sensors)):
            if not wearer.free_headings:
                yield gtsam.PriorFactorDouble(heading_key(s, number), float(own.headings[s]), one)
            if not wearer.free_mountings:
                yield rotation_prior_factor("held mounting", mounting_key(s, number), own.R_bone_sensor[s], HELD_SIGMA)
    if not model.camera.free_pose:
        poses, six = state.camera.poses, gtsam.noiseModel.Isotropic.Sigma(6, HELD_SIGMA)
        for t in range(len(poses)):
            pose = gtsam.Pose3(gtsam.Rot3(poses.R_world_camera[t]), np.asarray(poses.p_world_camera[t]))
            yield gtsam.PriorFactorPose3(camera_key(t), pose, six)
