"""The whole recording as one objective: all residuals in one evaluation, all frames in one elimination.

GTSAM sees one vector per frame (24 joints and the root) and one for the calibration, and gets ready Hessian factors.
The factors of :mod:`vip_factors.graph.frame` stay the definition, and a test holds both ways equal.
"""

from collections.abc import Mapping

import gtsam
import numpy as np

from vip_factors.body.kinematics import BodyState, forward_kinematics
from vip_factors.body.pose_prior import POSE_SIZE, joint_vector
from vip_factors.body.skeleton import JOINT_COUNT
from vip_factors.factors.gauge_prior import gauge_prior_residual
from vip_factors.factors.heading_prior import heading_prior_residual
from vip_factors.factors.pose_prior import pose_mean_residual
from vip_factors.factors.rotation_prior import rotation_prior_residual
from vip_factors.geometry.rotations import Array, inverse_right_jacobian
from vip_factors.graph.bone_factors import add_bone_factors
from vip_factors.graph.joint_factors import add_joint_factors
from vip_factors.graph.keys import WEARER
from vip_factors.graph.model import InertialModel
from vip_factors.graph.motion import MotionFactors
from vip_factors.graph.parallel import side_by_side
from vip_factors.graph.state import GraphState
from vip_factors.graph.system import ChainSystem
from vip_factors.graph.terms import (
    FRAME,
    ROOT,
    pose_mean_columns,
    width,
)
from vip_factors.graph.walk import WalkSystem, walk_costs
from vip_factors.graph.wearer_residuals import Sites, motion_residuals, pose_residuals

CHUNK = 32  # frames evaluated together: enough to amortise NumPy's calls, few enough to stay in a processor's cache
# One unit of damping, in physical units, is a prior of this size on every step.
STEP_ANGLE = 0.1  # rad
STEP_LENGTH = 0.5  # m


