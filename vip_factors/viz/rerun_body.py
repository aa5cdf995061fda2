"""Bodies in Rerun: the poses of all bones in one column of transforms; skin and sensors that move with them, once.

The skin is cut into rigid pieces, one a bone. Entities are absolute paths; poses are in the frame of ``WORLD``.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr

from vip_factors.body.body_mesh import BodyMesh, body_mesh
from vip_factors.body.kinematics import Motion, forward_kinematics
from vip_factors.body.mannequin import SENSOR_COLOUR, Colour, Side, side_of
from vip_factors.body.skeleton import JOINT_NAMES, Skeleton, joint_index
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import Array, rotation_z
from vip_factors.sensors.calibration import Calibration, Placement
from vip_factors.viz.colours import GHOST_COLOUR

WORLD = "/world"
GHOST_COLOURS: Mapping[Side, Colour] = dict.fromkeys(Side, GHOST_COLOUR)
GHOST_ALPHA, GLASS_ALPHA = 110, 70  # of 255


def time_column(time: Array) -> rr.TimeColumn:
    """Rerun's column of seconds ``(T,)`` from the recording's start."""
    return rr.TimeColumn("time", duration=time)


def log_poses(stream: rr.RecordingStream, entity: str, motion: Motion) -> None:
    """Log the world poses of all bones, ``entity/<bone>``, of a whole motion or of the next frames of one."""
    state, frames = motion.state, [f"tf#{entity}/{bone}" for bone in JOINT_NAMES]
    quaternions = quaternion_from_matrix(state.R_world_bone, Order.XYZW).astype(np.float32)
    # One column of all bones: a column for each would cost a stream several times as much.
    columns = rr.Transform3D.columns(
        translation=state.p_world_joint.astype(np.float32).reshape(-1, 3),
        quaternion=quaternions.reshape(-1, 4),
        child_frame=frames * len(motion),
        parent_frame=[f"tf#{WORLD}"] * (len(frames) * len(motion)),
    )
    stream.send_columns(entity, indexes=[time_column(np.repeat(motion.time, len(frames)))], columns=columns)


def log_sensors(
    stream: rr.RecordingStream,
    entity: str,
    placement: Placement,
    calibration: Calibration | None,
    colours: Mapping[str, Colour],
) -> None:
    """Log each sensor as a box with its axes, fixed to its bone: as calibrated, else as placed roughly.

    ``colours`` are those of its curves; a sensor without one is pale yellow.
    """
    half_size_m = (0.022, 0.016, 0.007)  # the box of a usual body-worn IMU: 45 × 32 × 14 mm
    axis_m = 0.07  # long enough to see how a sensor is turned
    for site in placement.sites:
        estimate = None if calibration is None else calibration.get(site.sensor)
        R_bone_sensor = site.R_bone_sensor if estimate is None else estimate.R_bone_sensor
        path = f"{entity}/{site.bone}/{rr.escape_entity_path_part(site.sensor)}"
        stream.log(path, rr.Transform3D(translation=site.p_bone_sensor, mat3x3=R_bone_sensor), static=True)
        colour = colours.get(site.sensor, SENSOR_COLOUR)
        stream.log(path, rr.Boxes3D(half_sizes=[half_size_m], colors=[colour], fill_mode="solid"), static=True)
        red_green_blue = ((224, 60, 60), (70, 170, 80), (60, 100, 220))
        axes = rr.Arrows3D(vectors=axis_m * np.eye(3), colors=red_green_blue, radii=0.0025)
        stream.log(f"{path}/axes", axes, static=True)


def log_trail(stream: rr.RecordingStream, entity: str, p_world: Array, colour: Colour) -> None:
    """Log a path ``(T, 3)`` in metres as one static line."""
    stream.log(entity, rr.LineStrips3D([p_world], colors=[colour], radii=0.006), static=True)


def log_name(stream: rr.RecordingStream, entity: str, name: str) -> None:
    """Log the wearer's name above the head of a body."""
    p_head = [0.0, 0.32, 0.0]  # metres above the head's joint: clear of the crown
    label = rr.Points3D([p_head], labels=[name], radii=0.004, colors=[(16, 18, 22)])
    stream.log(f"{entity}/head/name", label, static=True)


