"""Least-squares problem of one wearer: measurements, body, priors and settings."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from vip_factors.body.joint_priors import HingePrior, JointLimits, PosePrior
from vip_factors.body.kinematics import BodyState
from vip_factors.body.lengths import BodyVariation
from vip_factors.body.skeleton import HeldPose, Skeleton
from vip_factors.display import Summarised
from vip_factors.factor_settings import FactorSettings
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.frames import ImuFrames


@dataclass(frozen=True)
class BodyPoint:
    """Point fixed to a bone: ``p_bone_point`` ``(3,)`` metres, bone axes."""

    bone: int
    p_bone_point: Array

    def of(self, body: BodyState) -> Array:
        """World positions ``(T, 3)`` of the point, metres."""
        return body.point(self.bone, self.p_bone_point)


@dataclass(frozen=True)
class BodyPoints:
    """Points on the body, as arrays: their ``bones``, and ``p_bone_point`` ``(n, 3)`` metres."""

    bones: tuple[int, ...]
    p_bone_point: Array

    @classmethod
    def of(cls, points: Sequence[BodyPoint]) -> "BodyPoints":
        """Make arrays of points."""
        p = np.array([point.p_bone_point for point in points]).reshape(-1, 3)
        return cls(tuple(point.bone for point in points), p)

    def on(self, body: BodyState) -> Array:
        """World positions ``(T, n, 3)``."""
        return body.points(np.array(self.bones, dtype=int), self.p_bone_point)


def sole_shift(thickness: float) -> Array:
    """Vector ``(3,)`` from the foot's skin to the underside of the sole, metres, bone axes."""
    return np.array([0.0, -thickness, 0.0])


@dataclass(frozen=True, repr=False)
class InitialPose(Summarised):
    """Declared pose in the first ``frames``; the root's heading is free. ``passed`` of these precede the stretch."""

    pose: HeldPose
    frames: int
    passed: int = 0

    @property
    def left(self) -> int:
        """Number of frames of the stretch in which the pose is held."""
        return max(self.frames - self.passed, 0)


