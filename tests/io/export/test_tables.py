"""Tables are read back by column: OpenSim's markers, coordinates and orientations, C3D by another library.

Coordinates of OpenSim's model: its joints, put together from its axes by SciPy, stand as the estimate does.
"""

from functools import reduce
from operator import mul
from pathlib import Path

import c3d
import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from turning_body import FRAMES, RATE, sample_scene

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.joint_angles import R_WORLD_ISB, joint_angles, segment_axes, segment_orientations
from vip_factors.body.kinematics import Motion, local_rotations
from vip_factors.body.model_errors import UNFILMED, shape_factor
from vip_factors.body.skeleton import JOINT_COUNT, JOINT_NAMES, joint_index
from vip_factors.estimate import Estimate, WearerEstimate
from vip_factors.geometry.rotations import Array, angle_between
from vip_factors.io.export.files import export
from vip_factors.io.export.tables import opensim_coordinates
from vip_factors.io.importers.maker_tables import OPENSENSE


def read(path: Path) -> np.ndarray:
    return np.genfromtxt(path, delimiter=",", names=True, encoding="utf-8")


def test_positions_and_angles_come_back(tmp_path: Path) -> None:
    scene = sample_scene()
    motion = scene.wearers[0].motion
    table = read(export(scene, tmp_path / "walk.csv")[0])
    assert table["time_s"] == pytest.approx(motion.time, abs=1e-6)
    for number, joint in enumerate(JOINT_NAMES):
        found = np.stack([table[f"{joint}_{axis}_m"] for axis in "xyz"], axis=1)
        assert np.abs(found - motion.state.p_world_joint[:, number]).max() < 1e-6
    angles = joint_angles(motion)
    for name in angles.names:
        assert np.abs(table[f"{name}_deg"] - angles.of(name)).max() < 1e-4
    assert len(table.dtype.names) == 1 + 72 + len(angles.names)


def test_standard_deviations_follow_where_they_are_known(tmp_path: Path) -> None:
    table = read(export(sample_scene(covariance=True), tmp_path / "walk.csv")[0])
    assert table["pelvis_z_sd_m"] == pytest.approx(np.hypot(0.01, UNFILMED.position[0]), abs=1e-6)
    assert np.all(table["left_ankle_x_sd_m"] > table["left_hip_x_sd_m"])
    # Of an error that is alike about all axes the flexion's is as large, and larger where the shank is abducted.
    assert np.all(table["left_knee_flexion_sd_deg"] >= np.degrees(0.02) - 1e-4)
    assert np.all(table["left_knee_flexion_sd_deg"] < 1.2 * np.degrees(0.02))
    shape, whole = table["left_knee_flexion_shape_sd_deg"], table["left_knee_flexion_sd_deg"]
    assert shape == pytest.approx(shape_factor("left_knee") * whole, abs=1e-3)
    assert 0.3 < shape_factor("left_knee") < 1
    assert "left_shoulder_elevation_sd_deg" not in table.dtype.names


def read_trc(path: Path) -> tuple[dict[str, str], Array, dict[str, Array]]:
    lines = path.read_text(encoding="utf-8").splitlines()
    assert lines[0].split("\t")[:3] == ["PathFileType", "4", "(X/Y/Z)"]
    stated = dict(zip(lines[1].split("\t"), lines[2].split("\t"), strict=True))
    names = [name for name in lines[3].split("\t")[2:] if name]
    assert lines[4].split("\t")[2:5] == ["X1", "Y1", "Z1"]
    table = np.array([line.split("\t") for line in lines[5:] if line.strip()], dtype=float)
    assert len(table) == int(stated["NumFrames"])
    assert len(names) == int(stated["NumMarkers"]) == len(lines[4].split("\t")[2:]) / 3
    points = table[:, 2:].reshape(len(table), -1, 3)
    return stated, table[:, 1], {name: points[:, k] for k, name in enumerate(names)}


def test_points_come_back_with_y_up(tmp_path: Path) -> None:
    scene = sample_scene()
    motion = scene.wearers[0].motion
    stated, time, points = read_trc(export(scene, tmp_path / "walk.trc")[0])
    assert stated["Units"] == "m"
    assert float(stated["DataRate"]) == motion.rate
    assert np.abs(time - motion.time).max() < 1e-6
    for number, name in enumerate(JOINT_NAMES):
        x, y, z = motion.state.p_world_joint[:, number].T
        assert np.abs(points[name] - np.stack([x, z, -y], axis=1)).max() < 1e-6


FORWARD, UP, RIGHT = np.eye(3)
# Of the model's right side, in its file; the left one's are mirrored.
ANKLE, SUBTALAR, TOES = [-0.105014, -0.174022, 0.979126], [0.78718, 0.604747, -0.120949], [0.580954, 0.0, -0.813936]
ELBOW = [0.226047, 0.022269, 0.973862]


