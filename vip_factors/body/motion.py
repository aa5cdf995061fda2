"""A motion: the joint rotations and root path of one person over evenly spaced frames."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vip_factors.body.kinematics import BodyState, forward_kinematics
from vip_factors.body.skeleton import JOINT_COUNT, Skeleton
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array

FASTEST_HZ = 1e6  # what is faster than a million frames a second is a mistake of units
FARTHEST_M = 1e8  # nobody is farther from the origin than the Earth is wide, and its square is still a number


@dataclass(frozen=True)
class Motion:
    """Poses of one person at a constant rate, in a world with Z up.

    Attributes:
        skeleton: the person's bones.
        R_parent_child: ``(T, 24, 3, 3)`` joint rotations; joint 0 is ``R_world_pelvis``.
        p_world_pelvis: ``(T, 3)`` metres.
        rate: frames per second.
        start: time of the first frame in seconds from the recording's start.
        name: who or what this is.
    """

    skeleton: Skeleton
    R_parent_child: Array
    p_world_pelvis: Array
    rate: float
    start: float = 0.0
    name: str = "motion"

    def __post_init__(self) -> None:
        T = len(self.p_world_pelvis)
        if self.R_parent_child.shape != (T, JOINT_COUNT, 3, 3) or self.p_world_pelvis.shape != (T, 3):
            raise InputError(
                f"motion '{self.name}': rotations {self.R_parent_child.shape} and root {self.p_world_pelvis.shape}: "
                "expected (T, 24, 3, 3) and (T, 3)"
            )
        if not 0 < self.rate <= FASTEST_HZ:
            raise InputError(f"motion '{self.name}': rate {self.rate} Hz: expected a positive number")
        sound = np.isfinite(self.R_parent_child).all(axis=(1, 2, 3)) & (np.abs(self.p_world_pelvis) < FARTHEST_M).all(1)
        if not np.all(sound):
            at = int(np.argmin(sound))
            raise InputError(
                f"motion '{self.name}': frame {at} is not finite (root at {self.p_world_pelvis[at]} m): "
                "expected rotations and positions of a body"
            )

    def __len__(self) -> int:
        return len(self.p_world_pelvis)

    @property
    def time(self) -> Array:
        """Time of each frame ``(T,)`` in seconds from the recording's start."""
        return self.start + np.arange(len(self)) / self.rate

    @cached_property
    def state(self) -> BodyState:
        """World poses of all bones in all frames."""
        return forward_kinematics(self.skeleton, self.R_parent_child, self.p_world_pelvis)

    def frames(self, selection: slice) -> "Motion":
        """The motion at some of its frames; a step in the slice lowers the rate."""
        first, _, step = selection.indices(len(self))
        return Motion(
            self.skeleton,
            self.R_parent_child[selection],
            self.p_world_pelvis[selection],
            self.rate / step,
            self.start + first / self.rate,
            self.name,
        )
