"""Terms summed by compiled code, where there is a twin of them: what the accumulators do with equations in NumPy.

A twin takes what the term's equations are made of, and no array of residuals or Jacobians comes to be. What has none
goes the way of NumPy, into the same sums.
"""

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np

from vip_factors.assembly.accumulator import Accumulator
from vip_factors.assembly.charts import Charts
from vip_factors.body.hinges import TILTS
from vip_factors.body.kinematics import BodyState
from vip_factors.body.skeleton import PARENTS
from vip_factors.compiled import kernels
from vip_factors.factor_settings import SQUARE, RobustLoss
from vip_factors.geometry.rotations import Array
from vip_factors.problem.layout import STATIC, Layout, Owner, OwnerId
from vip_factors.problem.variables import DETECTOR, ROWS
from vip_factors.problem.wearer import BodyPoints
from vip_factors.solve.slices import REACH, Blocks
from vip_factors.terms.camera_velocity import camera_velocity_sigmas
from vip_factors.terms.equations import Evaluation, Term
from vip_factors.terms.evaluation import CameraEvaluation, ViewEvaluation, WearerEvaluation
from vip_factors.terms.hinge import hinge_sigmas, hinges_of_rows

_PARENTS = np.array(PARENTS)
_NONE = np.zeros((0, 0, 0))
_NEVER = np.zeros((0, 0, 0, 0))
_NO_FRAME = np.zeros(0, bool)
VIEWED = ("poses", "clock", "clock_drift", "zoom")  # of a camera, by reprojections
_NO_CAMERA = np.zeros((0, len(VIEWED)), dtype=int)


class CompiledAccumulator(Accumulator):
    """Sums by compiled code what has a twin there; arguments as of the base."""

    def __init__(
        self, layout: Layout, blocks: Blocks, begin: int, bodies: Sequence[BodyState], charts: Charts | None = None
    ) -> None:
        super().__init__(layout, blocks, begin, bodies, charts)
        self._target = blocks.target
        self._sums = dict[OwnerId, Any]()

    def add_term(self, term: Term[Any], at: Any) -> None:
        """See the base."""
        twin = TWINS.get(term.kind)
        if twin is None:
            super().add_term(term, at)
        elif isinstance(at, CameraEvaluation):
            twin(self._camera(at), at, self)
        else:
            twin(self._body(at.wearer if isinstance(at, ViewEvaluation) else at), at, self)

    def finish(self) -> None:
        """See the base."""
        for sums in self._sums.values():
            sums.expand()

    def _body(self, at: WearerEvaluation) -> Any:
        """Where a wearer's terms are summed."""
        if at.owner not in self._sums:
            chain, variation = self.layout.chain_of(at.owner), at.problem.variation
            first = -1 if chain is None else self.layout.chain_columns[chain].start
            turns = _NEVER if self.charts is None or chain is None else self.charts.turns[at.number]
            directions = variation.directions if at.problem.body_moves and variation is not None else _NONE
            self._sums[at.owner] = kernels.BodySums(
                self._target, self.begin, at.body.R_world_bone, at.body.p_world_joint, turns, first,
                self.layout.frame_width, _PARENTS, self.first_columns(at.owner), directions, self._camera_columns(),
            )  # fmt: skip
        return self._sums[at.owner]

    def _camera(self, at: CameraEvaluation) -> Any:
        """Where the terms of a camera alone are summed."""
        if at.owner not in self._sums:
            R, p = np.zeros((at.frames, 0, 3, 3)), np.zeros((at.frames, 0, 3))
            width, columns = self.layout.frame_width, self.first_columns(at.owner)
            self._sums[at.owner] = kernels.BodySums(
                self._target, self.begin, R, p, _NEVER, -1, width, _PARENTS, columns, _NONE, _NO_CAMERA
            )
        return self._sums[at.owner]

    def first_columns(self, owner: OwnerId) -> np.ndarray:
        """First columns of the blocks of an owner and of the detector in a slice; below nought of any other, and of
        one that does not move."""
        owners = {owner.kind: owner, Owner.DETECTOR: DETECTOR}
        return np.array([self._first_column(owners.get(kind), name) for name, kind in _names()])

    def _camera_columns(self) -> np.ndarray:
        """``(C, 4)`` of what reprojections see of each camera."""
        owners = [owner for owner, _ in self.layout.blocks if owner.kind is Owner.CAMERA]
        columns = [self._first_column(owner, name) for owner in owners for name in VIEWED]
        return np.array(columns, dtype=int).reshape(-1, len(VIEWED))

    def _first_column(self, owner: OwnerId | None, name: str) -> int:
        found, layout = None if owner is None else self.layout.columns_of(owner, name), self.layout
        if found is None:
            return -1
        static = (REACH + 1) * layout.frame_width
        return found.start + (static if found.chain == STATIC else layout.chain_columns[found.chain].start)

    def chart(self, owner: OwnerId, block: str) -> Array:
        """Of a static block's items, or of a camera's poses; nothing where steps are coordinates."""
        if self.charts is None:
            return _NONE
        poses = self.charts.poses.get(owner) if block == "poses" else None
        found = self.charts.static.get((owner, block), poses)
        return _NONE if found is None else found


