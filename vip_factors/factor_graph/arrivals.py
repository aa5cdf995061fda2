"""A scene's GTSAM factors in the order in which a stream brings them: each with the last of the frames it touches.

It is what one would feed to GTSAM's own smoothers; they are the reference of the fixed-lag tracker.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import gtsam

from vip_factors.factor_graph.graph import factor_graph_of
from vip_factors.factor_graph.variables import values_of
from vip_factors.problem.scene import SceneProblem
from vip_factors.problem.state import SceneState


@dataclass(frozen=True)
class Arrival:
    """What one update brings.

    Attributes:
        newest: number of the newest frame.
        factors: that can exist now and could not before.
        values: where their new variables start.
        frames: numbers of the new variables' frames, by key.
        shared: keys of what frames share.
    """

    newest: int
    factors: gtsam.NonlinearFactorGraph
    values: gtsam.Values
    frames: dict[int, int]
    shared: tuple[int, ...]


def arrivals(problem: SceneProblem, state: SceneState, first: int) -> Iterator[Arrival]:
    """A scene, update by update: frames up to ``first`` at once, then each by itself."""
    whole, moving = factor_graph_of(problem, state), problem.camera.moving
    of_frames = [one for one in whole.variables if one.is_of_a_frame or (one.is_of_the_camera_path and moving)]
    static = [one for one in whole.variables if one not in set(of_frames)]
    shared = tuple(one.key for one in static)
    for begin, newest in [(0, first), *((t, t) for t in range(first + 1, problem.frames))]:
        graph = gtsam.NonlinearFactorGraph()
        for factor in whole.factors:
            if begin <= factor.frames[-1] <= newest:
                graph.push_back(factor.factor)
        fresh = [one for one in of_frames if begin <= one.frame <= newest]
        frames = {one.key: one.frame for one in fresh}
        yield Arrival(newest, graph, values_of(state, [*fresh, *(static if begin == 0 else ())]), frames, shared)
