"""A problem at a state, as terms see it: what several of them need is computed once."""

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
    """One wearer, by number, with their problem and state."""

    number: int
    problem: WearerProblem
    state: WearerState
    _body: BodyState | None = None
    _vectors: dict[tuple[int, int], tuple[Array, Array]] = field(default_factory=dict, compare=False, repr=False)

    @cached_property
    def body(self) -> BodyState:
        """At the state, in all frames."""
        if self._body is not None:
            return self._body
        skeleton = self.problem.skeleton_at(self.state.body)
        return forward_kinematics(skeleton, self.state.R_parent_child, self.state.p_world_pelvis)

    @cached_property
    def owner(self) -> OwnerId:
        """Of the wearer's variables."""
        return OwnerId(Owner.WEARER, self.number)

    @property
    def frames(self) -> int:
        """Number of frames."""
        return self.state.frames

    @property
    def is_beginning(self) -> bool:
        """Whether its first frame is that of the whole."""
        return self.problem.is_beginning

    @property
    def frame_share(self) -> float:
        """What a frame counts."""
        return self.problem.frame_share

    def apart(self) -> "WearerEvaluation":
        """The same for another thread."""
        return WearerEvaluation(self.number, self.problem, self.state, self.body)

    def joint_vectors(self, frames: slice) -> Array:
        """Rotation vectors ``(t, 23, 3)`` of joints 1 … 23 in a stretch of frames."""
        key = frames.start, frames.stop
        if key not in self._vectors:
            vectors = log(self.state.R_parent_child[frames, 1:])
            self._vectors[key] = vectors, np.zeros(0)
        return self._vectors[key][0]

    def joint_jacobians(self, frames: slice) -> Array:
        """Derivatives ``(t, 23, 3, 3)`` of :meth:`joint_vectors` by each joint's own perturbation."""
        key, vectors = (frames.start, frames.stop), self.joint_vectors(frames)
        if not self._vectors[key][1].size:
            self._vectors[key] = vectors, inverse_right_jacobian(vectors)
        return self._vectors[key][1]

    def points(self, points: BodyPoints) -> BodyPoints:
        """Points on the problem's skeleton where they are on the state's."""
        variation = self.problem.variation
        if variation is None or not np.any(self.state.body):
            return points
        shift = variation.of_points(self.problem.skeleton, points.bones, points.p_bone_point) @ self.state.body
        return BodyPoints(points.bones, points.p_bone_point + shift)

    @cached_property
    def sensor_points(self) -> BodyPoints:
        """Where the sensors sit at the state."""
        points = self.points(self.problem.sensor_points)
        return BodyPoints(points.bones, points.p_bone_point + self.state.sensor_positions)

    @cached_property
    def sole(self) -> float:
        """Its thickness at the state, metres."""
        return self.problem.settings.sole.of(self.state.sole)

    @cached_property
    def contact_points(self) -> BodyPoints:
        """What touches the ground at the state: under the sole."""
        points = self.points(self.problem.contact_points)
        return BodyPoints(points.bones, points.p_bone_point + sole_shift(self.sole))

    def body_blocks(
        self, body: BodyState, points: BodyPoints, by_point: Array | None = None
    ) -> tuple[JacobianBlock, ...]:
        """What factors on points ``(n,)``, as they are before lengths change, see of the body's lengths, if these are
        variables.

        ``by_point`` ``(t, n, m, 3)`` are the derivatives of the factors by the points, whitened; None: the points
        themselves.
        """
        variation = self.problem.variation
        if variation is None or not self.problem.body_moves:
            return ()
        shift = variation.of_points(self.problem.skeleton, points.bones, points.p_bone_point)
        bones, R = list(points.bones), body.R_world_bone
        by_lengths = body.joints_by_offsets(variation.directions)[:, bones] + R[:, bones] @ shift
        return (JacobianBlock(self.owner, "body", by_lengths if by_point is None else by_point @ by_lengths),)

    def sensor_blocks(self, body: BodyState) -> tuple[JacobianBlock, ...]:
        """World positions of the sensors in a stretch of frames by where they sit and by the body's lengths."""
        points = self.problem.sensor_points
        by_lengths = self.body_blocks(body, points)
        if not self.problem.free_places:
            return by_lengths
        return JacobianBlock(self.owner, "sensor_positions", body.R_world_bone[:, points.bones], each=True), *by_lengths

    def contact_blocks(self, body: BodyState) -> tuple[JacobianBlock, ...]:
        """World positions of what touches the ground by the body's lengths and by the logarithm of the sole."""
        points = self.problem.contact_points
        by_lengths = self.body_blocks(body, points)
        if not self.problem.free_sole:
            return by_lengths
        by_sole = body.R_world_bone[:, points.bones] @ sole_shift(self.sole)[:, None]
        return *by_lengths, JacobianBlock(self.owner, "sole", by_sole)

    def arms(self, p_world: Array, first: slice) -> Array:
        """From the root to points ``(t, n, 3)`` in the frames from the first of a stretch on."""
        return p_world - self.state.p_world_pelvis[first.start : first.start + len(p_world), None]

    def headings(self, frames: slice) -> Array:
        """Of all sensors ``(S,)``, or ``(t, S)`` in frames where headings drift."""
        if not self.problem.headings_drift:
            return self.state.headings
        return self.state.heading_path[self.problem.heading_numbers(frames)]


