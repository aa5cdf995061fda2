"""The variables of one frame and those that all frames share, each around a point where its coordinates are zero."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.body.skeleton import JOINT_COUNT
from vip_factors.factors.camera_pose import CameraPoses
from vip_factors.geometry.rotations import Array, exp
from vip_factors.graph.scene_state import CameraState, SceneState
from vip_factors.graph.state import GraphState
from vip_factors.graph.terms import FRAME, ROOT


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


def moved_frames(origins: Sequence[FrameState], steps: Array) -> list[FrameState]:
    """Each of the frames at coordinates ``(n, w)``; all at once, for the arithmetic is small and the calls are not."""
    wearers, n = len(origins[0].p_world_pelvis), len(origins)
    bodies, camera = steps[:, : FRAME * wearers].reshape(n, wearers, FRAME), steps[:, FRAME * wearers :]
    turns = [bodies[:, :, :ROOT].reshape(n, -1, 3)]
    if camera.shape[1]:
        turns.append(camera[:, None, :3])
    R = exp(np.concatenate(turns, axis=1))
    joints = np.stack([one.R_parent_child for one in origins])
    joints = joints @ R[:, : wearers * JOINT_COUNT].reshape(joints.shape)
    p = np.stack([one.p_world_pelvis for one in origins]) + bodies[:, :, ROOT:]
    R_camera = np.stack([one.R_world_camera for one in origins])
    p_camera = np.stack([one.p_world_camera for one in origins])
    if camera.shape[1]:
        p_camera = p_camera + (R_camera @ camera[:, 3:, None])[..., 0]
        R_camera = R_camera @ R[:, -1]
    return [FrameState(*parts) for parts in zip(joints, p, R_camera, p_camera, strict=True)]


@dataclass(frozen=True)
class SharedState:
    """What all frames share.

    Attributes:
        headings: of each wearer's sensors ``(S,)`` radians.
        R_bone_sensor: of each wearer's sensors ``(S, 3, 3)``.
        camera: a standing camera's pose (of a moving one the pose is not used), its IMU's heading and mounting.
    """

    headings: tuple[Array, ...]
    R_bone_sensor: tuple[Array, ...]
    camera: CameraState


@dataclass(frozen=True)
class SharedColumns:
    """Where each shared variable has its coordinates: indices into ``(s,)``, empty where it is not free.

    Attributes:
        headings, mountings: of each wearer: ``(S,)`` and ``(S, 3)``.
        camera: ``(11,)`` of the camera's tangent; −1 where it is not free.
    """

    headings: tuple[np.ndarray, ...]
    mountings: tuple[np.ndarray, ...]
    camera: np.ndarray

    def moved(self, shared: SharedState, step: Array) -> SharedState:
        """The shared variables at coordinates ``(s,)`` from a point."""
        headings, mountings = [], []
        for own, R, h, m in zip(shared.headings, shared.R_bone_sensor, self.headings, self.mountings, strict=True):
            headings.append(own + step[h] if len(h) else own)
            mountings.append(R @ exp(step[m]) if len(m) else R)
        tangent = np.where(self.camera >= 0, step[np.maximum(self.camera, 0)] if len(step) else 0.0, 0.0)
        camera, poses = shared.camera, shared.camera.poses
        R_camera = poses.R_world_camera @ exp(tangent[None, :3])
        p = poses.p_world_camera + (poses.R_world_camera @ tangent[3:6])
        moved = replace(camera.retract(np.zeros((len(poses), 6)), tangent), poses=CameraPoses(R_camera, p))
        return SharedState(tuple(headings), tuple(mountings), moved)


def stacked(frames: Sequence[FrameState], shared: SharedState, moving: bool, pose_mean: Array) -> SceneState:
    """A stretch of frames as the state of a scene; ``pose_mean`` ``(69,)`` of the prior."""
    R = np.stack([frame.R_parent_child for frame in frames], axis=1)
    p = np.stack([frame.p_world_pelvis for frame in frames], axis=1)
    wearers = tuple(
        GraphState(R[number], p[number], headings, mountings, pose_mean)
        for number, (headings, mountings) in enumerate(zip(shared.headings, shared.R_bone_sensor, strict=True))
    )
    camera = shared.camera
    if moving:
        R_camera = np.stack([frame.R_world_camera for frame in frames])
        camera = replace(camera, poses=CameraPoses(R_camera, np.stack([frame.p_world_camera for frame in frames])))
    return SceneState(wearers, camera)
