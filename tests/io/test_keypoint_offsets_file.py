"""Files of keypoint offsets: what was written comes back, and what is wrong in one is told where it stands."""

from pathlib import Path

import numpy as np
import pytest

from vip_factors.body.keypoints import SHAPE, KeypointOffsets, PooledOffsets
from vip_factors.errors import FileFormatError, InputError
from vip_factors.io.keypoint_offsets_file import KeypointOffsetsFile, read_keypoint_offsets, write_keypoint_offsets


def written(path: Path) -> KeypointOffsetsFile:
    random = np.random.default_rng(0)
    offsets = KeypointOffsets(0.02 * random.standard_normal(SHAPE), random.uniform(0.003, 0.02, SHAPE))
    content = KeypointOffsetsFile({"coco17": PooledOffsets(offsets, 3), "body25": PooledOffsets(offsets, 1)}, 'a "b"')
    write_keypoint_offsets(path, content)
    return content


def test_round_trip(tmp_path: Path) -> None:
    content = written(tmp_path / "k.toml")
    read = read_keypoint_offsets(tmp_path / "k.toml")
    assert (read.provenance, list(read.sets)) == (content.provenance, ["coco17", "body25"])
    for name, pooled in content.sets.items():
        assert read.sets[name].people == pooled.people
        np.testing.assert_allclose(read.sets[name].offsets.mean, pooled.offsets.mean, atol=5e-7)
        np.testing.assert_allclose(read.sets[name].offsets.sigma, pooled.offsets.sigma, atol=5e-7)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("[coco17]", "[coco71]", "unknown key 'coco71'; did you mean 'coco17'"),
        ("people = 3", "people = 'many'", "coco17.people is 'many': expected a number"),
        ("knee = ", "kneee = ", "unknown key 'coco17.offsets.kneee'; did you mean 'knee'"),
        ("mean_m = [", "mean_m = [0.0, ", "expected a list of 3 numbers"),
        ("sigma_m = [", "sigma_m = [-", "sigmas above zero"),
        ("mean_m = [", "mean_m = [7", "expected means up to 0.15 m"),
    ],
)
def test_what_is_wrong_is_told(tmp_path: Path, old: str, new: str, told: str) -> None:
    path = tmp_path / "k.toml"
    written(path)
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(InputError, match=told.replace("[", r"\[")):
        read_keypoint_offsets(path)


def test_no_such_file(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="expected a file of keypoint offsets"):
        read_keypoint_offsets(tmp_path / "none.toml")
