"""Body files: what was found comes back as it was, and what is wrong in one is told where it stands."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap_samples import covariance, hinge_of, names, seeds, walk

from vip_factors.body.anthropometry import LengthPrior, likely_body, skeleton_from_stature
from vip_factors.body.lengths import LENGTHS
from vip_factors.errors import FileFormatError, InputError
from vip_factors.io.body_file import BodyFile, read_body_file, scene_with_body, with_body, write_body_file
from vip_factors.sensors.calibration import sensor_site
from vip_factors.sensors.scene import Scene


def body_of(seed: int, name: str = "Ada", stature: float = 1.7) -> BodyFile:
    rng, usual = np.random.default_rng(seed), skeleton_from_stature(stature)
    skeleton = likely_body(usual.stature).variation.varied(usual, 0.02 * rng.normal(size=len(LENGTHS)))
    hinge = hinge_of(rng, "left_knee")
    prior = LengthPrior(LENGTHS, covariance(rng, len(LENGTHS)))
    return BodyFile(name, replace(skeleton, source="found"), prior, (hinge,), "found")


@settings(max_examples=30, deadline=None)
@given(seeds, names, st.floats(1.2, 2.1))
def test_round_trip(tmp_path_factory: pytest.TempPathFactory, seed: int, name: str, stature: float) -> None:
    body, path = body_of(seed, name, stature), tmp_path_factory.mktemp("body") / "b.toml"
    write_body_file(path, body)
    read = read_body_file(path)
    assert (read.name, read.provenance, read.skeleton.source) == (name, "found", "found")
    np.testing.assert_array_equal(read.skeleton.p_parent_joint, body.skeleton.p_parent_joint)
    assert read.skeleton.landmarks.keys() == body.skeleton.landmarks.keys()
    assert read.skeleton.stature == body.skeleton.stature
    assert read.lengths.names == LENGTHS
    np.testing.assert_allclose(read.lengths.covariance, body.lengths.covariance, atol=2e-7)
    assert read.hinges[0].joint == "left_knee"
    np.testing.assert_allclose(read.hinges[0].variables, body.hinges[0].variables, atol=1e-5)
    np.testing.assert_allclose(read.hinges[0].covariance, body.hinges[0].covariance, rtol=1e-4, atol=2e-7)


@pytest.mark.parametrize(
    ("pattern", "instead", "words"),
    [
        (r"^\[hinges\.left_knee", "[hinges.left_kne", "unknown joint 'left_kne'; did you mean 'left_knee'"),
        (
            r"^offset_deg = .*$",
            "offset_deg = [1.0]",
            "hinges.left_knee: expected 2 numbers of offset_deg, 4 of sigma_deg and 4 rows",
        ),
        (r"^sigma_deg = .*$", "sigma_deg = [1.0, 1.0, 0.0, 1.0]", "hinges.left_knee.sigma_deg.2.: expected number > 0"),
        (r"^axis = .*$", "axis = [0.0, 1.0, 0.0]", "hinges.left_knee.axis is .*expected one near .1.0, 0.0, 0.0"),
        (r"^left_knee = \[.*$", "left_knee = [0, -430, 0]", "430 m from the joint above"),
        (r"^left_knee = \[.*$", "left_knee = [0, -0.5, 0]", "mirror image"),
        (
            r"^\"thigh\" = \{ found_m = 0\.",
            '"thigh" = { found_m = 1.',
            "lengths.thigh.found_m is 1.*the skeleton has 0",
        ),
        (r"^\"thigh\" = \[.*$", "", "expected one row for each length"),
        (r"^\"thigh\" = \[.*$", f'"thigh" = {[0.9] * len(LENGTHS)}', "correlations: expected a symmetric table"),
        (r"axis = \[.*?\]", "axis = [0, 0, 2]", "axis has length 2"),
        (r"bone = \"head\"", 'bone = "haed"', "unknown bone 'haed'; did you mean 'head'"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(tmp_path: Path, pattern: str, instead: str, words: str) -> None:
    path = tmp_path / "b.toml"
    write_body_file(path, body_of(1))
    changed, count = re.subn(pattern, instead, path.read_text(), count=1, flags=re.MULTILINE)
    assert count == 1
    path.write_text(changed)
    with pytest.raises(InputError, match=words) as told:
        read_body_file(path)
    assert str(path) in str(told.value)


def test_what_is_no_toml_is_told(tmp_path: Path) -> None:
    (tmp_path / "b.toml").write_text("name = ")
    for name in ("b.toml", "none.toml"):
        with pytest.raises(FileFormatError, match=f"{name}.*expected a body file"):
            read_body_file(tmp_path / name)


def test_sensors_keep_their_share_of_limbs() -> None:
    recording, body = walk(), body_of(2)
    moved = with_body(recording, body)
    assert moved.subject.body() is body.skeleton
    assert moved.subject.length_prior is body.lengths
    assert moved.subject.hinges == body.hinges
    assert moved.subject.name == recording.subject.name
    for before, after in zip(recording.placement.sites, moved.placement.sites, strict=True):
        expected = sensor_site(before.sensor, body.skeleton).p_bone_sensor
        np.testing.assert_allclose(after.p_bone_sensor, expected, atol=0.01, err_msg=before.sensor)


def test_of_several_wearers_the_one_of_that_name_gets_it() -> None:
    recording, body = walk(), body_of(3)
    bea = replace(recording, subject=replace(recording.subject, name="Bea"))
    scene = scene_with_body(Scene("both", (bea, recording)), body, Path("b.toml"))
    assert [wearer.subject.length_prior is body.lengths for wearer in scene.wearers] == [False, True]
    with pytest.raises(InputError, match=r"b.toml is the body of 'Cid', scene 'both' has the wearers Bea, Ada"):
        scene_with_body(scene, replace(body, name="Cid"), Path("b.toml"))
