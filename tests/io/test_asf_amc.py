from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vip_factors.body.pose_prior import joint_vector
from vip_factors.body.skeleton import joint_index
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.poses import align_rigid
from vip_factors.geometry.rotations import angle_between, exp, rotation_x, rotation_z
from vip_factors.io.motions.asf_amc import read_amc, rotation_in_order
from vip_factors.io.motions.bvh import read_bvh

# name: (parent, direction at rest, length in metres, axis in degrees, dof). Legs are spread by 20° at rest, as CMU's.
S, C = np.sin(np.radians(20)), np.cos(np.radians(20))
MIDDLE = {
    "lowerback": ("root", (0, 1, 0), 0.12, (0, 0, 0), "rx ry rz"),
    "upperback": ("lowerback", (0, 1, 0), 0.12, (0, 0, 0), "rx ry rz"),
    "thorax": ("upperback", (0, 1, 0), 0.12, (0, 0, 0), "rx ry rz"),
    "lowerneck": ("thorax", (0, 1, 0), 0.09, (0, 0, 0), "rx ry rz"),
    "upperneck": ("lowerneck", (0, 1, 0), 0.09, (0, 0, 0), "rx ry rz"),
    "head": ("upperneck", (0, 1, 0), 0.09, (0, 0, 0), "rx ry rz"),
}


def side_bones(side: str, x: float) -> dict[str, tuple]:
    return {
        f"{side}hipjoint": ("root", (x, -0.6, 0), 0.12, (0, 0, 0), ""),
        f"{side}femur": (f"{side}hipjoint", (x * S, -C, 0), 0.42, (0, 0, x * 20), "rx ry rz"),
        f"{side}tibia": (f"{side}femur", (x * S, -C, 0), 0.42, (0, 0, x * 20), "rx"),
        f"{side}foot": (f"{side}tibia", (x * S * 0.26, -C * 0.26, 0.966), 0.13, (-90, 0, x * 20), "rx rz"),
        f"{side}toes": (f"{side}foot", (0, 0, 1), 0.06, (-90, 0, x * 20), "rx"),
        f"{side}clavicle": ("thorax", (x, 0.2, 0), 0.18, (0, 0, 0), "ry rz"),
        f"{side}humerus": (f"{side}clavicle", (x, 0, 0), 0.29, (180, x * -30, x * -90), "rx ry rz"),
        f"{side}radius": (f"{side}humerus", (x, 0, 0), 0.18, (180, x * -30, x * -90), "rx"),
        f"{side}wrist": (f"{side}radius", (x, 0, 0), 0.09, (0, x * 90, x * 90), "ry"),
        f"{side}hand": (f"{side}wrist", (x, 0, 0), 0.05, (0, x * 90, x * 90), "rx rz"),
        f"{side}fingers": (f"{side}hand", (x, 0, 0), 0.06, (0, x * 90, x * 90), "rx"),
    }


BONES = MIDDLE | side_bones("l", 1.0) | side_bones("r", -1.0)
UNIT = 0.0254 / 0.45


def write_asf(path: Path) -> Path:
    lines = [":version 1.10", ":units", "  length 0.45", "  angle deg", ":root", "  order TX TY TZ RX RY RZ",
             "  axis XYZ", "  position 0 0 0", "  orientation 0 0 0", ":bonedata"]  # fmt: skip
    for number, (name, (_, direction, length, axis, dof)) in enumerate(BONES.items(), start=1):
        lines += ["  begin", f"    id {number}", f"    name {name}", "    direction {} {} {}".format(*direction)]
        lines += [f"    length {length / UNIT}", "    axis {} {} {} XYZ".format(*axis)]
        lines += [f"    dof {dof}", "    limits (-90 90)"] if dof else []
        lines += ["  end"]
    lines += [":hierarchy", "  begin"]
    for parent in ["root", *BONES]:
        children = [name for name, bone in BONES.items() if bone[0] == parent]
        lines += [f"    {parent} {' '.join(children)}"] if children else []
    path.write_text("\n".join([*lines, "  end"]) + "\n")
    return path


def write_amc(path: Path, frames: list[dict[str, list[float]]]) -> Path:
    lines = ["#!OML:ASF somewhere", ":FULLY-SPECIFIED", ":DEGREES"]
    for number, frame in enumerate(frames, start=1):
        lines += [str(number), "root " + " ".join(map(str, frame.get("root", [0, 17, 0, 0, 0, 0])))]
        for name, bone in BONES.items():
            if bone[4]:
                lines.append(f"{name} " + " ".join(map(str, frame.get(name, [0.0] * len(bone[4].split())))))
    path.write_text("\n".join(lines) + "\n")
    write_asf(path.with_name("07.asf"))
    return path


