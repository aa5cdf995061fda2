"""Where sensors sit: presets, mirrored sides, and what is refused."""

import numpy as np
import pytest

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.lengths import stature_of
from vip_factors.body.skeleton import Skeleton, joint_index
from vip_factors.errors import InputError
from vip_factors.sensors.calibration import SITES, Placement, SensorSite, preset, sensor_site, site_axes

BODY = skeleton_from_stature(1.75)
MIRROR = np.diag([-1.0, 1.0, 1.0])


@pytest.mark.parametrize(("name", "count"), [("sip6", 6), ("tnt10", 10), ("totalcapture13", 13), ("mvn17", 17)])
def test_presets_have_their_sensors_and_both_sides(name: str, count: int) -> None:
    sites = {site.sensor: site for site in preset(name, BODY).sites}
    assert len(sites) == count
    for sensor in sites:
        assert sensor.replace("left_", "right_") in sites
        assert sensor.replace("right_", "left_") in sites


@pytest.mark.parametrize("left", [name for name in SITES if name.startswith("left_")])
def test_the_right_mirrors_the_left(left: str) -> None:
    one, other = sensor_site(left, BODY), sensor_site(left.replace("left_", "right_"), BODY)
    assert other.bone == one.bone.replace("left_", "right_")
    np.testing.assert_allclose(other.p_bone_sensor, MIRROR @ one.p_bone_sensor, atol=1e-12)
    for axis in (0, 2):  # x along the strap and z off the skin mirror; y completes a right-handed frame
        np.testing.assert_allclose(other.R_bone_sensor[:, axis], MIRROR @ one.R_bone_sensor[:, axis], atol=1e-12)


@pytest.mark.parametrize("name", SITES)
def test_sensors_lie_on_the_skin_of_their_bone_and_face_outward(name: str) -> None:
    site = sensor_site(name, BODY)
    assert np.isclose(np.linalg.det(site.R_bone_sensor), 1.0)
    child = SITES[name].child
    axis = BODY.p_parent_joint[joint_index(child)] if child else np.array([0.0, 1.0, 0.0])
    nearest = axis * np.clip(site.p_bone_sensor @ axis / (axis @ axis), 0, 1)
    assert 0.015 < np.linalg.norm(site.p_bone_sensor - nearest) < 0.15
    assert (site.p_bone_sensor - nearest) @ site.R_bone_sensor[:, 2] > 0


def test_sites_scale_with_the_wearer() -> None:
    small, tall = (sensor_site("left_thigh", skeleton_from_stature(h)).p_bone_sensor for h in (1.5, 2.0))
    np.testing.assert_allclose(tall / 2.0, small / 1.5, atol=0.004)  # legs of the tall are a little longer


def test_a_sensor_without_a_place_is_told() -> None:
    placement = preset("sip6", BODY)
    assert placement.site("left_shank").bone == "left_knee"
    with pytest.raises(InputError, match="sensor '00B4' has no place on the body: placed are head, pelvis"):
        placement.site("00B4")


def test_unknown_names_are_refused_with_the_known_ones() -> None:
    with pytest.raises(InputError, match="unknown placement 'mvn9': expected one of sip6, tnt10"):
        preset("mvn9", BODY)
    with pytest.raises(InputError, match="unknown site 'elbow': expected one of head"):
        sensor_site("elbow", BODY)


def test_a_bone_may_be_called_as_people_do() -> None:
    assert SensorSite("s", "left_shank", np.zeros(3), np.eye(3)).bone == "left_knee"


def test_a_sensor_is_placed_once() -> None:
    with pytest.raises(InputError, match="sensor 'pelvis' is placed twice"):
        Placement((sensor_site("pelvis", BODY), sensor_site("pelvis", BODY)))


@pytest.mark.parametrize(
    ("position", "mounting", "sigma", "sentence"),
    [
        (np.array([0, np.nan, 0]), np.eye(3), 0.1, "expected three finite metres"),
        (np.zeros(2), np.eye(3), 0.1, "expected three finite metres"),
        (np.zeros(3), 2 * np.eye(3), 0.1, "not a rotation matrix"),
        (np.zeros(3), np.diag([1.0, 1.0, -1.0]), 0.1, "not a rotation matrix"),
        (np.zeros(3), np.full((3, 3), np.nan), 0.1, "not a rotation matrix"),
        (np.zeros(3), np.eye(3), 0.0, "expected radians above 0"),
    ],
)
def test_impossible_sites_are_refused(position: np.ndarray, mounting: np.ndarray, sigma: float, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        SensorSite("s", "pelvis", position, mounting, sigma)


def test_stature_of_a_skeleton_without_landmarks_comes_from_its_legs() -> None:
    assert stature_of(BODY) == BODY.stature
    assert np.isclose(stature_of(Skeleton(BODY.p_parent_joint)), BODY.stature, atol=0.01)


AXES = {
    "left": [1, 0, 0], "right": [-1, 0, 0], "up": [0, 1, 0], "down": [0, -1, 0], "front": [0, 0, 1], "back": [0, 0, -1]
}  # fmt: skip


@pytest.mark.parametrize("name", SITES)
def test_axes_in_words_are_those_of_the_mounting(name: str) -> None:
    words = [word.split()[1] for word in site_axes(name).split("; ")[1].split(", ")]
    np.testing.assert_allclose(sensor_site(name, BODY).R_bone_sensor.T, [AXES[word] for word in words], atol=1e-12)