class BatchObjective:
    """Cost, linearisation and retraction of an :class:`~vip_factors.graph.model.InertialModel`."""

    def __init__(self, model: InertialModel, wearer: int = 0) -> None:
        self.model = model
        S = len(model.sensors)
        free = [*[model.free_headings] * S, *[model.free_mountings] * (3 * S), *[model.free_pose_mean] * POSE_SIZE]
        self._static = np.flatnonzero(free) + FRAME  # columns of what all frames share that move
        self._columns = np.concatenate([np.arange(FRAME), self._static])
        shared = FRAME + 4 * S  # headings and mountings come together, whichever is free
        self.used = FRAME if not len(self._static) else max(shared, int(self._columns[-1]) + 1)
        self.sites = Sites.seen_by(model)
        self.frame_keys = [gtsam.symbol("x", wearer * WEARER + t) for t in range(len(model.frames))]
        self.static_key = gtsam.symbol("z", wearer * WEARER)
        later = range(1, len(model.heading_knots) if model.free_headings else 1)
        self.walk_keys = [gtsam.symbol("w", wearer * WEARER + k) for k in later]  # of the later headings

    @property
    def static_columns(self) -> np.ndarray:
        """Those of all columns that stand behind the static key, in its order."""
        return self._static

    # Cost

    def cost(self, state: GraphState, body: BodyState | None = None) -> Mapping[str, float]:
        """Half the sum of squared whitened residuals, losses applied, by factor kind.

        The ``body`` at the state is asked for only where it is at hand, to save its evaluation.
        """
        body = self._body(state) if body is None else body
        p, x = self.sites.on(body), joint_vector(state.R_parent_child)
        kinds = *pose_residuals(self.model, state, body, p, x), *motion_residuals(self.model, state, p)
        costs = {residuals.kind: residuals.cost for residuals in kinds}
        for kind, residual, _, _ in self.static_rows(state):
            costs[kind] = costs.get(kind, 0.0) + 0.5 * float(residual @ residual)
        if self.walk_keys:
            costs |= walk_costs(self.model, state)
        return costs

    def _body(self, state: GraphState) -> BodyState:
        return forward_kinematics(self.model.skeleton, state.R_parent_child, state.p_world_pelvis)

    def _chunks(self) -> list[slice]:
        T = len(self.model.frames)
        return [slice(start, min(start + CHUNK, T)) for start in range(0, T, CHUNK)]

    def static_rows(self, state: GraphState) -> list[tuple[str, Array, list[int], Array]]:
        """Kind, whitened residual, columns and Jacobian of the priors that are not per frame."""
        model, S = self.model, len(self.model.sensors)
        rows: list[tuple[str, Array, list[int], Array]] = []
        if not model.is_beginning:
            return rows
        if model.free_headings and not self.walk_keys:
            residual = heading_prior_residual(state.headings, model.prior_headings) / model.heading_sigmas
            rows.append(("heading prior", residual, list(range(FRAME, FRAME + S)), np.diag(1 / model.heading_sigmas)))
        if model.free_mountings:
            error = rotation_prior_residual(state.R_bone_sensor, model.prior_R_bone_sensor)
            J, each = np.zeros((S, 3, S, 3)), np.arange(S)
            J[each, :, each] = inverse_right_jacobian(error) / model.mounting_sigma[:, None, None]
            residual = (error / model.mounting_sigma[:, None]).ravel()
            rows.append(("mounting prior", residual, list(range(FRAME + S, FRAME + 4 * S)), J.reshape(3 * S, 3 * S)))
        if model.free_pose_mean:
            residual = pose_mean_residual(state.pose_mean, model.prior, model.settings.pose_prior)
            J = model.settings.pose_prior.mean_scale * model.prior.whitening
            rows.append(("pose mean", residual, list(pose_mean_columns(S)), J))
        if model.use_acceleration and model.is_gauge:
            sigma = model.settings.gauge_prior.position_sigma
            residual = gauge_prior_residual(state.p_world_pelvis[0], model.p_world_start) / sigma
            rows.append(("gauge prior", residual, list(range(ROOT, FRAME)), np.eye(3) / sigma))
        return rows

    # Linearisation

    def linearise(self, state: GraphState, body: BodyState | None = None) -> ChainSystem:
        """The normal equations at a state; of its ``body`` as for :meth:`cost`."""
        model, T = self.model, len(self.model.frames)
        body = self._body(state) if body is None else body
        moving = list(motion_residuals(model, state, self.sites.on(body)))
        motion = MotionFactors(moving, T) if moving else None
        tied = model.use_acceleration
        system = ChainSystem.empty(self.frame_keys, self.static_key, FRAME, self._columns, self._damping(), tied)
        if self.walk_keys:
            system.walk = WalkSystem.of(self.model, state, self.walk_keys, FRAME, STEP_ANGLE**-2.0)
        used = self.used

        def add(frames: slice) -> None:
            part = slice(frames.start, min(frames.stop + 2, T))  # two frames on, for the blocks off the diagonal
            beside = body.at(part)
            if used == len(self._columns):  # all columns are free
                H, g = system.own[frames], system.gradient[frames]
            else:
                H, g = np.zeros((frames.stop - frames.start, used, used)), np.zeros((frames.stop - frames.start, used))
            following = None if system.following is None else system.following[frames]
            add_joint_factors(model, state, frames, H, g, following)
            add_bone_factors(model, self.sites, state, beside, frames, motion, system, H, g)
            if used > len(self._columns):
                system.add_frames(frames, H, g)

        side_by_side(add, self._chunks())
        for _, residual, columns, J in self.static_rows(state):
            system.add_first(np.array(columns), J.T @ J, J.T @ residual)
        return system

    def _damping(self) -> Array:
        scale = np.full(width(len(self.model.sensors)), STEP_ANGLE**-2.0)
        scale[ROOT:FRAME] = STEP_LENGTH**-2.0
        return scale[self._columns]

    # Steps

    def retract(self, state: GraphState, delta: gtsam.VectorValues) -> GraphState:
        """The state moved by a solution of the linear system."""
        T, S = len(self.model.frames), len(self.model.sensors)
        static = np.zeros(width(S) - FRAME)
        if len(self._static):
            static[self._static - FRAME] = delta.at(self.static_key)
        steps = np.array([delta.at(key) for key in self.frame_keys])
        joints = steps[:, :ROOT].reshape(T, JOINT_COUNT, 3)
        walk = np.array([delta.at(key) for key in self.walk_keys]) if self.walk_keys else None
        return state.retract(joints, steps[:, ROOT:], static, walk)
