"""A stretch of frames as normal equations, slice by slice: each holds the factors whose first frame is its own.

A smoother that goes on where it left off needs them apart: what is left behind an eliminated frame then holds every
factor that touches it, and a later linearisation holds all the others.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import gtsam
import numpy as np

from vip_factors.body.kinematics import BodyState, forward_kinematics
from vip_factors.body.pose_prior import POSE_SIZE
from vip_factors.factors.camera_velocity import camera_velocity_jacobians, camera_velocity_residual
from vip_factors.factors.coasting import pelvis_turn_jacobians
from vip_factors.geometry.rotations import Array, inverse_right_jacobian, log, transpose
from vip_factors.graph import twist
from vip_factors.graph.batch import BatchObjective, pose_equations
from vip_factors.graph.bone_factors import add_bone_factors
from vip_factors.graph.camera_batch import CameraObjective
from vip_factors.graph.hessian import coupling_factor
from vip_factors.graph.joint_factors import JOINTS, PELVIS, add_joint_factors, is_smoothed
from vip_factors.graph.scene_batch import _view_equations as view_equations
from vip_factors.graph.scene_model import SceneModel
from vip_factors.graph.scene_state import CAMERA, SceneState
from vip_factors.graph.state import GraphState
from vip_factors.graph.terms import FRAME
from vip_factors.graph.wearer_residuals import motion_residuals, turn_residuals

REACH = 2  # frames that a factor reaches ahead of its first one


def slice_key(frame: int) -> int:
    """Key of all variables of one frame, as one vector."""
    return gtsam.symbol("x", frame)


def shared_key(epoch: int) -> int:
    """Key of all variables that frames share, as one vector; those of the next epoch have wandered from it."""
    return gtsam.symbol("z", epoch)


def step_factor(before: int, after: int, sigmas: Array) -> gtsam.JacobianFactor:
    """Between the shared variables of two epochs: they stay where they are, but for ``sigmas`` ``(s,)``."""
    one, none = np.diag(1 / sigmas), np.zeros(len(sigmas))
    return gtsam.JacobianFactor(before, -one, after, one, none, gtsam.noiseModel.Unit.Create(len(sigmas)))


@dataclass(frozen=True)
class SliceColumns:
    """Which columns of a slice are whose: those of a frame, of the next and of the one after, then of all frames.

    Attributes:
        frame: width of a frame: 75 for each wearer, 6 for a moving camera.
        static: width of what all frames share.
        wearers: of each wearer, its free columns (see :mod:`vip_factors.graph.terms`) in the slice.
        camera: ``(11,)`` of the camera's columns in the slice; −1 where it is not free.
    """

    frame: int
    static: int
    wearers: tuple[np.ndarray, ...]
    camera: np.ndarray

    @classmethod
    def of(cls, model: SceneModel) -> "SliceColumns":
        """The columns of a scene's problem."""
        statics = [len(BatchObjective(wearer).static_columns) for wearer in model.wearers]
        objective = CameraObjective(model.camera, 1, 1.0)
        frame, camera = FRAME * len(statics) + objective.frame_width, np.full(CAMERA, -1)
        wearers, place = [], 3 * frame
        for number, count in enumerate(statics):
            own = np.arange(FRAME) + FRAME * number
            wearers.append(np.concatenate([own, np.arange(place, place + count)]))
            place += count
        moving, shared = np.split(objective.columns, [objective.frame_width])
        camera[moving] = frame - objective.frame_width + np.arange(len(moving))
        camera[shared] = place + np.arange(len(shared))
        return cls(frame, place + len(shared) - 3 * frame, tuple(wearers), camera)

    @property
    def width(self) -> int:
        """Number of all columns."""
        return 3 * self.frame + self.static


