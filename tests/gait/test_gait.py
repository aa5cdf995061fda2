"""Strikes, toe-offs and strides of a walk that is known by construction; turns are no part of means."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from simulated_walk import STANCE, STRIDE_M, STRIDE_S, WIDTH_M, strikes, walk

import vip_factors as vip
from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import SIDES
from vip_factors.errors import InputError
from vip_factors.estimate import Estimate, PoseCovariance, WearerEstimate
from vip_factors.gait.analysis import _figures, gait_of, gaits_of
from vip_factors.gait.events import events_of_motion, events_of_sensor
from vip_factors.gait.files import curves_figure, write_gait
from vip_factors.gait.results import Gait
from vip_factors.gait.strides import travel_of_foot
from vip_factors.geometry.quaternions import interpolate_points
from vip_factors.geometry.rotations import rotation_y
from vip_factors.sensors.calibration import SensorCalibration, SensorSite, preset
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.recording import Recording
from vip_factors.simulate.gestures import STEP_HZ
from vip_factors.simulate.recording import simulate_recording

SECONDS, TURN_AT = 12.0, 5.2


@pytest.fixture(scope="module")
def motion() -> Motion:
    return walk(SECONDS, TURN_AT)


@pytest.fixture(scope="module")
def recording(motion: Motion) -> Recording:
    return simulate_recording(motion, preset("mvn17", motion.skeleton), seed=1)


def estimate_of(motion: Motion, recording: Recording | None = None) -> WearerEstimate:
    known = {} if recording is None or recording.truth is None else recording.truth.calibration
    sensors = () if recording is None else tuple(recording.placed)
    return WearerEstimate("walker", "SIP", motion, known or {}, sensors=sensors)


@pytest.fixture(scope="module")
def gait(motion: Motion, recording: Recording) -> Gait:
    return gait_of(estimate_of(motion, recording), recording)


def nearest_ms(found: np.ndarray, true: np.ndarray) -> np.ndarray:
    return 1000 * np.array([found[np.argmin(np.abs(found - one))] - one for one in true])


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("treadmill", [False, True])
def test_events_by_the_legs(side: str, treadmill: bool) -> None:
    found = events_of_motion(walk(8.0, treadmill=treadmill), side)
    true = strikes(side, 8.0)
    true = true[(true > 0.8) & (true < 7.5)]
    assert np.abs(nearest_ms(found.strike, true)).max() < 60
    assert np.ptp(nearest_ms(found.strike, true)) < 10
    assert np.abs(nearest_ms(found.off, true + STANCE * STRIDE_S)[:-1]).max() < 60
    assert not found.by_sensor


@pytest.mark.parametrize("side", SIDES)
def test_events_by_a_foot_sensor(side: str, recording: Recording) -> None:
    site = next(site for site in recording.placement.sites if site.bone == f"{side}_ankle")
    assert recording.truth is not None
    assert recording.truth.calibration is not None
    stream, R = recording.imus[site.sensor], recording.truth.calibration[site.sensor].R_bone_sensor
    true = strikes(side, SECONDS)
    true = true[(true > 0.8) & (true < SECONDS - 1)]
    for one in (stream, replace(stream, angular_rate=None)):  # some log orientation alone
        found = events_of_sensor(one, R)
        assert found is not None
        assert found.by_sensor
        assert np.abs(nearest_ms(found.strike, true)).max() < 25
        assert np.abs(nearest_ms(found.off, true + STANCE * STRIDE_S)).max() < 35
        assert np.all((found.rest > found.strike) & (found.off < found.strike))
    assert events_of_sensor(stream.cut(0.0, 0.5), R) is None


def test_turns_are_no_part_of_means(gait: Gait) -> None:
    turning = [stride for stride in gait.strides if stride.end > TURN_AT + 0.3 and stride.start < TURN_AT + 1.1]
    assert len(turning) >= 3
    assert all(one.left_out for one in turning)
    assert all(stride.end < TURN_AT + 0.7 or stride.start > TURN_AT + 0.7 for stride in gait.counted)
    assert len(gait.counted) >= 10


def test_figures_are_those_of_the_walk(gait: Gait) -> None:
    true = {"time": STRIDE_S, "length": STRIDE_M, "speed": STRIDE_M / STRIDE_S, "cadence": 120 / STRIDE_S,
            "width": WIDTH_M, "step_time": STRIDE_S / 2, "step_length": STRIDE_M / 2, "stance": STANCE * STRIDE_S,
            "swing_percent": 100 * (1 - STANCE), "double_support_percent": 100 * (2 * STANCE - 1)}  # fmt: skip
    for name, value in true.items():
        for side in ("left", "right", "both"):
            found = gait.figure(name, side)
            assert found is not None
            assert found.mean == pytest.approx(value, rel=0.1 if "support" in name else 0.04), (name, side)
            assert abs(found.mean - value) < 3 * max(found.sigma, 0.01 * value), (name, side)
        difference = gait.figure(name, "difference")
        assert difference is not None
        assert abs(difference.mean) < 3 * max(difference.sigma, 0.01 * value), name
    angle, clearance = gait.figure("strike_angle"), gait.figure("clearance")
    assert angle is not None
    assert angle.mean == pytest.approx(20, abs=4)
    assert clearance is not None
    assert 0.0 < clearance.mean < 0.15


def test_curves_are_over_the_cycle(motion: Motion, recording: Recording, gait: Gait) -> None:
    known = {(curve.angle, curve.side): curve for curve in gait.curves}
    knee = known["left_knee_flexion", "left"]
    assert len(knee.mean) == 101
    assert 0.6 < np.argmax(knee.mean) / 100 < 0.9  # knees are bent most in the swing
    assert ("right_knee_flexion", "left") not in known
    assert known["pelvis_rotation", "left"].mean == pytest.approx(np.zeros(101), abs=8)
    covariance = PoseCovariance(np.tile(4e-4 * np.eye(3), (len(motion), 24, 1, 1)), np.zeros((len(motion), 3, 3)))
    surer = gait_of(replace(estimate_of(motion, recording), covariance=covariance), recording)
    wide = next(curve for curve in surer.curves if (curve.angle, curve.side) == ("left_knee_flexion", "left"))
    assert surer.with_covariance
    assert np.all(wide.sigma > knee.sigma)


def test_the_walk_that_the_package_makes_can_be_measured() -> None:
    made = vip.simulate("walk", seconds=8.0, initial_pose="none").wearers[0]
    assert made.truth is not None
    motion = made.truth.motion
    way_m = np.linalg.norm(motion.p_world_pelvis[-1] - motion.p_world_pelvis[0])
    for recording in (made, None):  # by sensors on the feet, and by the legs
        gait = gait_of(estimate_of(motion, made), recording)
        assert {foot.by_sensor for foot in gait.feet.values()} == {recording is not None}
        assert len(gait.counted) == len(gait.strides) >= 10
        speed, time = gait.figure("speed"), gait.figure("time")
        assert speed is not None
        assert time is not None
        assert abs(speed.mean - way_m / np.ptp(motion.time)) < 3 * speed.sigma
        assert time.mean == pytest.approx(1 / STEP_HZ, abs=0.02)


def test_who_does_not_walk_has_no_strides() -> None:
    still = walk(2.0)
    still = replace(still, R_parent_child=np.repeat(still.R_parent_child[:1], 200, axis=0),
                    p_world_pelvis=np.repeat(still.p_world_pelvis[:1], 200, axis=0))  # fmt: skip
    for one in (still, still.frames(slice(0, 2))):
        none = gait_of(estimate_of(one))
        assert not none.strides
        assert not none.figures
        assert not none.curves


def test_a_foot_sensor_measures_its_way() -> None:
    """Across a floor with a still foot at both ends; the landing's blow is too short for the samples."""
    time = np.arange(0.0, 2.0, 0.01)
    u = np.clip((time - 0.5) / 0.6, 0, 1)
    p = 1.4 * u**3 * (10 - 15 * u + 6 * u**2)
    force = np.stack([np.gradient(np.gradient(p, time), time), 0 * time, 9.81 + 0 * time], axis=1)
    force[111:113, 0] += (100.0, -85.0)  # 0.15 m/s too much
    stream = ImuStream("foot", time, force, np.tile(np.eye(3), (len(time), 1, 1)))
    length = travel_of_foot(stream, np.array([0.3, 1.6]))
    assert length[0] == pytest.approx(1.4, abs=0.03)
    assert np.isnan(travel_of_foot(replace(stream, specific_force=None), np.array([0.3, 1.6]))).all()


