"""Starts that a search cannot distinguish, compared by the solutions that they lead to.

The search looks at pairs of sensors: what it does not settle need not matter. From a rival start the same problem is
solved once more, coarsely. Either both end in one motion, to within the standard deviations that the solution states,
and only what no motion shows differs: of a bone that is upright throughout the sensor may be turned about the vertical
if its heading is too. Or they end apart, which a finding reports. Costs do not decide then: with arbitrary straps a
start that was 67° wrong ended five nats likelier than its rival.
"""

from dataclasses import replace

import numpy as np

from vip_factors.assembly.objective import SceneObjective
from vip_factors.errors import SolveError
from vip_factors.geometry.rotations import Array, log, rotation_z, transpose, wrap_angle, yaw_of
from vip_factors.initialise.camera import robust_mean_angle
from vip_factors.initialise.start_search import Start, Starts
from vip_factors.problem.layout import Owner, OwnerId
from vip_factors.problem.scene import SceneProblem
from vip_factors.problem.state import SceneState
from vip_factors.sensors.recording import Recording
from vip_factors.settings import CommonSettings
from vip_factors.stages.decode import SharedCovariance
from vip_factors.stages.inertial import InertialSolution, inertial_tracker
from vip_factors.stages.solver import Solver

# On average over the frames, of bones whose orientation is certain. From rival starts of sound walks and foreign scenes
# one motion came out again to within 6°; what ended elsewhere was 16° off and more.
APART = np.deg2rad(10.0)
SIGMAS = 2.0  # standard deviations of the solution: two ends that are closer to each other are one


def with_rivals_solved(
    starts: Starts | None,
    problem: SceneProblem,
    state: SceneState,
    number: int,
    recording: Recording,
    settings: CommonSettings,
    solver: Solver,
) -> Starts | None:
    """Solve from rival starts; sensors whose bones then differ from the solution are doubtful.

    Args:
        starts: of a wearer; None where none were looked for.
        problem, state: the scene's coarse problem, and its solution from the best start.
        number: of the wearer.
        recording: of the wearer, as it was solved.
        settings, solver: with which it was.
    """
    if starts is None or not starts.rivals:
        return starts
    doubtful, margins = set[int](), dict[float, str]()
    covariance = SharedCovariance.at(problem, state)
    for rival in starts.rivals:
        quiet_solver = replace(solver, reports=[])
        try:
            end = _solved_from(rival, problem, state, number, recording, settings, quiet_solver)
        except SolveError:  # then it explains nothing
            continue
        contradicting = np.flatnonzero(_bones_apart(problem, number, state, end, covariance) > 1)
        if len(contradicting):
            doubtful |= set(contradicting.tolist())
            margins[rival.cost - starts.best.cost] = rival.hypothesis
    if not doubtful:
        return replace(starts, doubtful=(), rivals=())
    margin = min(margins)
    return replace(starts, rival=margins[margin], margin=max(margin, 0.0), doubtful=tuple(sorted(doubtful)))


def _solved_from(
    rival: Start,
    problem: SceneProblem,
    state: SceneState,
    number: int,
    recording: Recording,
    settings: CommonSettings,
    solver: Solver,
) -> SceneState:
    """Solve the problem with one wearer at a rival start, placed in the solution's world."""
    model, solved = problem.wearers[number], state.wearers[number]
    tracked = inertial_tracker(recording, model.frames, settings, solver, replace(rival.calibration, R_world_bone=None))
    begin = tracked.state.turned(robust_mean_angle(wrap_angle(solved.headings - tracked.state.headings)))
    model = replace(
        model,
        prior_headings=begin.headings,
        prior_R_bone_sensor=begin.R_bone_sensor,
        restarts=tracked.model.restarts,
        heading_times=tracked.model.heading_times,
    )
    begin = replace(
        solved,
        R_parent_child=begin.R_parent_child,
        headings=begin.headings,
        later_headings=begin.later_headings,
        R_bone_sensor=begin.R_bone_sensor,
    )
    wearers, states = list(problem.wearers), list(state.wearers)
    wearers[number], states[number] = model, begin
    problem, state = replace(problem, wearers=tuple(wearers)), replace(state, wearers=tuple(states))
    return solver.solve(SceneObjective(problem), state, "start")


def _bones_apart(
    problem: SceneProblem, number: int, solution: SceneState, rival: SceneState, covariance: SharedCovariance
) -> Array:
    """``(S,)`` turns between two motions of the bones with sensors, but for a turn of the world.

    The unit is what leaves two motions alike: ``APART``, and ``SIGMAS`` standard deviations of the first one's bone.
    """
    model = problem.wearers[number]
    bones = [sensor.bone for sensor in model.sensors]
    solutions = (InertialSolution(model, scene_state.wearers[number]) for scene_state in (solution, rival))
    R, S = (wearer.motion.state.R_world_bone[:, bones] for wearer in solutions)
    turns = np.array([robust_mean_angle(yaws) for yaws in yaw_of(S @ transpose(R)).T])
    R_world_sensor = R @ solution.wearers[number].R_bone_sensor
    turned = rotation_z(robust_mean_angle(turns)) @ R
    alike = APART**2 * np.eye(3) + SIGMAS**2 * _bone_covariance(number, R_world_sensor, covariance)
    difference = np.einsum("...ji,...j->...i", R_world_sensor, log(S @ transpose(turned)))
    squares = np.einsum("...i,...i", difference, np.linalg.solve(alike, difference[..., None])[..., 0])
    return np.asarray(np.sqrt(squares).mean(axis=0))


def _bone_covariance(number: int, R_world_sensor: Array, shared: SharedCovariance) -> Array:
    """``(T, S, 3, 3)`` of the bones' orientations in the sensors' axes, by headings and mountings; 0 if not known."""
    owner, covariance = OwnerId(Owner.WEARER, number), np.zeros((*R_world_sensor.shape[:2], 3, 3))
    if shared.covariance is None:
        return covariance
    for s in range(R_world_sensor.shape[1]):
        heading, mounting = (shared.layout.item_columns(owner, block, s) for block in ("headings", "R_bone_sensor"))
        up, axes = R_world_sensor[:, s, 2, :, None], np.broadcast_to(-np.eye(3), (len(covariance), 3, 3))
        J = np.concatenate([up[..., : len(heading)], axes[..., : len(mounting)]], axis=2)
        columns = [*heading, *mounting]
        covariance[:, s] = J @ shared.covariance[np.ix_(columns, columns)] @ transpose(J)
    return covariance
