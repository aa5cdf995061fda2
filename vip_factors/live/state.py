"""The variables of one frame and those that all frames share, each around a point where its coordinates are zero."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.geometry.rotations import Array
from vip_factors.problem.layout import Layout
from vip_factors.problem.state import SceneState
from vip_factors.terms.camera_pose import CameraPoses


@dataclass(frozen=True)
class FrameState:
    """What belongs to one frame.

    Attributes:
        R_parent_child: ``(W, 24, 3, 3)`` of the wearers.
        p_world_pelvis: ``(W, 3)`` metres.
        R_world_camera, p_world_camera: of the first camera, ``(3, 3)`` and ``(3,)``; a standing camera has no
            coordinates here.
    """

    R_parent_child: Array
    p_world_pelvis: Array
    R_world_camera: Array
    p_world_camera: Array


def moved_frames(layout: Layout, origins: Sequence[FrameState], static: SceneState, steps: Array) -> list[FrameState]:
    """Each of the frames at coordinates ``(n, w)`` from where these are zero."""
    moved = stacked(origins, static).retract_frames(layout, steps)
    R = np.stack([one.R_parent_child for one in moved.wearers], axis=1)
    p = np.stack([one.p_world_pelvis for one in moved.wearers], axis=1)
    poses = moved.camera.poses
    if len(static.camera.poses):  # a camera that stands still is no frame's
        camera = [(one.R_world_camera, one.p_world_camera) for one in origins]
    else:
        camera = list(zip(poses.R_world_camera, poses.p_world_camera, strict=True))
    return [FrameState(R[t], p[t], *camera[t]) for t in range(len(origins))]


def stacked(frames: Sequence[FrameState], static: SceneState) -> SceneState:
    """A stretch of frames as the state of a scene; what they share, and whether the camera moves, as in ``static``."""
    R = np.stack([frame.R_parent_child for frame in frames], axis=1)
    p = np.stack([frame.p_world_pelvis for frame in frames], axis=1)
    wearers = tuple(
        replace(one, R_parent_child=R[number], p_world_pelvis=p[number]) for number, one in enumerate(static.wearers)
    )
    camera = static.camera
    if not len(camera.poses):
        R_camera = np.stack([frame.R_world_camera for frame in frames])
        camera = replace(camera, poses=CameraPoses(R_camera, np.stack([frame.p_world_camera for frame in frames])))
    return replace(static, wearers=wearers, camera=camera)


def without_frames(state: SceneState) -> SceneState:
    """What all frames share, as a scene without any; the pose of a camera that stands still is among it."""
    none = slice(0, 0)
    return state.window(none)