@pytest.mark.parametrize("seed", [0, 2])
def test_strides_begin_where_a_foot_neither_turns_nor_slides(seed: int) -> None:
    """Feet that turn little while they land or slide made 9 to 16 % of single feet's lengths."""
    made = vip.simulate("walk", "totalcapture13", seconds=20.0, seed=seed).wearers[0]
    assert made.truth is not None
    motion = made.truth.motion
    for site in made.placement.sites:
        if site.bone.endswith("ankle"):
            found = events_of_sensor(made.imus[site.sensor], site.R_bone_sensor)
            assert found is not None
            ankle = interpolate_points(motion.time, motion.state.p_world_joint[:, site.bone_index, :2], found.rest)
            true = np.linalg.norm(np.diff(ankle, axis=0), axis=1)
            walked = true > 0.5
            lengths = travel_of_foot(made.imus[site.sensor], found.rest)[walked]
            assert np.nanmean(lengths / true[walked]) == pytest.approx(1.0, abs=0.03)


def shank_stream(motion: Motion, site: SensorSite) -> ImuStream:
    """What an ideal sensor on it measures."""
    R_world_sensor = motion.state.R_world_bone[:, site.bone_index] @ site.R_bone_sensor
    a = motion.state.point(site.bone_index, site.p_bone_sensor)
    for _ in range(2):
        a = np.gradient(a, 1 / motion.rate, axis=0)
    force = np.einsum("tji,tj->ti", R_world_sensor, a + np.array([0.0, 0.0, 9.81]))
    return ImuStream(site.sensor, motion.time, force, R_world_sensor)


