"""Motions (joint rotations and root path), forward kinematics and Jacobians of points on bones, for all frames at once.

Rotations are perturbed on the right, ``R_parent_child ← R_parent_child Exp(δ)``, as the graph's variables are.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vip_factors.body.skeleton import JOINT_COUNT, PARENTS, Skeleton, ancestors
from vip_factors.compiled import Kernels, kernels
from vip_factors.display import Summarised
from vip_factors.errors import InputError
from vip_factors.geometry.quaternions import interpolate_points, interpolate_rotations
from vip_factors.geometry.rotations import Array, hat, transpose

# Bones (columns) that each joint (row) moves; the last row is the root's translation, which moves all.
MOVES = np.ones((JOINT_COUNT + 1, JOINT_COUNT))
for _bone in range(JOINT_COUNT):
    MOVES[:JOINT_COUNT, _bone] = np.isin(np.arange(JOINT_COUNT), ancestors(_bone))


_PARENTS = np.array(PARENTS)


@dataclass(frozen=True)
class BodyState:
    """World poses of all bones in ``T`` frames: rotations ``(T, 24, 3, 3)``, joints ``(T, 24, 3)`` in metres."""

    R_world_bone: Array
    p_world_joint: Array

    def at(self, frames: slice) -> "BodyState":
        """Select a stretch of frames; all frames return this object with its cached properties."""
        if frames.start == 0 and frames.stop >= len(self.p_world_joint):
            return self
        return BodyState(self.R_world_bone[frames], self.p_world_joint[frames])

    def point(self, bone: int, p_bone_point: Array) -> Array:
        """World positions ``(T, 3)`` of a point fixed to a bone (``p_bone_point`` in metres, bone axes)."""
        return self.p_world_joint[:, bone] + self.R_world_bone[:, bone] @ p_bone_point

    def points(self, bones: np.ndarray, p_bone_point: Array, kernels: Kernels = kernels) -> Array:
        """World positions ``(T, n, 3)`` of points fixed to bones ``(n,)``, ``(n, 3)`` metres in their bones' axes."""
        if kernels is not None:
            p_world_point = np.empty((len(self.p_world_joint), len(bones), 3))
            kernels.points(self.R_world_bone, self.p_world_joint, bones, p_bone_point, p_world_point)
            return p_world_point
        return self.p_world_joint[:, bones] + (self.R_world_bone[:, bones] @ p_bone_point[..., None])[..., 0]

    def joints_by_offsets(self, directions: Array) -> Array:
        """Derivatives ``(T, 24, 3, B)`` of joints by changes of offsets along ``directions`` ``(24, 3, B)``."""
        moved = self.R_world_bone[:, PARENTS] @ directions  # the root's direction is zero
        return (MOVES[:-1].T @ moved.reshape(len(moved), JOINT_COUNT, -1)).reshape(moved.shape)

    @cached_property
    def screws(self) -> Array:
        """Twists ``(T, 25, 6, 3)`` of the bones beyond each joint by the joint's perturbation.

        A twist is the angular velocity, then the velocity of the point at the root's position, in world axes. The last
        of the 25 is the root's translation.
        """
        return joint_screws(self.R_world_bone, self.p_world_joint)

    def point_twists(self, p_world_point: Array) -> Array:
        """Derivatives ``(T, n, 3, 6)`` of points ``(T, n, 3)`` by the twists of their bones."""
        return twists_at(p_world_point - self.p_world_joint[:, :1])


def joint_screws(R_world_bone: Array, p_world_joint: Array, kernels: Kernels = kernels) -> Array:
    """:attr:`BodyState.screws` of bones ``(T, 24, 3, 3)`` and joints ``(T, 24, 3)``."""
    screws = np.zeros((len(R_world_bone), JOINT_COUNT + 1, 6, 3))
    if kernels is not None:
        kernels.screws(R_world_bone, p_world_joint, screws)
        return screws
    screws[:, :-1, :3] = R_world_bone
    screws[:, :-1, 3:] = hat(p_world_joint - p_world_joint[:, :1]) @ R_world_bone
    screws[:, -1, 3:] = np.eye(3)
    return screws


def twists_at(arms: Array) -> Array:
    """Derivatives ``(..., 3, 6)`` of points at ``arms`` ``(..., 3)`` from the root by the twists of their bones.

    A twist ``(ω, v)`` moves a point by ``ω × arm + v``.
    """
    return np.concatenate([hat(-arms), np.broadcast_to(np.eye(3), (*arms.shape, 3))], axis=-1)


