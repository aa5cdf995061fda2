"""GTSAM factors out of the registry: each is one residual of a term's equations, evaluated at GTSAM's values."""

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
    """A GTSAM factor and what it stands for."""

    kind: str
    factor: gtsam.NonlinearFactor
    variables: tuple[Variable, ...]

    @property
    def frames(self) -> range:
        """The frames that it sees: those of bodies, or else those of the camera; of none, the first."""
        numbers = [variable.frame for variable in self.variables if variable.is_of_a_frame]
        numbers = numbers or [variable.frame for variable in self.variables if variable.is_of_the_camera_path]
        return range(min(numbers), max(numbers) + 1) if numbers else range(1)


def term_factors(problem: SceneProblem, state: SceneState, layout: Layout) -> Iterator[TermFactor]:
    """All factors of a problem, by their first frame; ``state`` says which exist, and holds what does not move."""
    for t in range(problem.frames):
        for wearer in range(len(problem.wearers)):
            if layout.chain_of(OwnerId(Owner.WEARER, wearer)) is not None:
                for term in WEARER_TERMS:
                    yield from _of_term(term, partial(_wearer, number=wearer), problem, state, layout, t)
            for camera in range(len(problem.cameras)):
                for view_term in VIEW_TERMS:
                    view = partial(_view, number=wearer, camera=camera)
                    yield from _of_term(view_term, view, problem, state, layout, t)
        for camera in range(len(problem.cameras)):
            for camera_term in CAMERA_TERMS:
                yield from _of_term(camera_term, partial(_camera, number=camera), problem, state, layout, t)


def _wearer(problem: SceneProblem, state: SceneState, number: int) -> WearerEvaluation:
    return WearerEvaluation(number, problem.wearers[number], state.wearers[number])


def _view(problem: SceneProblem, state: SceneState, number: int, camera: int) -> ViewEvaluation:
    one = problem.viewpoints(state)[camera]
    wearer = _wearer(problem, state, number)
    offsets = state.detector.keypoint_offsets, problem.free_keypoints
    return ViewEvaluation(wearer, camera_owner(camera), one.problem, one.state, one.views[number], *offsets)


def _camera(problem: SceneProblem, state: SceneState, number: int) -> CameraEvaluation:
    offsets = state.detector.keypoint_offsets, problem.free_keypoints
    camera, own = problem.cameras[number], state.cameras[number]
    return CameraEvaluation(number, camera, own, problem.frames, problem.step, *offsets)


def _of_term(
    term: Term, at: Callable[[SceneProblem, SceneState], Evaluation], problem: SceneProblem, state: SceneState,
    layout: Layout, t: int,
) -> Iterator[TermFactor]:  # fmt: skip
    """The factors of one term whose first frame is ``t``, each by itself in the few frames that it sees."""
    if t + term.reach >= problem.frames:
        return
    # Two frames at least: a single one does not say how far frames are apart.
    begin = max(0, min(t, problem.frames - 2))
    frames = slice(begin, min(max(t + term.reach + 1, begin + 2), problem.frames))
    window = _Window(
        term, at, problem.window(frames), state.window(frames), layout, begin, slice(t - begin, t - begin + 1)
    )
    here = window.at(window.problem, window.state)
    equations = window.equations(here)
    if equations is None:
        return
    rows = 1 if not isinstance(equations, WalkEquations) else len(equations.residual)
    confidence = np.broadcast_to(equations.confidence, equations.residual.shape[:2])
    for row in range(rows):
        for n in np.flatnonzero(confidence[row] > 0).tolist():
            found = window.factor(here, equations, row, n)
            if found is not None:
                yield found