def test_shanks_tell_lengths_that_the_motion_has_too_short(motion: Motion, recording: Recording) -> None:
    """Of a motion whose feet slide back as they stand, as those do whose thighs swing too little."""
    short = replace(motion, p_world_pelvis=motion.p_world_pelvis * np.array([0.93, 0.93, 1.0]))
    sites = [site for site in recording.placement.sites if site.bone in ("left_knee", "right_knee")]
    worn = replace(recording, imus={site.sensor: shank_stream(motion, site) for site in sites}, truth=None)
    known = {site.sensor: SensorCalibration(0.0, site.R_bone_sensor, bone=site.bone) for site in sites}
    astray = {name: replace(one, heading=np.pi) for name, one in known.items()}
    for calibration, expected, sigma in ((known, STRIDE_M, 0.035), (astray, 0.93 * STRIDE_M, 0.06)):
        found = gait_of(WearerEstimate("walker", "SIP", short, calibration), worn).figure("length")
        assert found is not None
        assert found.mean == pytest.approx(expected, rel=0.02)
        assert found.sigma == pytest.approx(sigma * found.mean, rel=0.1)


FEET = frozenset({"left_ankle", "right_ankle"})  # between which no joint is


@pytest.mark.parametrize("with_recording", [True, False])
def test_nothing_is_told_of_what_no_sensor_measured(
    motion: Motion, recording: Recording, gait: Gait, tmp_path: Path, with_recording: bool
) -> None:
    """With the recording its placement tells where sensors sat, without it the estimate."""
    whole = estimate_of(motion, recording)
    bones = {site.sensor: site.bone for site in recording.placement.sites}
    feet = {name: replace(one, bone=bones[name]) for name, one in whole.calibration.items() if bones[name] in FEET}
    estimate = replace(whole, calibration=feet, sensors=tuple(feet))
    found = gait_of(estimate, recording if with_recording else None)
    assert found.bones == FEET
    assert not found.curves
    assert {figure.quantity.name for figure in gait.figures} - {figure.quantity.name for figure in found.figures} == {
        "width", "step_length"
    }  # fmt: skip
    assert all(np.isnan(stride.values["width"]) for stride in found.strides)
    *unsure, said = map(str, found.findings)
    assert len(unsure) == (not with_recording)  # then the legs tell when feet strike
    assert "hip, knee, ankle" in said
    assert "stride width, step length" in said
    written = write_gait([found], tmp_path / "feet")
    assert "gait.png" not in [one.name for one in written]
    assert (tmp_path / "feet" / "curves.csv").read_text().count("\n") == 1
    assert json.loads((tmp_path / "feet" / "gait.json").read_text())["findings"] == [*unsure, said]
    filmed = gait_of(estimate, recording, with_camera=True)  # a camera sees what no sensor measures
    assert len(filmed.curves) == len(gait_of(whole).curves)
    assert not filmed.findings


