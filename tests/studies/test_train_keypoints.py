"""A detector's habit, out of a recording whose wearers' motion is known: with the camera's pose, and without."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scene_sample import MODEL, scene_sample

from tests.studies.__main__ import main
from tests.studies.train_keypoints import offsets_in_recording, pooled_offsets
from vip_factors.body.keypoints import OFFSET_KEYPOINTS, KeypointOffsets, offset_of
from vip_factors.cli.main import main as vip_factors
from vip_factors.errors import InputError
from vip_factors.io.detections import read_keypoint_offsets
from vip_factors.io.mcap_recording import write_recording
from vip_factors.sensors.scene import Scene
from vip_factors.settings import Settings

HABIT = 0.015 * np.random.default_rng(3).standard_normal((len(OFFSET_KEYPOINTS), 3))
SETTINGS = Settings(frame_rate=15.0, covariance=False)


def seen_with_habit(seconds: float, noise_px: float = 0.5) -> Scene:
    """Two wearers before a standing camera, each keypoint beside its place by the detector's habit."""
    scene = scene_sample(seconds, moving=False)
    found, path = scene.camera.detections, scene.camera.truth.path
    pixels, names = found.pixels.copy(), found.keypoints.keypoints
    for number, wearer in enumerate(scene.wearers):
        rows, motion = np.flatnonzero(scene.camera.truth.wearer == number), wearer.truth.motion
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
    detections, truth = replace(found, pixels=pixels).select(some), replace(scene.camera.truth, pixels=None)
    truth = replace(truth, wearer=truth.wearer[some])
    return replace(scene, cameras=(replace(scene.camera, detections=detections, truth=truth),))


def without_truth_of_cameras(scene: Scene) -> Scene:
    """And without the others, who do the same as the first wearer: only their places tell them apart."""
    found = scene.camera.detections.select(scene.camera.truth.wearer == 0)
    return replace(scene, wearers=scene.wearers[:1], cameras=(replace(scene.camera, detections=found, truth=None),))


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
    path = replace(scene.camera.truth.path, p_world_camera=np.array([[9.0, 9.0, 1.5]]))
    elsewhere = replace(scene.camera, truth=replace(scene.camera.truth, path=path))
    with pytest.raises(InputError, match="in the same world"):
        offsets_in_recording(replace(scene, cameras=(elsewhere,)), SETTINGS, lambda done: None)


def test_what_teaches_nothing_is_refused() -> None:
    scene = seen_with_habit(2.0)
    untold = replace(scene, wearers=tuple(replace(one, truth=None) for one in scene.wearers))
    with pytest.raises(InputError, match="nobody's true motion is known"):
        offsets_in_recording(untold, SETTINGS, lambda done: None)
    with pytest.raises(InputError, match="has no camera"):
        offsets_in_recording(replace(scene, cameras=()), SETTINGS, lambda done: None)


def test_from_recordings_to_the_next_estimate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene, offsets, estimate = (tmp_path / name for name in ("scene.mcap", "offsets.toml", "e.mcap"))
    write_recording(seen_with_habit(3.0), scene)
    assert main(["train-keypoints", str(scene), "--out", str(offsets)]) == 0
    assert "2 people" in capsys.readouterr().out
    ((mean, _),) = read_keypoint_offsets(offsets).by_set.values()
    along = np.sum(mean * HABIT) / np.sum(HABIT**2)
    assert 0.3 < along < 1.0  # two people are believed by half
    assert np.linalg.norm(mean - along * HABIT) < 0.3 * np.linalg.norm(along * HABIT)
    quick = ["--frame-rate", "5", "--fusion.rounds", "1", "--fusion.refits", "0"]
    learned = ["--camera.keypoint-offset.learned", str(offsets)]
    assert vip_factors(["smooth", str(scene), "--out", str(estimate), *learned, *quick]) == 0


SHAPE = (len(OFFSET_KEYPOINTS), 3)
USUAL = np.full(SHAPE, 0.010)
DETECTOR_HABIT = 0.012 * np.random.default_rng(1).standard_normal(SHAPE)


def people(count: int, spread: float, noise: float, seed: int = 2) -> list[KeypointOffsets]:
    random = np.random.default_rng(seed)
    scattered = DETECTOR_HABIT + np.hypot(spread, noise) * random.standard_normal((count, *SHAPE))
    return [KeypointOffsets(one, np.full(SHAPE, noise)) for one in scattered]


def test_many_people_teach_habit_and_spread() -> None:
    pooled = pooled_offsets(people(400, 0.005, 0.003), USUAL)
    np.testing.assert_allclose(pooled.mean, DETECTOR_HABIT, atol=0.0015)
    np.testing.assert_allclose(pooled.sigma, 0.005, rtol=0.2)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_few_people_are_believed_little(count: int) -> None:
    few = pooled_offsets(people(count, 0.0, 0.001), USUAL)
    assert np.all(few.sigma < USUAL)
    assert np.all(few.sigma > 0.004)  # how people scatter, so few do not tell
    assert np.abs(few.mean).mean() < np.abs(DETECTOR_HABIT).mean()


def test_offsets_to_expect_are_as_sure_as_they_say() -> None:
    """Over many detectors with a habit and a spread as usual: the next person is where the sigmas expect them."""
    random, missed = np.random.default_rng(5), []
    for _ in range(200):
        habit = np.sqrt(0.5) * USUAL * random.standard_normal(SHAPE)
        each = habit + np.sqrt(0.5) * USUAL * random.standard_normal((4, *SHAPE))
        noise = np.full(SHAPE, 0.004)
        found = [KeypointOffsets(one + noise * random.standard_normal(SHAPE), noise) for one in each[:3]]
        pooled = pooled_offsets(found, USUAL)
        missed.append(((each[3] - pooled.mean) / pooled.sigma) ** 2)
    assert 0.85 < np.mean(missed) < 1.15


def test_noisy_ones_count_less() -> None:
    sure = KeypointOffsets(np.full(SHAPE, 0.01), np.full(SHAPE, 0.001))
    vague = KeypointOffsets(np.full(SHAPE, -0.05), np.full(SHAPE, 0.1))
    alone, both = pooled_offsets([sure], USUAL), pooled_offsets([sure, vague], USUAL)
    np.testing.assert_allclose(both.mean, alone.mean, atol=1e-3)
