"""The factor graph of a recording or a scene, before it is solved: to look at, to extend, to solve otherwise."""

from vip_factors.factor_graph.graph import FactorGraph, factor_graph_of
from vip_factors.problem.scene import SceneProblem
from vip_factors.problem.state import SceneState
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene
from vip_factors.sensors.sources import SceneInMemory
from vip_factors.settings import Settings
from vip_factors.stages.association import associate_cameras, usable_cameras
from vip_factors.stages.decode import motion_of
from vip_factors.stages.fusion import fusion_problem
from vip_factors.stages.fusion_start import start_fusion
from vip_factors.stages.inertial import inertial_trackers
from vip_factors.stages.inertial_model import with_contacts
from vip_factors.stages.solver import Progress, Solver
from vip_factors.stages.windows import scene_plan


def factor_graph(
    source: Recording | Scene, settings: Settings | None = None, progress: Progress | None = None
) -> FactorGraph:
    """The factor graph of a recording or a scene, with everything free, and where it starts.

    It is the problem in which headings, mountings and the camera are found, at ``calibration_rate``: of a
    scene the first round of fusion, of a recording the first calibration. What comes before it is done here: the
    inertial tracker and who is who.

    Args:
        source: of one wearer, or filmed.
        settings: of all rooms; ``calibration_rate=frame_rate`` for the graph of all frames.
        progress: called with the name of the stage and the fraction of it done.

    Returns:
        The graph, values to start from, and what they stand for.

    Raises:
        InputError, RecordingError: for a recording that cannot be used.
        SolveError: if a problem on the way is not determined.
    """
    settings = settings or Settings()
    scene = source if isinstance(source, Scene) else Scene(source.name, (source,))
    solver = Solver(settings.solve, progress or (lambda stage, fraction: None), name=settings.solver)
    plan = scene_plan(SceneInMemory(scene), settings, whole=True)
    wearers = inertial_trackers(scene, plan.all_coarse_time, settings, solver)
    if scene.camera is not None and settings.fusion.use_camera:
        names = scene.names
        motions = [motion_of(one.model, one.state, name) for one, name in zip(wearers, names, strict=True)]
        associated = usable_cameras(
            associate_cameras(scene, wearers, motions, settings, solver.progress_of("association"))
        )
        if associated:
            start = fusion_problem(start_fusion(associated, wearers, settings), None, associated, settings)
            return factor_graph_of(start.model, start.state)
    problems = [with_contacts(one.model, one.state) for one in wearers]
    return factor_graph_of(SceneProblem.unfilmed(problems), SceneState.unfilmed([one.state for one in wearers]))
