"""The whole recording as one objective: all residuals in one evaluation, all frames in one elimination.

GTSAM sees one vector per frame (24 joints and the root) and one for the calibration: ready linear factors, a
``HessianFactor`` for what concerns a frame alone and a Jacobian over three frames for what ties them together. The
factors of :mod:`vip_factors.graph.frame` stay the definition, and a test holds both ways equal.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import gtsam
import numpy as np

from vip_factors.body.kinematics import BodyState, forward_kinematics
from vip_factors.body.skeleton import JOINT_COUNT
from vip_factors.factors.adapter import Evaluate, custom_factor
from vip_factors.factors.gauge_prior import gauge_prior_residual
from vip_factors.factors.heading_prior import heading_prior_residual
from vip_factors.factors.rotation_prior import rotation_prior_residual
from vip_factors.geometry.rotations import Array, inverse_right_jacobian
from vip_factors.graph.model import BodyPoint, InertialModel
from vip_factors.graph.state import GraphState
from vip_factors.graph.terms import FRAME, ROOT, MotionTerm, PoseTerm, motion_terms, pose_terms

CHUNK = 500  # frames evaluated together: enough to amortise NumPy's calls, few enough to stay in cache and memory
# One unit of damping, in physical units, is a prior of this size on every step.
STEP_ANGLE = 0.1  # rad
STEP_LENGTH = 0.5  # m


class BatchObjective:
    """Cost, linearisation and retraction of an :class:`~vip_factors.graph.model.InertialModel`."""

    def __init__(self, model: InertialModel) -> None:
        self.model = model
        S = len(model.sensors)
        free = [*[model.free_headings] * S, *[model.free_mountings] * (3 * S)]
        self._static = np.flatnonzero(free) + FRAME  # columns of the calibration that move
        self.columns = np.concatenate([np.arange(FRAME), self._static])
        self.frame_keys = [gtsam.symbol("x", t) for t in range(len(model.frames))]
        self._static_key = gtsam.symbol("s", 0)
        self.ordering = gtsam.Ordering()
        for key in self.frame_keys:
            self.ordering.push_back(key)
        if len(self._static):
            self.ordering.push_back(self._static_key)

    # Cost

    def cost(self, state: GraphState) -> Mapping[str, float]:
        """Half the sum of squared whitened residuals, losses applied, by factor kind."""
        costs: dict[str, float] = {}
        body = self._body(state)
        terms: list[PoseTerm | MotionTerm] = list(motion_terms(self.model, state, body, jacobians=False))
        for frames in self._chunks():
            terms += pose_terms(self.model, *_stretch(state, body, frames), frames, jacobians=False)
        for term in terms:
            costs[term.kind] = costs.get(term.kind, 0.0) + term.cost
        for kind, residual, _, _ in self._static_rows(state):
            costs[kind] = costs.get(kind, 0.0) + 0.5 * float(residual @ residual)
        return costs

    def _body(self, state: GraphState) -> BodyState:
        return forward_kinematics(self.model.skeleton, state.R_parent_child, state.p_world_pelvis)

    def _chunks(self) -> list[slice]:
        T = len(self.model.frames)
        return [slice(start, min(start + CHUNK, T)) for start in range(0, T, CHUNK)]

    def _static_rows(self, state: GraphState) -> list[tuple[str, Array, list[int], Array]]:
        """Kind, whitened residual, columns and Jacobian of the priors that are not per frame."""
        model, S, rows = self.model, len(self.model.sensors), []
        if model.free_headings:
            residual = heading_prior_residual(state.headings, model.prior_headings) / model.heading_sigmas
            rows.append(("heading prior", residual, list(range(FRAME, FRAME + S)), np.diag(1 / model.heading_sigmas)))
        if model.free_mountings:
            error = rotation_prior_residual(state.R_bone_sensor, model.prior_R_bone_sensor)
            J = np.zeros((3 * S, 3 * S))
            for s, block in enumerate(inverse_right_jacobian(error) / model.mounting_sigma[:, None, None]):
                J[3 * s : 3 * s + 3, 3 * s : 3 * s + 3] = block
            residual = (error / model.mounting_sigma[:, None]).ravel()
            rows.append(("mounting prior", residual, list(range(FRAME + S, FRAME + 4 * S)), J))
        if model.use_acceleration:
            sigma = model.settings.gauge_prior.position_sigma
            residual = gauge_prior_residual(state.p_world_pelvis[0], model.p_world_start) / sigma
            rows.append(("gauge prior", residual, list(range(ROOT, FRAME)), np.eye(3) / sigma))
        return rows

    # Linearisation

    def linearise(self, state: GraphState) -> "BatchSystem":
        """The normal equations at a state."""
        T, width = len(self.model.frames), FRAME + 4 * len(self.model.sensors)
        body = self._body(state)
        free = len(self.columns)
        hessian, gradient = np.empty((T, free, free)), np.empty((T, free))
        for frames in self._chunks():
            H, g = np.zeros((frames.stop - frames.start, width, width)), np.zeros((frames.stop - frames.start, width))
            for term in pose_terms(self.model, *_stretch(state, body, frames), frames, jacobians=True):
                _accumulate(H, g, term)
            hessian[frames] = H if free == width else H[:, self.columns[:, None], self.columns]
            gradient[frames] = g[:, self.columns]
        self._add_static(state, hessian[0], gradient[0], width)
        terms = list(motion_terms(self.model, state, body, jacobians=True))
        return BatchSystem(
            hessian, gradient, self._motion_factors(body, terms), self.frame_keys, self._static_key, self._damping()
        )

    def _add_static(self, state: GraphState, hessian: Array, gradient: Array, width: int) -> None:
        """Add the priors of the calibration and the gauge to the first frame's equations."""
        H, g = np.zeros((width, width)), np.zeros(width)
        for _, residual, columns, J in self._static_rows(state):
            H[np.ix_(columns, columns)] += J.T @ J
            g[columns] += J.T @ residual
        hessian += H[np.ix_(self.columns, self.columns)]
        gradient += g[self.columns]

    def _damping(self) -> Array:
        scale = np.full(FRAME + 4 * len(self.model.sensors), STEP_ANGLE**-2.0)
        scale[ROOT:FRAME] = STEP_LENGTH**-2.0
        return scale[self.columns]

    def _motion_factors(self, body: BodyState, terms: list[MotionTerm]) -> gtsam.GaussianFactorGraph:
        if not terms:
            return gtsam.GaussianFactorGraph()
        points = [*self.model.sensors, *self.model.contacts]
        jacobians = [_point_jacobian(body, points[term.point]) for term in terms]
        roots = [np.sqrt(term.weight) for term in terms]
        residual = np.concatenate([w[:, None] * term.residual for w, term in zip(roots, terms, strict=True)], axis=1)
        blocks = [
            np.concatenate(
                [
                    (term.coefficients[k] * w)[:, None, None] * J[k : len(J) - 2 + k]
                    for J, w, term in zip(jacobians, roots, terms, strict=True)
                ],
                axis=1,
            )
            for k in range(3)
        ]
        static = self._heading_block(terms, roots, residual.shape)
        return _linear_factors(residual, blocks, static, self.frame_keys, self._static_key)

    def _heading_block(self, terms: list[MotionTerm], roots: list[Array], shape: tuple[int, ...]) -> Array | None:
        if not len(self._static):
            return None
        block = np.zeros((*shape, 4 * len(self.model.sensors)))
        for row, (w, term) in enumerate(zip(roots, terms, strict=True)):
            if term.by_heading is not None:
                block[:, 3 * row : 3 * row + 3, term.point] = w[:, None] * term.by_heading
        return block[:, :, self._static - FRAME]

    # Steps

    def retract(self, state: GraphState, delta: gtsam.VectorValues) -> GraphState:
        """The state moved by a solution of the linear system."""
        T, S = len(self.model.frames), len(self.model.sensors)
        static = np.zeros(4 * S)
        if len(self._static):
            static[self._static - FRAME] = delta.at(self._static_key)
        steps = np.array([delta.at(key) for key in self.frame_keys])
        joints = steps[:, :ROOT].reshape(T, JOINT_COUNT, 3)
        return state.retract(joints, steps[:, ROOT:], static[:S], static[S:].reshape(S, 3))


