"""TotalCapture as scenes: a sequence of its form written here, from a motion that is known."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.studies.study import markdown, run
from tests.studies.totalcapture import TotalCapture, read_cameras, sequences, totalcapture_scene
from vip_factors.body.skeleton import joint_index
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import angle_between, rotation_x, rotation_z, wrap_angle
from vip_factors.io.importers.totalcapture import BONE_JOINTS, SENSOR_SITES
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.recording import Recording
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording
from vip_factors.simulate.settings import SimulateSettings
from vip_factors.simulate.staging import with_initial_pose

UP = rotation_x(-np.pi / 2)  # our z becomes their y
R_CAMERA_VICON = np.diag([1.0, -1.0, -1.0])  # looks against their z, upright
T_CAMERA = np.array([0.0, 1.0, 5.0])  # the wearer stands five metres before it, its eye one metre up
QUICK = TotalCapture(folder=Path(), seconds=0.0, variants=("IT", "VIP-2D"), frame_rate=30.0, iterations=3)


def camera_rows() -> str:
    R = "\n".join(" ".join(map(str, row)) for row in R_CAMERA_VICON)
    return f"0 1079 0 1919\n1000 1010 960 540\n-0.05\n{R}\n{' '.join(map(str, T_CAMERA))}\n"


def cells(rows: np.ndarray) -> str:
    return "\t".join(" ".join(f"{value:.9g}" for value in row) for row in rows) + "\t"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Recording]:
    """A folder with one sequence and the calibration above it, and the recording it was made from."""
    top = tmp_path_factory.mktemp("totalcapture")
    folder = top / "S1" / "walking2"
    folder.mkdir(parents=True)
    motion = with_initial_pose(gestures(1.5), "t-pose", 1.0, 0.5)
    names = {site: name for name, site in SENSOR_SITES.items()}
    settings = SimulateSettings.noise_free(imu_rate=60.0, heading_offset_deg=90.0)
    recording = simulate_recording(motion, preset("totalcapture13", motion.skeleton, names), settings, 3)
    assert recording.truth is not None
    streams = {name: recording.imus[name] for name in SENSOR_SITES if name in recording.imus}
    frames = min(len(recording.truth.motion), *(len(stream) for stream in streams.values()))
    state = recording.truth.motion.frames(slice(0, frames)).state
    joints = dict(
        sorted({joint: bone for bone, joint in BONE_JOINTS.items() if not bone.endswith(("foot", "hand"))}.items())
    )
    joints["Spine1"] = "spine1"
    rows = [joint_index(bone) for bone in joints.values()]
    p = state.p_world_joint[:, rows] @ UP.T / 0.0254
    q = quaternion_from_matrix(UP @ state.R_world_bone[:, rows], Order.XYZW)
    for name, values in (("pos", p), ("ori", q)):
        lines = ["\t".join(joints) + "\t", *(cells(frame) for frame in values)]
        (folder / f"gt_skel_gbl_{name}.txt").write_text("\n".join(lines) + "\n")
    for kind in ("bone", "ref"):
        lines = [str(len(streams))]
        for name in streams:
            one = (recording.truth.calibration or {})[name]
            matrix = one.R_bone_sensor if kind == "bone" else UP @ rotation_z(one.heading)
            lines.append(f"{name} " + " ".join(f"{x:.9f}" for x in quaternion_from_matrix(matrix, Order.XYZW)))
        (folder / f"s1_walking2_calib_imu_{kind}.txt").write_text("\n".join(lines) + "\n")
    lines = [f"{len(streams)}\t{frames}"]
    for t in range(frames):
        lines.append(str(t + 1))
        for name, stream in streams.items():
            assert stream.R_inertial_sensor is not None
            assert stream.specific_force is not None
            numbers = [*quaternion_from_matrix(stream.R_inertial_sensor[t], Order.WXYZ), *stream.specific_force[t]]
            lines.append(f"{name}\t" + " ".join(f"{x:.9g}" for x in numbers))
    (folder / "s1_walking2_Xsens.sensors").write_text("\n".join(lines) + "\n")
    (top / "calibration.cal").write_text("2 1\n" + 2 * camera_rows())
    return top, recording


def test_the_camera_sees_the_wearer_where_it_stands(made: tuple[Path, Recording]) -> None:
    top, recording = made
    (sequence,) = sequences(top)
    assert (sequence.name, sequence.kind) == ("s1_walking2", "walking")
    scene, origin = totalcapture_scene(sequence, replace(QUICK, folder=top))
    assert "simulator's detector" in origin
    assert scene.camera is not None
    assert scene.truth is not None
    assert scene.truth.pixels is not None
    assert recording.truth is not None
    np.testing.assert_allclose(scene.truth.camera.p_world_camera[0], rotation_x(np.pi / 2) @ [0.0, 1.0, 5.0])
    middle = np.nanmean(scene.truth.pixels, axis=(0, 1))
    pelvis = recording.truth.motion.p_world_pelvis.mean(axis=0)
    assert abs(middle[0] - (960 + 1000 * pelvis[0] / 5)) < 250
    assert 0 < middle[1] < 1080
    assert np.mean(scene.truth.wearer == 0) > 0.9
    assert np.isclose(scene.camera.detections.rate, 30.0)


def test_headings_and_mountings_are_those_of_the_files(made: tuple[Path, Recording]) -> None:
    top, recording = made
    scene, _ = totalcapture_scene(sequences(top)[0], replace(QUICK, folder=top))
    truth = scene.wearers[0].truth
    assert truth is not None
    assert recording.truth is not None
    for name, one in (recording.truth.calibration or {}).items():
        found = (truth.calibration or {})[name]
        assert abs(wrap_angle(found.heading - one.heading)) < 1e-3
        assert angle_between(found.R_bone_sensor, one.R_bone_sensor) < 1e-3


def test_variants_run_on_it_and_the_table_says_where_the_poses_came_from(made: tuple[Path, Recording]) -> None:
    study = replace(QUICK, folder=made[0])
    trials = run(study)
    assert [trial.variant for trial in trials] == ["IT", "VIP-2D"]
    assert all(not trial.failure and trial.mpjpe_mm < 60 for trial in trials)
    tables = markdown(study, trials)
    assert "made by the simulator's detector" in tables
    assert "| VIP-2D |" in tables


def test_calibrations_that_are_none_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "calibration.cal"
    for text, sentence in (
        ("2 1\n" + camera_rows(), "23 numbers: expected 2 and 21 for each of 2 cameras"),
        ("1 3\n" + camera_rows(), "distortion of order 3"),
        ("1 1\n" + camera_rows().replace("-1.0", "-2.0"), "no rotation"),
        ("one camera", "expected numbers alone"),
    ):
        path.write_text(text)
        with pytest.raises(FileFormatError, match=sentence):
            read_cameras(path)
    with pytest.raises(InputError, match=r"no \.sensors file"):
        sequences(tmp_path)
