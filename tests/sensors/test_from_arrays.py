"""Recordings and 2D poses from arrays, and orientations found while samples arrive."""

import numpy as np
import pytest

import vip_factors as vip
from vip_factors.errors import InputError, RecordingError
from vip_factors.geometry.quaternions import quaternion_from_matrix
from vip_factors.geometry.rotations import angle_between
from vip_factors.sensors.imu_stream import AttitudeFilter, ImuStream


@pytest.fixture(scope="module")
def worn() -> vip.Recording:
    return vip.simulate(seconds=3.0, placement="sip6", seed=1).wearers[0]


def by_sensor(worn: vip.Recording, name: str) -> dict[str, np.ndarray]:
    return {sensor: getattr(one, name) for sensor, one in worn.imus.items()}


def test_matrices_and_quaternions_are_the_same_orientation(worn: vip.Recording) -> None:
    R, time = by_sensor(worn, "R_inertial_sensor"), by_sensor(worn, "time")
    wxyz = {sensor: quaternion_from_matrix(one, "wxyz") for sensor, one in R.items()}
    one, other = (vip.Recording.from_arrays(time, orientation=given) for given in (R, wxyz))
    assert one.placed == list(R)  # by the names of their sites
    for sensor in R:
        np.testing.assert_allclose(one.imus[sensor].R_inertial_sensor, other.imus[sensor].R_inertial_sensor, atol=1e-12)


def test_a_sample_that_is_not_finite_is_a_gap(worn: vip.Recording) -> None:
    stream = worn.imus["head"]
    wxyz = quaternion_from_matrix(stream.R_inertial_sensor, "wxyz")
    wxyz[10:20] = np.nan
    made = vip.Recording.from_arrays(stream.time, orientation={"hat": wxyz}, placement={"head": "hat"})
    assert len(made.imus["hat"]) == len(stream) - 10
    assert made.placement.sites[0].bone == "head"


def test_raw_samples_get_the_orientation_of_importers(worn: vip.Recording) -> None:
    raw = {"acceleration": by_sensor(worn, "specific_force"), "gyroscope": by_sensor(worn, "angular_rate")}
    made = vip.Recording.from_arrays(by_sensor(worn, "time"), **raw, placement="sip6")
    assert all(imu.R_inertial_sensor is not None for imu in made.imus.values())


@pytest.mark.parametrize(
    ("given", "problem"),
    [
        ({"placement": "sip7"}, "unknown placement"),
        ({"placement": {"hat": "head"}}, "unknown site 'hat'"),
        ({"placement": {"head": "other"}}, "without samples: other; sensors are head"),
        ({"time": {"other": np.arange(3.0)}}, "'head' has no times"),
        ({"orientation": {"head": np.zeros((3, 5))}}, r"orientation has shape \(3, 5\)"),
        ({"orientation": {}, "acceleration": {"head": np.zeros((3, 3))}}, "neither orientation nor angular rate"),
    ],
)
def test_what_cannot_be_is_told(given: dict[str, object], problem: str) -> None:
    usual: dict[str, object] = {"time": np.arange(3.0), "orientation": {"head": np.tile(np.eye(3), (3, 1, 1))}}
    with pytest.raises((InputError, RecordingError), match=problem):
        vip.Recording.from_arrays(**{**usual, **given})  # type: ignore[arg-type]


def test_poses_of_everybody_in_every_frame() -> None:
    pixels = np.full((3, 2, 17, 2), np.nan)
    pixels[0, 1], pixels[2, :, 4] = 5.0, 7.0
    found = vip.Detections.from_arrays(np.arange(3) / 30, pixels, "coco17")
    np.testing.assert_array_equal(found.frame, [0, 2, 2])
    np.testing.assert_array_equal(found.seen.sum(axis=1), [17, 1, 1])
    alone = vip.Detections.from_arrays(np.arange(3) / 30, pixels[:, 1], "coco17", np.full((3, 17), 0.5))
    np.testing.assert_array_equal(alone.frame, [0, 2])
    assert alone.confidence.max() == 0.5
    with pytest.raises(RecordingError, match="expected \\(2, people, 17, 2\\)"):
        vip.Detections.from_arrays(np.arange(2), pixels, "coco17")


def filtered(stream: ImuStream) -> np.ndarray:
    attitude = AttitudeFilter()
    assert stream.specific_force is not None
    assert stream.angular_rate is not None
    found = [
        attitude.orientation(float(time), force, rate)
        for time, force, rate in zip(stream.time, stream.specific_force, stream.angular_rate, strict=True)
    ]
    return np.array([one for one in found if one is not None])


def test_orientation_while_samples_arrive_is_that_of_the_sensor_but_for_its_heading(worn: vip.Recording) -> None:
    for stream in worn.imus.values():
        R, own = filtered(stream), stream.R_inertial_sensor
        assert own is not None
        turned = angle_between(R[0].T @ R, own[0].T @ own)  # since the first sample: the heading's zero is free
        tilt = np.arccos(np.clip(np.sum(R[:, 2] * own[:, 2], axis=1), -1, 1))
        assert np.rad2deg(np.median(turned)) < 6.0
        assert np.rad2deg(np.median(tilt)) < 6.0


def test_lost_samples_turn_it_as_far_and_late_ones_are_left_out(worn: vip.Recording) -> None:
    stream = worn.imus["left_forearm"]
    whole = filtered(stream)
    kept = np.ones(len(stream), bool)
    kept[100:110] = False
    thinned = ImuStream("thinned", stream.time[kept], stream.specific_force[kept], None, stream.angular_rate[kept])
    assert np.rad2deg(angle_between(filtered(thinned)[-1], whole[-1])) < 5.0
    attitude = AttitudeFilter()
    up, still = np.array([0.0, 0.0, 9.81]), np.zeros(3)
    assert attitude.orientation(1.0, up, still) is not None
    assert attitude.orientation(0.9, up, still) is None
    assert attitude.orientation(-5.0, up, still) is not None  # its clock began again