class Slices:
    """The slices of a stretch.

    Attributes:
        columns: whose columns are where.
        hessian, gradient: ``(T, n, n)`` and ``(T, n)``.
    """

    def __init__(self, columns: SliceColumns, frames: int) -> None:
        self.columns = columns
        self.hessian = np.zeros((frames, columns.width, columns.width))
        self.gradient = np.zeros((frames, columns.width))

    def emptied(self, frames: int) -> "Slices":
        """Of so many frames, all zero; in the same memory, if it is enough: new pages cost more than zeros."""
        if frames > len(self.hessian):
            return Slices(self.columns, frames)
        self.hessian[:frames], self.gradient[:frames] = 0.0, 0.0
        return self

    def add(self, first: slice, place: np.ndarray, hessian: Array, gradient: Array) -> None:
        """Add ``(t, k, k)`` and ``(t, k)`` at ``k`` columns of a stretch of slices; columns below zero are left out."""
        runs = _runs(place)
        for here, there in runs:
            self.gradient[first, there] += gradient[:, here]
            for other, beside in runs:
                self.hessian[first, there, beside] += hessian[:, here, other]

    def add_between(self, first: slice, rows: np.ndarray, columns: np.ndarray, block: Array) -> None:
        """Add blocks ``(t, k, l)`` off the diagonal, and their mirror images."""
        for here, there in _runs(rows):
            for other, beside in _runs(columns):
                part = block[:, here, other]
                self.hessian[first, there, beside] += part
                self.hessian[first, beside, there] += transpose(part)

    def add_rows(self, first: slice, place: np.ndarray, jacobian: Array, residual: Array) -> None:
        """Add weighted rows ``(t, m, k)`` with residuals ``(t, m)``."""
        transposed = transpose(jacobian)
        self.add(first, place, transposed @ jacobian, (transposed @ residual[..., None])[..., 0])

    def factors(self, t: int, keys: Sequence[int], shared_key: int, value: Array) -> gtsam.GaussianFactorGraph:
        """One slice as factors on its frame, the two after it (``keys``) and the shared variables.

        The slice is a quadratic in steps from the coordinates ``value`` ``(n,)``; the factors are in the coordinates.
        """
        H = self.hessian[t]
        g = self.gradient[t] - H @ value
        w = self.columns.frame
        parts = [slice(0, w), slice(w, 2 * w), slice(2 * w, 3 * w), slice(3 * w, None)]
        now, after, last, shared = parts
        graph = gtsam.GaussianFactorGraph()
        reach = [bool(H[part].any()) for part in (after, last)]
        if not any(reach):
            graph.push_back(gtsam.HessianFactor(keys[0], H[now, now], -g[now], 0.0))
        elif not reach[1]:
            graph.push_back(
                gtsam.HessianFactor(
                    keys[0], keys[1], H[now, now], H[now, after], -g[now], H[after, after], -g[after], 0.0
                )
            )
        else:
            graph.push_back(
                gtsam.HessianFactor(
                    *keys, H[now, now], H[now, after], H[now, last], -g[now],
                    H[after, after], H[after, last], -g[after], H[last, last], -g[last], 0.0,
                )
            )  # fmt: skip
        if self.columns.static:
            graph.push_back(gtsam.HessianFactor(shared_key, H[shared, shared], -g[shared], 0.0))
            for key, part, there in zip(keys, parts, (True, *reach), strict=False):
                if there and H[part, shared].any():
                    graph.push_back(coupling_factor(key, shared_key, H[part, shared]))
        return graph


def _runs(place: np.ndarray) -> tuple[tuple[slice, slice], ...]:
    """Stretches of columns that follow one another, as they are numbered in a block and in a slice.

    NumPy moves whole stretches at once; picked columns it moves number by number.
    """
    return _runs_of(place.astype(np.int64).tobytes())


@cache
def _runs_of(place: bytes) -> tuple[tuple[slice, slice], ...]:
    columns = np.frombuffer(place, np.int64)
    starts = [0, *(np.flatnonzero(np.diff(columns) != 1) + 1).tolist(), len(columns)]
    return tuple(
        (slice(start, stop), slice(int(columns[start]), int(columns[start]) + stop - start))
        for start, stop in pairwise(starts)
        if stop > start and columns[start] >= 0
    )


