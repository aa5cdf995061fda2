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
        R_world_camera, p_world_camera: of the first camera, ``(3, 3)`` and ``(3,)``.
    """

    R_parent_child: Array
    p_world_pelvis: Array
    R_world_camera: Array
    p_world_camera: Array

    def moved(self, step: Array) -> "FrameState":
        """At coordinates ``(w,)`` from here; a camera whose pose is no variable of the frame has none."""
        wearers = len(self.p_world_pelvis)
        bodies, camera = np.split(step, [FRAME * wearers])
        bodies = bodies.reshape(wearers, FRAME)
        turns = [bodies[:, :ROOT].reshape(-1, 3)]
        if len(camera):
            turns.append(camera[None, :3])
        R = exp(np.concatenate(turns))
        joints = self.R_parent_child @ R[: wearers * JOINT_COUNT].reshape(wearers, JOINT_COUNT, 3, 3)
        p = self.p_world_pelvis + bodies[:, ROOT:]
        if not len(camera):
            return replace(self, R_parent_child=joints, p_world_pelvis=p)
        return FrameState(
            joints, p, self.R_world_camera @ R[-1], self.p_world_camera + self.R_world_camera @ camera[3:]
        )


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