@cache
def _names() -> tuple[tuple[str, Owner], ...]:
    return tuple((row.name, row.owner) for row in ROWS.values())


# Twins: of a term what it is made of, for the sums of the body that it sees.


def _believed(loss: RobustLoss, at: Evaluation) -> tuple[str, float, float]:
    return loss.loss.value, loss.k, at.frame_share


def _headings(at: WearerEvaluation) -> Array:
    """``(T or 1, S)``, of the frames where they drift."""
    return np.atleast_2d(at.headings(slice(None)))


def _shift(at: WearerEvaluation, points: BodyPoints) -> Array:
    """How points shift on their bones with the body's lengths, ``(n, 3, B)``; nothing where these are kept."""
    if at.problem.variation is None or not at.problem.body_moves:
        return _NONE
    return at.problem.variation.of_points(at.problem.skeleton, points.bones, points.p_bone_point)


@cache
def _numbers(bones: tuple[int, ...]) -> np.ndarray:
    return np.array(bones)


def _orientation(sums: Any, at: WearerEvaluation, scatter: CompiledAccumulator) -> None:
    problem, settings = at.problem, at.problem.settings.orientation
    sums.orientation(
        _numbers(problem.sensor_points.bones), at.state.R_bone_sensor, _headings(at), problem.frames.R_inertial_sensor,
        problem.frames.orientation_valid, settings.sigma, *_believed(settings.loss, at),
        scatter.chart(at.owner, "R_bone_sensor"),
    )  # fmt: skip


def _acceleration(sums: Any, at: WearerEvaluation, scatter: CompiledAccumulator) -> None:
    problem, settings = at.problem, at.problem.settings.acceleration
    if problem.use_acceleration:
        points, frames = problem.sensor_points, problem.frames
        sums.acceleration(
            _numbers(points.bones), at.sensor_points.p_bone_point, _shift(at, points), _headings(at),
            frames.specific_force_inertial, frames.acceleration_valid, frames.step, settings.sigma,
            *_believed(settings.loss, at),
        )  # fmt: skip


def _contact(sums: Any, at: WearerEvaluation, settings: Any, follows: np.ndarray) -> None:
    problem, points = at.problem, at.problem.contact_points
    sums.contact(
        _numbers(points.bones), at.contact_points.p_bone_point, _shift(at, points), problem.contact_confidence, at.sole,
        problem.frames.step, settings.sigma, *_believed(settings.loss, at), follows,
    )  # fmt: skip


def _floor_contact(sums: Any, at: WearerEvaluation, scatter: CompiledAccumulator) -> None:
    if at.problem.has_floor and at.problem.contacts:
        _contact(sums, at, at.problem.settings.floor_contact, _NO_FRAME)


def _foot_contact(sums: Any, at: WearerEvaluation, scatter: CompiledAccumulator) -> None:
    if at.problem.use_acceleration and at.problem.contacts and at.frames > 1:
        _contact(sums, at, at.problem.settings.foot_contact, at.problem.frames.follows)


def _pose_prior(sums: Any, at: WearerEvaluation, scatter: CompiledAccumulator) -> None:
    scale = at.problem.settings.pose_prior.scale
    prior = at.problem.prior
    sums.pose_prior(at.state.R_parent_child, prior.information, at.state.pose_mean, at.frame_share * scale**2)