@dataclass
class BatchSystem:
    """Normal equations per frame, and factors over three frames."""

    hessian: Array
    gradient: Array
    motion: gtsam.GaussianFactorGraph
    frame_keys: list[int]
    static_key: int
    damping: Array

    def damped(self, damping: float) -> gtsam.GaussianFactorGraph:
        """All factors, with ``damping`` times the unit of damping on the diagonal."""
        graph = self.motion.clone() if self.motion.size() else gtsam.GaussianFactorGraph()
        extra = damping * self.damping
        for t, (key, H, g) in enumerate(zip(self.frame_keys, self.hessian, self.gradient, strict=True)):
            static = FRAME if t else None  # the calibration's damping is added once, with the first frame
            G = np.array(H, order="F")
            G.ravel(order="K")[:: len(G) + 1][:static] += extra[:static]
            if len(G) == FRAME:
                graph.push_back(gtsam.HessianFactor(key, G, -g, 0.0))
            else:
                graph.push_back(
                    gtsam.HessianFactor(
                        key, self.static_key, G[:FRAME, :FRAME], G[:FRAME, FRAME:], -g[:FRAME], G[FRAME:, FRAME:],
                        -g[FRAME:], 0.0,
                    )
                )
        return graph


def _stretch(state: GraphState, body: BodyState, frames: slice) -> tuple[GraphState, BodyState]:
    part = GraphState(state.R_parent_child[frames], state.p_world_pelvis[frames], state.headings, state.R_bone_sensor)
    return part, BodyState(body.R_world_bone[frames], body.p_world_joint[frames])