def read_mot(path: Path) -> dict[str, Array]:
    lines = path.read_text(encoding="utf-8").splitlines()
    header = dict(line.split("=") for line in lines[: lines.index("endheader")] if "=" in line)
    names = lines[lines.index("endheader") + 1].split("\t")
    table = np.loadtxt(lines[lines.index("endheader") + 2 :])
    assert header["inDegrees"] == "yes"
    assert (int(header["nRows"]), int(header["nColumns"])) == table.shape
    return dict(zip(names, table.T, strict=True))


def turn(axis: object, degrees: Array, side: str = "r") -> Rotation:
    """Mirroring turns the axis of a rotation round, and then its component along the mirror's normal back."""
    mirror = np.array([1.0, 1.0, 1.0] if side == "r" else [-1.0, -1.0, 1.0])
    return Rotation.from_rotvec(np.radians(degrees)[:, None] * np.asarray(axis) * mirror)


def three(table: dict[str, Array], *names: str, side: str = "r") -> Rotation:
    return reduce(mul, (turn(axis, table[name], side) for axis, name in zip((RIGHT, FORWARD, UP), names, strict=True)))


def apart(found: Rotation, R: Array) -> Array:
    """Degrees ``(T,)`` between rotations."""
    return np.degrees((found.inv() * Rotation.from_matrix(R)).magnitude())


def test_joints_of_three_axes_are_turned_as_in_the_estimate(tmp_path: Path) -> None:
    scene = sample_scene()
    motion = scene.wearers[0].motion
    R = segment_orientations(motion)
    table = read_mot(export(scene, tmp_path / "walk.mot")[0])
    pelvis = three(table, "pelvis_tilt", "pelvis_list", "pelvis_rotation")
    torso = pelvis * three(table, "lumbar_extension", "lumbar_bending", "lumbar_rotation")
    assert apart(pelvis, R[:, 0]).max() < 1e-5
    assert apart(torso, R[:, joint_index("spine3")]).max() < 1e-5
    for side, name in (("r", "right"), ("l", "left")):
        femur = pelvis * three(table, *(f"hip_{one}_{side}" for one in ("flexion", "adduction", "rotation")), side=side)
        assert apart(femur, R[:, joint_index(f"{name}_hip")]).max() < 1e-5
        # The model's upper arm is turned about itself until its elbow's axis is ours.
        humerus = torso * three(table, *(f"arm_{one}_{side}" for one in ("flex", "add", "rot")), side=side)
        axis = humerus.apply(turn(ELBOW, np.full(1, 180 / np.pi), side).as_rotvec()[0])
        assert axis == pytest.approx(R[:, joint_index(f"{name}_shoulder")][:, :, 2], abs=1e-5)
    assert table["time"] == pytest.approx(motion.time)


@pytest.mark.parametrize(
    ("above", "below", "names", "axes"),
    [
        ("knee", "ankle", ("ankle_angle", "subtalar_angle"), (ANKLE, SUBTALAR)),
        ("ankle", "foot", ("mtp_angle",), (TOES,)),
    ],
)
@pytest.mark.parametrize("side", ["right", "left"])
def test_no_other_coordinates_are_nearer(
    above: str, below: str, names: tuple[str, ...], axes: tuple[list[float], ...], side: str
) -> None:
    motion = sample_scene().wearers[0].motion
    R = segment_orientations(motion)
    target = np.swapaxes(R[:, joint_index(f"{side}_{above}")], 1, 2) @ R[:, joint_index(f"{side}_{below}")]
    found = opensim_coordinates(motion)
    for frame in range(0, len(motion), 8):

        def missing(degrees: Array, wanted: Array = target[frame]) -> Array:
            turns = [turn(axis, degrees[[k]], side[0])[0] for k, axis in enumerate(axes)]
            return (reduce(mul, turns).inv() * Rotation.from_matrix(wanted)).as_rotvec()

        best = least_squares(missing, np.zeros(len(axes)), x_scale=10.0, xtol=1e-12, gtol=1e-12, ftol=1e-12)
        assert [found[f"{name}_{side[0]}"][frame] for name in names] == pytest.approx(best.x, abs=0.01)


def anatomical(**degrees: float) -> Motion:
    """The posture of which all coordinates are about zero, with a body's segments turned about the room's z (right)."""
    skeleton = skeleton_from_stature(1.75)
    R_room_segment = np.broadcast_to(np.eye(3), (1, JOINT_COUNT, 3, 3)).copy()
    for name, angle in degrees.items():
        segment, _, axis = name.partition("_about_")
        R_room_segment[0, joint_index(segment)] = Rotation.from_euler(axis or "z", angle, degrees=True).as_matrix()
    R_world_bone = R_WORLD_ISB @ R_room_segment @ np.swapaxes(segment_axes(skeleton), 1, 2)
    return Motion(skeleton, local_rotations(R_world_bone), np.zeros((1, 3)), 1.0)


