"""Files of keypoint offsets: what is wrong in one is told where it stands, and only their own detector gets them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scene_sample import scene_sample

from vip_factors.body.keypoints import OFFSET_KEYPOINTS, keypoint_set
from vip_factors.errors import FileFormatError, InputError
from vip_factors.factor_settings import KeypointOffsetSettings
from vip_factors.io.detections import read_keypoint_offsets
from vip_factors.problem.scene import keypoint_offset_sigmas
from vip_factors.sensors.detections import Detections
from vip_factors.stages.fusion_start import prior_offsets

MEAN = np.round(0.02 * np.random.default_rng(0).standard_normal((len(OFFSET_KEYPOINTS), 3)), 6)


def written(path: Path) -> Path:
    lines = ['provenance = "walk.mcap"', "[body25]", "people = 3", "[body25.offsets]"]
    for name, mean in zip(OFFSET_KEYPOINTS, MEAN, strict=True):
        lines.append(f"{name} = {{ mean_m = {mean.tolist()}, sigma_m = [0.01, 0.02, 0.01] }}")
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[body25]", "[body52]", "unknown key 'body52'; did you mean 'body25'"),
        ("knee = ", "kneee = ", "body25.offsets.knee is missing"),
        ("sigma_m = [", "sigma_m = [-", "sigmas above zero"),
        ("mean_m = [", "mean_m = [7", "expected means up to 0.15 m"),
    ],
)
def test_what_is_wrong_is_told(tmp_path: Path, old: str, new: str, words: str) -> None:
    path = written(tmp_path / "k.toml")
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(InputError, match=words.replace("[", r"\[")):
        read_keypoint_offsets(path)


def test_no_such_file(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="expected a file of keypoint offsets"):
        read_keypoint_offsets(tmp_path / "none.toml")


def test_what_was_learnt_of_another_detector_is_not_used(tmp_path: Path) -> None:
    settings = KeypointOffsetSettings(learned=read_keypoint_offsets(written(tmp_path / "k.toml")))
    camera, body25 = scene_sample(1.0).camera, keypoint_set("body25")
    with pytest.raises(InputError, match="has no offsets of 'coco17'"):
        prior_offsets(camera, settings)
    nobody = Detections(
        body25, np.zeros(1), np.zeros(0, int), np.zeros((0, len(body25), 2)), np.zeros((0, len(body25)))
    )
    np.testing.assert_array_equal(prior_offsets(replace(camera, detections=nobody, truth=None), settings).mean, MEAN)


def test_without_a_file_nothing_was_learnt() -> None:
    usual = prior_offsets(scene_sample(1.0).camera, KeypointOffsetSettings())
    assert not np.any(usual.mean)
    assert np.all(usual.sigma >= keypoint_offset_sigmas(KeypointOffsetSettings()))
