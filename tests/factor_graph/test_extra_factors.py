"""A user's own GTSAM factors: linearised by GTSAM, and equal to what they are in a GTSAM graph; batch and live."""

from dataclasses import replace
from functools import partial

import gtsam
import numpy as np
import pytest
from linear import assert_same, dense, dense_of_graph
from small_problems import T, small_scene

from vip_factors.assembly.charts import Charts
from vip_factors.assembly.objective import SceneObjective, joined_slices
from vip_factors.errors import InputError
from vip_factors.factor_graph.extra import StreamedTerms, UserTerms
from vip_factors.factor_graph.graph import factor_graph_of
from vip_factors.factor_graph.keys import camera_key, joint_key, root_key, variable_key
from vip_factors.geometry.rotations import Array
from vip_factors.problem.scene import SceneProblem
from vip_factors.problem.state import SceneState
from vip_factors.problem.variables import scene_layout
from vip_factors.settings import SolveSettings
from vip_factors.solve.levenberg_marquardt import levenberg_marquardt
from vip_factors.solve.slices import Slices

ONE, THREE, SIX = (gtsam.noiseModel.Isotropic.Sigma(n, 0.1) for n in (1, 3, 6))


def apart(frame: int, distance: float, sigma: float) -> gtsam.CustomFactor:
    """Both pelvises so many metres from one another."""

    def evaluate(this: gtsam.CustomFactor, values: gtsam.Values, H: list[Array] | None) -> Array:
        p, q = (np.asarray(values.atPoint3(key)) for key in list(this.keys()))
        arm = p - q
        length = float(np.linalg.norm(arm))
        if H is not None:
            H[0] = np.asfortranarray((arm / length)[None])
            H[1] = np.asfortranarray((-arm / length)[None])
        return np.array([length - distance])

    noise = gtsam.noiseModel.Isotropic.Sigma(1, sigma)
    return gtsam.CustomFactor(noise, [root_key(frame), root_key(frame, 1)], evaluate)


def many_kinds(time: Array, first: int, begin: int = 0, moving: bool = False) -> gtsam.NonlinearFactorGraph:
    """Factors of GTSAM's own and a custom one, on variables of every kind; some over frames that are not neighbours."""
    graph, turned = gtsam.NonlinearFactorGraph(), gtsam.Rot3.Rodrigues(0.1, 0.2, 0.3)
    for t in range(first, first + len(time)):
        graph.push_back(apart(t, 0.5, 0.1))
        graph.add(gtsam.PriorFactorRot3(joint_key(t, 5, 1), turned, THREE))
        if t - begin >= 2:
            graph.add(gtsam.BetweenFactorPoint3(root_key(t - 2), root_key(t), np.array([0.1, 0.0, 0.0]), THREE))
            graph.add(gtsam.BetweenFactorRot3(joint_key(t - 1, 3), joint_key(t, 3), turned, THREE))
    if first == begin:
        graph.add(gtsam.PriorFactorRot3(variable_key("R_bone_sensor", 2), turned, THREE))
        graph.add(gtsam.PriorFactorDouble(variable_key("headings", 3, 1), 0.4, ONE))
        graph.add(
            gtsam.BetweenFactorRot3(
                variable_key("R_bone_sensor", 1, 1), variable_key("R_bone_sensor", 4), turned, THREE
            )
        )
        graph.add(gtsam.PriorFactorDouble(variable_key("clock"), 0.1, ONE))
        graph.add(
            gtsam.PriorFactorVector(variable_key("pose_mean"), np.zeros(69), gtsam.noiseModel.Isotropic.Sigma(69, 0.1))
        )
        robust = gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Huber.Create(1.3), SIX)
        graph.add(
            gtsam.PriorFactorPose3(
                camera_key(begin if moving else 0), gtsam.Pose3(turned, np.array([0.0, -4.0, 0.0])), robust
            )
        )
    return graph


def with_extra(kind: str) -> tuple[SceneProblem, SceneState]:
    problem, state = small_scene(kind)
    return replace(problem, extra=UserTerms(many_kinds)), state


@pytest.mark.parametrize("kind", ["moving", "known path"])
def test_cost_and_equations_are_those_of_the_graph_with_them(kind: str) -> None:
    problem, state = with_extra(kind)
    objective = SceneObjective(problem)
    time = problem.wearers[0].frames.time
    bare = factor_graph_of(problem, state)
    kept = set() if problem.cameras[0].free_pose else {camera_key(0)}
    for index in range(many_kinds(time, 0).size()):
        factor = many_kinds(time, 0).at(index)
        if not kept & {int(key) for key in list(factor.keys())}:
            bare.graph.push_back(factor)
    costs = dict(objective.cost(state))
    if not kept:
        assert sum(costs.values()) == pytest.approx(bare.graph.error(bare.values), rel=1e-9)
    assert costs["extra"] > 0
    assert_same(dense(objective, state), dense_of_graph(bare))


