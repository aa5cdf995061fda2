"""Errors put into a scene's estimate come out of its evaluation, and the gauge is none of them."""

from dataclasses import replace

import numpy as np
import pytest
from scene_sample import MODEL, Injected, camera_path, estimate_of, scene_sample, with_labels

from vip_factors.errors import InputError
from vip_factors.evaluate.calibration import common_instants
from vip_factors.evaluate.evaluation import evaluate_scene, label_metrics
from vip_factors.sensors.camera import CameraPath, VideoClock
from vip_factors.sensors.scene import Scene

TURNED = Injected(yaw=1.3, shift=(2.0, -1.0, 0.5))


@pytest.fixture(scope="module")
def scene() -> Scene:
    return scene_sample(1.0)


@pytest.mark.parametrize("moving", [True, False])
def test_the_truth_in_another_gauge_is_perfect(moving: bool) -> None:
    scene = scene_sample(0.5, moving)
    result = evaluate_scene(estimate_of(scene, TURNED), scene)
    for name in (
        "mpjpe", "scene_position_error", "heading_error", "mounting_error", "camera_translation",
        "camera_rotation", "camera_heading_error", "camera_mounting_error", "time_offset_error",
    ):  # fmt: skip
        assert result[name] == pytest.approx(0.0, abs=1e-4), name
    assert result["association_precision"] == result["association_recall"] == 100
    assert list(result.wearers) == ["ann", "bob"]


def test_errors_of_sensors_come_out(scene: Scene) -> None:
    result = evaluate_scene(estimate_of(scene, replace(TURNED, heading=0.13, mounting=0.05)), scene)
    assert result["heading_error"] == pytest.approx(np.rad2deg(0.13) / 13)
    assert result["mounting_error_95th"] == pytest.approx(np.rad2deg(0.05))
    assert result["camera_mounting_error"] == pytest.approx(np.rad2deg(0.05))
    assert result.wearers["bob"].sensors["left_foot"]["heading_deg"] == pytest.approx(np.rad2deg(0.13))
    assert result["nees_mounting"] == pytest.approx(1 / 3)
    assert result["nees_heading"] == pytest.approx((0.13 / 0.05) ** 2 * 2 / 25)  # the anchor is not counted


def test_honesty_is_judged_by_the_sensor_that_is_surest(scene: Scene) -> None:
    estimate = estimate_of(scene, TURNED)
    calibration = dict(estimate.wearers[1].calibration)
    wrong = calibration["head"]
    calibration["head"] = replace(wrong, heading=wrong.heading + 0.1, heading_sigma=0.001)
    anchored = replace(estimate, wearers=(estimate.wearers[0], replace(estimate.wearers[1], calibration=calibration)))
    result = evaluate_scene(anchored, scene)
    assert result["nees_heading"] == pytest.approx((0.1 / 0.05) ** 2)  # of all the others
    assert not any("nees_heading" in wearer.metrics for wearer in result.wearers.values())  # against the scene's alone
    known = replace(scene, cameras=(replace(scene.camera, known_path=scene.camera.truth.path),))
    result = evaluate_scene(estimate_of(known, Injected(yaw=0.1)), known)
    assert result["nees_heading"] == pytest.approx((0.1 / 0.05) ** 2)  # a world that was given has no gauge
    assert result["heading_error"] == pytest.approx(0.0, abs=1e-5)


def test_camera_error_is_what_was_put_in(scene: Scene) -> None:
    result = evaluate_scene(estimate_of(scene, replace(TURNED, camera_rad=0.02)), scene)
    assert result["camera_rotation"] == pytest.approx(np.rad2deg(0.02))
    assert result["camera_translation"] == pytest.approx(0.0, abs=1e-6)
    # A camera that is too near also moves the gauge, by its share of the scene: one of three bodies.
    result = evaluate_scene(estimate_of(scene, replace(TURNED, camera_m=0.03)), scene)
    assert result["camera_translation"] == pytest.approx(0.02, rel=0.05)


