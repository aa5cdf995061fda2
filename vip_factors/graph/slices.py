"""A stretch of frames as normal equations, slice by slice: each holds the factors whose first frame is its own.

A smoother that goes on where it left off needs them apart: what is left behind an eliminated frame then holds every
factor that touches it, and a later linearisation holds all the others.
"""

from dataclasses import dataclass

import gtsam
import numpy as np

from vip_factors.body.kinematics import BodyState, forward_kinematics
from vip_factors.factors.camera_velocity import camera_velocity_jacobians, camera_velocity_residual
from vip_factors.factors.smoothness import turn_jacobians
from vip_factors.geometry.rotations import Array, log, transpose
from vip_factors.graph.batch import BatchObjective, _point_jacobians, pose_equations
from vip_factors.graph.camera_batch import CameraObjective
from vip_factors.graph.evaluated import MotionTerm
from vip_factors.graph.hessian import coupling_factor
from vip_factors.graph.reprojection_batch import reprojection_equations
from vip_factors.graph.scene_model import SceneModel
from vip_factors.graph.scene_state import CAMERA, SceneState
from vip_factors.graph.smooth import JOINTS, _rows, is_smoothed
from vip_factors.graph.state import GraphState
from vip_factors.graph.terms import FRAME, motion_terms, pose_terms


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
    """The slices of a stretch: Hessians ``(T, n, n)`` and gradients ``(T, n)``."""

    def __init__(self, columns: SliceColumns, frames: int) -> None:
        self.columns = columns
        self.hessian = np.zeros((frames, columns.width, columns.width))
        self.gradient = np.zeros((frames, columns.width))

    def add(self, first: slice, place: np.ndarray, hessian: Array, gradient: Array) -> None:
        """Add ``(t, k, k)`` and ``(t, k)`` at ``k`` columns of the slices of a stretch; columns below zero are left out."""
        inside = np.flatnonzero(place >= 0)
        if len(inside) < len(place):
            place, hessian, gradient = place[inside], hessian[:, inside[:, None], inside], gradient[:, inside]
        self.hessian[first, place[:, None], place] += hessian
        self.gradient[first, place] += gradient

    def add_rows(self, first: slice, place: np.ndarray, jacobian: Array, residual: Array) -> None:
        """Add weighted rows ``(t, m, k)`` with residuals ``(t, m)``."""
        transposed = transpose(jacobian)
        self.add(first, place, transposed @ jacobian, (transposed @ residual[..., None])[..., 0])

    def factors(self, t: int, keys: tuple[int, int, int, int], value: Array) -> gtsam.GaussianFactorGraph:
        """One slice as factors on its frame, the two after it and the shared variables, around the coordinates ``value``.

        The slice is a quadratic in steps from ``value`` ``(n,)``; the factors are in the coordinates themselves.
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
                    *keys[:3], H[now, now], H[now, after], H[now, last], -g[now],
                    H[after, after], H[after, last], -g[after], H[last, last], -g[last], 0.0,
                )
            )  # fmt: skip
        if self.columns.static:
            graph.push_back(gtsam.HessianFactor(keys[3], H[shared, shared], -g[shared], 0.0))
            for key, part, there in zip(keys, parts, (True, *reach), strict=False):
                if there and H[part, shared].any():
                    graph.push_back(coupling_factor(key, keys[3], H[part, shared]))
        return graph


def scene_slices(model: SceneModel, state: SceneState, columns: SliceColumns) -> Slices:
    """The slices of a scene's problem at a state."""
    slices = Slices(columns, model.frames)
    camera = CameraObjective(model.camera, model.frames, model.step)
    for number, (wearer, own) in enumerate(zip(model.wearers, state.wearers, strict=True)):
        body = forward_kinematics(wearer.skeleton, own.R_parent_child, own.p_world_pelvis)
        objective = BatchObjective(wearer, number)
        _add_wearer(slices, objective, own, body, columns.wearers[number])
        _add_views(slices, model, number, state, body)
    _add_camera(slices, camera, state)
    return slices