def _smoothness(sums: Any, at: WearerEvaluation, scatter: CompiledAccumulator) -> None:
    problem, settings = at.problem, at.problem.settings.smoothness
    if problem.use_acceleration and settings.use and at.frames > 1:
        scale, R = settings.time / problem.frames.step, at.state.R_parent_child
        sums.smoothness(R, problem.prior.information, problem.frames.follows, at.frame_share * scale**2)


def _joint_limit(sums: Any, at: WearerEvaluation, scatter: CompiledAccumulator) -> None:
    limits, settings = at.problem.limits, at.problem.settings.joint_limit
    sums.joint_limit(
        at.state.R_parent_child, limits.lower, limits.upper, np.deg2rad(settings.sigma_deg), settings.per_axis,
        *_believed(settings.loss, at),
    )  # fmt: skip


def _hinge(sums: Any, at: WearerEvaluation, scatter: CompiledAccumulator) -> None:
    settings = at.problem.settings.hinge
    if settings.use:
        sums.hinge(
            at.state.R_parent_child, *hinges_of_rows(at.state.hinges), at.state.hinges[TILTS:],
            1 / hinge_sigmas(settings), *_believed(SQUARE, at),
        )  # fmt: skip


def _reprojection(sums: Any, at: ViewEvaluation, scatter: CompiledAccumulator) -> None:
    view, poses, lens = at.view, at.state.poses, at.lens
    if not view.points or not view.seen.any():
        return
    settings, every = at.camera.settings.reprojection, slice(None)
    numbers = np.array([*lens.focal, *lens.centre, *lens.distortion, *[0.0] * (8 - len(lens.distortion))])
    sums.reprojection(
        _numbers(view.body_points.bones), at.points_on(view.body_points).p_bone_point,
        _shift(at.wearer, view.body_points), poses.R_world_camera, poses.p_world_camera, numbers, view.pixels,
        view.sigma, view.seen, view.pixels_per_second, at.seconds_late(every), at.since_middle(every),
        *_believed(settings.loss, at), at.owner.number, scatter.chart(at.owner, "poses"), *view.offsets,
    )  # fmt: skip


def _poses(at: CameraEvaluation, scatter: CompiledAccumulator) -> tuple[Array, Array, Array]:
    return at.state.poses.R_world_camera, at.state.poses.p_world_camera, scatter.chart(at.owner, "poses")


def _camera_orientation(sums: Any, at: CameraEvaluation, scatter: CompiledAccumulator) -> None:
    imu = at.problem.imu
    if imu is not None:
        settings = at.problem.settings.orientation
        sums.camera_orientation(
            *_poses(at, scatter), at.state.R_camera_imu, at.state.heading, imu.R_inertial_sensor, imu.orientation_valid,
            settings.sigma(at.problem.orientation_weight(at.step)), *_believed(settings.loss, at),
            scatter.chart(at.owner, "R_camera_imu"),
        )  # fmt: skip


def _camera_acceleration(sums: Any, at: CameraEvaluation, scatter: CompiledAccumulator) -> None:
    imu = at.problem.imu
    if imu is not None and at.is_path:
        settings = at.problem.settings.acceleration
        sums.camera_acceleration(
            *_poses(at, scatter), at.problem.p_camera_imu, at.state.heading, imu.specific_force_inertial,
            imu.acceleration_valid, at.step, settings.sigma, *_believed(settings.loss, at),
        )  # fmt: skip


def _camera_velocity(sums: Any, at: CameraEvaluation, scatter: CompiledAccumulator) -> None:
    if at.is_path:
        settings = at.problem.settings.velocity
        sums.camera_velocity(
            *_poses(at, scatter), at.step, camera_velocity_sigmas(settings), *_believed(settings.loss, at)
        )


TWINS: dict[str, Callable[[Any, Any, CompiledAccumulator], None]] = {
    "orientation": _orientation,
    "acceleration": _acceleration,
    "pose prior": _pose_prior,
    "smoothness": _smoothness,
    "joint limit": _joint_limit,
    "hinge": _hinge,
    "floor contact": _floor_contact,
    "foot contact": _foot_contact,
    "reprojection": _reprojection,
    "camera orientation": _camera_orientation,
    "camera acceleration": _camera_acceleration,
    "camera velocity": _camera_velocity,
}
