"""State: the values of all variables, as arrays."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from vip_factors.body.joint_priors import HINGE_VARIABLES
from vip_factors.body.keypoints import OFFSET_KEYPOINTS
from vip_factors.body.lengths import LENGTHS
from vip_factors.body.skeleton import JOINT_COUNT
from vip_factors.display import Summarised
from vip_factors.geometry.poses import retract_pose
from vip_factors.geometry.rotations import Array, exp, hat, rotation_z
from vip_factors.problem.layout import ROOT, Layout, Owner, OwnerId


@dataclass(frozen=True, repr=False)
class CameraPoses(Summarised):
    """Poses at ``T`` frames: ``R_world_camera`` ``(T, 3, 3)`` and ``p_world_camera`` ``(T, 3)`` in metres.

    The tangent is ``(ω, v)``, rotation first, both in the camera's axes: ``T ← T Exp(ω, v)``, that is ``R ← R Exp(ω)``
    and ``p ← p + R J_l(ω) v``, which to first order is ``p + R v``.
    """

    R_world_camera: Array
    p_world_camera: Array

    def __len__(self) -> int:
        return len(self.p_world_camera)

    def point(self, p_camera_point: Array) -> Array:
        """World positions ``(T, 3)`` of a point fixed to the camera."""
        return self.p_world_camera + self.R_world_camera @ p_camera_point

    def point_jacobian(self, p_camera_point: Array) -> Array:
        """Derivative ``(T, 3, 6)`` of :meth:`point` by the tangent."""
        R = self.R_world_camera
        return np.concatenate([-R @ hat(p_camera_point), R], axis=2)

    def shifted(self, shift: Array) -> "CameraPoses":
        """Shift by ``(3,)`` metres in the world."""
        return CameraPoses(self.R_world_camera, self.p_world_camera + shift)

    def retract(self, steps: Array) -> "CameraPoses":
        """Move by tangent steps ``(T, 6)``, as ``Pose3.retract``."""
        return CameraPoses(*retract_pose(self.R_world_camera, self.p_world_camera, steps))


@dataclass(frozen=True, repr=False)
class WearerState(Summarised):
    """Values of all variables of one wearer.

    Attributes:
        R_parent_child: ``(T, 24, 3, 3)`` joint rotations.
        p_world_pelvis: ``(T, 3)`` metres.
        headings: ``(S,)`` radians; the first ones if they drift.
        R_bone_sensor: ``(S, 3, 3)`` mountings.
        pose_mean: ``(69,)`` mean joint vector of the recording, radians.
        later_headings: ``(K − 1, S)`` radians, headings at later times; empty if they are constant.
        body: ``(B,)`` metres, changes of the skeleton's lengths.
        sensor_positions: ``(S, 3)`` metres, position of each sensor minus the declared one, bone axes.
        hinges: ``(H,)`` radians, tilts of the axes of elbows and knees, and offsets.
        sole: logarithm of the sole's thickness over the likeliest one.
    """

    R_parent_child: Array
    p_world_pelvis: Array
    headings: Array
    R_bone_sensor: Array
    pose_mean: Array
    later_headings: Array = field(default_factory=lambda: np.zeros((0, 0)))
    body: Array = field(default_factory=lambda: np.zeros(len(LENGTHS)))
    sensor_positions: Array = field(default_factory=lambda: np.zeros((0, 3)))
    hinges: Array = field(default_factory=lambda: np.zeros(HINGE_VARIABLES))
    sole: float = 0.0

    def __post_init__(self) -> None:
        if not len(self.sensor_positions):  # as declared
            object.__setattr__(self, "sensor_positions", np.zeros((len(self.headings), 3)))

    @property
    def heading_path(self) -> Array:
        """Headings ``(K, S)`` at all times."""
        return np.vstack([self.headings, self.later_headings.reshape(-1, len(self.headings))])

    def with_headings(self, count: int) -> "WearerState":
        """Repeat the first headings at ``count`` times."""
        return replace(self, later_headings=np.tile(self.headings, (max(count - 1, 0), 1)))

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.p_world_pelvis)

    def window(self, frames: slice) -> "WearerState":
        """Select consecutive frames."""
        return replace(self, R_parent_child=self.R_parent_child[frames], p_world_pelvis=self.p_world_pelvis[frames])

    def retract_frames(self, steps: Array) -> "WearerState":
        """Move poses by steps ``(T, 75)`` of joints and root; rotations on the right, as in GTSAM."""
        joints = steps[:, :ROOT].reshape(len(steps), JOINT_COUNT, 3)
        return replace(
            self,
            R_parent_child=self.R_parent_child @ exp(joints),
            p_world_pelvis=self.p_world_pelvis + steps[:, ROOT:],
        )

    def turned(self, angle: float, shift: Array | None = None) -> "WearerState":
        """Turn the world about the vertical by an angle in radians, then shift it by ``(3,)`` metres."""
        turn, R = rotation_z(angle), self.R_parent_child.copy()
        R[:, 0] = turn @ R[:, 0]
        p = self.p_world_pelvis @ turn.T + (0.0 if shift is None else shift)
        later_headings = self.later_headings + angle
        return replace(
            self, R_parent_child=R, p_world_pelvis=p, headings=self.headings + angle, later_headings=later_headings
        )


@dataclass(frozen=True, repr=False)
class CameraState(Summarised):
    """Values of a camera's variables.

    Attributes:
        poses: one for each frame, or a single one.
        heading: heading of the IMU on the camera, radians.
        R_camera_imu: ``(3, 3)`` mounting of that IMU.
        clock: seconds to add to the video's clock in the recording's middle.
        clock_drift: further seconds to add for each second from there.
        zoom: logarithm of the focal length over the nominal one.
        path_scale: logarithm of the scale of the camera's odometry.
    """

    poses: CameraPoses
    heading: float = 0.0
    R_camera_imu: Array = field(default_factory=lambda: np.eye(3))
    clock: float = 0.0
    clock_drift: float = 0.0
    zoom: float = 0.0
    path_scale: float = 0.0

    def at_frames(self, frames: slice) -> CameraPoses:
        """Poses in a stretch of frames; a single pose is repeated."""
        if len(self.poses) > 1:
            return CameraPoses(self.poses.R_world_camera[frames], self.poses.p_world_camera[frames])
        count = frames.stop - frames.start
        return CameraPoses(
            np.broadcast_to(self.poses.R_world_camera, (count, 3, 3)),
            np.broadcast_to(self.poses.p_world_camera, (count, 3)),
        )

    def window(self, frames: slice) -> "CameraState":
        """Select consecutive frames; a standing camera keeps its pose."""
        return replace(self, poses=self.at_frames(frames)) if len(self.poses) > 1 else self

    def retract_frames(self, steps: Array) -> "CameraState":
        """Move the poses by steps ``(T, 6)``."""
        return replace(self, poses=self.poses.retract(steps))


@dataclass(frozen=True)
class DetectorState:
    """Values of a detector's variables.

    Attributes:
        keypoint_offsets: ``(K, 3)`` metres, of the left side, bone axes.
    """

    keypoint_offsets: Array = field(default_factory=lambda: np.zeros((len(OFFSET_KEYPOINTS), 3)))


@dataclass(frozen=True, repr=False)
class SceneState(Summarised):
    """Values of all variables of a scene."""

    wearers: tuple[WearerState, ...]
    cameras: tuple[CameraState, ...]
    detector: DetectorState = field(default_factory=DetectorState)

    @classmethod
    def unfilmed(cls, wearers: Sequence[WearerState]) -> "SceneState":
        """Make the state of wearers without cameras."""
        return cls(tuple(wearers), ())

    def count(self, kind: Owner) -> int:
        """Number of owners of a kind."""
        return {Owner.WEARER: len(self.wearers), Owner.CAMERA: len(self.cameras)}.get(kind, 1)

    def of(self, owner: OwnerId) -> "OwnerState":
        """Values of one owner's variables."""
        match owner.kind:
            case Owner.CAMERA:
                return self.cameras[owner.number]
            case Owner.DETECTOR:
                return self.detector
        return self.wearers[owner.number]

    def window(self, frames: slice) -> "SceneState":
        """Select consecutive frames."""
        wearers = tuple(wearer.window(frames) for wearer in self.wearers)
        return SceneState(wearers, tuple(camera.window(frames) for camera in self.cameras), self.detector)

    def replaced(self, owners: Mapping[OwnerId, "OwnerState"]) -> "SceneState":
        """Replace the values of some owners."""
        wearers, cameras, detector = list(self.wearers), list(self.cameras), self.detector
        for owner, state in owners.items():
            match state:
                case WearerState():
                    wearers[owner.number] = state
                case CameraState():
                    cameras[owner.number] = state
                case DetectorState():
                    detector = state
        return SceneState(tuple(wearers), tuple(cameras), detector)

    def retract_static(self, layout: Layout, step: Array) -> "SceneState":
        """Move static variables by a step ``(s,)`` of the layout's static vector."""
        moved = {owner: dict(vars(self.of(owner))) for owner, _ in layout.owners}
        for owner, block, columns in layout.placed:
            if block.free:
                moved[owner][block.name] = block.retract(moved[owner][block.name], step[columns])
        return self.replaced({owner: type(self.of(owner))(**values) for owner, values in moved.items()})

    def retract_frames(self, layout: Layout, steps: Array) -> "SceneState":
        """Move all frames by steps ``(T, w)`` of the layout's frame vectors."""
        changed = dict[OwnerId, OwnerState]()
        for chain, columns in zip(layout.chains, layout.chain_columns, strict=True):
            state = self.of(chain.owner)
            assert not isinstance(state, DetectorState)  # it has no variables in frames
            changed[chain.owner] = state.retract_frames(steps[:, columns])
        return self.replaced(changed)


OwnerState = WearerState | CameraState | DetectorState
"""Values of one owner's variables."""


def seconds_late(offset: float, drift: float, time: Array, middle: float) -> Array:
    """Seconds to add to the video's clock at instants ``time`` of any shape."""
    return offset + drift * (time - middle)
