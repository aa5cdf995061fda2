"""GTSAM factors of the registry's terms: each is one residual of a term, evaluated at GTSAM's values."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import gtsam
import numpy as np

from vip_factors.body.kinematics import twists_at
from vip_factors.body.skeleton import JOINT_COUNT, JOINT_NAMES, ancestors, joint_index
from vip_factors.display import Summarised
from vip_factors.errors import SolveError
from vip_factors.factor_graph.variables import HEADINGS, JOINT, POSES, ROOT, Variable, state_of
from vip_factors.factor_settings import Loss, RobustLoss
from vip_factors.geometry.rotations import Array
from vip_factors.problem.layout import Layout, Owner, OwnerId
from vip_factors.problem.scene import SceneProblem
from vip_factors.problem.state import SceneState
from vip_factors.problem.variables import camera_owner
from vip_factors.terms.equations import (
    BoneEquations,
    DenseEquations,
    DifferenceEquations,
    Equations,
    JacobianBlock,
    JointEquations,
    Term,
    WalkEquations,
)
from vip_factors.terms.evaluation import CameraEvaluation, ViewEvaluation, WearerEvaluation
from vip_factors.terms.registry import CAMERA_TERMS, VIEW_TERMS, WEARER_TERMS

Evaluation = WearerEvaluation | ViewEvaluation | CameraEvaluation
Blocks = list[tuple[Variable, Array]]


@dataclass(frozen=True, repr=False)
class TermFactor(Summarised):
    """GTSAM factor with its kind and variables."""

    kind: str
    factor: gtsam.NonlinearFactor
    variables: tuple[Variable, ...]

    @property
    def frames(self) -> range:
        """Frames of the factor: those of bodies, else those of the camera, else the first."""
        numbers = [variable.frame for variable in self.variables if variable.is_of_a_frame]
        numbers = numbers or [variable.frame for variable in self.variables if variable.is_of_the_camera_path]
        return range(min(numbers), max(numbers) + 1) if numbers else range(1)


def term_factors(problem: SceneProblem, state: SceneState, layout: Layout) -> Iterator[TermFactor]:
    """Yield all factors of a problem that exist at ``state``, by their first frame."""
    for t in range(problem.frames):
        for wearer in range(len(problem.wearers)):
            if layout.chain_of(OwnerId(Owner.WEARER, wearer)) is not None:
                for term in WEARER_TERMS:
                    yield from _factors_of_term(term, partial(_wearer, number=wearer), problem, state, layout, t)
            for camera in range(len(problem.cameras)):
                for view_term in VIEW_TERMS:
                    view = partial(_view, number=wearer, camera=camera)
                    yield from _factors_of_term(view_term, view, problem, state, layout, t)
        for camera in range(len(problem.cameras)):
            for camera_term in CAMERA_TERMS:
                yield from _factors_of_term(camera_term, partial(_camera, number=camera), problem, state, layout, t)


def _wearer(problem: SceneProblem, state: SceneState, number: int) -> WearerEvaluation:
    return WearerEvaluation(number, problem.wearers[number], state.wearers[number])


def _view(problem: SceneProblem, state: SceneState, number: int, camera: int) -> ViewEvaluation:
    viewpoint = problem.viewpoints(state)[camera]
    wearer = _wearer(problem, state, number)
    offsets = state.detector.keypoint_offsets, problem.free_keypoints
    return ViewEvaluation(
        wearer, camera_owner(camera), viewpoint.problem, viewpoint.state, viewpoint.views[number], *offsets
    )


def _camera(problem: SceneProblem, state: SceneState, number: int) -> CameraEvaluation:
    offsets = state.detector.keypoint_offsets, problem.free_keypoints
    camera, camera_state = problem.cameras[number], state.cameras[number]
    return CameraEvaluation(number, camera, camera_state, problem.frames, problem.step, *offsets)


def _factors_of_term(
    term: Term,
    evaluate_at: Callable[[SceneProblem, SceneState], Evaluation],
    problem: SceneProblem,
    state: SceneState,
    layout: Layout,
    t: int,
) -> Iterator[TermFactor]:
    """Yield the factors of one term whose first frame is ``t``, evaluated in a window of their frames."""
    if t + term.reach >= problem.frames:
        return
    # two frames at least: a single one has no time step
    begin = max(0, min(t, problem.frames - 2))
    frames = slice(begin, min(max(t + term.reach + 1, begin + 2), problem.frames))
    window = _Window(
        term, evaluate_at, problem.window(frames), state.window(frames), layout, begin, slice(t - begin, t - begin + 1)
    )
    evaluation = window.evaluate_at(window.problem, window.state)
    equations = window.equations(evaluation)
    if equations is None:
        return
    rows = 1 if not isinstance(equations, WalkEquations) else len(equations.residual)
    confidence = np.broadcast_to(equations.confidence, equations.residual.shape[:2])
    for row in range(rows):
        for n in np.flatnonzero(confidence[row] > 0).tolist():
            factor = window.factor(evaluation, equations, row, n)
            if factor is not None:
                yield factor


@dataclass(frozen=True)
class _Window:
    """Term in the frames of the factors with one first frame."""

    term: Term
    evaluate_at: Callable[[SceneProblem, SceneState], Evaluation]
    problem: SceneProblem
    state: SceneState
    layout: Layout
    begin: int
    stretch: slice

    def equations(self, evaluation: Evaluation) -> Equations | None:
        return next(iter(self.term.equations(evaluation, self.stretch)), None)

    def factor(self, evaluation: Evaluation, equations: Equations, row: int, n: int) -> TermFactor | None:
        """Make one of the factors; None if all its variables are constant."""
        variables = tuple(variable for variable, _ in self._blocks(equations, evaluation, row, n))
        if not variables:
            return None
        confidence = np.broadcast_to(equations.confidence, equations.residual.shape[:2])[row, n]
        root = float(np.sqrt(confidence))

        def evaluate(values: gtsam.Values, derived: bool) -> tuple[Array, list[Array]]:
            evaluation = self.evaluate_at(self.problem, state_of(values, self.state, variables, self.begin))
            eq = self.equations(evaluation)
            assert eq is not None
            blocks = [root * block for _, block in self._blocks(eq, evaluation, row, n)] if derived else []
            return root * eq.residual[row, n], blocks

        noise = noise_model(equations.loss, equations.residual.shape[2])
        keys, widths = [variable.key for variable in variables], [variable.width for variable in variables]
        return TermFactor(self.term.kind, custom_factor(self.term.kind, noise, keys, widths, evaluate), variables)

    # Derivatives by single variables

    def _blocks(self, eq: Equations, evaluation: Evaluation, row: int, n: int) -> Blocks:
        match eq:
            case BoneEquations():
                by_twist, other_blocks = eq.derivatives()
                bone_blocks = self._by_bone(eq, evaluation, by_twist[row, n], eq.bones[n], 0)
                return bone_blocks + self._by_blocks(other_blocks, row, n)
            case DifferenceEquations():
                blocks: Blocks = []
                for ahead, c in enumerate(eq.coefficients):
                    arm = eq.arms[row + ahead, n]
                    bone = eq.bones[n] if arm.any() else None
                    blocks += self._by_bone(eq, evaluation, c * twists_at(arm), bone, ahead)
                return [*blocks, *self._by_blocks(eq.blocks(), row, n)]
            case JointEquations():
                return self._by_joints(eq, row, n)
            case DenseEquations():
                return self._by_blocks(eq.blocks(), row, n)
            case WalkEquations():
                wearer, root = eq.owner.number, eq.root[row, n].reshape(1, 1)
                signs = ((row, -root), (row + 1, root))
                return [(Variable(HEADINGS, wearer, 0, n, step), block) for step, block in signs]

    def _by_bone(
        self,
        eq: BoneEquations | DifferenceEquations,
        evaluation: Evaluation,
        by_twist: Array,
        bone: int | None,
        ahead: int,
    ) -> Blocks:
        """Derivatives by the joints above a bone and by the root (not for rotations); None: the root alone."""
        if self.layout.chain_of(eq.owner) is None:
            return []
        number, t = eq.owner.number, self.stretch.start + ahead
        frame, k = self.begin + t, by_twist.shape[1]
        joints: tuple[int, ...] = ancestors(bone) if bone is not None else ()
        assert not isinstance(evaluation, CameraEvaluation)
        body = evaluation.body if isinstance(evaluation, WearerEvaluation) else evaluation.wearer.body
        screws = body.screws[t, :, :k]
        blocks = [(Variable(JOINT, number, frame, joint), by_twist @ screws[joint]) for joint in joints]
        if k == 6:
            blocks.append((Variable(ROOT, number, frame), by_twist @ screws[JOINT_COUNT]))
        return blocks

    def _by_joints(self, eq: JointEquations, row: int, n: int) -> Blocks:
        number, frame = eq.owner.number, self.begin + eq.first_frame + row
        jacobians = eq.by_joints()
        if eq.whitening is None:
            m = eq.residual.shape[2]
            joint, axis = divmod(n * m, 3)
            block = jacobians[0][row, joint, axis : axis + m]
            return [(Variable(JOINT, number, frame, joint + 1), block)]
        columns = eq.whitening.reshape(len(eq.whitening), JOINT_COUNT - 1, 3).swapaxes(0, 1)
        blocks = [
            (Variable(JOINT, number, frame + ahead, joint + 1), columns[joint] @ D[row, joint])
            for ahead, D in enumerate(jacobians)
            for joint in range(JOINT_COUNT - 1)
        ]
        if eq.mean is not None and self.layout.columns_of(eq.owner, eq.mean) is not None:
            blocks.append((Variable(eq.mean, number), -eq.whitening))
        return blocks

    def _by_blocks(self, jacobians: Sequence[JacobianBlock], row: int, n: int) -> Blocks:
        blocks: Blocks = []
        for block in jacobians:
            if self.layout.columns_of(block.owner, block.block) is not None:
                blocks += self._by_block(block, block.jacobian[row, n], n)
        return blocks

    def _by_block(self, block: JacobianBlock, jacobian: Array, n: int) -> Blocks:
        number = block.owner.number
        frame = self.begin + self.stretch.start + block.ahead
        if block.block in JOINT_NAMES:
            return [(Variable(JOINT, number, frame, joint_index(block.block)), jacobian)]
        if block.block == ROOT:
            return [(Variable(ROOT, number, frame), jacobian)]
        if block.block == POSES:
            return [(Variable(POSES, number, frame if self.problem.cameras[number].moving else 0), jacobian)]
        width, step = Variable(block.block).width, 0
        if block.block == HEADINGS:  # the heading of the factor's first frame
            step = int(self.problem.wearers[block.owner.number].heading_numbers(self.stretch)[0])
        indices = [n] if block.is_per_factor else range(jacobian.shape[1] // width)
        return [
            (Variable(block.block, number, 0, index, step), jacobian[:, place * width : (place + 1) * width])
            for place, index in enumerate(indices)
        ]


def noise_model(loss: RobustLoss, rows: int) -> gtsam.noiseModel.Base:
    """Make the noise model of whitened residuals with a robust loss."""
    unit, k = gtsam.noiseModel.Unit.Create(rows), np.asarray(loss.k).item()
    if loss.loss is Loss.HUBER:
        return gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Huber.Create(k), unit)
    if loss.loss is Loss.CAUCHY:
        return gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Cauchy.Create(k), unit)
    return unit


Evaluate = Callable[[gtsam.Values, bool], tuple[Array, list[Array]]]
"""Function of values, and of whether Jacobians are required; returns residual ``(m,)`` and Jacobians ``(m, d)``."""


def custom_factor(
    name: str, noise: gtsam.noiseModel.Base, keys: Sequence[int], dimensions: Sequence[int], evaluate: Evaluate
) -> gtsam.CustomFactor:
    """Make a GTSAM factor from a function, which must not reference the graph: it would never be freed.

    ``name`` is the factor's kind, for messages; ``dimensions`` are those of the variables' tangents.

    Raises:
        SolveError: from inside GTSAM, if ``evaluate`` returns wrong shapes or numbers that are not finite.
    """
    rows = noise.dim()

    def callback(_: gtsam.CustomFactor, values: gtsam.Values, H: list[Array] | None) -> Array:
        residual, jacobians = evaluate(values, H is not None)
        if residual.shape != (rows,) or not np.all(np.isfinite(residual)):
            raise SolveError(f"{name} factor: residual {residual}: expected {rows} finite numbers")
        if H is not None:
            for index, (jacobian, columns) in enumerate(zip(jacobians, dimensions, strict=True)):
                if jacobian.shape != (rows, columns) or not np.all(np.isfinite(jacobian)):
                    raise SolveError(
                        f"{name} factor: Jacobian {index} has shape {jacobian.shape}: expected a finite "
                        f"({rows}, {columns})"
                    )
                H[index] = np.asfortranarray(jacobian)
        return residual

    return gtsam.CustomFactor(noise, list(keys), callback)
