"""A detector's habit, out of a recording whose wearers' motion is known: with the camera's pose, and without."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scene_sample import MODEL, scene_sample

from vip_factors.body.keypoints import OFFSET_KEYPOINTS, KeypointOffsets, PooledOffsets, keypoint_set, offset_of
from vip_factors.errors import InputError
from vip_factors.io.keypoint_offsets_file import KeypointOffsetsFile, write_keypoint_offsets
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.scene import Scene
from vip_factors.settings import Settings
from vip_factors.stages.fusion_start import prior_offsets
from vip_factors.stages.keypoint_offsets import offsets_in_recording
from vip_factors.terms.keypoint_offset import KeypointOffsetSettings

HABIT = 0.015 * np.random.default_rng(3).standard_normal((len(OFFSET_KEYPOINTS), 3))
SETTINGS = replace(Settings(), frame_rate=15.0)


def seen_with_habit(seconds: float, noise_px: float = 0.5) -> Scene:
    """Two wearers before a standing camera, each keypoint beside its place by the detector's habit."""
    scene = scene_sample(seconds, moving=False)
    found, path = scene.camera.detections, scene.truth.camera
    pixels, names = found.pixels.copy(), found.keypoints.keypoints
    for number, wearer in enumerate(scene.wearers):
        rows, motion = np.flatnonzero(scene.truth.wearer == number), wearer.truth.motion
        frames = np.rint(found.time[found.frame[rows]] * motion.rate).astype(int)
        for column, (name, place) in enumerate(zip(names, found.keypoints.on_body(motion.skeleton), strict=True)):
            index, sign = offset_of(name)
            if index >= 0 and place is not None:
                point = place.p_bone_point + HABIT[index] * [sign, 1, 1]
                p = path.at(found.time[found.frame[rows]]).to_camera(
                    motion.state.point(place.bone, point)[frames, None]
                )
                pixels[rows, column] = MODEL.project(p)[:, 0]
    pixels += noise_px * np.random.default_rng(0).standard_normal(pixels.shape)
    some = found.frame % 3 == 0  # what is left tells as much, in a third of the time
    detections, truth = replace(found, pixels=pixels).select(some), replace(scene.truth, pixels=None)
    truth = replace(truth, wearer=truth.wearer[some])
    return replace(scene, camera=replace(scene.camera, detections=detections), truth=truth)


def without_truth_of_cameras(scene: Scene) -> Scene:
    """And without the others, who do the same as the first wearer: only their places tell them apart."""
    found = scene.camera.detections.select(scene.truth.wearer == 0)
    return replace(scene, wearers=scene.wearers[:1], camera=replace(scene.camera, detections=found), truth=None)


@pytest.mark.parametrize("known", [True, False])
def test_a_habit_is_found(known: bool) -> None:
    scene = seen_with_habit(3.0)
    found = offsets_in_recording(scene if known else without_truth_of_cameras(scene), SETTINGS, lambda done: None)
    assert [one.wearer for one in found] == (["ann", "bob"] if known else ["ann"])
    for one in found:
        assert one.keypoints == "coco17"
        missed = one.offsets.mean - HABIT
        assert np.sqrt(np.mean(missed**2)) < (0.003 if known else 0.008)
        assert np.mean((missed / one.offsets.sigma) ** 2) < 2.0


def test_cameras_and_truth_have_to_be_in_one_world() -> None:
    scene = seen_with_habit(2.5)
    truth = replace(scene.truth, camera=replace(scene.truth.camera, p_world_camera=np.array([[9.0, 9.0, 1.5]])))
    with pytest.raises(InputError, match="in the same world"):
        offsets_in_recording(replace(scene, truth=truth), SETTINGS, lambda done: None)


def test_what_teaches_nothing_is_refused() -> None:
    scene = seen_with_habit(2.0)
    untold = replace(scene, wearers=tuple(replace(one, truth=None) for one in scene.wearers), truth=None)
    with pytest.raises(InputError, match="nobody's true motion is known"):
        offsets_in_recording(untold, SETTINGS, lambda done: None)
    with pytest.raises(InputError, match="has no camera"):
        offsets_in_recording(replace(scene, camera=None, truth=None), SETTINGS, lambda done: None)


def test_what_was_learnt_of_another_detector_is_not_used(tmp_path: Path) -> None:
    usual = KeypointOffsetSettings()
    learned, path = KeypointOffsets(HABIT, usual.sigmas), tmp_path / "offsets.toml"
    write_keypoint_offsets(path, KeypointOffsetsFile({"body25": PooledOffsets(learned, 3)}))
    camera, named = scene_sample(1.0).camera, replace(usual, learned=path)
    with pytest.raises(InputError, match="has no offsets of 'coco17'"):
        prior_offsets(camera, named)
    body25 = keypoint_set("body25")
    nobody = Detections(
        body25, np.zeros(1), np.zeros(0, int), np.zeros((0, len(body25), 2)), np.zeros((0, len(body25)))
    )
    other = replace(camera, detections=nobody)
    np.testing.assert_allclose(prior_offsets(other, named).mean, HABIT, atol=1e-6)


def test_without_a_file_nothing_was_learnt() -> None:
    usual = prior_offsets(scene_sample(1.0).camera, KeypointOffsetSettings())
    assert not np.any(usual.mean)
    assert np.all(usual.sigma >= KeypointOffsetSettings().sigmas)
