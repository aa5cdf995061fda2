"""Accumulation of terms by compiled kernels, which need no arrays of residuals and Jacobians.

Terms without a kernel are summed by the NumPy accumulator into the same blocks.
"""

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np

from vip_factors.assembly.accumulator import Accumulator
from vip_factors.assembly.charts import Charts
from vip_factors.body.joint_priors import TILTS
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
_NO_CHART = np.zeros((0, 0, 0))
_NO_TURNS = np.zeros((0, 0, 0, 0))
_NO_FRAME = np.zeros(0, bool)
VIEWED = ("poses", "clock", "clock_drift", "zoom")  # blocks of a camera that reprojections depend on
_NO_CAMERA = np.zeros((0, len(VIEWED)), dtype=int)


class CompiledAccumulator(Accumulator):
    """Accumulator that uses compiled kernels; arguments as for :class:`Accumulator`."""

    def __init__(
        self, layout: Layout, blocks: Blocks, begin: int, bodies: Sequence[BodyState], charts: Charts | None = None
    ) -> None:
        super().__init__(layout, blocks, begin, bodies, charts)
        self._target = blocks.target
        self._sums = dict[OwnerId, Any]()

    def add_term(self, term: Term[Any], evaluation: Any) -> None:
        """Add the factors of a term whose first frame is in the stretch."""
        add = KERNELS.get(term.kind)
        if add is None:
            super().add_term(term, evaluation)
        elif isinstance(evaluation, CameraEvaluation):
            add(self._camera(evaluation), evaluation, self)
        else:
            wearer = evaluation.wearer if isinstance(evaluation, ViewEvaluation) else evaluation
            add(self._body(wearer), evaluation, self)

    def finish(self) -> None:
        """Add deferred sums after the last term."""
        for sums in self._sums.values():
            sums.expand()

    def _body(self, wearer: WearerEvaluation) -> Any:
        """Return the compiled sums of a wearer's terms."""
        if wearer.owner not in self._sums:
            chain, variation = self.layout.chain_of(wearer.owner), wearer.problem.variation
            root_column = -1 if chain is None else self.layout.chain_columns[chain].start
            turns = _NO_TURNS if self.charts is None or chain is None else self.charts.turns[wearer.number]
            directions = variation.directions if wearer.problem.body_moves and variation is not None else _NO_CHART
            pose, width = (wearer.body.R_world_bone, wearer.body.p_world_joint), self.layout.frame_width
            columns, viewed = self.first_columns(wearer.owner), self._camera_columns()
            self._sums[wearer.owner] = kernels.BodySums(
                self._target, self.begin, *pose, turns, root_column, width, _PARENTS, columns, directions, viewed
            )
        return self._sums[wearer.owner]

    def _camera(self, camera: CameraEvaluation) -> Any:
        """Return the compiled sums of the terms on a camera alone."""
        if camera.owner not in self._sums:
            R, p = np.zeros((camera.frames, 0, 3, 3)), np.zeros((camera.frames, 0, 3))
            width, columns = self.layout.frame_width, self.first_columns(camera.owner)
            self._sums[camera.owner] = kernels.BodySums(
                self._target, self.begin, R, p, _NO_TURNS, -1, width, _PARENTS, columns, _NO_CHART, _NO_CAMERA
            )
        return self._sums[camera.owner]

    def first_columns(self, owner: OwnerId) -> np.ndarray:
        """First columns in a slice of the blocks of an owner and the detector; −1 for other and constant blocks."""
        owners = {owner.kind: owner, Owner.DETECTOR: DETECTOR}
        return np.array([self._first_column(owners.get(kind), name) for name, kind in _names()])

    def _camera_columns(self) -> np.ndarray:
        """``(C, 4)`` of what reprojections see of each camera."""
        owners = [owner for owner, _ in self.layout.blocks if owner.kind is Owner.CAMERA]
        columns = [self._first_column(owner, name) for owner in owners for name in VIEWED]
        return np.array(columns, dtype=int).reshape(-1, len(VIEWED))

    def _first_column(self, owner: OwnerId | None, name: str) -> int:
        columns, layout = None if owner is None else self.layout.columns_of(owner, name), self.layout
        if columns is None:
            return -1
        static = (REACH + 1) * layout.frame_width
        return columns.start + (static if columns.chain == STATIC else layout.chain_columns[columns.chain].start)

    def chart(self, owner: OwnerId, block: str) -> Array:
        """Chart Jacobians of a static block's items or a camera's poses; empty if they are the identity."""
        if self.charts is None:
            return _NO_CHART
        poses = self.charts.poses.get(owner) if block == "poses" else None
        jacobians = self.charts.static.get((owner, block), poses)
        return _NO_CHART if jacobians is None else jacobians


