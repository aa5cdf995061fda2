"""Evaluation of a problem at a state: quantities that several terms need are computed once."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from vip_factors.body.keypoints import OFFSET_KEYPOINTS
from vip_factors.body.kinematics import BodyState, forward_kinematics
from vip_factors.geometry.rotations import Array, inverse_right_jacobian, log
from vip_factors.problem.layout import Owner, OwnerId
from vip_factors.problem.scene import CameraProblem, KeypointView
from vip_factors.problem.state import CameraPoses, CameraState, WearerState, seconds_late
from vip_factors.problem.variables import DETECTOR
from vip_factors.problem.wearer import BodyPoints, WearerProblem, sole_shift
from vip_factors.sensors.camera import CameraModel
from vip_factors.terms.equations import JacobianBlock


@dataclass(frozen=True)
class WearerEvaluation:
    """Problem and state of one wearer."""

    number: int
    problem: WearerProblem
    state: WearerState
    _body: BodyState | None = None
    _vectors: dict[tuple[int, int], tuple[Array, Array]] = field(default_factory=dict, compare=False, repr=False)

    @cached_property
    def body(self) -> BodyState:
        """Forward kinematics of all frames."""
        if self._body is not None:
            return self._body
        skeleton = self.problem.skeleton_at(self.state.body)
        return forward_kinematics(skeleton, self.state.R_parent_child, self.state.p_world_pelvis)

    @cached_property
    def owner(self) -> OwnerId:
        """Owner of the wearer's variables."""
        return OwnerId(Owner.WEARER, self.number)

    @property
    def frames(self) -> int:
        """Number of frames of the problem."""
        return self.state.frames

    @property
    def is_beginning(self) -> bool:
        """True if the first frame is that of the recording."""
        return self.problem.is_beginning

    @property
    def frame_share(self) -> float:
        """Scale of one frame's information, at most 1."""
        return self.problem.frame_share

    def copy_for_thread(self) -> "WearerEvaluation":
        """Copy without the mutable cache, for use in another thread."""
        return WearerEvaluation(self.number, self.problem, self.state, self.body)

    def joint_vectors(self, frames: slice) -> Array:
        """Rotation vectors ``(t, 23, 3)`` of joints 1 … 23 in a stretch of frames."""
        key = frames.start, frames.stop
        if key not in self._vectors:
            vectors = log(self.state.R_parent_child[frames, 1:])
            self._vectors[key] = vectors, np.zeros(0)
        return self._vectors[key][0]

    def joint_jacobians(self, frames: slice) -> Array:
        """Derivatives ``(t, 23, 3, 3)`` of :meth:`joint_vectors` by each joint's perturbation."""
        key, vectors = (frames.start, frames.stop), self.joint_vectors(frames)
        if not self._vectors[key][1].size:
            self._vectors[key] = vectors, inverse_right_jacobian(vectors)
        return self._vectors[key][1]

    def points(self, points: BodyPoints) -> BodyPoints:
        """Move points of the problem's skeleton to the state's lengths."""
        variation = self.problem.variation
        if variation is None or not np.any(self.state.body):
            return points
        shift = variation.of_points(self.problem.skeleton, points.bones, points.p_bone_point) @ self.state.body
        return BodyPoints(points.bones, points.p_bone_point + shift)

    @cached_property
    def sensor_points(self) -> BodyPoints:
        """Sensor positions in bone axes at the state."""
        points = self.points(self.problem.sensor_points)
        return BodyPoints(points.bones, points.p_bone_point + self.state.sensor_positions)

    @cached_property
    def sole(self) -> float:
        """Thickness of the sole at the state, metres."""
        return self.problem.settings.sole.of(self.state.sole)

    @cached_property
    def contact_points(self) -> BodyPoints:
        """Contact points under the sole, in bone axes at the state."""
        points = self.points(self.problem.contact_points)
        return BodyPoints(points.bones, points.p_bone_point + sole_shift(self.sole))

    def body_blocks(
        self, body: BodyState, points: BodyPoints, by_point: Array | None = None
    ) -> tuple[JacobianBlock, ...]:
        """Derivatives of factors on points by the body's lengths, if these are variables.

        Args:
            body: kinematics of the frames.
            points: ``(n,)``, on the problem's skeleton.
            by_point: ``(t, n, m, 3)``, whitened derivatives of the factors by the points; None for the points.
        """
        variation = self.problem.variation
        if variation is None or not self.problem.body_moves:
            return ()
        shift = variation.of_points(self.problem.skeleton, points.bones, points.p_bone_point)
        bones, R = list(points.bones), body.R_world_bone
        by_lengths = body.joints_by_offsets(variation.directions)[:, bones] + R[:, bones] @ shift
        return (JacobianBlock(self.owner, "body", by_lengths if by_point is None else by_point @ by_lengths),)

    def sensor_blocks(self, body: BodyState) -> tuple[JacobianBlock, ...]:
        """Derivatives of the sensors' world positions by their positions on bones and by the body's lengths."""
        points = self.problem.sensor_points
        by_lengths = self.body_blocks(body, points)
        if not self.problem.free_places:
            return by_lengths
        by_position = body.R_world_bone[:, points.bones]
        return JacobianBlock(self.owner, "sensor_positions", by_position, is_per_factor=True), *by_lengths

    def contact_blocks(self, body: BodyState) -> tuple[JacobianBlock, ...]:
        """Derivatives of the contact points' world positions by the body's lengths and by the logarithm of the sole."""
        points = self.problem.contact_points
        by_lengths = self.body_blocks(body, points)
        if not self.problem.free_sole:
            return by_lengths
        by_sole = body.R_world_bone[:, points.bones] @ sole_shift(self.sole)[:, None]
        return *by_lengths, JacobianBlock(self.owner, "sole", by_sole)

    def arms(self, p_world: Array, stretch: slice) -> Array:
        """Vectors ``(t, n, 3)`` from the root to points in the frames from the first of a stretch on."""
        return p_world - self.state.p_world_pelvis[stretch.start : stretch.start + len(p_world), None]

    def headings(self, frames: slice) -> Array:
        """Headings of all sensors, radians: ``(S,)``, or ``(t, S)`` if they drift."""
        if not self.problem.headings_drift:
            return self.state.headings
        return self.state.heading_path[self.problem.heading_numbers(frames)]