def test_factors_over_frames_far_apart_are_those_of_the_graph() -> None:
    problem, state = small_scene("moving")

    def loops(time: Array, first: int) -> gtsam.NonlinearFactorGraph:
        graph = gtsam.NonlinearFactorGraph()
        graph.add(gtsam.BetweenFactorPoint3(root_key(0), root_key(T - 1), np.array([0.1, 0.2, 0.0]), THREE))
        graph.add(gtsam.BetweenFactorRot3(joint_key(0, 3, 1), joint_key(T - 2, 3), gtsam.Rot3(), THREE))
        return graph

    whole = factor_graph_of(problem, state)
    objective = SceneObjective(replace(problem, extra=UserTerms(loops)), chunk=2)
    whole.graph.push_back(loops(problem.wearers[0].frames.time, 0))
    H, g = dense_of_graph(whole)
    layout = objective.layout
    unit = np.tile(np.concatenate([chain.step for chain in layout.chains]), T) ** -2.0
    x = np.linalg.solve(H + 0.1 * np.diag(np.concatenate([unit, layout.per_column("step") ** -2.0])), g)
    steps = objective.linearise(state).step(0.1)
    np.testing.assert_allclose(np.concatenate([steps.frames.ravel(), steps.static]), x, atol=1e-8 * np.abs(x).max())
    covariance, marginals = np.linalg.inv(H), objective.linearise(state).marginals()
    (own, *_), w = marginals.chains, layout.frame_width
    for t in range(T):
        expected = covariance[w * t : w * t + 75, w * t : w * t + 75]
        np.testing.assert_allclose(own[t], expected, atol=1e-6 * np.abs(expected).max())
    static = covariance[w * T :, w * T :]
    np.testing.assert_allclose(marginals.static, static, atol=1e-6 * np.abs(static).max())


def test_a_range_between_two_pelvises_moves_them() -> None:
    problem, state = small_scene("standing")
    settings = SolveSettings(max_iterations=20)

    def ranges(time: Array, first: int) -> gtsam.NonlinearFactorGraph:
        graph = gtsam.NonlinearFactorGraph()
        for t in range(first, first + len(time)):
            graph.push_back(apart(t, 1.5, 1e-3))
        return graph

    def distance(state: SceneState) -> Array:
        return np.linalg.norm(state.wearers[0].p_world_pelvis - state.wearers[1].p_world_pelvis, axis=1)

    with_it = replace(problem, extra=UserTerms(ranges))
    solved, _ = levenberg_marquardt(SceneObjective(with_it), state, settings)
    assert np.abs(distance(state) - 1.5).max() > 0.1
    assert np.abs(distance(solved) - 1.5).max() < 0.01


@pytest.mark.parametrize("kind", ["moving", "standing"])
def test_in_slices_they_are_what_they_are_in_the_chain_far_from_zero_coordinates_too(kind: str) -> None:
    problem, origin = small_scene(kind)
    layout, random = scene_layout(problem), np.random.default_rng(0)
    frames = 0.2 * random.standard_normal((T, layout.frame_width))
    static = 0.2 * random.standard_normal(layout.static_width)
    state = origin.retract_frames(layout, frames).retract_static(layout, static)
    charts, first = Charts.at(layout, frames, static), 100
    streamed = StreamedTerms(partial(many_kinds, begin=first, moving=kind == "moving"), layout)
    for t in range(T):
        streamed.append(first + t, float(t))

    def gradient(with_extra: bool) -> Array:
        empty = Slices(layout.frame_width, layout.static_width, T)
        (slices,) = joined_slices([layout], problem, state, [empty], charts)
        if with_extra:
            streamed.add_to(slices.blocks(T), state, first, charts)
        w, whole = layout.frame_width, np.zeros(layout.frame_width * T + layout.static_width)
        for t in range(T):
            for ahead in range(min(3, T - t)):
                whole[w * (t + ahead) : w * (t + ahead + 1)] += slices.gradient[t, w * ahead : w * (ahead + 1)]
            whole[w * T :] += slices.gradient[t, 3 * w :]
        return whole

    ours = gradient(True) - gradient(False)
    terms = UserTerms(many_kinds)
    at = np.concatenate([frames.ravel(), static])

    def cost(value: Array) -> float:
        own, shared = np.split(value, [frames.size])
        moved = origin.retract_frames(layout, own.reshape(frames.shape)).retract_static(layout, shared)
        return terms.cost(problem, moved)

    seen = np.flatnonzero(np.abs(ours) > 1e-9)
    for column in random.choice(seen, 25, replace=False):
        step = 1e-6 * (np.arange(len(at)) == column)
        numerical = (cost(at + step) - cost(at - step)) / 2e-6
        assert numerical == pytest.approx(ours[column], abs=1e-6 * np.abs(ours).max())


@pytest.mark.parametrize(
    ("key", "message"),
    [
        (root_key(T), f"frame {T} .*expected one of 0 to {T - 1}"),
        (root_key(0, 2), "wearer 2 .*there are 2"),
        (gtsam.symbol("y", 3), "has the key y3: expected a key of"),
    ],
)
def test_a_variable_that_is_not_there_is_said(key: int, message: str) -> None:
    problem, state = small_scene("standing")

    def wrong(time: Array, first: int) -> gtsam.NonlinearFactorGraph:
        graph = gtsam.NonlinearFactorGraph()
        graph.add(gtsam.PriorFactorPoint3(key, np.zeros(3), THREE))
        return graph

    with pytest.raises(InputError, match=message):
        SceneObjective(replace(problem, extra=UserTerms(wrong))).cost(state)


def test_a_stream_says_which_frames_its_factors_may_see() -> None:
    problem, _ = small_scene("standing")

    def far_back(time: Array, first: int) -> gtsam.NonlinearFactorGraph:
        graph = gtsam.NonlinearFactorGraph()
        graph.add(gtsam.BetweenFactorPoint3(root_key(first - 9), root_key(first), np.zeros(3), THREE))
        return graph

    with pytest.raises(InputError, match="is on frames 1 to 10: in a stream, expected frames 8 to 10"):
        StreamedTerms(far_back, scene_layout(problem)).append(10, 0.5)