@dataclass(frozen=True)
class CutSkin:
    """A mesh, and by bone the triangles that move with it.

    Attributes:
        p_cut, normal: ``(V, 3)`` vertices (metres) and normals in the pose in which it is cut.
        R_cut_bone, p_cut_bone: ``(24, 3, 3)`` and ``(24, 3)`` poses of the bones there.
        once, lapped: by bone ``(F, 3)`` vertices of its triangles: each triangle once, or reaching over joints.
    """

    mesh: BodyMesh
    p_cut: Array
    normal: Array
    R_cut_bone: Array
    p_cut_bone: Array
    once: Sequence[np.ndarray]
    lapped: Sequence[np.ndarray]


def cut_skin(skeleton: Skeleton) -> CutSkin:
    """The skin of a skeleton, cut half way between hanging arms and arms held out; it takes some tenths of a second."""
    arms_down, lapped_share = 0.95, 0.3  # radians from the T-pose; of a triangle's movement, so that no joint gapes
    mesh = body_mesh(skeleton)
    shares = mesh.weights[mesh.faces].mean(axis=1)
    strongest = np.argmax(shares, axis=1)
    bones = range(len(JOINT_NAMES))
    R_parent_child = np.tile(np.eye(3), (1, len(JOINT_NAMES), 1, 1))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        R_parent_child[0, joint_index(f"{side}_shoulder")] = rotation_z(-sign * arms_down)
    state = forward_kinematics(skeleton, R_parent_child, np.zeros((1, 3)))
    R, p = state.R_world_bone[0], state.p_world_joint[0]
    once = [mesh.faces[strongest == bone] for bone in bones]
    lapped = [mesh.faces[(strongest == bone) | (shares[:, bone] > lapped_share)] for bone in bones]
    return CutSkin(mesh, *mesh.posed(R, p), R, p, once, lapped)


def log_skin(
    stream: rr.RecordingStream, entity: str, skin: CutSkin, colours: Mapping[Side, Colour], *, ghost: bool = False
) -> None:
    """Log the skin that moves with the bones below ``entity``, until it is logged again.

    Args:
        stream: where to.
        entity: of the body, whose poses :func:`log_poses` logs.
        skin: of the body.
        colours: by side.
        ghost: see-through, for what another body is compared with.
    """
    tones = np.array([colours[side_of(bone)] for bone in range(len(JOINT_NAMES))], np.uint8)[skin.mesh.bone]
    # Where pieces overlap a see-through body would be darker.
    for bone, triangles in enumerate(skin.once if ghost else skin.lapped):
        if not len(triangles):
            continue
        used, faces = np.unique(triangles, return_inverse=True)
        R = skin.R_cut_bone[bone]
        shape = rr.Mesh3D(
            vertex_positions=((skin.p_cut[used] - skin.p_cut_bone[bone]) @ R).astype(np.float32),
            vertex_normals=(skin.normal[used] @ R).astype(np.float32),
            vertex_colors=tones[used],
            triangle_indices=faces.reshape(-1, 3).astype(np.uint32),
            albedo_factor=(255, 255, 255, GHOST_ALPHA if ghost else 255),
        )
        stream.log(f"{entity}/{JOINT_NAMES[bone]}", shape, static=True)


def see_through(entity: str) -> dict[str, rr.Mesh3D]:
    """Overrides for a view in which the body below ``entity`` must not hide what is behind it."""
    glass = rr.Mesh3D.from_fields(albedo_factor=(255, 255, 255, GLASS_ALPHA))
    return {f"{entity}/{bone}": glass for bone in JOINT_NAMES}
