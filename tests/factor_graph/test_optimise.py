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

WHOLE = cache(lambda: factor_graph(filmed_gestures("fixed", 0.6), QUICK))
TO_THE_END = SolveSettings(max_iterations=40, relative_decrease=1e-9)


def test_both_find_the_same_minimum_of_a_filmed_scene() -> None:
    whole = WHOLE()
    assert {"orientation", "acceleration", "reprojection"} <= set(whole.factor_counts)
    objective = SceneObjective(whole.problem)
    ours, report = levenberg_marquardt(objective, whole.state, TO_THE_END)
    theirs, their_report = optimise_with_gtsam(objective, whole.state, TO_THE_END)
    costs = [sum(one.final_cost.values()) for one in (report, their_report)]
    np.testing.assert_allclose(costs[0], costs[1], rtol=1e-7)
    (one,), (other,) = ours.wearers, theirs.wearers
    assert np.abs(one.p_world_pelvis - other.p_world_pelvis).max() < 1e-4  # m
    assert np.rad2deg(angle_between(one.R_parent_child, other.R_parent_child)).max() < 0.05
    assert np.rad2deg(np.abs(one.headings - other.headings)).max() < 0.01
    assert np.abs(ours.camera.poses.p_world_camera - theirs.camera.poses.p_world_camera).max() < 1e-4
    assert np.abs(one.p_world_pelvis - whole.state.wearers[0].p_world_pelvis).max() > 1e-3  # it was some way


def test_the_solution_and_its_marginals_are_gtsams() -> None:
    whole = WHOLE()
    values = whole.solved()
    assert isinstance(values, gtsam.Values)
    assert whole.graph.error(values) < 0.9 * whole.graph.error(whole.values)
    ours, theirs = whole.marginals(values), gtsam.Marginals(whole.graph, values)
    assert set(ours) == {one.key for one in whole.variables}
    for one in whole.variables[::7] + whole.variables[-30:]:
        expected = theirs.marginalCovariance(one.key)
        np.testing.assert_allclose(ours[one.key], expected, atol=1e-6 * np.abs(expected).max(), err_msg=one.kind)


def test_keys_go_by_names() -> None:
    whole = WHOLE()
    ((wearer, sensors),) = whole.sensors.items()
    for sensor, number in sensors.items():
        assert whole.heading_key(wearer, sensor) == variable_key("headings", number)
        assert whole.key_words(whole.heading_key(wearer, sensor)) == f"heading of {sensor}, {wearer}"
        assert whole.key_words(whole.mounting_key(wearer, sensor)) == f"mounting of {sensor}, {wearer}"
    words = {whole.key_words(one.key) for one in whole.variables}
    assert len(words) == len(whole.variables)
    assert {f"joint rotation of left_knee, frame 3, {wearer}", f"root translation, frame 0, {wearer}"} <= words
    assert whole.key_words(gtsam.symbol("x", 3)) == "x3"
    with pytest.raises(InputError, match=r"no 'left_shonk' in the factor graph; did you mean 'left_shank'"):
        whole.heading_key(wearer, "left_shonk")
    with pytest.raises(InputError, match="no 'Nobody' in the factor graph"):
        whole.mounting_key("Nobody", "left_shank")


def test_gtsam_prints_with_these_names(capfd: pytest.CaptureFixture[str]) -> None:
    whole = WHOLE()
    whole.values.print("", whole.key_words)
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
    assert [one.stage for one in theirs.reports] == [one.stage for one in ours.reports]
