"""Everything that defines one wearer's cost: measurements, body, priors and settings."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from vip_factors.body.calibration_pose import HeldPose
from vip_factors.body.hinges import HingePrior
from vip_factors.body.joint_limits import JointLimits
from vip_factors.body.lengths import BodyVariation
from vip_factors.body.pose_prior import PosePrior
from vip_factors.body.skeleton import Skeleton
from vip_factors.geometry.rotations import Array
from vip_factors.problem.points import BodyPoint, BodyPoints
from vip_factors.sensors.frames import ImuFrames
from vip_factors.terms.acceleration import AccelerationSettings
from vip_factors.terms.agreeing_headings import AgreeingHeadingsSettings
from vip_factors.terms.coasting import CoastingSettings
from vip_factors.terms.floor_contact import FloorContactSettings
from vip_factors.terms.foot_contact import FootContactSettings
from vip_factors.terms.gauge_prior import GaugePriorSettings
from vip_factors.terms.heading_knots import knot_weights
from vip_factors.terms.heading_prior import HeadingPriorSettings
from vip_factors.terms.heading_walk import HeadingWalkSettings
from vip_factors.terms.hinge import HingeSettings
from vip_factors.terms.joint_limit import JointLimitSettings
from vip_factors.terms.orientation import OrientationSettings
from vip_factors.terms.pose_prior import PosePriorSettings
from vip_factors.terms.rotation_prior import InitialPoseSettings
from vip_factors.terms.sensor_place import SensorPlaceSettings
from vip_factors.terms.smoothness import SmoothnessSettings
from vip_factors.terms.sole import SoleSettings


@dataclass(frozen=True)
class FactorSettings:
    """The settings of every factor kind."""

    orientation: OrientationSettings = field(default_factory=OrientationSettings)
    acceleration: AccelerationSettings = field(default_factory=AccelerationSettings)
    pose_prior: PosePriorSettings = field(default_factory=PosePriorSettings)
    joint_limit: JointLimitSettings = field(default_factory=JointLimitSettings)
    heading_prior: HeadingPriorSettings = field(default_factory=HeadingPriorSettings)
    agreeing_headings: AgreeingHeadingsSettings = field(default_factory=AgreeingHeadingsSettings)
    sensor_place: SensorPlaceSettings = field(default_factory=SensorPlaceSettings)
    heading_walk: HeadingWalkSettings = field(default_factory=HeadingWalkSettings)
    initial_pose: InitialPoseSettings = field(default_factory=InitialPoseSettings)
    hinge: HingeSettings = field(default_factory=HingeSettings)
    smoothness: SmoothnessSettings = field(default_factory=SmoothnessSettings)
    sole: SoleSettings = field(default_factory=SoleSettings)
    foot_contact: FootContactSettings = field(default_factory=FootContactSettings)
    floor_contact: FloorContactSettings = field(default_factory=FloorContactSettings)
    gauge_prior: GaugePriorSettings = field(default_factory=GaugePriorSettings)
    coasting: CoastingSettings = field(default_factory=CoastingSettings)
    # s. Errors of tissue, joints and detectors last as long as postures do: frames nearer than this are one statement,
    # and each of them counts as its share of it; so the frame rate, which is nobody's evidence, changes no weight.
    correlation_s: float = 0.35
    # Of the prior over bodies, in sigmas: what a table calls a joint's centre is not quite what keypoints follow.
    length_scale: float = 1.5


@dataclass(frozen=True)
class InitialPose:
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


@dataclass(frozen=True)
class WearerProblem:
    """One wearer's least-squares problem.

    Attributes:
        skeleton, prior, limits: the body.
        frames: the measurements.
        sensors: ``S`` points where the sensors sit, in the order of ``frames.sensors``.
        prior_headings, heading_sigma: ``(S,)`` radians; of the first knot, where headings walk.
        prior_R_bone_sensor: ``(S, 3, 3)``.
        mounting_sigma: ``(S,)`` radians.
        p_world_start: root position of the first frame, metres; or ``(N, 3)``, of the first frame of each stretch.
        settings: of the factors.
        initial_pose: declared by the wearer, or None.
        contacts: points of the feet that may bear the body.
        contact_confidence: ``(T, C)`` in [0, 1], whether each contact holds from its frame to the next.
        use_acceleration: False leaves acceleration, contact and gauge factors out: frames decouple (IT, SOP).
        free_headings, free_mountings, free_pose_mean: whether those variables move.
        gauge_sensor: whose heading defines the world's.
        is_gauge: whether this wearer's first root position and gauge heading define the world. Where headings walk, the
            gauge sensor's is pinned at the first knot only: what it drifts shows against a camera that stands, and
            without one it stays as the walk's prior has it.
        is_beginning: False for a stretch of something longer, whose beginning holds the priors on what all frames
            share and on the first root position.
        variation: how the skeleton may change, and how likely; None of a body that is known.
        free_body: whether it does.
        free_hinges: whether the axes of elbows and knees are variables.
        hinge_prior: what is likely of those.
        free_places: whether the sensors' places on their bones are variables.
        free_sole: whether the sole's thickness is a variable.
        heading_knots: ``(K,)`` seconds at which headings are variables, linear in between; one or none: constant.
        heading_drift_deg: ``(S,)`` degrees per √minute by which headings walk; empty before anything shows it.
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
    p_world_start: Array = field(default_factory=lambda: np.zeros(3))
    settings: FactorSettings = field(default_factory=FactorSettings)
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
    heading_knots: Array = field(default_factory=lambda: np.zeros(0))
    heading_drift_deg: Array = field(default_factory=lambda: np.zeros(0))
    variation: BodyVariation | None = None
    free_body: bool = False
    free_hinges: bool = False
    hinge_prior: HingePrior = field(default_factory=HingePrior)
    free_places: bool = False
    free_sole: bool = False

    @cached_property
    def sensor_points(self) -> BodyPoints:
        """Where the sensors sit, as arrays."""
        return BodyPoints.of(self.sensors)

    @cached_property
    def contact_points(self) -> BodyPoints:
        """The contacts, as arrays."""
        return BodyPoints.of(self.contacts)

    @cached_property
    def place_whitening(self) -> Array:
        """``(S, 3, 3)`` per metre, of the prior on the sensors' places: another sigma along limbs than across."""
        settings, found = self.settings.sensor_place, []
        for bone in self.sensor_points.bones:
            limb = self.skeleton.limb(bone)
            if limb is None:
                found.append(np.eye(3) / settings.elsewhere)
                continue
            length = float(np.linalg.norm(limb))
            along = np.outer(limb, limb) / length**2
            found.append(along / (settings.along * length) + (np.eye(3) - along) / settings.across)
        return np.array(found).reshape(-1, 3, 3)

    def frame_share(self, first: slice) -> Array:
        """What frames count ``(t, 1)``: their share of a correlation time."""
        return np.full((first.stop - first.start, 1), min(1.0, self.frames.step / self.settings.correlation_s))

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

    @cached_property
    def coasting(self) -> np.ndarray:
        """``(T,)`` whether the root coasts over a frame and its neighbours: no accelerometer says how it moves there.

        The first frame and the last of a stretch have one neighbour and never do.
        """
        coasting = np.zeros(len(self.frames), bool)
        if self.use_acceleration and self.settings.coasting.use:
            follows = self.frames.follows
            coasting[1:-1] = ~np.any(self.frames.acceleration_valid[1:-1], axis=1) & follows[:-1] & follows[1:]
        return coasting

    @cached_property
    def turning(self) -> np.ndarray:
        """``(T − 1,)`` whether the pelvis turns unseen from a frame to the next: one has no orientation of a sensor."""
        if not (self.use_acceleration and self.settings.coasting.use):
            return np.zeros(max(len(self.frames) - 1, 0), bool)
        seen = np.any(self.frames.orientation_valid, axis=1)
        return ~(seen[:-1] & seen[1:]) & self.frames.follows

    @property
    def heading_sigmas(self) -> Array:
        """``(S,)`` radians, as used: tight for the gauge sensor, not too tight for the others.

        What the motion of a whole recording says of a heading that walks is its mean, against that of the gauge
        sensor: a walk's mean is off its start by a third of the variance that it gathers, and here two walk.
        """
        prior = self.settings.heading_prior
        sigmas = np.maximum(self.heading_sigma, prior.least_sigma)
        if self.headings_walk:
            whole = self._walk_sigma(self.heading_knots[-1] - self.heading_knots[0])
            sigmas = np.hypot(sigmas, np.sqrt(2 / 3) * whole)
        if self.is_gauge:
            sigmas[self.gauge_sensor] = prior.gauge_sigma
        return sigmas

    @property
    def headings_walk(self) -> bool:
        """Whether headings change with time."""
        return len(self.heading_knots) > 1

    def knot_weights(self, frames: slice = slice(None)) -> Array | None:
        """What each knot counts in a stretch of frames ``(t, K)``; None where headings are constant."""
        return knot_weights(self.heading_knots, self.frames.time[frames]) if self.headings_walk else None

    @property
    def walk_sigmas(self) -> Array:
        """``(K − 1, S)`` radians from knot to knot."""
        return self._walk_sigma(np.diff(self.heading_knots)[:, None])

    def _walk_sigma(self, seconds: Array) -> Array:
        """Radians by which each sensor's heading walks, ``(..., S)``."""
        walk = self.settings.heading_walk
        unknown = np.full(len(self.sensors), walk.unknown_drift_deg)
        return walk.sigma(seconds, self.heading_drift_deg if len(self.heading_drift_deg) else unknown)

    @property
    def initial_pose_sigma(self) -> Array:
        """Standard deviations ``(23, 3)`` in radians for each of the initial frames, which together weigh as one."""
        assert self.initial_pose is not None
        return self.initial_pose.pose.sigma[1:] * self.settings.initial_pose.scale * np.sqrt(self.initial_pose.frames)
