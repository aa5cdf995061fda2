"""Starts that a search cannot tell apart, told apart by where the fit goes from each of them.

The search looks at pairs of sensors: what it does not settle need not matter. From a rival start the same problem is
solved once more, coarsely. Either both end in one motion, and only what no motion shows differs: of a bone that is
upright throughout the sensor may be turned about the vertical if its heading is too. Or they end apart, and that is
told. Costs do not decide then: of sensors worn anyhow a start 67° wrong ended five nats likelier than its rival.
"""

from dataclasses import replace

import numpy as np

from vip_factors.assembly.objective import SceneObjective
from vip_factors.errors import SolveError
from vip_factors.geometry.rotations import Array, angle_between, rotation_z, transpose, wrap_angle, yaw_of
from vip_factors.initialise.camera import robust_mean_angle
from vip_factors.initialise.start_search import Start, Starts
from vip_factors.problem.scene import SceneProblem
from vip_factors.problem.state import SceneState
from vip_factors.sensors.recording import Recording
from vip_factors.settings import CommonSettings
from vip_factors.stages.decode import motion_of
from vip_factors.stages.inertial import inertial_tracker
from vip_factors.stages.solver import Solver

# On average over the frames. From rival starts of sound walks and foreign scenes one motion came out again to within
# 6°; what ended elsewhere was 16° off and more.
APART = np.deg2rad(10.0)


def with_rivals_solved(
    starts: Starts | None, problem: SceneProblem, state: SceneState, number: int, recording: Recording,
    settings: CommonSettings, solver: Solver,
) -> Starts | None:  # fmt: skip
    """How sure a start is, once the solutions of its rivals are known: doubtful are sensors whose bones they move.

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
    for rival in starts.rivals:
        own = replace(solver, reports=[])
        try:
            end = _solved_from(rival, problem, state, number, recording, settings, own)
        except SolveError:  # then it explains nothing
            continue
        apart = np.flatnonzero(_bones_apart(problem, number, state, end) > APART)
        if len(apart):
            doubtful |= set(apart.tolist())
            margins[rival.cost - starts.best.cost] = rival.hypothesis
    if not doubtful:
        return replace(starts, doubtful=(), rivals=())
    margin = min(margins)
    return replace(starts, rival=margins[margin], margin=max(margin, 0.0), doubtful=tuple(sorted(doubtful)))


def _solved_from(
    rival: Start, problem: SceneProblem, state: SceneState, number: int, recording: Recording,
    settings: CommonSettings, solver: Solver,
) -> SceneState:  # fmt: skip
    """Where the problem ends if one wearer starts as a rival start has him, in the solution's world."""
    model, solved = problem.wearers[number], state.wearers[number]
    tracked = inertial_tracker(recording, model.frames, settings, solver, replace(rival.calibration, R_world_bone=None))
    begin = tracked.state.turned(robust_mean_angle(wrap_angle(solved.headings - tracked.state.headings)))
    model = replace(
        model, prior_headings=begin.headings, prior_R_bone_sensor=begin.R_bone_sensor, restarts=tracked.model.restarts,
        heading_times=tracked.model.heading_times,
    )  # fmt: skip
    begin = replace(
        solved, R_parent_child=begin.R_parent_child, headings=begin.headings, later_headings=begin.later_headings,
        R_bone_sensor=begin.R_bone_sensor,
    )  # fmt: skip
    wearers, states = list(problem.wearers), list(state.wearers)
    wearers[number], states[number] = model, begin
    problem, state = replace(problem, wearers=tuple(wearers)), replace(state, wearers=tuple(states))
    return solver.solve(SceneObjective(problem), state, "start")


def _bones_apart(problem: SceneProblem, number: int, one: SceneState, other: SceneState) -> Array:
    """``(S,)`` radians by which two motions turn the bones with sensors, but for a turn of the world."""
    model = problem.wearers[number]
    bones = [sensor.bone for sensor in model.sensors]
    R, S = (motion_of(model, each.wearers[number]).state.R_world_bone[:, bones] for each in (one, other))
    turns = np.array([robust_mean_angle(each) for each in yaw_of(S @ transpose(R)).T])
    return np.asarray(angle_between(rotation_z(robust_mean_angle(turns)) @ R, S).mean(axis=0))