def test_files_hold_it_all(gait: Gait, tmp_path: Path) -> None:
    folder = tmp_path / "gait"
    written = write_gait([gait], folder)
    assert [one.name for one in written] == ["strides.csv", "figures.csv", "curves.csv", "gait.json", "gait.png"]
    with (folder / "strides.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(gait.strides)
    assert sum(int(row["counted"]) for row in rows) == len(gait.counted)
    assert float(rows[0]["length_m"]) == pytest.approx(gait.strides[0].values["length"], abs=1e-3)
    held = json.loads((folder / "gait.json").read_text())
    assert held["units"]["speed"] == "m/s"
    assert len(held["strides"]) == len(gait.strides)
    assert held["figures"][0]["quantity"] == "time"
    with pytest.raises(InputError, match="exists"):
        write_gait([gait], folder)
    plain = replace(gait, curves=())
    two = write_gait([plain, replace(plain, name="Bea")], folder)
    assert {one.name for one in two} >= {"walker.strides.csv", "Bea.gait.json"}
    alike = write_gait([replace(plain, name="a/b"), replace(plain, name="A_b")], tmp_path / "alike")
    assert {one.name for one in alike} >= {"a_b.strides.csv", "A_b-2.strides.csv"}
    with pytest.raises(InputError, match="different names"):
        write_gait([gait, gait], folder)


def test_wearers_belong_to_recordings(motion: Motion, recording: Recording) -> None:
    (one,) = vip.gait(estimate_of(motion, recording), recording)
    assert one.feet["left"].by_sensor
    assert not vip.gait(estimate_of(motion))[0].feet["left"].by_sensor
    both = Estimate("two", "SIP", (estimate_of(motion), estimate_of(motion)))
    with pytest.raises(InputError, match="2 wearers"):
        gaits_of(both, vip.Scene("one", (recording,)))


def test_strikes_are_where_the_heel_lands() -> None:
    """By the legs, of this walk, a little before: what the bounds of single strikes leave open."""
    late = [nearest_ms(events_of_motion(walk(8.0), side).strike, strikes(side, 8.0)[1:-2]).mean() for side in SIDES]
    assert np.mean(late) == pytest.approx(-35.0, abs=8)


def test_feet_that_strike_with_their_toes_first_have_a_negative_angle() -> None:
    angle = gait_of(estimate_of(walk(8.0, strike_deg=-12.0))).figure("strike_angle")
    assert angle is not None
    assert angle.mean == pytest.approx(-12, abs=4)


def test_uphill_toes_are_as_high_over_the_ground_as_on_the_level() -> None:
    level = walk(8.0)
    R, slope = level.R_parent_child.copy(), rotation_y(-np.deg2rad(4.0))
    R[:, 0] = slope @ R[:, 0]
    uphill = replace(level, R_parent_child=R, p_world_pelvis=level.p_world_pelvis @ slope.T)
    found = [gait_of(estimate_of(one)).figure("clearance") for one in (level, uphill)]
    assert found[0] is not None
    assert found[1] is not None
    assert found[1].mean == pytest.approx(found[0].mean, abs=0.01)


def test_lengths_by_the_legs_are_as_sure_as_the_legs_length(motion: Motion, recording: Recording) -> None:
    sigmas = []
    for stature_m in (None, 1.75):
        unshod = {name: one for name, one in recording.imus.items() if not name.endswith(("foot", "shank"))}
        worn = replace(recording, imus=unshod, subject=vip.Subject(stature_m=stature_m))
        length = gait_of(estimate_of(motion, recording), worn).figure("length")
        assert length is not None
        sigmas.append(length.sigma / length.mean)
    assert sigmas[0] > 1.2 * sigmas[1] > 0.07


def test_a_difference_is_left_less_right(gait: Gait) -> None:
    longer = [
        replace(stride, values=stride.values | {"length": stride.values["length"] + 0.1 * (stride.side == "left")})
        for stride in gait.counted
    ]
    found = [
        next(
            figure.mean
            for figure in _figures(strides, 0.05)
            if (figure.quantity.name, figure.side) == ("length", "difference")
        )
        for strides in (gait.counted, longer)
    ]
    assert found[1] - found[0] == pytest.approx(0.1)


def test_the_picture_says_what_it_shows(gait: Gait) -> None:
    figure = curves_figure(gait)
    assert figure is not None
    words = " ".join(text.get_text() for text in figure.texts)
    for side in SIDES:
        assert f"{side} (" in words
        assert f"n = {sum(stride.side == side for stride in gait.counted)}" in words
    for axes in figure.axes:
        assert axes.get_xlabel() == "% of the gait cycle"
        assert axes.get_ylabel() == "degrees"
        assert "(+ " in axes.get_title(loc="left")
        upright = {line.get_xdata()[0] for line in axes.lines if len(line.get_xdata()) == 2}
        assert upright == {found.mean for side in SIDES if (found := gait.figure("stance_percent", side))}
