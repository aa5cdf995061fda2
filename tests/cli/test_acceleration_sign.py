"""Accelerometers of the opposite sign mirror a body: it is noticed, turned round and reported; sound ones are left."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import vip_factors as vip
from vip_factors.findings import Severity
from vip_factors.geometry.quaternions import quaternion_from_matrix
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.settings import Settings
from vip_factors.stages.accelerometers import is_sign_opposite, mirror_stream

QUICK = vip.Settings(frame_rate=20.0, covariance=False)
LEGS = ("pelvis", "left_thigh", "right_thigh", "left_shank", "right_shank", "left_foot", "right_foot")


@cache
def walk(placement: str = "mvn17", seconds: float = 6.0) -> vip.Recording:
    (wearer,) = vip.simulate(seconds=seconds, placement=placement, seed=3).wearers
    return wearer


def strapped_upside_down(stream: ImuStream) -> ImuStream:
    """As the sensor measures with its cable the other way: half a turn about the axis out of the skin."""
    turn = np.diag([-1.0, -1.0, 1.0])
    assert stream.specific_force is not None
    assert stream.R_inertial_sensor is not None
    return replace(
        stream, specific_force=stream.specific_force @ turn, R_inertial_sensor=stream.R_inertial_sensor @ turn
    )


def as_given(stream: ImuStream) -> ImuStream:
    return stream


@pytest.mark.parametrize(
    ("placement", "pose"), [("mvn17", "none"), ("totalcapture13", "n-pose"), ("tnt10", "none"), ("sip6", "n-pose")]
)
@pytest.mark.parametrize(
    ("change", "opposite"), [(as_given, False), (strapped_upside_down, False), (mirror_stream, True)]
)
def test_the_sign_is_told_by_bodies(
    change: Callable[[ImuStream], ImuStream], opposite: bool, placement: str, pose: str
) -> None:
    imus = {name: change(stream) for name, stream in walk(placement).imus.items()}
    recording = replace(walk(placement), imus=imus, initial_pose=pose)
    assert is_sign_opposite(recording, Settings()) is opposite


def written(folder: Path, sign: float) -> Path:
    """A table of raw samples, converted with the guesses of a template."""
    time, columns, names = np.arange(0.05, 6.0, 0.01), [], ["time"]
    for name in LEGS:
        stream = walk().imus[name]
        for quantity, values in (("acc", stream.specific_force), ("gyr", stream.angular_rate)):
            assert values is not None
            factor = sign if quantity == "acc" else 1.0
            columns += [factor * np.interp(time, stream.time, column) for column in values.T]
            names += [f"{name}_{quantity}_{axis}" for axis in "xyz"]
    table = folder / "log.csv"
    np.savetxt(table, np.column_stack([time, *columns]), delimiter=",", header=",".join(names), comments="", fmt="%.5f")
    return table


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_rotation_is_not_mirrored(run, tmp_path: Path, sign: float) -> None:
    table, made = written(tmp_path, sign), tmp_path / "log.mcap"
    assert run("convert", table, "--template", tmp_path / "log").code == 0
    columns, placement = tmp_path / "log_columns.toml", tmp_path / "log_placement.toml"
    options = ("--stature-m", 1.75, "--initial-pose", "n-pose")
    assert run("convert", table, made, "--columns", columns, "--placement", placement, *options).code == 0
    estimate = vip.smooth(vip.read(made), QUICK)
    assert ("acceleration turned round" in {finding.kind for finding in estimate.all_findings}) is (sign < 0)
    angles = vip.joint_angles(estimate.wearers[0].motion)
    truth = walk().truth
    assert truth is not None
    expected = vip.joint_angles(truth.motion)
    at = angles.time + 0.05  # the table begins there
    true = np.interp(at, expected.time, expected.of("pelvis_rotation"))
    assert np.corrcoef(true, angles.of("pelvis_rotation"))[0, 1] > 0.95


def test_straps_that_nobody_declared_are_a_note() -> None:
    recording = walk("tnt10")
    imus = {name: strapped_upside_down(stream) for name, stream in recording.imus.items()}
    estimate = vip.smooth(replace(recording, imus=imus, initial_pose="none", truth=None), QUICK)
    assert "mountings estimated" in {finding.kind for finding in estimate.all_findings}
    assert estimate.verdict.severity is Severity.CARE


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_template_never_turns_the_world_silently(run, tmp_path: Path, sign: float) -> None:
    """A phone's orientation with z up, and acceleration of either sign."""
    stream, table, made = walk().imus["pelvis"], tmp_path / "phone.csv", tmp_path / "phone.mcap"
    assert stream.R_inertial_sensor is not None
    assert stream.specific_force is not None
    quaternion = quaternion_from_matrix(stream.R_inertial_sensor, "wxyz")
    values = np.column_stack([stream.time, sign * stream.specific_force, quaternion])
    header = "time,pelvis_acc_x,pelvis_acc_y,pelvis_acc_z,pelvis_quat_w,pelvis_quat_x,pelvis_quat_y,pelvis_quat_z"
    np.savetxt(table, values, delimiter=",", header=header, comments="", fmt="%.5f")
    columns, placement = tmp_path / "phone_columns.toml", tmp_path / "phone_placement.toml"
    assert run("convert", table, "--template", tmp_path / "phone").code == 0
    converted = run("convert", table, made, "--columns", columns, "--placement", placement)
    assert converted.code == 0, converted.err
    for text in (columns.read_text(encoding="utf-8"), converted.out + converted.err):
        assert ("world is turned over" in " ".join(text.split())) is (sign < 0)
