"""What a detector calls a joint is found where bodies are known, and where sensors sit where motion is."""

from dataclasses import replace

import numpy as np
import pytest
from small_problems import small_scene

from vip_factors.assembly.objective import SceneObjective
from vip_factors.body.keypoints import OFFSET_KEYPOINTS, KeypointOffsets, offset_of
from vip_factors.body.kinematics import forward_kinematics
from vip_factors.factor_settings import SQUARE, KeypointOffsetSettings
from vip_factors.problem.scene import KeypointView, SceneProblem
from vip_factors.problem.state import DetectorState, SceneState
from vip_factors.settings import SolveSettings
from vip_factors.solve.levenberg_marquardt import levenberg_marquardt

OFFSETS = 0.02 * np.random.default_rng(11).standard_normal((len(OFFSET_KEYPOINTS), 3))


def seen_with_offsets() -> tuple[SceneProblem, SceneState]:
    """A scene before a camera of known path, whose keypoints were seen without noise, each beside its place."""
    problem, state = small_scene("known path")
    settings = problem.cameras[0].settings
    loose = KeypointOffsetSettings(10.0, 10.0, 10.0)
    settings = replace(settings, keypoint_offset=loose, reprojection=replace(settings.reprojection, loss=SQUARE))
    camera, views = replace(problem.cameras[0], settings=settings, imu=None, free_clock=False), []
    state = replace(state, cameras=(replace(state.cameras[0], clock=0.0, clock_drift=0.0),), detector=DetectorState())
    R, centre = state.cameras[0].poses.R_world_camera, state.cameras[0].poses.p_world_camera
    for view, wearer, own in zip(problem.views[0], problem.wearers, state.wearers, strict=True):
        body = forward_kinematics(wearer.skeleton_at(own.body), own.R_parent_child, own.p_world_pelvis)
        index, signs = view.offsets
        shift = np.where(index[:, None] < 0, 0.0, signs * OFFSETS[index])
        assert wearer.variation is not None
        points = view.body_points
        stretched = wearer.variation.of_points(wearer.skeleton, points.bones, points.p_bone_point) @ own.body
        p = body.points(np.array(points.bones), points.p_bone_point + stretched + shift)
        lens = camera.model.zoomed(state.cameras[0].zoom)
        views.append(replace(view, pixels=lens.project((p - centre[:, None]) @ R), clock=(0.0, 0.0)))
    return replace(problem, cameras=(camera,), views=(tuple(views),)), state


def test_offsets_of_a_detector_are_found() -> None:
    problem, state = seen_with_offsets()
    found, _ = levenberg_marquardt(
        SceneObjective(problem, wearers_move=False), state, SolveSettings(relative_decrease=1e-9)
    )
    np.testing.assert_allclose(found.detector.keypoint_offsets, OFFSETS, atol=2e-4)


def test_nothing_is_left_over_at_the_true_offsets() -> None:
    problem, state = seen_with_offsets()
    true = replace(state, detector=DetectorState(OFFSETS))
    assert SceneObjective(problem).cost(true)["reprojection"] == pytest.approx(0.0, abs=1e-12)


def test_the_focal_length_is_recovered() -> None:
    problem, true = seen_with_offsets()
    begin = replace(true, cameras=(replace(true.cameras[0], zoom=-0.2),), detector=DetectorState(OFFSETS))
    objective = SceneObjective(replace(problem, free_keypoints=False), wearers_move=False)
    solved, _ = levenberg_marquardt(objective, begin, SolveSettings(relative_decrease=1e-9))
    assert solved.cameras[0].zoom == pytest.approx(true.cameras[0].zoom, abs=1e-3)


def test_the_lens_prior_costs_nothing_at_the_supposed_focal_length() -> None:
    problem, state = small_scene("standing")
    supposed = replace(state, cameras=(replace(state.cameras[0], zoom=0.0),))
    assert SceneObjective(problem).cost(supposed)["lens prior"] == 0.0
    assert SceneObjective(problem).cost(state)["lens prior"] == pytest.approx(0.5 * (0.1 / 0.25) ** 2)
    held = replace(problem, cameras=(replace(problem.cameras[0], focal_sigma=0.0),))
    assert "lens prior" not in SceneObjective(held).cost(state)


@pytest.mark.parametrize("name", OFFSET_KEYPOINTS)
def test_both_sides_have_one_offset_mirrored(name: str) -> None:
    (left, x), (right, mirrored) = offset_of(f"left_{name}"), offset_of(f"right_{name}")
    assert left == right == OFFSET_KEYPOINTS.index(name)
    assert (x, mirrored) == (1, -1)


def test_a_nose_has_none() -> None:
    assert offset_of("nose")[0] == -1


def test_offsets_that_were_learnt_cost_nothing() -> None:
    problem, state = small_scene("standing")
    learned = KeypointOffsets(OFFSETS, np.full(OFFSETS.shape, 0.005))
    problem = replace(problem, cameras=(replace(problem.cameras[0], learned_offsets=learned),))
    as_learned, as_in_the_table = (replace(state, detector=DetectorState(one)) for one in (OFFSETS, 0 * OFFSETS))
    cost = SceneObjective(problem).cost
    assert cost(as_learned)["keypoint offset prior"] == 0.0
    expected = 0.5 * np.sum((OFFSETS / 0.005) ** 2)
    assert cost(as_in_the_table)["keypoint offset prior"] == pytest.approx(expected)


def test_views_of_single_frames_know_whose_offsets_they_have() -> None:
    problem, _ = small_scene("standing")
    view = problem.views[0][0]
    view = replace(view, confidence=np.ones(view.seen.shape))
    joined = KeypointView.joined(view.points, [None, view.at_frames(slice(0, 1))], None)
    np.testing.assert_array_equal(joined.offsets[0], view.offsets[0])


def test_the_prior_of_a_shared_detector_counts_once() -> None:
    problem, state = small_scene("further cameras")
    alone = replace(problem, cameras=problem.cameras[:1], views=problem.views[:1])
    costs = [
        SceneObjective(scene).cost(replace(state, cameras=state.cameras[: len(scene.cameras)]))["keypoint offset prior"]
        for scene in (problem, alone)
    ]
    assert costs[0] == pytest.approx(costs[1], rel=1e-12)