@dataclass(frozen=True)
class CameraEvaluation:
    """One camera, by number: its problem and state, the scene's frames, and the offsets of the detector."""

    number: int
    problem: CameraProblem
    state: CameraState
    frames: int
    step: float
    offsets: Array | None = None
    free_offsets: bool = False

    @cached_property
    def owner(self) -> OwnerId:
        """Of the camera's variables."""
        return OwnerId(Owner.CAMERA, self.number)

    @property
    def is_beginning(self) -> bool:
        """Whether its first frame is that of the whole."""
        return self.problem.is_beginning

    @property
    def frame_share(self) -> float:
        """What a frame counts."""
        return float(min(1.0, self.step / self.problem.settings.correlation_s))

    @property
    def is_path(self) -> bool:
        """Whether each frame has a pose of its own that moves."""
        return self.problem.moving and self.problem.free_pose

    def poses(self, frames: slice) -> CameraPoses:
        """At a stretch of frames."""
        return self.state.at_frames(frames)


@dataclass(frozen=True)
class ViewEvaluation:
    """One wearer before one camera: ``owner`` of its variables, problem and state, and what it saw; ``offsets`` ``(K,
    3)`` are those of the detector's keypoints, ``free_offsets`` whether they move.
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
        """Seconds ``(t,)`` of a stretch of frames, from the instant of the clock's offset."""
        return self.wearer.problem.frames.time[frames] - self.camera.clock_middle

    def seconds_late(self, frames: slice) -> Array:
        """By which the video's clock must be put forward ``(t,)``, beyond what its pixels were."""
        offset, drift = self.view.clock
        change = self.state.clock - offset, self.state.clock_drift - drift
        return seconds_late(*change, self.wearer.problem.frames.time[frames], self.camera.clock_middle)

    def points_on(self, points: BodyPoints) -> BodyPoints:
        """The keypoints where the detector puts them on the wearer's body."""
        found = self.wearer.points(points)
        if self.offsets is None or not np.any(self.offsets):
            return found
        index, signs = self.view.offsets
        shift = np.where(index[:, None] < 0, 0.0, signs * self.offsets[index])
        return BodyPoints(found.bones, found.p_bone_point + shift)

    def offset_blocks(self, body: BodyState, by_point: Array) -> tuple[JacobianBlock, ...]:
        """What keypoints see of the offsets; ``by_point`` ``(t, n, m, 3)`` are their derivatives, whitened."""
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
        """Number of frames."""
        return self.wearer.frames

    @property
    def is_beginning(self) -> bool:
        """Whether its first frame is that of the whole."""
        return self.camera.is_beginning

    @property
    def frame_share(self) -> float:
        """What a frame counts that the camera saw."""
        return min(1.0, self.view.frames_apart * self.wearer.frame_share)