@dataclass(frozen=True)
class _Window:
    """A term in the few frames that factors of one first frame see."""

    term: Term
    at: Callable[[SceneProblem, SceneState], Evaluation]
    problem: SceneProblem
    state: SceneState
    layout: Layout
    begin: int
    first: slice

    def equations(self, here: Evaluation) -> Equations | None:
        return next(iter(self.term.equations(here, self.first)), None)

    def factor(self, here: Evaluation, equations: Equations, row: int, n: int) -> TermFactor | None:
        """One of the factors; None if nothing that it sees moves."""
        variables = tuple(variable for variable, _ in self._blocks(equations, here, row, n))
        if not variables:
            return None
        confidence = np.broadcast_to(equations.confidence, equations.residual.shape[:2])[row, n]
        root = float(np.sqrt(confidence))

        def evaluate(values: gtsam.Values, derived: bool) -> tuple[Array, list[Array]]:
            at = self.at(self.problem, state_of(values, self.state, variables, self.begin))
            found = self.equations(at)
            assert found is not None
            blocks = [root * block for _, block in self._blocks(found, at, row, n)] if derived else []
            return root * found.residual[row, n], blocks

        noise = noise_model(equations.loss, equations.residual.shape[2])
        keys, widths = [one.key for one in variables], [one.width for one in variables]
        return TermFactor(self.term.kind, custom_factor(self.term.kind, noise, keys, widths, evaluate), variables)

    # Derivatives by single variables

    def _blocks(self, eq: Equations, at: Evaluation, row: int, n: int) -> Blocks:
        match eq:
            case BoneEquations():
                by_twist, others = eq.derivatives()
                return [*self._by_bone(eq, at, by_twist[row, n], eq.bones[n], 0), *self._by_blocks(others, row, n)]
            case DifferenceEquations():
                blocks: Blocks = []
                for ahead, c in enumerate(eq.coefficients):
                    arm = eq.arms[row + ahead, n]
                    blocks += self._by_bone(eq, at, c * twists_at(arm), eq.bones[n] if arm.any() else None, ahead)
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
        self, eq: BoneEquations | DifferenceEquations, at: Evaluation, by_twist: Array, bone: int | None, ahead: int
    ) -> Blocks:
        """By the joints above a bone, and by the root if more than a turn is seen; None: the root alone."""
        if self.layout.chain_of(eq.owner) is None:
            return []
        number, t = eq.owner.number, self.first.start + ahead
        frame, k = self.begin + t, by_twist.shape[1]
        joints: tuple[int, ...] = ancestors(bone) if bone is not None else ()
        assert not isinstance(at, CameraEvaluation)
        body = at.body if isinstance(at, WearerEvaluation) else at.wearer.body
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
        for one in jacobians:
            if self.layout.columns_of(one.owner, one.block) is not None:
                blocks += self._by_block(one, one.jacobian[row, n], n)
        return blocks

    def _by_block(self, one: JacobianBlock, jacobian: Array, n: int) -> Blocks:
        number = one.owner.number
        frame = self.begin + self.first.start + one.ahead
        if one.block in JOINT_NAMES:
            return [(Variable(JOINT, number, frame, joint_index(one.block)), jacobian)]
        if one.block == ROOT:
            return [(Variable(ROOT, number, frame), jacobian)]
        if one.block == POSES:
            return [(Variable(POSES, number, frame if self.problem.cameras[number].moving else 0), jacobian)]
        width, step = Variable(one.block).width, 0
        if one.block == HEADINGS:  # where they drift, that of the factor's first frame
            step = int(self.problem.wearers[one.owner.number].heading_numbers(self.first)[0])
        items = [n] if one.is_per_factor else range(jacobian.shape[1] // width)
        return [
            (Variable(one.block, number, 0, item, step), jacobian[:, place * width : (place + 1) * width])
            for place, item in enumerate(items)
        ]


def noise_model(loss: RobustLoss, rows: int) -> gtsam.noiseModel.Base:
    """Of whitened residuals under a loss."""
    unit, k = gtsam.noiseModel.Unit.Create(rows), np.asarray(loss.k).item()  # of the one frame that a factor begins in
    if loss.loss is Loss.HUBER:
        return gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Huber.Create(k), unit)
    if loss.loss is Loss.CAUCHY:
        return gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Cauchy.Create(k), unit)
    return unit


Evaluate = Callable[[gtsam.Values, bool], tuple[Array, list[Array]]]
"""From values, and whether Jacobians are asked for, to the residual ``(m,)`` and one ``(m, d)`` per key, in the order
of the keys; or to the residual alone."""


def custom_factor(
    name: str, noise: gtsam.noiseModel.Base, keys: Sequence[int], dimensions: Sequence[int], evaluate: Evaluate
) -> gtsam.CustomFactor:
    """A GTSAM factor from a plain function, which must not hold on to the graph: it would never be freed.

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