@pytest.mark.parametrize(
    ("turned", "coordinate", "degrees"),
    [
        ({"left_knee": -40.0, "left_ankle": -40.0, "left_foot": -40.0}, "knee_angle_l", 40.0),
        ({"right_elbow": 70.0, "right_wrist": 70.0, "right_hand": 70.0}, "elbow_flex_r", 70.0),
        ({"right_wrist": 30.0, "right_hand": 30.0}, "wrist_flex_r", 30.0),
        ({"right_wrist_about_x": 20.0, "right_hand_about_x": 20.0}, "wrist_dev_r", 20.0),
        ({"left_wrist_about_x": -20.0, "left_hand_about_x": -20.0}, "wrist_dev_l", 20.0),
        ({"left_ankle": 15.0, "left_foot": 15.0}, "ankle_angle_l", 15.0),
        ({"left_foot": 20.0}, "mtp_angle_l", -20.0),
    ],
)
def test_signs(turned: dict[str, float], coordinate: str, degrees: float) -> None:
    assert opensim_coordinates(anatomical(**turned))[coordinate][0] == pytest.approx(degrees, rel=0.2)


def test_coordinates_do_not_jump(tmp_path: Path) -> None:
    standing, time = anatomical(), np.arange(60) / 30
    R = np.repeat(standing.R_parent_child, len(time), axis=0)
    lifted = Rotation.from_rotvec(np.outer(np.radians(75 * time), [0.0, 0.0, 1.0])).as_matrix()  # sideways, by 150°
    shoulder = joint_index("left_shoulder")
    R[:, shoulder] = lifted @ R[:, shoulder]
    motion = Motion(standing.skeleton, R, np.zeros((len(time), 3)), 30.0)
    scene = Estimate("lift", "SIP", (WearerEstimate("Ada", "SIP", motion, {}),))
    table = read_mot(export(scene, tmp_path / "lift.mot")[0])
    assert table["arm_add_l"].min() < -120
    for name in ("arm_flex_l", "arm_add_l", "arm_rot_l"):
        assert np.abs(np.diff(table[name])).max() < 20, name


SOME = {
    "pelvis_imu": "pelvis", "torso_imu": "spine3", "head_imu": "head", "femur_l_imu": "left_hip",
    "calcn_r_imu": "right_ankle", "humerus_l_imu": "left_shoulder", "radius_r_imu": "right_elbow",
}  # fmt: skip


def test_segments_come_back(tmp_path: Path) -> None:
    scene = sample_scene()
    motion = scene.wearers[0].motion
    path = export(scene, tmp_path / "walk.sto")[0]
    found = OPENSENSE.read(path)
    R = segment_orientations(motion)
    for sensor, bone in SOME.items():
        apart = angle_between(found.imus[sensor].R_inertial_sensor, R[:, joint_index(bone)])
        assert np.degrees(apart).max() < 1e-5
    assert found.imus["pelvis_imu"].time == pytest.approx(motion.time - motion.time[0], abs=1e-6)
    assert len(found.imus) == 17


pytestmark = pytest.mark.filterwarnings("ignore:No analog data found")


def read_c3d(path: Path) -> tuple[c3d.Reader, dict[str, Array]]:
    with path.open("rb") as file:
        reader = c3d.Reader(file)
        points = np.stack([points for _, points, _ in reader.read_frames()])
    labels = [label.strip() for label in reader.point_labels]
    assert np.all(points[..., 3] >= 0)  # all points are valid
    return reader, {label: points[:, number, :3] for number, label in enumerate(labels)}


def test_points_come_back_in_millimetres(tmp_path: Path) -> None:
    scene = sample_scene()
    motion = scene.wearers[0].motion
    reader, points = read_c3d(export(scene, tmp_path / "walk.c3d")[0])
    assert reader.point_rate == pytest.approx(RATE)
    assert reader.first_frame == round(motion.start * RATE) + 1
    assert reader.last_frame - reader.first_frame + 1 == FRAMES
    assert reader.get("POINT:UNITS").string_value.strip() == "mm"
    for number, name in enumerate(JOINT_NAMES):
        assert np.abs(points[name] - 1000 * motion.state.p_world_joint[:, number]).max() < 0.001


def test_angles_come_back_in_degrees(tmp_path: Path) -> None:
    scene = sample_scene()
    reader, points = read_c3d(export(scene, tmp_path / "walk.c3d")[0])
    angles = joint_angles(scene.wearers[0].motion)
    labels = [label.strip() for label in reader.get("POINT:ANGLES").string_array]
    assert {"LKneeAngles", "RHipAngles", "PelvisAngles", "LShoulderFlexionAngles"} <= set(labels)
    assert 3 * len(labels) == len(angles.names)
    assert reader.get("POINT:ANGLE_UNITS").string_value.strip() == "deg"
    for label, joint, first in (
        ("LKneeAngles", "left_knee", "flexion"), ("RHipAngles", "right_hip", "flexion"),
        ("PelvisAngles", "pelvis", "tilt"), ("RShoulderAngles", "right_shoulder", "plane_of_elevation"),
        ("RShoulderFlexionAngles", "right_shoulder", "flexion"), ("SpineAngles", "trunk", "flexion"),
    ):  # fmt: skip
        assert np.abs(points[label][:, 0] - angles.of(f"{joint}_{first}")).max() < 1e-4
    assert np.abs(points["PelvisAngles"][:, 2] - angles.of("pelvis_rotation")).max() < 1e-4
