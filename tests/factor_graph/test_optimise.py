"""GTSAM's own optimiser, on the graph in the open, finds what the fast solver finds."""

from dataclasses import replace
from functools import cache

import gtsam
import numpy as np
import pytest
from filmed_gestures import QUICK, filmed_gestures

from vip_factors.assembly.objective import SceneObjective
from vip_factors.errors import InputError
from vip_factors.factor_graph.graph import optimise_with_gtsam
from vip_factors.factor_graph.keys import variable_key
from vip_factors.geometry.rotations import angle_between
from vip_factors.pipeline import factor_graph, smooth
from vip_factors.settings import SolverName, SolveSettings
from vip_factors.solve.levenberg_marquardt import levenberg_marquardt

SCENE_GRAPH = cache(lambda: factor_graph(filmed_gestures("fixed", 0.6), QUICK))
TO_THE_END = SolveSettings(max_iterations=40, relative_decrease=1e-9)


def test_both_find_the_same_minimum_of_a_filmed_scene() -> None:
    scene_graph = SCENE_GRAPH()
    assert {"orientation", "acceleration", "reprojection"} <= set(scene_graph.factor_counts)
    objective = SceneObjective(scene_graph.problem)
    fast, report = levenberg_marquardt(objective, scene_graph.state, TO_THE_END)
    reference, reference_report = optimise_with_gtsam(objective, scene_graph.state, TO_THE_END)
    costs = [sum(solve.final_cost.values()) for solve in (report, reference_report)]
    np.testing.assert_allclose(costs[0], costs[1], rtol=1e-7)
    (wearer,), (expected,) = fast.wearers, reference.wearers
    assert np.abs(wearer.p_world_pelvis - expected.p_world_pelvis).max() < 1e-4  # m
    assert np.rad2deg(angle_between(wearer.R_parent_child, expected.R_parent_child)).max() < 0.05
    assert np.rad2deg(np.abs(wearer.headings - expected.headings)).max() < 0.01
    assert np.abs(fast.cameras[0].poses.p_world_camera - reference.cameras[0].poses.p_world_camera).max() < 1e-4
    assert np.abs(wearer.p_world_pelvis - scene_graph.state.wearers[0].p_world_pelvis).max() > 1e-3  # it was some way


def test_the_solution_and_its_marginals_are_gtsams() -> None:
    scene_graph = SCENE_GRAPH()
    values = scene_graph.solved()
    assert isinstance(values, gtsam.Values)
    assert scene_graph.graph.error(values) < 0.9 * scene_graph.graph.error(scene_graph.values)
    covariances, expected = scene_graph.marginals(values), gtsam.Marginals(scene_graph.graph, values)
    assert set(covariances) == {variable.key for variable in scene_graph.variables}
    for variable in scene_graph.variables[::7] + scene_graph.variables[-30:]:
        covariance = expected.marginalCovariance(variable.key)
        np.testing.assert_allclose(
            covariances[variable.key], covariance, atol=1e-6 * np.abs(covariance).max(), err_msg=variable.kind
        )


def test_keys_go_by_names() -> None:
    scene_graph = SCENE_GRAPH()
    ((wearer, sensors),) = scene_graph.sensors.items()
    for sensor, number in sensors.items():
        assert scene_graph.heading_key(wearer, sensor) == variable_key("headings", number)
        assert scene_graph.key_words(scene_graph.heading_key(wearer, sensor)) == f"heading of {sensor}, {wearer}"
        assert scene_graph.key_words(scene_graph.mounting_key(wearer, sensor)) == f"mounting of {sensor}, {wearer}"
    words = {scene_graph.key_words(variable.key) for variable in scene_graph.variables}
    assert len(words) == len(scene_graph.variables)
    assert {f"joint rotation of left_knee, frame 3, {wearer}", f"root translation, frame 0, {wearer}"} <= words
    assert scene_graph.key_words(gtsam.symbol("x", 3)) == "x3"
    with pytest.raises(InputError, match=r"no 'left_shonk' in the factor graph; did you mean 'left_shank'"):
        scene_graph.heading_key(wearer, "left_shonk")
    with pytest.raises(InputError, match="no 'Nobody' in the factor graph"):
        scene_graph.mounting_key("Nobody", "left_shank")


def test_gtsam_prints_with_these_names(capfd: pytest.CaptureFixture[str]) -> None:
    scene_graph = SCENE_GRAPH()
    scene_graph.values.print("", scene_graph.key_words)
    assert "Value heading of left_shank, " in capfd.readouterr().out


@pytest.mark.slow
def test_smoothing_with_gtsam_is_smoothing() -> None:
    (recording,) = filmed_gestures("fixed", 0.6).wearers
    quick = replace(QUICK, frame_rate=12.0, solve=replace(QUICK.solve, max_iterations=15))
    ours, theirs = (
        smooth(recording, quick).wearer(),
        smooth(recording, replace(quick, solver=SolverName.GTSAM)).wearer(),
    )
    apart = ours.motion.state.p_world_joint - theirs.motion.state.p_world_joint
    assert np.linalg.norm(apart, axis=2).mean() < 2e-3  # m: they stop where a step gains a thousandth of the cost
    assert theirs.settings["solver"] == "gtsam"
    assert [report.stage for report in theirs.reports] == [report.stage for report in ours.reports]