@dataclass(frozen=True, repr=False)
class WearerProblem(Summarised):
    """Least-squares problem of one wearer.

    Attributes:
        name: name of the wearer.
        skeleton, prior, limits: the body, its pose prior and joint limits.
        frames: the measurements.
        sensors: ``S`` sensor positions, in the order of ``frames.sensors``.
        prior_headings, heading_sigma: ``(S,)`` radians; of the first headings if they drift.
        prior_R_bone_sensor: ``(S, 3, 3)``.
        mounting_sigma: ``(S,)`` radians.
        settings: settings of the terms.
        p_world_start: root position of the first frame, metres; or ``(N, 3)``, of the first frame of each stretch.
        initial_pose: declared pose, or None.
        contacts: points of the feet that may bear the body.
        contact_confidence: ``(T, C)`` in [0, 1], that each contact holds from its frame to the next.
        use_acceleration: False without acceleration, contact and gauge factors: frames are independent (IT, SOP).
        free_headings, free_mountings, free_pose_mean, free_body, free_hinges, free_places, free_sole: True for
            variables, False for constants.
        gauge_sensor: sensor whose heading defines the world's.
        is_gauge: True if this wearer's first root position and gauge heading define the world. A drifting gauge heading
            is fixed in the first frame only.
        is_beginning: False for a later stretch of a recording, without priors on static variables and the first root
            position.
        variation: prior over changes of the skeleton; None if it is exact.
        hinge_prior: prior on the axes of elbows and knees.
        heading_times: ``(K,)`` seconds of the headings: frames have the nearest one. Headings are constant if there is
            one or none.
        heading_drift_deg: ``(S,)`` drift of the headings, degrees per √minute; empty if unknown.
        restarts: ``(P, 2)`` seconds of pauses after which headings are new; they change in the middle of each.
    """

    skeleton: Skeleton
    prior: PosePrior
    limits: JointLimits
    frames: ImuFrames
    sensors: tuple[BodyPoint, ...]
    prior_headings: Array
    heading_sigma: Array
    prior_R_bone_sensor: Array
    mounting_sigma: Array
    settings: FactorSettings
    p_world_start: Array = field(default_factory=lambda: np.zeros(3))
    initial_pose: InitialPose | None = None
    contacts: tuple[BodyPoint, ...] = ()
    contact_confidence: Array = field(default_factory=lambda: np.zeros((0, 0)))
    use_acceleration: bool = True
    free_headings: bool = False
    free_mountings: bool = False
    free_pose_mean: bool = False
    gauge_sensor: int = 0
    is_gauge: bool = True
    is_beginning: bool = True
    heading_times: Array = field(default_factory=lambda: np.zeros(0))
    heading_drift_deg: Array = field(default_factory=lambda: np.zeros(0))
    restarts: Array = field(default_factory=lambda: np.zeros((0, 2)))
    variation: BodyVariation | None = None
    free_body: bool = False
    free_hinges: bool = False
    hinge_prior: HingePrior = field(default_factory=HingePrior)
    free_places: bool = False
    free_sole: bool = False
    name: str = "wearer"

    @cached_property
    def sensor_points(self) -> BodyPoints:
        """Sensor positions on the bones, as arrays."""
        return BodyPoints.of(self.sensors)

    @cached_property
    def contact_points(self) -> BodyPoints:
        """Contact points of the feet, as arrays."""
        return BodyPoints.of(self.contacts)

    @property
    def frame_share(self) -> float:
        """Scale of one frame's information: its share of a correlation time, at most 1."""
        return float(min(1.0, self.frames.step / self.settings.correlation_s))

    @property
    def body_moves(self) -> bool:
        """True if the body's lengths are variables."""
        return self.free_body and self.variation is not None

    def skeleton_at(self, lengths: Array) -> Skeleton:
        """Change the skeleton by ``(B,)`` metres."""
        if self.variation is None or not np.any(lengths):
            return self.skeleton
        return self.variation.varied(self.skeleton, lengths)

    def with_body(self, lengths: Array) -> "WearerProblem":
        """Change the body by ``(B,)`` metres; further changes are relative to the new body."""
        if self.variation is None or not np.any(lengths):
            return self
        points = self.sensor_points
        shift = self.variation.of_points(self.skeleton, points.bones, points.p_bone_point) @ lengths
        sensors = tuple(BodyPoint(bone, p) for bone, p in zip(points.bones, points.p_bone_point + shift, strict=True))
        return replace(
            self, skeleton=self.skeleton_at(lengths), variation=self.variation.about(lengths), sensors=sensors
        )

    def window(self, frames: slice) -> "WearerProblem":
        """Select consecutive frames; priors belong to the recording's first frame."""
        pose, starts = self.initial_pose, self.p_world_start
        if starts.ndim > 1:
            begins = self.frames.beginnings
            starts = starts[(begins >= frames.start) & (begins < frames.stop)]
        return replace(
            self,
            frames=self.frames.window(frames),
            p_world_start=starts,
            contact_confidence=self.contact_confidence[frames],
            initial_pose=None if pose is None else replace(pose, passed=pose.passed + frames.start),
            is_beginning=self.is_beginning and frames.start == 0,
        )

    @property
    def placed_starts(self) -> list[tuple[int, Array]]:
        """Frames with a chosen root position, and the positions ``(3,)``: of the beginning, or of each stretch."""
        if self.p_world_start.ndim == 1:
            return [(0, self.p_world_start)] if self.is_beginning else []
        frames = self.frames.beginnings.tolist()
        return list(zip(frames[len(frames) - len(self.p_world_start) :], self.p_world_start, strict=True))

    @property
    def has_floor(self) -> bool:
        """True if contacts are on the floor at z = 0; roots of independent frames are free."""
        return self.use_acceleration and self.settings.floor_contact.use

    @property
    def headings_drift(self) -> bool:
        """True if headings change with time."""
        return len(self.heading_times) > 1

    def heading_numbers(self, frames: slice = slice(None)) -> np.ndarray:
        """Index ``(t,)`` of each frame's heading among the ``K``: the nearest one on its side of a pause."""
        between = (self.heading_times[1:] + self.heading_times[:-1]) / 2
        between[self.restart_steps] = self.restarts.mean(axis=1)
        return np.searchsorted(between, self.frames.time[frames], side="right")

    @property
    def restart_steps(self) -> np.ndarray:
        """Indices ``(P,)`` of the steps at which headings are new."""
        return np.searchsorted(self.heading_times, self.restarts.mean(axis=1)) - 1