@cache
def _names() -> tuple[tuple[str, Owner], ...]:
    return tuple((row.name, row.owner) for row in ROWS.values())


# Each function passes the arguments of a term to its kernel.


def _loss_arguments(loss: RobustLoss, evaluation: Evaluation) -> tuple[str, float, float]:
    return loss.loss.value, loss.k, evaluation.frame_share


def _headings(wearer: WearerEvaluation) -> Array:
    """Headings ``(T, S)`` if they drift, else ``(1, S)``."""
    return np.atleast_2d(wearer.headings(slice(None)))


def _shift(wearer: WearerEvaluation, points: BodyPoints) -> Array:
    """Derivative ``(n, 3, B)`` of points in bone axes by the body's lengths; empty if these are constant."""
    if wearer.problem.variation is None or not wearer.problem.body_moves:
        return _NO_CHART
    return wearer.problem.variation.of_points(wearer.problem.skeleton, points.bones, points.p_bone_point)


@cache
def _numbers(bones: tuple[int, ...]) -> np.ndarray:
    return np.array(bones)


def _orientation(sums: Any, wearer: WearerEvaluation, scatter: CompiledAccumulator) -> None:
    problem, settings = wearer.problem, wearer.problem.settings.orientation
    calibration = wearer.state.R_bone_sensor, _headings(wearer)
    measured = problem.frames.R_inertial_sensor, problem.frames.orientation_valid
    chart = scatter.chart(wearer.owner, "R_bone_sensor")
    loss = settings.sigma, *_loss_arguments(settings.loss, wearer)
    sums.orientation(_numbers(problem.sensor_points.bones), *calibration, *measured, *loss, chart)


def _acceleration(sums: Any, wearer: WearerEvaluation, scatter: CompiledAccumulator) -> None:
    problem, settings = wearer.problem, wearer.problem.settings.acceleration
    if problem.use_acceleration:
        points, frames = problem.sensor_points, problem.frames
        position = _numbers(points.bones), wearer.sensor_points.p_bone_point, _shift(wearer, points)
        measured = frames.specific_force_inertial, frames.acceleration_valid, frames.step
        loss = settings.sigma, *_loss_arguments(settings.loss, wearer)
        sums.acceleration(*position, _headings(wearer), *measured, *loss)


def _contact(sums: Any, wearer: WearerEvaluation, settings: Any, follows: np.ndarray) -> None:
    problem, points = wearer.problem, wearer.problem.contact_points
    position = _numbers(points.bones), wearer.contact_points.p_bone_point, _shift(wearer, points)
    loss = settings.sigma, *_loss_arguments(settings.loss, wearer)
    sums.contact(*position, problem.contact_confidence, wearer.sole, problem.frames.step, *loss, follows)


def _floor_contact(sums: Any, wearer: WearerEvaluation, scatter: CompiledAccumulator) -> None:
    if wearer.problem.has_floor and wearer.problem.contacts:
        _contact(sums, wearer, wearer.problem.settings.floor_contact, _NO_FRAME)


def _foot_contact(sums: Any, wearer: WearerEvaluation, scatter: CompiledAccumulator) -> None:
    if wearer.problem.use_acceleration and wearer.problem.contacts and wearer.frames > 1:
        _contact(sums, wearer, wearer.problem.settings.foot_contact, wearer.problem.frames.follows)


def _pose_prior(sums: Any, wearer: WearerEvaluation, scatter: CompiledAccumulator) -> None:
    scale = wearer.problem.settings.pose_prior.scale
    prior = wearer.problem.prior
    sums.pose_prior(
        wearer.state.R_parent_child, prior.information, wearer.state.pose_mean, wearer.frame_share * scale**2
    )