def _accumulate(H: Array, g: Array, term: PoseTerm) -> None:
    """Add a term to the normal equations of each frame."""
    assert term.jacobian is not None
    weighted = (term.weight[:, None, None] * term.jacobian).swapaxes(1, 2)
    columns = np.array(term.columns)
    H[:, columns[:, None], columns] += weighted @ term.jacobian
    g[:, columns] += np.einsum("tkm,tm->tk", weighted, term.residual)


def _point_jacobian(body: BodyState, point: BodyPoint) -> Array:
    """Derivative ``(T, 3, 75)`` of a point's position by its frame's tangent."""
    chain, J = body.point_jacobian(point.bone, point.p_bone_point)
    full = np.zeros((len(J), 3, FRAME))
    for index, joint in enumerate(chain):
        full[:, :, 3 * joint : 3 * joint + 3] = J[:, index]
    full[:, :, ROOT:] = np.eye(3)
    return full


def _linear_factors(
    residual: Array, blocks: list[Array], static: Array | None, frame_keys: list[int], static_key: int
) -> gtsam.GaussianFactorGraph:
    """One linear factor per inner frame, over three frames (and the calibration)."""
    graph = gtsam.GaussianFactorGraph()
    noise = gtsam.noiseModel.Unit.Create(residual.shape[1])
    if static is None:
        for t, r in enumerate(residual):
            A = [block[t] for block in blocks]
            graph.push_back(
                gtsam.JacobianFactor(
                    frame_keys[t], A[0], frame_keys[t + 1], A[1], frame_keys[t + 2], A[2], -r, noise
                )
            )
        return graph
    # gtsam's Python constructors take three keys at most; a custom factor takes any number.
    width = static.shape[2]
    zeros = gtsam.Values()
    for key in frame_keys:
        zeros.insert(key, np.zeros(FRAME))
    zeros.insert(static_key, np.zeros(width))
    nonlinear = gtsam.NonlinearFactorGraph()
    for t in range(len(residual)):
        A = [*(block[t] for block in blocks), static[t]]
        keys = [frame_keys[t], frame_keys[t + 1], frame_keys[t + 2], static_key]
        nonlinear.push_back(custom_factor("motion", noise, keys, [FRAME] * 3 + [width], _constant(residual[t], A)))
    return nonlinear.linearize(zeros)


def _constant(residual: Array, jacobians: list[Array]) -> Evaluate:
    return lambda _: (residual, jacobians)
