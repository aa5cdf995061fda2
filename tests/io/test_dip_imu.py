"""DIP-IMU: pickles of that form written here, and pickles that must not be opened."""

import contextlib
import pickle
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.kinematics import forward_kinematics
from vip_factors.body.skeleton import joint_index
from vip_factors.errors import FileFormatError, VipFactorsError
from vip_factors.geometry.rotations import angle_between, exp, log, rotation_x, rotation_z
from vip_factors.io.importers import dip_imu
from vip_factors.io.importers.numpy_pickle import load_plain_pickle
from vip_factors.sensors.calibration import SITES

T = 30
BONES = [SITES[site].bone for site in dip_imu.SENSOR_SITES.values()]
Y_UP = rotation_x(-np.pi / 2)  # our z becomes their y


def content(seed: int = 0, up: np.ndarray = Y_UP) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]:
    """A log whose sensors sit on the bones without error; its joint rotations and true global accelerations."""
    rng = np.random.default_rng(seed)
    R = exp(0.3 * rng.normal(size=(T, 24, 3)))
    R[:, 0] = rotation_z(0.5) @ rotation_x(np.pi / 2) @ R[:, 0]  # standing in our world
    state = forward_kinematics(skeleton_from_stature(1.7), R, np.zeros((T, 3)))
    acceleration = rng.normal(size=(T, 17, 3))
    poses = R.copy()
    poses[:, 0] = up @ R[:, 0]
    log_file = {
        "imu_ori": up @ state.R_world_bone[:, [joint_index(bone) for bone in BONES]],
        "imu_acc": acceleration @ up.T,
        "gt": log(poses).reshape(T, 72),
    }
    return log_file, R, acceleration


def write(path: Path, data: object, protocol: int = 2) -> Path:
    path.write_bytes(pickle.dumps(data, protocol=protocol))
    return path


@pytest.mark.parametrize("up", [Y_UP, np.eye(3)], ids=["y up", "z up"])
@pytest.mark.parametrize("protocol", [0, 2, 4, 5])
def test_poses_and_sensors_arrive_in_our_world(tmp_path: Path, protocol: int, up: np.ndarray) -> None:
    data, R, acceleration = content(up=up)
    path = write(tmp_path / "01.pkl", data, protocol)
    assert dip_imu.matches(path)
    log_ = dip_imu.read(path)
    assert log_.truth_motion is not None
    assert np.max(angle_between(log_.truth_motion.R_parent_child, R)) < 1e-6
    assert log_.truth_motion.rate == 60
    assert log_.default_sites == dip_imu.SENSOR_SITES
    assert log_.placement is not None
    for row, (name, stream) in enumerate(log_.imus.items()):
        site = log_.placement.site(name)
        assert site.bone == BONES[row]
        R_world_sensor = log_.truth_motion.state.R_world_bone[:, site.bone_index] @ site.R_bone_sensor
        assert stream.R_inertial_sensor is not None
        assert stream.specific_force is not None
        assert np.max(angle_between(stream.R_inertial_sensor, R_world_sensor)) < 1e-6
        felt = np.einsum("tij,tj->ti", stream.R_inertial_sensor, stream.specific_force) - [0, 0, 9.81]
        np.testing.assert_allclose(felt, acceleration[:, row], atol=1e-6)


def test_the_skeleton_stands_on_the_floor(tmp_path: Path) -> None:
    data, _, _ = content()
    data["gt"] = np.zeros((T, 72))
    truth = dip_imu.read(write(tmp_path / "a.pkl", data)).truth_motion
    assert truth is not None
    at = truth.state.p_world_joint[0]
    assert at[joint_index("head"), 2] > at[joint_index("pelvis"), 2] > at[joint_index("left_ankle"), 2] > 0


def test_what_is_not_finite_becomes_a_gap(tmp_path: Path) -> None:
    data, R, _ = content()
    data["imu_ori"][5:8, 3] = np.nan
    data["imu_acc"][6:9, 3] = np.nan
    data["imu_acc"][:, 4] = np.nan
    data["gt"][10] = np.nan
    log_ = dip_imu.read(write(tmp_path / "a.pkl", data))
    np.testing.assert_allclose(log_.imus["lchest"].gaps, [[4 / 60, 9 / 60]])
    assert "rchest" not in log_.imus
    assert "rchest" not in log_.default_sites
    assert any("rchest has no finite sample" in note for note in log_.notes)
    assert any("1 of 30 poses" in note for note in log_.notes)
    truth = log_.truth_motion
    assert truth is not None
    assert len(truth) == T
    kept = np.arange(T) != 10
    assert np.max(angle_between(truth.R_parent_child[kept], R[kept])) < 1e-6


def test_uncalibrated_orientations_get_no_mounting(tmp_path: Path) -> None:
    data, _, _ = content()
    data["imu_ori"] = data["imu_ori"] @ exp(np.array([1.5, 0.5, 0.0]))
    log_ = dip_imu.read(write(tmp_path / "a.pkl", data))
    assert log_.placement is None
    assert len(log_.default_sites) == 17