def _smoothness(sums: Any, wearer: WearerEvaluation, scatter: CompiledAccumulator) -> None:
    problem, settings = wearer.problem, wearer.problem.settings.smoothness
    if problem.use_acceleration and settings.use and wearer.frames > 1:
        scale, R = settings.time / problem.frames.step, wearer.state.R_parent_child
        sums.smoothness(R, problem.prior.information, problem.frames.follows, wearer.frame_share * scale**2)


def _joint_limit(sums: Any, wearer: WearerEvaluation, scatter: CompiledAccumulator) -> None:
    limits, settings = wearer.problem.limits, wearer.problem.settings.joint_limit
    R, sigma, loss = wearer.state.R_parent_child, np.deg2rad(settings.sigma_deg), _loss_arguments(settings.loss, wearer)
    sums.joint_limit(R, limits.lower, limits.upper, sigma, settings.per_axis, *loss)


def _hinge(sums: Any, wearer: WearerEvaluation, scatter: CompiledAccumulator) -> None:
    settings = wearer.problem.settings.hinge
    if settings.use:
        R, hinges = wearer.state.R_parent_child, wearer.state.hinges
        weights, loss = 1 / hinge_sigmas(settings), _loss_arguments(SQUARE, wearer)
        sums.hinge(R, *hinges_of_rows(hinges), hinges[TILTS:], weights, *loss)


def _reprojection(sums: Any, evaluation: ViewEvaluation, scatter: CompiledAccumulator) -> None:
    view, poses, lens = evaluation.view, evaluation.state.poses, evaluation.lens
    if not view.points or not view.seen.any():
        return
    settings, every = evaluation.camera.settings.reprojection, slice(None)
    intrinsics = np.array([*lens.focal, *lens.centre, *lens.distortion, *[0.0] * (8 - len(lens.distortion))])
    points = view.body_points
    position = _numbers(points.bones), evaluation.points_on(points).p_bone_point, _shift(evaluation.wearer, points)
    camera = poses.R_world_camera, poses.p_world_camera, intrinsics
    measured = view.pixels, view.sigma, view.seen, view.pixels_per_second
    clock = evaluation.seconds_late(every), evaluation.since_middle(every)
    loss = _loss_arguments(settings.loss, evaluation)
    chart = evaluation.owner.number, scatter.chart(evaluation.owner, "poses")
    sums.reprojection(*position, *camera, *measured, *clock, *loss, *chart, *view.offsets)


def _poses(camera: CameraEvaluation, scatter: CompiledAccumulator) -> tuple[Array, Array, Array]:
    return camera.state.poses.R_world_camera, camera.state.poses.p_world_camera, scatter.chart(camera.owner, "poses")


def _camera_orientation(sums: Any, camera: CameraEvaluation, scatter: CompiledAccumulator) -> None:
    imu = camera.problem.imu
    if imu is not None:
        settings = camera.problem.settings.orientation
        calibration = camera.state.R_camera_imu, camera.state.heading
        measured = imu.R_inertial_sensor, imu.orientation_valid
        sigma = settings.sigma(camera.problem.orientation_weight(camera.step))
        loss, chart = _loss_arguments(settings.loss, camera), scatter.chart(camera.owner, "R_camera_imu")
        sums.camera_orientation(*_poses(camera, scatter), *calibration, *measured, sigma, *loss, chart)


def _camera_acceleration(sums: Any, camera: CameraEvaluation, scatter: CompiledAccumulator) -> None:
    imu = camera.problem.imu
    if imu is not None and camera.is_path:
        settings = camera.problem.settings.acceleration
        calibration = camera.problem.p_camera_imu, camera.state.heading
        measured = imu.specific_force_inertial, imu.acceleration_valid, camera.step
        loss = settings.sigma, *_loss_arguments(settings.loss, camera)
        sums.camera_acceleration(*_poses(camera, scatter), *calibration, *measured, *loss)


def _camera_velocity(sums: Any, camera: CameraEvaluation, scatter: CompiledAccumulator) -> None:
    if camera.is_path:
        settings = camera.problem.settings.velocity
        sigmas, loss = camera_velocity_sigmas(settings), _loss_arguments(settings.loss, camera)
        sums.camera_velocity(*_poses(camera, scatter), camera.step, sigmas, *loss)


KERNELS: dict[str, Callable[[Any, Any, CompiledAccumulator], None]] = {
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