def test_each_camera_is_judged_and_none_is_the_first(scene: Scene) -> None:
    estimate, truth = estimate_of(scene, TURNED), scene.camera.truth
    second = replace(scene.camera, name="left", focal_sigma=0.25, truth=replace(truth, model=MODEL.zoomed(0.1)))
    near = estimate_of(scene, replace(TURNED, camera_m=0.03)).camera
    lens = MODEL.zoomed(0.1 + 0.03)
    labels = np.where(np.arange(len(truth.wearer)) % 4 == 0, -1, truth.wearer)
    found = replace(
        near, name="left", model=lens, focal_sigma=0.02, clock=VideoClock(0.004), wearer_of_detection=labels
    )
    both = replace(scene, cameras=(scene.camera, second))
    result = evaluate_scene(replace(estimate, cameras=(*estimate.cameras, found)), both)
    assert "focal_length_error" not in result.cameras["phone"]  # a calibrated lens is not estimated
    assert result.cameras["left"]["focal_length_error"] == result["focal_length_error"] == pytest.approx(3.05, abs=0.01)
    assert result.cameras["left"]["nees_focal_length"] == pytest.approx(1.5**2)
    assert result.cameras["left"]["time_offset_error"] == pytest.approx(4)
    assert result["time_offset_error"] == pytest.approx(2)
    assert result.cameras["left"]["camera_translation"] > 2 * result.cameras["phone"]["camera_translation"]
    recalls = {name: errors["association_recall"] for name, errors in result.cameras.items()}
    assert recalls == {"phone": 100, "left": pytest.approx(75, abs=4)}
    assert result["association_recall"] == pytest.approx(np.mean(list(recalls.values())))
    assert result.cameras["left"]["association_precision"] == 100
    assert all("left" in text for text in (str(result), result.to_table()))
    turned = replace(estimate, cameras=(found, *estimate.cameras))
    other = evaluate_scene(turned, replace(both, cameras=both.cameras[::-1]))
    for name, errors in result.cameras.items():
        assert other.cameras[name] == pytest.approx(errors)


def test_paths_at_other_instants_are_compared_at_the_coarser_ones() -> None:
    truth = camera_path(1.0)
    sparse = CameraPath(truth.time[::2], truth.R_world_camera[::2], truth.p_world_camera[::2])
    short = CameraPath(truth.time[10:41], truth.R_world_camera[10:41], truth.p_world_camera[10:41])
    for estimate, true, count in ((short, sparse, 16), (sparse, short, 16), (truth, camera_path(1.0, False), 61)):
        one, other, nearest = common_instants(estimate, true)
        assert len(one) == len(other) == len(nearest) == count
        assert estimate.time[nearest] == pytest.approx(one.time)
    still, _, nearest = common_instants(camera_path(1.0, False), short)
    assert len(still) == 31
    assert not nearest.any()
    with pytest.raises(InputError, match="share no time"):
        common_instants(CameraPath(truth.time + 9, truth.R_world_camera, truth.p_world_camera), sparse)


def test_wearers_apart_show_in_the_scene_not_in_their_poses(scene: Scene) -> None:
    result = evaluate_scene(estimate_of(scene, replace(TURNED, apart_m=0.05)), scene)
    assert result["mpjpe"] == pytest.approx(0.0, abs=1e-5)
    assert 1 < result["scene_position_error"] < 5


def test_camera_covariance_is_judged_in_the_gauge_of_the_prior(scene: Scene) -> None:
    estimate = estimate_of(scene, replace(TURNED, camera_m=0.03))
    covariance = np.tile(np.diag([0.01, 0.01, 0.01, 0.03, 0.03, 0.03]) ** 2, (len(estimate.camera.path), 1, 1))
    result = evaluate_scene(replace(estimate, cameras=(replace(estimate.camera, covariance=covariance),)), scene)
    assert result["nees_camera"] == pytest.approx(1 / 6)


def test_without_a_camera_every_wearer_has_a_gauge_of_its_own(scene: Scene) -> None:
    estimate = estimate_of(scene, replace(TURNED, apart_m=0.5))
    result = evaluate_scene(replace(estimate, cameras=()), scene)
    assert result["scene_position_error"] == pytest.approx(0.0, abs=1e-5)
    assert "camera_translation" not in result.metrics
    assert "association_recall" not in result.metrics


def test_what_does_not_belong_together_is_refused(scene: Scene) -> None:
    estimate = estimate_of(scene)
    with pytest.raises(InputError, match="1 wearers for a scene of 2"):
        evaluate_scene(replace(estimate, wearers=estimate.wearers[:1]), scene)
    with pytest.raises(InputError, match="labels 3 detections"):
        evaluate_scene(with_labels(estimate, np.zeros(3, int)), scene)
    unknown = tuple(replace(wearer, truth=None) for wearer in scene.wearers)
    with pytest.raises(InputError, match="no wearer's truth"):
        evaluate_scene(estimate, replace(scene, wearers=unknown))


def test_labels_by_hand() -> None:
    truth = np.array([0, 0, 0, 1, 1, -1, -1, 2])
    labels = np.array([0, 1, -1, 1, 1, -1, 0, -1])
    score = label_metrics(labels, truth)
    assert {name: metric.value for name, metric in score.items()} == pytest.approx(
        {"association_precision": 60, "association_recall": 50}
    )
    nothing = label_metrics(np.full(3, -1), np.array([0, 1, -1]))
    assert np.isnan(nothing["association_precision"].value)
    assert nothing["association_recall"].value == 0