def test_a_log_without_poses_has_its_y_axis_up(tmp_path: Path) -> None:
    data, _, _ = content()
    del data["gt"]
    log_ = dip_imu.read(write(tmp_path / "a.pkl", data))
    assert log_.truth_motion is None
    assert any("y axis is taken" in note for note in log_.notes)


def test_python_2_pickles_are_read(tmp_path: Path) -> None:
    # NumPy on Python 2 wrote array bytes as a text in Latin-1, which the protocol-2 opcodes below carry.
    values = np.arange(6.0).reshape(2, 3)
    raw = values.tobytes()
    path = tmp_path / "old.pkl"
    path.write_bytes(
        b"\x80\x02cnumpy.core.multiarray\n_reconstruct\ncnumpy\nndarray\nK\x00\x85U\x01b\x87R(K\x01K\x02K\x03\x86cnumpy\n"
        b"dtype\nU\x02f8K\x00K\x01\x87R(K\x03U\x01<NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tb\x89U"
        + bytes([len(raw)])
        + raw
        + b"tb."
    )
    np.testing.assert_array_equal(load_plain_pickle(path), values)


class Malicious:
    def __reduce__(self) -> tuple[object, tuple[str]]:
        return (Path.touch, (self.path,))  # type: ignore[attr-defined]


def test_pickles_run_no_code(tmp_path: Path) -> None:
    trap = Malicious()
    trap.path = tmp_path / "sprung"  # type: ignore[attr-defined]
    data, _, _ = content()
    path = write(tmp_path / "evil.pkl", {**data, "extra": trap})
    with pytest.raises(FileFormatError, match="which is neither an array nor plain data"):
        dip_imu.read(path)
    assert not (tmp_path / "sprung").exists()
    for call in (
        b"cposix\nsystem\n(S'true'\ntR.",
        b"cbuiltins\neval\n(S'1'\ntR.",
        b"c_codecs\nencode\n(S'a'\nS'hex'\ntR.",
    ):
        path.write_bytes(call)
        with pytest.raises(FileFormatError, match="not a readable pickle of arrays"):
            load_plain_pickle(path)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"imu_ori": np.zeros((T, 6, 3, 3))}, r"imu_ori has shape \(30, 6, 3, 3\): expected \(frames, 17, 3, 3\)"),
        ({"imu_acc": np.zeros((T - 1, 17, 3))}, "frames differ or are none: imu_ori 30, imu_acc 29, gt 30"),
        ({"imu_ori": np.zeros((T, 17, 3, 3))}, "imu_ori of head in frame 0 is not a rotation matrix"),
        ({"gt": "words"}, "gt is no array of numbers"),
    ],
)
def test_mistakes_are_named(tmp_path: Path, change: dict[str, object], sentence: str) -> None:
    data, _, _ = content()
    with pytest.raises(FileFormatError, match=sentence):
        dip_imu.read(write(tmp_path / "a.pkl", {**data, **change}))


def test_other_pickles_are_refused_with_what_they_hold(tmp_path: Path) -> None:
    path = write(tmp_path / "a.pkl", {"acc": np.zeros(3), "ori": np.zeros(3)})
    assert not dip_imu.matches(path)
    with pytest.raises(FileFormatError, match="holds acc, ori: expected imu_ori"):
        dip_imu.read(path)


def test_a_pickle_that_breaks_off_is_no_pickle(tmp_path: Path) -> None:
    path = write(tmp_path / "a.pkl", content()[0])
    path.write_bytes(path.read_bytes()[:5000])
    with pytest.raises(FileFormatError, match="not a readable pickle of arrays"):
        dip_imu.read(path)
    path.write_text("no pickle, but imu_ori and imu_acc")
    assert not dip_imu.matches(path)


@settings(max_examples=60)
@given(st.integers(0, 2**31))
def test_damage_is_refused_in_words_or_read_past(tmp_path_factory: pytest.TempPathFactory, seed: int) -> None:
    rng, folder = np.random.default_rng(seed), tmp_path_factory.mktemp("damage")
    path = write(folder / "a.pkl", content()[0])
    whole = bytearray(path.read_bytes())
    at = int(rng.integers(len(whole)))
    damaged = (
        whole[:at],
        whole[:at] + whole[at + int(rng.integers(1, 300)) :],
        whole[:at] + bytes(rng.integers(0, 256, 2, dtype=np.uint8)) + whole[at + 2 :],
        whole[:at] + [b"nan ", b"1e999 ", b"\n", b"-", b"\x00"][rng.integers(5)] + whole[at:],
    )
    path.write_bytes(damaged[rng.integers(4)])
    with contextlib.suppress(VipFactorsError):
        dip_imu.read(path)
