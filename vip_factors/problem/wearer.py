"""Everything that defines one wearer's cost: measurements, body, priors and settings."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from vip_factors.body.hinges import HingePrior
from vip_factors.body.kinematics import BodyState
from vip_factors.body.lengths import BodyVariation
from vip_factors.body.pose_prior import JointLimits, PosePrior
from vip_factors.body.skeleton import HeldPose, Skeleton
from vip_factors.display import Summarised
from vip_factors.factor_settings import FactorSettings
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.frames import ImuFrames


@dataclass(frozen=True)
class BodyPoint:
    """A point fixed to a bone."""

    bone: int
    p_bone_point: Array

    def of(self, body: BodyState) -> Array:
        """World positions ``(T, 3)``."""
        return body.point(self.bone, self.p_bone_point)


@dataclass(frozen=True)
class BodyPoints:
    """Points on the body, as arrays: ``bones`` they are on, and ``p_bone_point`` ``(n, 3)`` metres."""

    bones: tuple[int, ...]
    p_bone_point: Array

    @classmethod
    def of(cls, points: Sequence[BodyPoint]) -> "BodyPoints":
        """The same points."""
        p = np.array([point.p_bone_point for point in points]).reshape(-1, 3)
        return cls(tuple(point.bone for point in points), p)

    def on(self, body: BodyState) -> Array:
        """World positions ``(T, n, 3)``."""
        return body.points(np.array(self.bones, dtype=int), self.p_bone_point)


def sole_shift(thickness: float) -> Array:
    """From the foot's skin to what touches the ground, ``(3,)`` metres in bone axes: at rest down."""
    return np.array([0.0, -thickness, 0.0])


@dataclass(frozen=True, repr=False)
class InitialPose(Summarised):
    """A declared pose over the first ``frames``; the root's heading is free.

    Of a stretch of something longer, ``passed`` frames are before it.
    """

    pose: HeldPose
    frames: int
    passed: int = 0

    @property
    def left(self) -> int:
        """How many frames of this stretch it is held in."""
        return max(self.frames - self.passed, 0)


@dataclass(frozen=True, repr=False)
class WearerProblem(Summarised):
    """One wearer's least-squares problem.

    Attributes:
        name: the wearer's.
        skeleton, prior, limits: the body.
        frames: the measurements.
        sensors: ``S`` points where the sensors sit, in the order of ``frames.sensors``.
        prior_headings, heading_sigma: ``(S,)`` radians; at first, where headings drift.
        prior_R_bone_sensor: ``(S, 3, 3)``.
        mounting_sigma: ``(S,)`` radians.
        settings: of the terms.
        p_world_start: root position of the first frame, metres; or ``(N, 3)``, of the first frame of each stretch.
        initial_pose: declared by the wearer, or None.
        contacts: points of the feet that may bear the body.
        contact_confidence: ``(T, C)`` in [0, 1], whether each contact holds from its frame to the next.
        use_acceleration: False leaves acceleration, contact and gauge factors out: frames decouple (IT, SOP).
        free_headings, free_mountings, free_pose_mean: whether those variables move.
        gauge_sensor: whose heading defines the world's.
        is_gauge: whether this wearer's first root position and gauge heading define the world. Where headings drift,
            the gauge sensor's is pinned at first only: what it drifts shows against a camera that stands, and without
            one it stays as the walk's prior has it.
        is_beginning: False for a stretch of something longer, whose beginning holds the priors on what all frames
            share and on the first root position.
        variation: how the skeleton may change, and how likely; None of a body that is known.
        free_body: whether it does.
        free_hinges: whether the axes of elbows and knees are variables.
        hinge_prior: what is likely of those.
        free_places: whether the sensors' places on their bones are variables.
        free_sole: whether the sole's thickness is a variable.
        heading_times: ``(K,)`` seconds around which headings are the same: frames have those of the nearest, and they
            step half-way between; one or none: constant.
        heading_drift_deg: ``(S,)`` degrees per √minute by which headings drift; empty before anything shows it.
        restarts: ``(P, 2)`` seconds of pauses over which they begin anew: they step in the middle of each.
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
        """Where the sensors sit, as arrays."""
        return BodyPoints.of(self.sensors)

    @cached_property
    def contact_points(self) -> BodyPoints:
        """The contacts, as arrays."""
        return BodyPoints.of(self.contacts)

    @property
    def frame_share(self) -> float:
        """What a frame counts: its share of a correlation time."""
        return float(min(1.0, self.frames.step / self.settings.correlation_s))

    @property
    def body_moves(self) -> bool:
        """Whether lengths are variables."""
        return self.free_body and self.variation is not None

    def skeleton_at(self, lengths: Array) -> Skeleton:
        """The skeleton, changed by ``(B,)`` metres."""
        if self.variation is None or not np.any(lengths):
            return self.skeleton
        return self.variation.varied(self.skeleton, lengths)

    def with_body(self, lengths: Array) -> "WearerProblem":
        """The problem of the body changed by ``(B,)`` metres: what is left to change starts from there."""
        if self.variation is None or not np.any(lengths):
            return self
        points = self.sensor_points
        shift = self.variation.of_points(self.skeleton, points.bones, points.p_bone_point) @ lengths
        sensors = tuple(BodyPoint(bone, p) for bone, p in zip(points.bones, points.p_bone_point + shift, strict=True))
        return replace(
            self, skeleton=self.skeleton_at(lengths), variation=self.variation.about(lengths), sensors=sensors
        )

    def window(self, frames: slice) -> "WearerProblem":
        """The problem of some consecutive frames; its priors are those of the first frame."""
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
        """The frames whose root positions are chosen, and these ``(3,)``: of the whole's beginning, or of each stretch.

        A part of several stretches may begin within one: it has the positions of those that begin in it.
        """
        if self.p_world_start.ndim == 1:
            return [(0, self.p_world_start)] if self.is_beginning else []
        frames = self.frames.beginnings.tolist()
        return list(zip(frames[len(frames) - len(self.p_world_start) :], self.p_world_start, strict=True))

    @property
    def has_floor(self) -> bool:
        """Whether contacts stand on the floor at z = 0; where frames are independent, roots are free."""
        return self.use_acceleration and self.settings.floor_contact.use

    @property
    def headings_drift(self) -> bool:
        """Whether headings change with time."""
        return len(self.heading_times) > 1

    def heading_numbers(self, frames: slice = slice(None)) -> np.ndarray:
        """Which of the ``K`` headings frames have, ``(t,)``: the nearest one on their side of a pause."""
        between = (self.heading_times[1:] + self.heading_times[:-1]) / 2
        between[self.restart_steps] = self.restarts.mean(axis=1)
        return np.searchsorted(between, self.frames.time[frames], side="right")

    @property
    def restart_steps(self) -> np.ndarray:
        """``(P,)`` numbers of the steps at which headings begin anew: others drift on to the next ones."""
        return np.searchsorted(self.heading_times, self.restarts.mean(axis=1)) - 1