def forward_kinematics(
    skeleton: Skeleton, R_parent_child: Array, p_world_pelvis: Array, kernels: Kernels = kernels
) -> BodyState:
    """Compute world poses of all bones.

    Args:
        skeleton: offsets of the joints.
        R_parent_child: ``(T, 24, 3, 3)`` joint rotations; joint 0 is ``R_world_pelvis``.
        p_world_pelvis: ``(T, 3)`` metres.
        kernels: compiled kernels, or None for NumPy.
    """
    if kernels is not None:
        R_world_bone, p_world_joint = np.empty(R_parent_child.shape), np.empty(R_parent_child.shape[:-1])
        kernels.forward_kinematics(
            R_parent_child, skeleton.p_parent_joint, p_world_pelvis, _PARENTS, R_world_bone, p_world_joint
        )
        return BodyState(R_world_bone, p_world_joint)
    R_world_bone = np.empty_like(R_parent_child)
    R_world_bone[:, 0] = R_parent_child[:, 0]
    for joint, parent in enumerate(PARENTS[1:], start=1):
        R_world_bone[:, joint] = R_world_bone[:, parent] @ R_parent_child[:, joint]
    bones = np.empty(R_parent_child.shape[:-1])  # from each joint's parent to the joint, world axes
    bones[:, 0] = p_world_pelvis
    bones[:, 1:] = (R_world_bone[:, PARENTS[1:]] @ skeleton.p_parent_joint[1:, :, None])[..., 0]
    return BodyState(R_world_bone, MOVES[:-1].T @ bones)


def local_rotations(R_world_bone: Array) -> Array:
    """Joint rotations ``(..., 24, 3, 3)`` from world bone rotations ``(..., 24, 3, 3)``; joint 0 is unchanged."""
    R_parent_child = R_world_bone.copy()
    R_parent_child[..., 1:, :, :] = transpose(R_world_bone[..., _PARENTS[1:], :, :]) @ R_world_bone[..., 1:, :, :]
    return R_parent_child


FARTHEST_M = 1e8  # larger coordinates are errors; squares stay finite


@dataclass(frozen=True, repr=False)
class Motion(Summarised):
    """Poses of one person at a constant rate, in a world with Z up.

    Attributes:
        skeleton: the person's bones.
        R_parent_child: ``(T, 24, 3, 3)`` joint rotations; joint 0 is ``R_world_pelvis``.
        p_world_pelvis: ``(T, 3)`` metres.
        rate: frames per second.
        start: time of the first frame in seconds from the recording's start.
        name: of the motion.
    """

    skeleton: Skeleton
    R_parent_child: Array
    p_world_pelvis: Array
    rate: float
    start: float = 0.0
    name: str = "motion"

    def __post_init__(self) -> None:
        fastest_hz = 1e6  # higher rates are errors of units
        T = len(self.p_world_pelvis)
        if self.R_parent_child.shape != (T, JOINT_COUNT, 3, 3) or self.p_world_pelvis.shape != (T, 3):
            raise InputError(
                f"motion '{self.name}': rotations {self.R_parent_child.shape} and root {self.p_world_pelvis.shape}: "
                "expected (T, 24, 3, 3) and (T, 3)"
            )
        if not 0 < self.rate <= fastest_hz:
            raise InputError(f"motion '{self.name}': rate {self.rate} Hz: expected a positive number")
        sound = np.isfinite(self.R_parent_child).all(axis=(1, 2, 3)) & (np.abs(self.p_world_pelvis) < FARTHEST_M).all(1)
        if not np.all(sound):
            frame = int(np.argmin(sound))
            raise InputError(
                f"motion '{self.name}': frame {frame} is not finite (root at {self.p_world_pelvis[frame]} m): "
                "expected rotations and positions of a body"
            )

    def __len__(self) -> int:
        return len(self.p_world_pelvis)

    def summary(self) -> list[str]:
        """Describe duration and body, line by line."""
        frames = f"frames: {len(self)} at {self.rate:g} Hz, from {self.start:.2f} s on"
        return [f"motion '{self.name}'", frames, f"body: {self.skeleton.source}"]

    @property
    def time(self) -> Array:
        """Time of each frame ``(T,)`` in seconds from the recording's start."""
        return self.start + np.arange(len(self)) / self.rate

    def poses_at(self, time: Array) -> tuple[Array, Array]:
        """Joint rotations ``(N, 24, 3, 3)`` by slerp and roots ``(N, 3)`` linearly at instants ``(N,)`` in seconds.

        Instants outside the motion take the nearest end.
        """
        R = [interpolate_rotations(self.time, R_joint, time) for R_joint in self.R_parent_child.swapaxes(0, 1)]
        return np.stack(R, axis=1), interpolate_points(self.time, self.p_world_pelvis, time)

    @cached_property
    def state(self) -> BodyState:
        """World poses of all bones in all frames."""
        return forward_kinematics(self.skeleton, self.R_parent_child, self.p_world_pelvis)

    def frames(self, selection: slice) -> "Motion":
        """Select frames; a step in the slice lowers the rate."""
        first_frame, _, step = selection.indices(len(self))
        R, p = self.R_parent_child[selection], self.p_world_pelvis[selection]
        start = self.start + first_frame / self.rate
        return Motion(self.skeleton, R, p, self.rate / step, start, self.name)
