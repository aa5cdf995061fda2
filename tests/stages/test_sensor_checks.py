"""Sensors that are wrong by themselves or late are found, told and put right; sound ones are left as they are."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from vip_factors.errors import RecordingError
from vip_factors.geometry.rotations import rotation_z, transpose
from vip_factors.initialise.sensor_clocks import fewest_delays
from vip_factors.io.convert import read_log
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.frames import resample_streams
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene
from vip_factors.sensors.sources import RecordingInMemory, one_stream
from vip_factors.settings import SensorClockSettings, Settings, WindowSettings
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording
from vip_factors.simulate.settings import SimulateSettings
from vip_factors.stages.accelerometers import accelerometer_scale, is_scale_wrong
from vip_factors.stages.calibrate import Stretches, check_sensors
from vip_factors.stages.pauses import pauses_of
from vip_factors.stages.sensor_checks import PreparedRecording, check_scene, checked
from vip_factors.stages.windows import WindowPlan

LEG = ("pelvis", "left_thigh", "left_shank", "left_foot")


@cache
def leg(rigid: bool = False) -> Recording:
    motion = gestures(18.0)
    whole = preset("totalcapture13", motion.skeleton)
    placement = replace(whole, sites=tuple(site for site in whole.sites if site.sensor in LEG))
    settings = SimulateSettings.noise_free() if rigid else SimulateSettings()
    return simulate_recording(motion, placement, settings, seed=1)


def with_stream(name: str, stream: ImuStream, rigid: bool = False) -> Recording:
    return replace(leg(), imus={**leg(rigid).imus, name: stream})


def test_sound_sensors_are_left_alone() -> None:
    recording, findings = checked(leg(), Settings())
    assert findings == ()
    assert recording.imus == leg().imus


@pytest.mark.parametrize(
    ("late", "seconds", "rigid"), [("left_shank", 0.035, True), ("left_foot", -0.03, True), ("left_foot", 0.05, False)]
)
def test_a_sensor_whose_clock_is_off_is_found_and_put_right(late: str, seconds: float, rigid: bool) -> None:
    """Sensors that are tied to rigid bones tell it to 5 ms; skin that follows the bone adds some more."""
    sound = leg(rigid).imus[late]
    delayed = with_stream(late, replace(sound, time=sound.time + seconds), rigid)
    recording, findings = checked(delayed, Settings())
    assert len(findings) == 1
    assert f"'{late}'" in str(findings[0])
    assert ("behind" if seconds > 0 else "ahead of") in str(findings[0])
    np.testing.assert_allclose(recording.imus[late].time, sound.time, atol=0.005 if rigid else 0.015)


def test_a_clock_is_compared_over_a_pause_after_which_headings_are_others() -> None:
    """Neither of the two stretches is long enough by itself."""
    imus = {}
    for number, (name, stream) in enumerate(leg(True).imus.items()):
        assert stream.R_inertial_sensor is not None
        begin, end = stream.cut(-np.inf, 8.0), stream.cut(10.0, np.inf)
        assert end.R_inertial_sensor is not None
        end = replace(end, R_inertial_sensor=rotation_z(0.7 * number) @ end.R_inertial_sensor)
        stream = one_stream([begin, end])
        imus[name] = replace(stream, time=stream.time + 0.035) if name == "left_foot" else stream
    recording = replace(leg(True), imus=imus, pauses=pauses_of(imus), truth=None)
    scene, _, findings = check_scene(Scene("leg", (recording,)), Settings())
    assert [(finding.kind, finding.subject) for finding in findings] == [("clock corrected", "sensor 'left_foot'")]
    corrected = scene.wearers[0].imus["left_foot"]
    np.testing.assert_allclose(corrected.time, imus["left_foot"].time - 0.035, atol=0.005)


def test_samples_that_are_impossible_are_told_but_not_where_no_accelerometer_is() -> None:
    sound = leg().imus["left_foot"]
    assert sound.specific_force is not None
    blow = sound.specific_force.copy()
    blow[300] = 461.0
    _, findings = checked(with_stream("left_foot", replace(sound, specific_force=blow)), Settings())
    assert [(finding.kind, finding.subject, finding.numbers["spikes"]) for finding in findings] == [
        ("accelerometer corrected", "left_foot", 1.0)
    ]
    _, findings = checked(with_stream("left_foot", replace(sound, specific_force=None)), Settings())
    assert findings == ()


def test_a_reversed_axis_is_told_and_put_right() -> None:
    sound = leg().imus["left_foot"]
    force = sound.specific_force
    assert force is not None
    axis = int(np.argmax(np.abs(force.mean(axis=0))))
    flipped = replace(sound, specific_force=force * np.where(np.arange(3) == axis, -1.0, 1.0))
    recording, findings = checked(with_stream("left_foot", flipped), Settings())
    assert [finding.kind for finding in findings] == ["accelerometer axis"]
    assert f"the {'xyz'[axis]} axis of the accelerometer of 'left_foot'" in str(findings[0])
    np.testing.assert_array_equal(recording.imus["left_foot"].specific_force, force)


def test_inverted_orientations_are_refused_by_name() -> None:
    imus = {
        name: replace(one, R_inertial_sensor=transpose(one.R_inertial_sensor))
        for name, one in leg().imus.items()
        if one.R_inertial_sensor is not None
    }
    with pytest.raises(RecordingError, match=r"are inverted: .* conjugate of each quaternion"):
        checked(replace(leg(), imus=imus), Settings())


def test_clocks_are_only_told_of_where_asked() -> None:
    sound = leg().imus["left_foot"]
    late = with_stream("left_foot", replace(sound, time=sound.time + 0.05))
    told, findings = checked(late, Settings(sensor_clocks=SensorClockSettings(correct=False)))
    assert "left so" in str(findings[0])
    assert told.imus["left_foot"] is late.imus["left_foot"]
    assert checked(late, Settings(sensor_clocks=SensorClockSettings(check=False)))[1] == ()


def test_the_fewest_clocks_that_explain_it() -> None:
    """A late one between two others shows on both of its links; of two sensors nobody knows which is off."""
    sigma = np.array([0.009, 0.0055, 0.0055])
    chain = [(0, 1), (1, 2), (2, 3)]
    (late,) = fewest_delays(4, chain, np.array([0.001, 0.041, -0.039]), sigma)
    assert (late.sensor, late.rival) == (2, None)
    assert late.seconds == pytest.approx(0.04, abs=0.001)
    (one,) = fewest_delays(2, [(0, 1)], np.array([0.05]), sigma[1:2])
    assert {one.sensor, one.rival} == {0, 1}
    assert fewest_delays(4, chain, np.array([0.02, -0.01, 0.003]), sigma) == ()


def test_a_sensor_that_hangs_is_told() -> None:
    stream = leg().imus["left_shank"]
    rows = np.minimum(np.arange(len(stream)), len(stream) // 2)
    values = {name: own[rows] for name, own in vars(stream).items() if isinstance(own, np.ndarray)}
    _, findings = checked(with_stream("left_shank", replace(stream, **(values | {"time": stream.time}))), Settings())
    (found,) = (finding for finding in findings if finding.kind == "sensor stuck")
    assert found.subject == "left_shank"
    assert found.numbers["seconds"] == pytest.approx(stream.time[-1] - stream.time[len(stream) // 2])


def test_gravity_weighs_the_accelerometer() -> None:
    sound = leg().imus["left_foot"]
    assert sound.specific_force is not None
    scaled = with_stream("left_foot", replace(sound, specific_force=1.2 * sound.specific_force))
    recording, findings = checked(scaled, Settings(sensor_clocks=SensorClockSettings(check=False)))
    assert len(findings) == 1
    assert "'left_foot' measures gravity as 11." in str(findings[0])
    assert recording.imus["left_foot"].specific_force is not None
    np.testing.assert_allclose(recording.imus["left_foot"].specific_force, sound.specific_force, rtol=0.03, atol=1e-9)


def test_samples_in_g_are_scaled_and_one_sensor_without_gravity_keeps_its_orientation() -> None:
    sound, settings = leg().imus["left_foot"], Settings(sensor_clocks=SensorClockSettings(check=False))
    assert sound.specific_force is not None
    in_g = with_stream("left_foot", replace(sound, specific_force=sound.specific_force / 9.81))
    assert "scaled to 9.81; was it given in g?" in str(checked(in_g, settings)[1][0])
    assert sound.R_inertial_sensor is not None
    free = sound.specific_force - 9.81 * sound.R_inertial_sensor[:, 2]
    recording, (finding,) = checked(with_stream("left_foot", replace(sound, specific_force=free)), settings)
    assert "'left_foot' measures gravity as" in str(finding)
    assert recording.imus["left_foot"].specific_force is None
    np.testing.assert_array_equal(recording.imus["left_foot"].R_inertial_sensor, sound.R_inertial_sensor)


def test_clipped_samples_are_left_out() -> None:
    sound = leg().imus["left_foot"]
    assert sound.specific_force is not None
    force = sound.specific_force.copy()
    force[200:600, 0] += np.where(np.arange(400) % 100 < 8, 40.0, 0.0)
    clipped = with_stream("left_foot", replace(sound, specific_force=np.clip(force, -39.24, 39.24)))
    recording, findings = checked(clipped, Settings(sensor_clocks=SensorClockSettings(check=False)))
    assert len(findings) == 1
    assert "end of its range (39 m/s²)" in str(findings[0])
    found = recording.imus["left_foot"].force_measured
    np.testing.assert_array_equal(found, ~(np.abs(clipped.imus["left_foot"].specific_force[:, 0]) >= 39.24))


def test_frames_know_what_was_not_measured() -> None:
    time = np.arange(100) / 100.0
    measured = np.ones(100, bool)
    measured[50] = False
    R, force = np.tile(np.eye(3), (100, 1, 1)), np.tile([0.0, 0, 9.81], (100, 1))
    stream = ImuStream("s", time, force, R, force_measured=measured)
    frames = resample_streams([stream], np.arange(1, 9) / 10)
    np.testing.assert_array_equal(frames.acceleration_valid[:, 0], [True, True, True, False, False, False, True, True])
    assert frames.orientation_valid.all()
    with pytest.raises(RecordingError, match="mask of measured forces"):
        replace(stream, force_measured=measured[:50])


def test_long_recordings_are_put_right_by_time() -> None:
    """Found in stretches and in the middle as in the whole; any samples that are asked for are those of the whole."""
    foot, shank = leg(rigid=True).imus["left_foot"], leg(rigid=True).imus["left_shank"]
    assert foot.specific_force is not None
    force = 1.2 * foot.specific_force
    force[200:600, 0] += np.where(np.arange(400) % 100 < 8, 60.0, 0.0)
    odd = {
        "left_foot": replace(foot, specific_force=np.clip(force, -45.0, 45.0)),
        "left_shank": replace(shank, time=shank.time + 0.05),
    }
    recording = replace(leg(), imus={**leg(rigid=True).imus, **odd})
    settings = Settings(windows=WindowSettings(above_s=1.0, calibration_stretches=2, calibration_stretch_s=4.5))
    source = RecordingInMemory(recording)
    plan = WindowPlan.of("leg", source.interval, settings)
    corrections, findings = check_sensors(Stretches.of(source, plan), source, plan, settings)
    right = PreparedRecording(source, corrections=corrections)
    whole, told = checked(recording, settings)
    assert [(finding.kind, finding.subject) for finding in findings] == [
        (finding.kind, finding.subject) for finding in told
    ]
    assert [set(finding.numbers) for finding in findings] == [{"clipped", "gravity", "percent"}, {"off_ms", "sigma_ms"}]
    found, expected = right.between(3.0, 5.0), RecordingInMemory(whole).between(3.0, 5.0)
    assert found.keys() == expected.keys()
    for name, stream in found.items():
        # both find scale and delay of their own samples: to a hundredth and some milliseconds
        np.testing.assert_allclose(stream.time[5:200], expected[name].time[5:200], atol=0.004)
        if name == "left_foot":
            np.testing.assert_array_equal(stream.force_measured, expected[name].force_measured)
            assert not stream.force_measured_mask.all()
            assert stream.specific_force is not None
            np.testing.assert_allclose(stream.specific_force, expected[name].specific_force, rtol=0.01)
    sound = RecordingInMemory(leg())
    assert check_sensors(Stretches.of(sound, plan), sound, plan, settings) == ({}, ())


def test_a_sensor_that_lost_samples_and_moved_up_what_came_after_is_told() -> None:
    """These strides are all alike, so a shift of one more is as good."""
    name = "left_shank"
    sound = leg().imus[name]
    middle, lost = len(sound) // 2, round(0.6 * sound.rate)
    late = sound.cut(float(sound.time[middle + lost]), np.inf)
    early = replace(late, time=late.time - (late.time[0] - sound.time[middle]))
    recording, findings = checked(
        with_stream(name, one_stream([sound.cut(-np.inf, float(sound.time[middle - 1])), early])), Settings()
    )
    assert [(finding.kind, finding.subject) for finding in findings] == [("clock jumped", f"sensor '{name}'")]
    assert recording.imus[name].time[-1] == early.time[-1]


ORDER = ("torso", "pelvis", "tibia_r", "femur_r", "tibia_l", "femur_l", "toes_r", "toes_l")


@pytest.mark.data
def test_the_two_that_are_wrong_on_the_treadmill(data_folder: Path) -> None:
    """Walking without a rest; the file's own header says in which order its columns are."""
    folder = data_folder / "xsens_treadmill_optical"
    force = np.loadtxt(folder / "OpenSim_Sub02_CSBaseline_Accel.trc", skiprows=6)[:, 2:].reshape(-1, len(ORDER), 3)
    streams = read_log(folder / "OpenSim_Sub02_CSBaseline_Orientations.sto").imus
    wrong = {}
    for number, bone in enumerate(ORDER):
        stream = next(one for name, one in streams.items() if name.startswith(bone))
        found = accelerometer_scale(replace(stream, specific_force=force[: len(stream), number]))
        assert found is not None
        if is_scale_wrong(*found):
            wrong[bone] = found[0]
    assert wrong == pytest.approx({"torso": 1.157, "toes_l": 1.224}, abs=0.005)
