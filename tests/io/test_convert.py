"""From a log to a recording: detection, what the user adds, cutting, poses held before, mappings, and errors."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from table_samples import columns_of, write_mtw

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import Array, exp, rotation_z
from vip_factors.io.convert import ImportOptions, detect_format, import_recording, recording_of_log
from vip_factors.io.importers.shared import ImportedLog
from vip_factors.io.log_streams import HOLD_S, LEAD_S
from vip_factors.io.mcap_recording import write_recording
from vip_factors.io.placement_file import placement_from_file
from vip_factors.sensors.calibration import CARELESS_MOUNTING_SIGMA, SITES, Placement, sensor_site
from vip_factors.sensors.imu_stream import ImuStream

RATE = 100.0


def write_walk(
    folder: Path, sensors: dict[str, range], orientation: bool = True, gyro: bool = True, lost: range = range(0)
) -> Path:
    """A folder with one MTw export per sensor, each with the packets of its range but for the lost ones."""
    folder.mkdir(exist_ok=True)
    for sensor, packets in sensors.items():
        rows = np.array([packet for packet in packets if packet not in lost])
        R = exp(np.stack([np.full(len(rows), 0.3), np.full(len(rows), 0.1), 0.002 * rows], axis=1))
        rate = np.tile([0.0, 0.0, 0.2], (len(rows), 1)) if gyro else None
        columns = columns_of(R, np.einsum("nji,j->ni", R, [0, 0, 9.81]), rate, "quaternion" if orientation else "none")
        write_mtw(folder / f"walk-1_{sensor}.txt", columns, rows)
    return folder


@pytest.fixture
def walk(tmp_path: Path) -> Path:
    return write_walk(tmp_path / "walk", {"Pelvis": range(500), "LFemur": range(500), "00B4": range(500)})


def write_toml(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def test_sites_from_names_and_notes_on_the_rest(walk: Path) -> None:
    recording = import_recording(walk)
    assert set(recording.placed) == {"LFemur", "Pelvis"}
    assert set(recording.imus) == {"Pelvis", "LFemur", "00B4"}
    assert recording.name == "walk"
    assert "not placed on the body, and so not used: 00B4" in recording.notes
    assert "stature unknown: an adult's is assumed, 1.69 ± 0.09 m" in recording.notes
    assert recording.subject.stature_m is None
    assert recording.truth is None
    assert recording.initial_pose == "none"


def test_options_win_over_the_placement_file_and_that_over_the_log(walk: Path, tmp_path: Path) -> None:
    file = write_toml(
        tmp_path / "who.toml",
        'subject = "S02"\nstature_m = 1.80\nsex = "female"\ninitial_pose = "n-pose"\n'
        '[segment_lengths_m]\nthigh = 0.45\n[sensors]\n00B4 = "right_shank"\n'
        'Pelvis = { site = "pelvis", sigma_deg = 10 }\n',
    )
    recording = import_recording(walk, ImportOptions(placement=file, stature_m=1.60, name="first"))
    assert (recording.name, recording.subject.name, recording.subject.sex) == ("first", "S02", "female")
    assert recording.subject.stature_m == 1.60
    assert recording.initial_pose == "n-pose"
    assert recording.subject.body().bone_length("left_knee") == pytest.approx(0.45, abs=0.01)
    assert set(recording.placed) == {"00B4", "Pelvis"}
    assert recording.placement.site("Pelvis").mounting_sigma == pytest.approx(np.deg2rad(10))
    expected = sensor_site("right_shank", recording.subject.body(), "00B4")
    np.testing.assert_allclose(recording.placement.site("00B4").p_bone_sensor, expected.p_bone_sensor)


def test_free_placement_on_a_bone(walk: Path, tmp_path: Path) -> None:
    R = exp(np.array([0.1, 0.2, 0.3]))
    entry = {
        "bone": "left_thigh",
        "position_m": [0.01, -0.2, 0.05],
        "mounting_wxyz": [float(q) for q in quaternion_from_matrix(R, Order.WXYZ)],
    }
    file = write_toml(tmp_path / "who.json", json.dumps({"sensors": {"00B4": entry}}))
    site = import_recording(walk, ImportOptions(placement=file)).placement.site("00B4")
    assert site.bone == "left_hip"
    np.testing.assert_allclose(site.p_bone_sensor, entry["position_m"])
    np.testing.assert_allclose(site.R_bone_sensor, R, atol=1e-12)
    assert site.mounting_sigma == CARELESS_MOUNTING_SIGMA


def test_mapping_of_sites_and_presets(walk: Path) -> None:
    recording = import_recording(walk, ImportOptions(placement={"sternum": "00B4", "pelvis": "Pelvis"}))
    assert {site.sensor: site.bone for site in recording.placement.sites} == {"00B4": "spine3", "Pelvis": "pelvis"}
    recording = import_recording(walk, ImportOptions(placement="tnt10"))
    assert set(recording.placed) == {"Pelvis", "LFemur"}
    assert "sites without a sensor" in recording.notes


def test_cutting_moves_the_start(walk: Path) -> None:
    recording = import_recording(walk, ImportOptions(start_s=1.0, end_s=2.0))
    stream = recording.imus["Pelvis"]
    assert stream.time[0] == pytest.approx(0)
    assert stream.time[-1] == pytest.approx(1.0)
    whole = import_recording(walk).imus["Pelvis"]
    np.testing.assert_allclose(stream.R_inertial_sensor[0], whole.R_inertial_sensor[100])
    with pytest.raises(InputError, match=r"log ends at 4\.99 s"):
        import_recording(walk, ImportOptions(start_s=10.0))
    with pytest.raises(InputError, match="start before the end"):
        ImportOptions(start_s=2.0, end_s=1.0)


def test_orientation_is_filled_in_where_the_sensor_has_none(tmp_path: Path) -> None:
    recording = import_recording(write_walk(tmp_path / "w", {"Pelvis": range(500)}, orientation=False))
    R = recording.imus["Pelvis"].R_inertial_sensor
    assert R is not None
    np.testing.assert_allclose(R[:, 2] @ [0, 0, 1], np.cos(np.hypot(0.3, 0.1)), atol=0.1)
    assert "VQF" in recording.notes
    with pytest.raises(InputError, match="has an orientation, nor"):
        import_recording(write_walk(tmp_path / "w", {"Pelvis": range(500)}, orientation=False, gyro=False))


def test_nothing_placed_shows_how_to_say_it(tmp_path: Path) -> None:
    folder = write_walk(tmp_path / "w", {"00B4": range(9), "00B5": range(9)})
    with pytest.raises(InputError) as caught:
        import_recording(folder)
    message = str(caught.value)
    assert "00B4, 00B5" in message
    assert '[sensors]\n  "00B4" = "pelvis"' in message
    assert all(site in message for site in SITES)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("statur_m = 1.7", "unknown key 'statur_m'; did you mean 'stature_m'"),
        ('[sensors]\na = "left_tigh"', "unknown site 'left_tigh'; did you mean 'left_thigh'"),
        ('[sensors]\na = { sit = "pelvis" }', "unknown key 'sensors.a.sit'"),
        ('[sensors]\na = { bone = "left_kne", mounting_wxyz = [1, 0, 0, 0] }', "did you mean 'left_knee'"),
        ('[sensors]\na = { bone = "left_knee" }', "needs mounting_wxyz"),
        ('[sensors]\na = { site = "pelvis", bone = "pelvis" }', "either a site"),
        ('[sensors]\na = { site = "pelvis", mounting_wxyz = [2, 0, 0, 0] }', "expected unit length"),
        ('[sensors]\na = { site = "pelvis", sigma_deg = -3 }', "sensors.a.sigma_deg: expected number > 0.0"),
        ('initial_pose = "npose"', "did you mean 'n-pose'"),
        ("[sensors", "expected a placement file"),
    ],
)
def test_placement_files_name_their_mistakes(tmp_path: Path, text: str, match: str) -> None:
    with pytest.raises(InputError, match=match.replace(".", r"\.").replace("[", r"\[")):
        placement_from_file(write_toml(tmp_path / "who.toml", text))


def test_absent_placement_file(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="cannot be read"):
        placement_from_file(tmp_path / "none.toml")


@pytest.mark.parametrize(
    ("options", "match"),
    [
        (ImportOptions(placement="tnt01"), "did you mean 'tnt10'"),
        (ImportOptions(placement={"pelvi": "Pelvis"}), "did you mean 'pelvis'"),
        (ImportOptions(placement={"pelvis": "Nobody"}), "none of the placed sensors"),
        (ImportOptions(placement={"pelvis": "Pelvis", "sternum": "Pelvis"}), "placed twice"),
        (ImportOptions(stature_m=175.0), "looks like centimetres"),
    ],
)
def test_options_that_do_not_fit(walk: Path, options: ImportOptions, match: str) -> None:
    with pytest.raises(InputError, match=match):
        import_recording(walk, options)


def test_detection_is_by_content(walk: Path, tmp_path: Path) -> None:
    assert detect_format(walk) == "xsens_txt"
    assert detect_format(walk / "walk-1") == "xsens_txt"
    (tmp_path / "a.sto").write_text("DataType=Quaternion\nendheader\ntime\tpelvis_imu\n0\t1,0,0,0\n")
    assert detect_format(tmp_path / "a.sto") == "opensense_sto"
    (tmp_path / "a.xyz").write_text("hello\n")
    with pytest.raises(FileFormatError, match=r"not a sensor log of a known format \(recording, ros2, mvnx"):
        detect_format(tmp_path / "a.xyz")
    (tmp_path / "empty.txt").touch()
    with pytest.raises(FileFormatError, match="empty"):
        detect_format(tmp_path / "empty.txt")
    with pytest.raises(InputError, match="no such file"):
        detect_format(tmp_path / "nowhere")


def test_our_own_recordings_are_known_and_are_no_logs(walk: Path, tmp_path: Path) -> None:
    write_recording(import_recording(walk), tmp_path / "own.mcap")
    assert detect_format(tmp_path / "own.mcap") == "recording"
    with pytest.raises(InputError, match="a recording of this package already"):
        import_recording(tmp_path / "own.mcap")


def test_the_logs_own_mounting_survives_another_choice_of_sites() -> None:
    mounting, stature = exp(np.array([0.5, 1.0, -0.5])), skeleton_from_stature(1.7)
    stream = ImuStream("hip", np.arange(40) / RATE, None, np.tile(np.eye(3), (40, 1, 1)))
    told = replace(sensor_site("pelvis", stature, "hip"), R_bone_sensor=mounting, mounting_sigma=0.1)
    log = ImportedLog("made", {"hip": stream}, placement=Placement((told,)), stature_m=1.7)
    by_log = recording_of_log(log, Path("made"), ImportOptions(stature_m=1.9))
    chosen = recording_of_log(log, Path("made"), ImportOptions(stature_m=1.9, placement={"pelvis": "hip"}))
    assert chosen.placed == ["hip"]
    site = chosen.placement.site("hip")
    np.testing.assert_allclose(site.R_bone_sensor, mounting)
    # Positions follow the wearer's stature.
    np.testing.assert_allclose(by_log.placement.site("hip").p_bone_sensor, site.p_bone_sensor, rtol=0.02)


NAMES = ("pelvis_imu", "femur_r_imu")
R_POSE = np.stack([exp(np.array([0.3, 0.1, 0.0])), exp(np.array([-0.2, 0.5, 1.0]))])


def write_sto(path: Path, R: Array, names: tuple[str, ...] = NAMES) -> Path:
    """Rotations ``(N, sensors, 3, 3)`` at 50 Hz."""
    lines = ["DataType=Quaternion", "endheader", "\t".join(["time", *names])]
    for i, row in enumerate(R):
        cells = [",".join(repr(float(q)) for q in quaternion_from_matrix(one, Order.WXYZ)) for one in row]
        lines.append("\t".join([f"{i / 50}", *cells]))
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture
def posed_walk() -> Array:
    return np.stack([rotation_z(2.0) @ exp(np.array([0.01 * i, 0, 0])) @ R_POSE for i in range(100)])


def test_a_row_of_the_log_itself(tmp_path: Path, posed_walk: Array) -> None:
    log = write_sto(tmp_path / "a.sto", np.concatenate([R_POSE[None], posed_walk]))
    recording = import_recording(log, ImportOptions(initial_pose="n-pose", pose_from=f"{log}:1"))
    assert recording.initial_pose == "n-pose"
    for number, name in enumerate(NAMES):
        stream = recording.imus[name]
        held = stream.cut(0, HOLD_S + 0.1)
        assert len(held) == 51
        np.testing.assert_allclose(held.R_inertial_sensor, np.tile(R_POSE[number], (51, 1, 1)), atol=1e-9)
        rest = stream.cut(HOLD_S + 0.1, np.inf)
        np.testing.assert_allclose(rest.time, LEAD_S + np.arange(100) / 50)
        np.testing.assert_allclose(rest.R_inertial_sensor, posed_walk[:, number], atol=1e-9)
    assert f"begins at {LEAD_S:g} s" in recording.notes


def test_a_pose_decades_before_the_rest_is_refused_unless_it_is_said_to_be_one(
    tmp_path: Path, posed_walk: Array
) -> None:
    log = write_sto(tmp_path / "a.sto", np.concatenate([R_POSE[None], posed_walk]))
    header, first, *rows = log.read_text().split("\n0.0\t")[0], *log.read_text().splitlines()[3:]
    unix = [f"{1.6e9 + float(row.partition(chr(9))[0])!r}\t{row.partition(chr(9))[2]}" for row in rows]
    log.write_text("\n".join([header, first, *unix]) + "\n")
    with pytest.raises(InputError, match=r"leap from 0.00 to 1600000000.\d\d s after row 1 .* --start-s 1600000000.0"):
        import_recording(log)
    recording = import_recording(log, ImportOptions(initial_pose="n-pose", pose_from=f"{log}:1"))
    assert recording.interval[1] == pytest.approx(LEAD_S + 99 / 50, abs=1e-3)
    assert import_recording(log, ImportOptions(start_s=1.6e9)).interval[1] == pytest.approx(2.0, abs=1e-3)


@pytest.mark.parametrize(
    ("source", "match"),
    [
        ("{0}:0", "sample '0': expected LOG, or LOG:SAMPLE with a number from 1 on"),
        ("{0}:last", "sample 'last'"),
        ("{0}:101", "has 100 samples: there is no sample 101"),
        ("{0}:100", "none is left after the pose's, 100"),
        ("nowhere.sto", "there is no file or folder nowhere.sto"),
    ],
)
def test_mistakes_are_told(tmp_path: Path, posed_walk: Array, source: str, match: str) -> None:
    log = write_sto(tmp_path / "a.sto", posed_walk)
    with pytest.raises(InputError, match=match):
        import_recording(log, ImportOptions(initial_pose="n-pose", pose_from=source.format(log)))
    with pytest.raises(InputError, match="expected an initial pose, t-pose or n-pose"):
        import_recording(log, ImportOptions(pose_from=source.format(log)))


def mapping(*pairs: tuple[str, str]) -> str:
    sensors = "".join(
        f'<ExperimentalSensor name="{name}"><!-- a note --><name_in_model>{frame}</name_in_model></ExperimentalSensor>'
        for name, frame in pairs
    )
    return (
        '<?xml version="1.0" encoding="UTF-8" ?><OpenSimDocument Version="40000"><XsensDataReaderSettings>'
        f"<ExperimentalSensors>{sensors}</ExperimentalSensors></XsensDataReaderSettings></OpenSimDocument>"
    )


def test_sensors_sit_where_the_models_frames_say(tmp_path: Path) -> None:
    path = tmp_path / "myIMUMappings.xml"
    path.write_text(mapping(("_00B42268", "torso_imu"), ("_00B4227D", "tibia_r_imu"), ("00B4", "calcn_l_imu")))
    found = placement_from_file(path).sensors
    assert {name: entry.site for name, entry in found.items()} == {
        "00B42268": "sternum", "00B4227D": "right_shank", "00B4": "left_foot",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("<a></b>", "expected OpenSense's"),
        ("", "expected OpenSense's"),
        ("<a/>", "names no ExperimentalSensor"),
        (mapping(("_1", "mystery")), "sensor '1' is frame 'mystery' of the model: expected a name that tells"),
        (mapping(("", "torso_imu")), "sensor '' is frame 'torso_imu'"),
    ],
)
def test_mistakes_are_named(tmp_path: Path, text: str, match: str) -> None:
    path = tmp_path / "m.xml"
    path.write_text(text)
    with pytest.raises(FileFormatError, match=match):
        placement_from_file(path)
    with pytest.raises(FileFormatError, match="cannot be read"):
        placement_from_file(tmp_path / "none.xml")