@dataclass(frozen=True)
class CameraEvaluation:
    """Problem and state of one camera, number of frames and time step, and the detector's keypoint offsets."""

    number: int
    problem: CameraProblem
    state: CameraState
    frames: int
    step: float
    offsets: Array | None = None
    free_offsets: bool = False

    @cached_property
    def owner(self) -> OwnerId:
        """Owner of the camera's variables."""
        return OwnerId(Owner.CAMERA, self.number)

    @property
    def is_beginning(self) -> bool:
        """True if the first frame is that of the recording."""
        return self.problem.is_beginning

    @property
    def frame_share(self) -> float:
        """Scale of one frame's information, at most 1."""
        return float(min(1.0, self.step / self.problem.settings.correlation_s))

    @property
    def is_path(self) -> bool:
        """True if each frame has a pose that is a variable."""
        return self.problem.moving and self.problem.free_pose

    def poses(self, frames: slice) -> CameraPoses:
        """Camera poses in a stretch of frames."""
        return self.state.at_frames(frames)


@dataclass(frozen=True)
class ViewEvaluation:
    """One wearer in the view of one camera.

    Attributes:
        wearer: evaluation of the wearer.
        owner, camera, state: owner of the camera's variables, its problem and state.
        view: keypoints of the wearer in this camera.
        offsets: ``(K, 3)`` m of the detector's keypoints; ``free_offsets`` is True if they are variables.
    """

    wearer: WearerEvaluation
    owner: OwnerId
    camera: CameraProblem
    state: CameraState
    view: KeypointView
    offsets: Array | None = None
    free_offsets: bool = False

    @cached_property
    def lens(self) -> CameraModel:
        """The camera's intrinsics at the state."""
        return self.camera.model.zoomed(self.state.zoom)

    def since_middle(self, frames: slice) -> Array:
        """Times ``(t,)`` of a stretch of frames, seconds from the instant that the clock's offset refers to."""
        return self.wearer.problem.frames.time[frames] - self.camera.clock_middle

    def seconds_late(self, frames: slice) -> Array:
        """Correction ``(t,)`` of the video clock, seconds, relative to the clock that pixels were resampled with."""
        offset, drift = self.view.clock
        change = self.state.clock - offset, self.state.clock_drift - drift
        return seconds_late(*change, self.wearer.problem.frames.time[frames], self.camera.clock_middle)

    def points_on(self, points: BodyPoints) -> BodyPoints:
        """Move points to the wearer's lengths and add the detector's keypoint offsets."""
        body_points = self.wearer.points(points)
        if self.offsets is None or not np.any(self.offsets):
            return body_points
        index, signs = self.view.offsets
        shift = np.where(index[:, None] < 0, 0.0, signs * self.offsets[index])
        return BodyPoints(body_points.bones, body_points.p_bone_point + shift)

    def offset_blocks(self, body: BodyState, by_point: Array) -> tuple[JacobianBlock, ...]:
        """Derivatives by the keypoint offsets, given whitened ones by the points, ``by_point`` ``(t, n, m, 3)``."""
        if not self.free_offsets:
            return ()
        index, signs = self.view.offsets
        spread = np.zeros((len(index), 3, 3 * len(OFFSET_KEYPOINTS)))
        for n in np.flatnonzero(index >= 0):
            spread[n, :, 3 * index[n] : 3 * index[n] + 3] = np.diag(signs[n])
        R = body.R_world_bone[:, list(self.view.body_points.bones)]
        return (JacobianBlock(DETECTOR, "keypoint_offsets", (by_point @ R) @ spread),)

    @property
    def frames(self) -> int:
        """Number of frames of the problem."""
        return self.wearer.frames

    @property
    def is_beginning(self) -> bool:
        """True if the first frame is that of the recording."""
        return self.camera.is_beginning

    @property
    def frame_share(self) -> float:
        """Scale of one video frame's information, at most 1."""
        return min(1.0, self.view.frames_apart * self.wearer.frame_share)
