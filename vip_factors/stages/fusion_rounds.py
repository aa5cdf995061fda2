"""Association and fusion, again with what the first found (thesis 4.3): who is who shows in the cameras then known."""

from collections.abc import Sequence

from vip_factors.settings import Settings
from vip_factors.stages.associated_cameras import AssociatedCamera, look_again, watch_again
from vip_factors.stages.filming import Filmed
from vip_factors.stages.fusion import Fused, fuse
from vip_factors.stages.solver import Solver


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
    associated = look_again(associated, fused.camera_path, fused.clock, fused.motions(names), settings)
    return fused, associated
