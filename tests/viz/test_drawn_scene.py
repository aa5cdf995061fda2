"""A scene brought into one world, and the numbers that are drawn."""

from dataclasses import replace

import numpy as np
import pytest
from scene_sample import Injected, estimate_of, scene_sample

from vip_factors.body.keypoints import KEYPOINT_SETS
from vip_factors.sensors.scene import Scene
from vip_factors.viz.drawn_scene import drawn_scene, heading_paths, implied_headings, rows_of
from vip_factors.viz.images import limb_pairs

GAUGE = Injected(yaw=2.5, shift=(3.0, 1.0, -0.4), heading=0.2)


@pytest.fixture(scope="module")
def sample() -> Scene:
    return scene_sample(0.5)


@pytest.mark.parametrize("with_camera", [True, False])
def test_an_estimate_in_another_gauge_lies_on_the_truth(sample: Scene, with_camera: bool) -> None:
    estimate = estimate_of(sample, GAUGE)
    if not with_camera:
        estimate = replace(estimate, camera=None)
    drawn = drawn_scene(sample, estimate)
    for wearer in drawn.wearers:
        assert wearer.motion.p_world_pelvis == pytest.approx(wearer.truth.p_world_pelvis, abs=1e-6)
        assert wearer.error_mm == pytest.approx(0.0, abs=1e-6)
    assert drawn.path.p_world_camera == pytest.approx(sample.truth.camera.p_world_camera, abs=1e-6)


def test_bodies_project_onto_their_detections(sample: Scene) -> None:
    drawn = drawn_scene(sample, estimate_of(sample, GAUGE))
    for wearer in drawn.wearers:
        mine = sample.truth.wearer == wearer.index
        assert drawn.reprojected(wearer) == pytest.approx(sample.truth.pixels[mine], abs=1e-5)
        assert drawn.reprojection_px(wearer) == pytest.approx(0.0, abs=1e-5)
    labels = sample.truth.wearer.copy()
    labels[0] = -1  # the first frame's detection of the first wearer
    drawn = drawn_scene(sample, replace(estimate_of(sample, GAUGE), wearer_of_detection=labels))
    assert np.isnan(drawn.reprojection_px(drawn.wearers[0])).tolist() == [True] + [False] * 15


def test_the_clock_of_the_video_is_the_estimates(sample: Scene) -> None:
    late = replace(sample, camera=replace(sample.camera, detections=sample.camera.detections.shifted(-0.2)))
    estimate = estimate_of(late, GAUGE)
    drawn = drawn_scene(late, replace(estimate, camera=replace(estimate.camera, time_offset=0.2)))
    assert drawn.detections.time == pytest.approx(sample.camera.detections.time)
    assert drawn.reprojection_px(drawn.wearers[1]) == pytest.approx(0.0, abs=1e-5)


def test_headings_are_drawn_in_the_true_world(sample: Scene) -> None:
    drawn = drawn_scene(sample, estimate_of(sample, GAUGE))
    rows = {row.sensor: row for row in rows_of(drawn.wearers[0])}
    assert rows["left_foot"].error == pytest.approx(np.rad2deg(0.2))
    assert rows["right_foot"].error == pytest.approx(0.0, abs=1e-5)
    assert rows["head"].sigma == pytest.approx(np.rad2deg(0.05))
    unknown = rows_of(drawn_scene(None, estimate_of(sample)).wearers[0])
    assert all(np.isnan(row.error) for row in unknown)


def test_single_frames_disagree_with_a_wrong_heading(sample: Scene) -> None:
    time, degrees = implied_headings(drawn_scene(sample, estimate_of(sample, GAUGE)).wearers[0])
    assert degrees["left_foot"] == pytest.approx(-np.rad2deg(0.2), abs=1e-6)
    assert degrees["head"] == pytest.approx(0.0, abs=1e-6)
    assert len(time) == len(degrees["head"])


def test_only_headings_that_change_have_a_path(sample: Scene) -> None:
    estimate = estimate_of(sample)
    calibration = dict(estimate.wearers[0].calibration)
    path = 2.0 + np.deg2rad([0.0, 3.0, -1.0])
    calibration["head"] = replace(calibration["head"], heading_time=np.array([0.0, 0.2, 0.4]), heading_path=path)
    wearer = replace(estimate.wearers[0], calibration=calibration)
    paths = heading_paths(drawn_scene(None, replace(estimate, wearers=(wearer, *estimate.wearers[1:]))).wearers[0])
    assert list(paths) == ["head"]
    assert paths["head"][1] == pytest.approx([0.0, 3.0, -1.0])
    ann = sample.wearers[0]
    imu = ann.imus["head"]
    kept = imu.time < 0.2
    cut = replace(imu, time=imu.time[kept], specific_force=imu.specific_force[kept],
                  R_inertial_sensor=imu.R_inertial_sensor[kept])  # fmt: skip
    silent = replace(sample, wearers=(replace(ann, imus={**ann.imus, "head": cut}), sample.wearers[1]))
    _, degrees = implied_headings(drawn_scene(silent, estimate_of(sample)).wearers[0])
    assert np.isfinite(degrees["head"][:12]).all()
    assert np.isnan(degrees["head"][-5:]).all()


@pytest.mark.parametrize("name", KEYPOINT_SETS)
def test_limbs_exist_in_every_keypoint_set(name: str) -> None:
    pairs = limb_pairs(KEYPOINT_SETS[name])
    assert len(pairs) >= 16
    assert pairs.max() < len(KEYPOINT_SETS[name])