def scene_slices(model: SceneModel, state: SceneState, slices: Slices) -> Slices:
    """The slices of a scene's problem at a state, in the memory of earlier ``slices`` if that is enough."""
    slices, columns = slices.emptied(model.frames), slices.columns
    everything = slice(0, model.frames)
    for number, (wearer, own) in enumerate(zip(model.wearers, state.wearers, strict=True)):
        body = forward_kinematics(wearer.skeleton, own.R_parent_child, own.p_world_pelvis)
        objective, place = BatchObjective(wearer, number), columns.wearers[number]
        _add_poses(slices, objective, own, body, place)
        _add_smoothness(slices, objective, own, place)
        _add_turns(slices, objective, own, place)
        _add_motion(slices, objective, own, body, place)
        whose = [columns.camera, *[np.full(CAMERA, -1)] * len(model.further)]
        for camera, one in zip(whose, model.viewpoints(state.camera), strict=True):
            view = one.views[number]
            if view.seen.any():
                equations = view_equations(view, everything, one.problem, one.state, body)
                both = np.concatenate([place[:FRAME], camera])
                slices.add(everything, both, equations.hessian, equations.gradient)
    _add_camera(slices, CameraObjective(model.camera, model.frames, model.step), state)
    return slices


def _add_poses(
    slices: Slices, objective: BatchObjective, state: GraphState, body: BodyState, place: np.ndarray
) -> None:
    """The factors of a wearer on single frames, and the priors on what all share."""
    model, T = objective.model, len(body.p_world_joint)
    everything, width = slice(0, T), objective._used
    used = np.concatenate([np.arange(FRAME), objective.static_columns])
    H, g = np.zeros((T, width, width)), np.zeros((T, width))
    settings = model.settings
    smoothness, coasting = replace(settings.smoothness, use=False), replace(settings.coasting, use=False)
    rough = replace(model, settings=replace(settings, smoothness=smoothness, coasting=coasting))
    add_joint_factors(rough, state, everything, H, g, None)
    add_bone_factors(model, objective.sites, state, body, everything, None, None, H, g)
    H[:, FRAME:, :FRAME] = transpose(H[:, :FRAME, FRAME:])
    slices.add(everything, place, H[:, used[:, None], used], g[:, used])
    for _, residual, own, J in objective._static_rows(state):
        there = np.searchsorted(used, own)
        slices.add(slice(0, 1), place[there], (J.T @ J)[None], (J.T @ residual)[None])


def _add_smoothness(slices: Slices, objective: BatchObjective, state: GraphState, place: np.ndarray) -> None:
    """The factors of a wearer between each frame and the next one."""
    model, w = objective.model, slices.columns.frame
    if not is_smoothed(model):
        return
    R, information = state.R_parent_child[:, 1:], model.prior.information
    turn = log(transpose(R[:-1]) @ R[1:])
    by_after = inverse_right_jacobian(turn)
    T = len(turn)
    blocks = np.concatenate([-transpose(by_after), by_after], axis=1)  # of 23 joints in either frame
    information = (model.settings.smoothness.time / model.frames.step) ** 2 * np.tile(information, (2, 2))
    Bt = transpose(blocks)
    half = (Bt @ information.reshape(-1, 3, 2 * POSE_SIZE)).reshape(T, 2 * POSE_SIZE, 2 * POSE_SIZE)
    hessian = (Bt @ transpose(half).reshape(T, -1, 3, 2 * POSE_SIZE)).reshape(half.shape)
    force = np.tile(turn.reshape(T, -1), (1, 2)) @ information / 2
    gradient = (Bt @ force.reshape(T, -1, 3, 1)).reshape(T, -1)
    joints = place[JOINTS]
    slices.add(slice(0, T), np.concatenate([joints, joints + w]), hessian, gradient)


def _add_turns(slices: Slices, objective: BatchObjective, state: GraphState, place: np.ndarray) -> None:
    """The factors of a wearer between pelvises of which one was not measured."""
    model, w = objective.model, slices.columns.frame
    if not model.turning.any():
        return
    term = turn_residuals(model, state.R_parent_child)
    sigma, step, root = model.settings.coasting.turn_sigma, model.frames.step, np.sqrt(term.weight)[..., None]
    J = np.concatenate(pelvis_turn_jacobians(term.residual[:, 0] * sigma, step), axis=2) / sigma
    pelvis, pairs = place[PELVIS], slice(0, len(J))
    slices.add_rows(pairs, np.concatenate([pelvis, pelvis + w]), root * J, root[..., 0] * term.residual[:, 0])