def test_the_rest_pose_is_our_t_pose_with_the_subjects_own_bones(tmp_path: Path) -> None:
    motion = read_amc(write_amc(tmp_path / "07_01.amc", [{}, {}]))
    legs = [joint_index(f"{side}_{bone}") for side in ("left", "right") for bone in ("hip", "knee", "ankle")]
    R = motion.state.R_world_bone
    # At rest the thighs point 20° outwards, which is a rotation of the hips; knees and ankles are straight.
    assert np.degrees(angle_between(R[0, 0], R[0, legs])) == pytest.approx([20.0] * 6, abs=1e-6)
    vectors = joint_vector(motion.R_parent_child)[0].reshape(-1, 3)
    shoulders = [joint_index(f"{side}_shoulder") - 1 for side in ("left", "right")]
    # The database's arms are turned about themselves against ours: their elbows bend about an axis 30° off y.
    np.testing.assert_allclose(np.degrees(vectors[shoulders]), [[-30, 0, 0]] * 2, atol=1e-9)
    assert np.abs(np.delete(vectors, shoulders, axis=0))[3:].max() < 1e-9
    assert motion.skeleton.bone_length("left_knee") == pytest.approx(0.42)
    assert motion.skeleton.bone_length("right_wrist") == pytest.approx(0.27)  # radius and wrist
    assert motion.rate == 120.0


def test_knees_bend_forward_about_x_and_elbows_about_minus_y_on_the_left(tmp_path: Path) -> None:
    frame = {"ltibia": [50.0], "rtibia": [50.0], "lradius": [70.0], "root": [0, 17, 0, 0, 90, 0]}
    motion = read_amc(write_amc(tmp_path / "07_01.amc", [frame, frame]))
    x = np.degrees(joint_vector(motion.R_parent_child)[0]).reshape(-1, 3)
    for side in ("left", "right"):
        np.testing.assert_allclose(x[joint_index(f"{side}_knee") - 1], [50, 0, 0], atol=1e-6)
    np.testing.assert_allclose(x[joint_index("left_elbow") - 1], [0, -70, 0], atol=1e-6)
    # Turned by 90° about the vertical from facing −y: the wearer faces +x.
    np.testing.assert_allclose(motion.R_parent_child[0, 0] @ [0, 0, 1], [1, 0, 0], atol=1e-9)
    np.testing.assert_allclose(motion.p_world_pelvis[0], [0, 0, 17 * UNIT], atol=1e-9)


@given(angles=st.tuples(*[st.floats(-1.5, 1.5)] * 3))
def test_fixed_axis_order_is_the_first_named_first(angles: tuple[float, float, float]) -> None:
    x, y, z = (exp(np.eye(3)[axis] * angles[axis]) for axis in range(3))
    np.testing.assert_allclose(rotation_in_order(np.array(angles), "xyz"), z @ y @ x, atol=1e-12)
    expected = exp([0, angles[2], 0]) @ rotation_x(angles[1]) @ rotation_z(angles[0])
    np.testing.assert_allclose(rotation_in_order(np.array(angles), "zxy"), expected, atol=1e-12)


def test_a_file_cut_off_gives_its_whole_frames(tmp_path: Path) -> None:
    path = write_amc(tmp_path / "07_01.amc", [{}] * 5)
    text = path.read_text()
    path.write_text(text[:-60])
    assert len(read_amc(path)) == 4


def test_messages_say_where_and_what(tmp_path: Path) -> None:
    path = write_amc(tmp_path / "07_01.amc", [{}] * 3)
    text = path.read_text()
    path.write_text(text.replace("ltibia 0.0", "ltibia x", 1))
    with pytest.raises(FileFormatError, match=r"line \d+: 'ltibia x': expected 1 numbers"):
        read_amc(path)
    path.write_text(text.replace("ltibia", "tail", 1))
    with pytest.raises(FileFormatError, match="moving bone"):
        read_amc(path)
    path.write_text(text.replace("ltibia 0.0\n", "", 1))
    with pytest.raises(FileFormatError, match="lacks ltibia"):
        read_amc(path)
    (tmp_path / "07.asf").unlink()
    with pytest.raises(InputError, match=r"named 07\.asf"):
        read_amc(path)
    (tmp_path / "bad.asf").write_text(":bonedata\n begin\n length long\n")
    with pytest.raises(FileFormatError, match="line 3"):
        read_amc(path, asf=tmp_path / "bad.asf")


@pytest.mark.data
@pytest.mark.parametrize(("clip", "hips_within"), [("02/02_05", 3.0), ("02/02_10", 3.0), ("03/03_01", 14.0)])
def test_the_bvh_of_a_clip_has_the_joint_angles_of_its_original(
    data_folder: Path, clip: str, hips_within: float
) -> None:
    original, converted = (
        read_amc(data_folder / f"cmu_asfamc/{clip}.amc"),
        read_bvh(data_folder / f"cmu_bvh/{clip}.bvh"),
    )
    original = original.frames(slice(len(original) - len(converted), None))
    difference = np.degrees(joint_vector(converted.R_parent_child) - joint_vector(original.R_parent_child))
    mean = np.abs(np.mean(difference, axis=0)).reshape(-1, 3)
    # The figure's own offset of hips and ankles differs between subjects; knees and elbows do not suffer from it.
    for bone, limit in (("hip", hips_within), ("ankle", hips_within), ("knee", 3.0), ("elbow", 7.0)):
        for side in ("left", "right"):
            assert mean[joint_index(f"{side}_{bone}") - 1].max() < limit, bone
    # It has other proportions than the subject, too: joints lie some centimetres apart.
    chosen = [joint_index(f"{side}_{one}") for side in ("left", "right") for one in ("hip", "knee", "ankle", "wrist")]
    ours, theirs = (motion.state.p_world_joint[:, chosen] for motion in (converted, original))
    apart = np.linalg.norm(align_rigid(ours, theirs).apply(ours) - theirs, axis=-1)
    assert apart.mean() < 0.09