def _add_wearer(
    slices: Slices, objective: BatchObjective, state: GraphState, body: BodyState, place: np.ndarray
) -> None:
    model, T, w = objective.model, len(body.p_world_joint), slices.columns.frame
    used = np.concatenate([np.arange(FRAME), objective.static_columns])
    everything = slice(0, T)
    H, g = pose_equations(pose_terms(model, state, body, everything, jacobians=True), T, int(used[-1]) + 1)
    slices.add(everything, place, H[:, used[:, None], used], g[:, used])
    terms = list(motion_terms(model, state, body, jacobians=True))
    if terms:
        jacobian = _point_jacobians(model, body, terms).reshape(T, len(terms), 3, FRAME)
        headings = place[FRAME:] if model.free_headings else place[:0]
        _add_motion(slices, terms, jacobian, place[:FRAME], headings)
    if is_smoothed(model):
        R = state.R_parent_child[:, 1:]
        turn = log(transpose(R[:-1]) @ R[1:])
        weighted = model.settings.smoothness.time / model.frames.step * model.prior.whitening
        rows = np.concatenate([_rows(weighted, J) for J in turn_jacobians(turn)], axis=2)
        joints = place[JOINTS]
        slices.add_rows(
            slice(0, T - 1), np.concatenate([joints, joints + w]), rows, turn.reshape(T - 1, -1) @ weighted.T
        )
    for _, residual, own, J in objective._static_rows(state):
        there = np.searchsorted(used, own)
        slices.add(slice(0, 1), place[there], (J.T @ J)[None], (J.T @ residual)[None])


def _add_motion(
    slices: Slices, terms: list[MotionTerm], jacobian: Array, place: np.ndarray, headings: np.ndarray
) -> None:
    """Factors over three frames, or over the last two of three; ``jacobian`` is ``(T, m, 3, k)`` of their points."""
    w, T = slices.columns.frame, len(jacobian)
    for ahead in (2, 1):  # frames after the first
        chosen = [m for m, term in enumerate(terms) if (term.start == 1) == (ahead == 2)]
        count = T - ahead
        if not chosen or count <= 0:
            continue
        some = [terms[m] for m in chosen]
        root = np.sqrt(np.stack([term.weight for term in some], axis=1))  # (t, m)
        parts = []
        for later in range(ahead + 1):
            c = np.array([term.coefficients[later + 2 - ahead] for term in some])
            parts.append((root * c)[..., None, None] * jacobian[later : later + count, chosen])
        columns = [place + w * later for later in range(ahead + 1)]
        turned = [(index, term) for index, term in enumerate(some) if term.by_heading is not None]
        if turned and len(headings):
            by_heading = np.zeros((count, len(some), 3, len(turned)))
            for column, (index, term) in enumerate(turned):
                by_heading[:, index, :, column] = root[:, index, None] * term.by_heading
            parts.append(by_heading)
            columns.append(headings[[term.point for _, term in turned]])
        rows = np.concatenate(parts, axis=3)
        residual = root[..., None] * np.stack([term.residual for term in some], axis=1)
        rows = rows.reshape(count, 3 * len(some), -1)
        slices.add_rows(slice(0, count), np.concatenate(columns), rows, residual.reshape(count, -1))


def _add_views(slices: Slices, model: SceneModel, number: int, state: SceneState, body: BodyState) -> None:
    columns, everything = slices.columns, slice(0, model.frames)
    frame = columns.wearers[number][:FRAME]
    cameras = [(model.camera, state.camera, model.views[number], columns.camera)]
    nothing = np.full(CAMERA, -1)
    cameras += [(known.problem, known.state, known.views[number], nothing) for known in model.further]
    for problem, camera, view, own in cameras:
        if not view.seen.any():
            continue
        equations = reprojection_equations(view, problem, camera.at_frames(everything), camera.clock, body)
        slices.add(everything, np.concatenate([frame, own]), equations.hessian, equations.gradient)


def _add_camera(slices: Slices, objective: CameraObjective, state: SceneState) -> None:
    camera, T, w = state.camera, objective.frames, slices.columns.frame
    place, everything = slices.columns.camera, slice(0, objective.frames)
    H, g = pose_equations(objective._pose_terms(camera, jacobians=True), T, CAMERA)
    slices.add(everything, place, H, g)
    if objective.frame_width:
        terms = list(objective._motion_terms(camera, jacobians=True))
        if terms:
            jacobian = camera.poses.point_jacobian(objective.camera.p_camera_imu)[:, None]
            _add_motion(slices, terms, jacobian, place[:6], place[6:7])
        if T > 1:
            velocity = objective.camera.settings.velocity
            now, after = camera.at_frames(slice(0, T - 1)), camera.at_frames(slice(1, T))
            residual = camera_velocity_residual(now, after, objective.step)
            J = np.concatenate(camera_velocity_jacobians(now, after, residual, objective.step), axis=2)
            residual = residual / velocity.sigmas
            root = np.sqrt(velocity.loss.weight(np.linalg.norm(residual, axis=1)))[:, None]
            rows = (root / velocity.sigmas)[..., None] * J
            slices.add_rows(slice(0, T - 1), np.concatenate([place[:6], place[:6] + w]), rows, root * residual)
    for _, residual, own, J in objective._static_rows(camera):
        slices.add(slice(0, 1), place[own], (J.T @ J)[None], (J.T @ residual)[None])