def _add_motion(
    slices: Slices, objective: BatchObjective, state: GraphState, body: BodyState, place: np.ndarray
) -> None:
    """The factors of a wearer that see a point move: over three frames, or over two."""
    model, sites, w = objective.model, objective.sites, slices.columns.frame
    p, S = sites.on(body), len(model.sensors)
    by_twist, screws, frame = body.point_twists(p), body.screws, place[:FRAME]
    for term in motion_residuals(model, state, p):
        chosen = term.sites
        bones, reach = sites.bones[chosen], 2 if term.start else 1
        count = len(term.residual)
        if count == 0:
            continue
        here, weight = [slice(ahead, ahead + count) for ahead in range(reach + 1)], term.weight
        c = term.coefficients[2 - reach :]
        J = [by_twist[one][:, chosen] for one in here]
        first = slice(0, count)
        for i in range(reach + 1):
            pushed = J[i].swapaxes(2, 3) * (weight * c[i])[..., None, None]
            own = twist.carried(bones, c[i] * (pushed @ J[i]))
            force = twist.carried(bones, (pushed @ term.residual[..., None])[..., 0])
            now = screws[here[i]]
            slices.add(first, frame + w * i, twist.hessian(now, own), twist.gradient(now, force))
            for j in range(i + 1, reach + 1):
                between = twist.carried(bones, c[j] * (pushed @ J[j]))
                block = twist.hessian_between(now, between, screws[here[j]])
                slices.add_between(first, frame + w * i, frame + w * j, block)
            if term.by_heading is not None and model.free_headings:
                turned = pushed @ term.by_heading[..., None]
                block = twist.coupling_of_each(now, bones, turned)
                slices.add_between(first, frame + w * i, place[FRAME : FRAME + S], block)
        if term.by_heading is not None and model.free_headings:
            headings = place[FRAME : FRAME + S]
            slices.hessian[first, headings, headings] += weight * np.sum(term.by_heading**2, axis=2)
            slices.gradient[first, headings] += weight * np.sum(term.by_heading * term.residual, axis=2)


def _add_camera(slices: Slices, objective: CameraObjective, state: SceneState) -> None:
    """The factors of the camera alone."""
    camera, T, w = state.camera, objective.frames, slices.columns.frame
    place, everything = slices.columns.camera, slice(0, objective.frames)
    H, g = pose_equations(objective._pose_terms(camera, jacobians=True), T, CAMERA)
    slices.add(everything, place, H, g)
    if objective.frame_width and T > 1:
        pose, both = place[:6], np.concatenate([place[:6], place[:6] + w])
        for term in objective._motion_terms(camera, jacobians=True):
            jacobian = camera.poses.point_jacobian(objective.camera.p_camera_imu)
            count, root = T - 2, np.sqrt(term.weight)[:, None, None]
            rows = [c * jacobian[ahead : ahead + count] for ahead, c in enumerate(term.coefficients)]
            J = root * np.concatenate([*rows, term.by_heading[..., None]], axis=2)
            columns = np.concatenate([both, pose + 2 * w, place[6:7]])
            slices.add_rows(slice(0, count), columns, J, root[..., 0] * term.residual)
        velocity = objective.camera.settings.velocity
        now, after = camera.at_frames(slice(0, T - 1)), camera.at_frames(slice(1, T))
        residual = camera_velocity_residual(now, after, objective.step)
        J = np.concatenate(camera_velocity_jacobians(now, after, residual, objective.step), axis=2)
        residual = residual / velocity.sigmas
        root = np.sqrt(velocity.loss.weight(np.linalg.norm(residual, axis=1)))[:, None]
        slices.add_rows(slice(0, T - 1), both, (root / velocity.sigmas)[..., None] * J, root * residual)
    for _, residual, own, J in objective._static_rows(camera):
        slices.add(slice(0, 1), place[own], (J.T @ J)[None], (J.T @ residual)[None])
