"""Association and fusion, again with what the first found (thesis 4.3): who is who shows in the cameras then known."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vip_factors.assembly.objective import SceneObjective
from vip_factors.geometry.rotations import angle_between
from vip_factors.problem.state import WearerState
from vip_factors.problem.wearer import WearerProblem
from vip_factors.settings import Settings
from vip_factors.stages.associated_cameras import AssociatedCamera, look_again, watch_again
from vip_factors.stages.filming import Filmed
from vip_factors.stages.fusion import Fused, fuse
from vip_factors.stages.posture_findings import TURNED
from vip_factors.stages.solver import Solver

UNLIKELY = 4.0  # sigmas of its prior: what ends there is a hypothesis
HELD = np.deg2rad(1.0)  # of a mounting that is kept where the start had it


def fuse_in_rounds(
    filmed: Filmed, associated: Sequence[AssociatedCamera], names: Sequence[str], settings: Settings, solver: Solver
) -> tuple[Fused, tuple[AssociatedCamera, ...]]:
    """The coarse solution, and the association that it was made from.

    Args:
        filmed: where to start.
        associated: by the first association, of the cameras that are of use.
        names: of the wearers.
        settings: of all rooms.
        solver: of the scene.

    Raises:
        SolveError: if the problem is not determined.
    """
    tell = solver.telling("association")
    fused = fuse(filmed, None, associated, settings, solver)
    for _ in range(settings.fusion.rounds - 1):
        associated = watch_again(associated, fused.camera_path, fused.clock, fused.motions(names), settings, tell)
        fused = fuse(filmed, fused, associated, settings, solver)
    for _ in range(settings.fusion.refits):
        if not fused.is_settled():
            fused = fuse(filmed, fused, associated, settings, solver)
    fused = _reconsidered(filmed, fused, associated, settings, solver)
    associated = look_again(associated, fused.camera_path, fused.clock, fused.motions(names), settings)
    return fused, associated


def _reconsidered(
    filmed: Filmed, fused: Fused, associated: Sequence[AssociatedCamera], settings: Settings, solver: Solver
) -> Fused:
    """The better of a solution and, if something ended far from where it is likely, of one that began with that held.

    Many frames of one posture may lead a mounting or a hinge's axis from where a single statement had it into another
    valley, from which no way leads back.
    """
    cautious = [_held(one, own) for one, own in zip(fused.model.wearers, fused.state.wearers, strict=True)]
    if all(one is own for one, own in zip(cautious, fused.model.wearers, strict=True)):
        return fused
    likely = [
        replace(one, model=replace(one.model, mounting_sigma=held.mounting_sigma, free_hinges=held.free_hinges))
        for one, held in zip(filmed.wearers, cautious, strict=True)
    ]
    other = fuse(replace(filmed, wearers=tuple(likely)), None, associated, settings, solver)
    other = fuse(filmed, other, associated, settings, solver)
    return min(fused, other, key=lambda one: _cost(one, fused))


def _held(model: WearerProblem, state: WearerState) -> WearerProblem:
    """The problem with what is far from likely kept where it began; the same one if nothing is."""
    turned = angle_between(model.prior_R_bone_sensor, state.R_bone_sensor) > TURNED
    axes = np.abs(model.hinge_prior.whitening @ (state.hinges - model.hinge_prior.mean)) > UNLIKELY
    if not (model.free_mountings and turned.any()) and not (model.free_hinges and axes.any()):
        return model
    return replace(model, mounting_sigma=np.where(turned, HELD, model.mounting_sigma), free_hinges=not axes.any())


def _cost(one: Fused, other: Fused) -> float:
    """Of a solution, with its detections believed as much as in another."""
    views = zip(one.model.views, other.model.views, strict=True)
    believed = tuple(replace(view, sigma=theirs.sigma) for view, theirs in views)
    return sum(SceneObjective(replace(one.model, views=believed)).cost(one.state).values())
