"""A body in Rerun: one entity per bone whose transform moves, so that skin, sensors and names are logged once.

The skin is cut into rigid pieces, one a bone. Every wearer is a class of Rerun's annotation context, so that the links
between joints and keypoints take the wearer's colour, and the viewer names what the pointer is on.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr

from vip_factors.body.body_mesh import BodyMesh, body_mesh
from vip_factors.body.keypoints import KeypointSet
from vip_factors.body.kinematics import Motion, forward_kinematics
from vip_factors.body.mannequin import SENSOR_COLOUR, Colour, Side, side_of
from vip_factors.body.skeleton import JOINT_NAMES, PARENTS, Skeleton, joint_index
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import Array, rotation_z
from vip_factors.sensors.calibration import Calibration, Placement
from vip_factors.viz.colours import UNCLAIMED, wearer_colour
from vip_factors.viz.images import limb_pairs

TIMELINE = "time"
SENSOR_HALF_SIZE_M = (0.022, 0.016, 0.007)  # a usual body-worn IMU's box: 45 × 32 × 14 mm
SENSOR_AXIS_M = 0.07  # long enough to see how a sensor is turned
AXIS_COLOURS = ((224, 60, 60), (70, 170, 80), (60, 100, 220))
TRAIL_RADIUS_M = 0.006


def time_column(time: Array) -> rr.TimeColumn:
    """Seconds from the recording's start as Rerun's column."""
    return rr.TimeColumn(TIMELINE, duration=time)


def log_body(
    stream: rr.RecordingStream, entity: str, motion: Motion, colours: Mapping[Side, Colour], *, ghost: bool = False
) -> None:
    """Log a moving body below ``entity``: ``entity/<bone>`` carries the bone's world pose and its static shape.

    Args:
        stream: where to.
        entity: path in the world, such as ``world/estimate``.
        motion: in the world to be drawn.
        colours: of the segments by side.
        ghost: draw see-through, for what something else is compared with.
    """
    log_poses(stream, entity, motion)
    log_shape(stream, entity, motion.skeleton, colours, ghost=ghost)


def log_poses(stream: rr.RecordingStream, entity: str, motion: Motion) -> None:
    """Log the world poses of all bones, ``entity/<bone>``."""
    state = motion.state
    quaternions = quaternion_from_matrix(state.R_world_bone, Order.XYZW).astype(np.float32)
    positions = state.p_world_joint.astype(np.float32)
    time = time_column(motion.time)
    for bone, name in enumerate(JOINT_NAMES):
        stream.send_columns(
            f"{entity}/{name}",
            indexes=[time],
            columns=rr.Transform3D.columns(translation=positions[:, bone], quaternion=quaternions[:, bone]),
        )


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
    for site in placement.sites:
        known = None if calibration is None else calibration.get(site.sensor)
        R_bone_sensor = site.R_bone_sensor if known is None else known.R_bone_sensor
        path = f"{entity}/{site.bone}/{site.sensor}"
        pose = rr.Transform3D(translation=site.p_bone_sensor, mat3x3=R_bone_sensor)
        stream.log(path, pose, static=True)
        box = rr.Boxes3D(
            half_sizes=[SENSOR_HALF_SIZE_M], colors=[colours.get(site.sensor, SENSOR_COLOUR)], fill_mode="solid"
        )
        stream.log(path, box, static=True)
        axes = rr.Arrows3D(vectors=SENSOR_AXIS_M * np.eye(3), colors=AXIS_COLOURS, radii=0.0025)
        stream.log(f"{path}/axes", axes, static=True)


def log_trail(stream: rr.RecordingStream, entity: str, motion: Motion, floor: float, colour: Colour) -> None:
    """Log the way of the pelvis, laid on the floor, as one static line."""
    path = motion.p_world_pelvis.copy()
    path[:, 2] = floor
    stream.log(entity, rr.LineStrips3D([path], colors=[colour], radii=TRAIL_RADIUS_M), static=True)


GHOST_ALPHA, GLASS_ALPHA = 110, 70  # of 255
ARMS_DOWN = 0.95  # radians from the T-pose, where the skin is cut: between arms that hang and arms held out
LAPPED = 0.3  # of a triangle's movement: pieces reach over joints, so that none gapes when it bends
MESHES = 8  # that are kept: making one takes some tenths of a second
_CUT: dict[bytes, "CutSkin"] = {}


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
    """The skin of a skeleton; those of the last few bodies are kept."""
    points = [one.p_bone_point for one in skeleton.landmarks.values()]
    key = b"".join(np.asarray(one, dtype=float).tobytes() for one in (skeleton.p_parent_joint, *points))
    if key not in _CUT:
        while len(_CUT) >= MESHES:
            del _CUT[next(iter(_CUT))]
        mesh = body_mesh(skeleton)
        shares = mesh.weights[mesh.faces].mean(axis=1)
        most = np.argmax(shares, axis=1)
        bones = range(len(JOINT_NAMES))
        once = [mesh.faces[most == bone] for bone in bones]
        lapped = [mesh.faces[(most == bone) | (shares[:, bone] > LAPPED)] for bone in bones]
        R, p = _pose(skeleton)
        _CUT[key] = CutSkin(mesh, *mesh.posed(R, p), R, p, once, lapped)
    return _CUT[key]


def _pose(skeleton: Skeleton) -> tuple[Array, Array]:
    """Poses of the bones ``(24, 3, 3)``, ``(24, 3)`` where the skin is cut, half way between common poses."""
    R = np.tile(np.eye(3), (1, len(JOINT_NAMES), 1, 1))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        R[0, joint_index(f"{side}_shoulder")] = rotation_z(-sign * ARMS_DOWN)
    state = forward_kinematics(skeleton, R, np.zeros((1, 3)))
    return state.R_world_bone[0], state.p_world_joint[0]


def log_shape(
    stream: rr.RecordingStream, entity: str, skeleton: Skeleton, colours: Mapping[Side, Colour], *, ghost: bool = False
) -> None:
    """Log the skin that moves with the bones below ``entity``, for ever.

    Args:
        stream: where to.
        entity: of the body; its bones are below it.
        skeleton: the body.
        colours: by side.
        ghost: see-through, for what something else is compared with.
    """
    skin = cut_skin(skeleton)
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
    return {f"{entity}/{name}": glass for name in JOINT_NAMES}


NOBODY_CLASS = 0
JOINT_RADIUS_M = 0.012  # within the body: seen in see-through bodies, and where a body is switched off


def class_of(index: int) -> int:
    """Rerun's class of a wearer; of −1, nobody, too."""
    return index + 1


def log_joint_names(stream: rr.RecordingStream, entity: str, names: Sequence[str]) -> None:
    """Log names and links of the joints of wearers of these names, for all that is below ``entity``."""
    links = [(parent, joint) for joint, parent in enumerate(PARENTS) if parent >= 0]
    classes = [
        _class(class_of(index), name, wearer_colour(index), JOINT_NAMES, links) for index, name in enumerate(names)
    ]
    stream.log(entity, rr.AnnotationContext(classes), static=True)


def log_keypoint_names(stream: rr.RecordingStream, image: str, keypoints: KeypointSet, names: Sequence[str]) -> None:
    """Log names and links of a detector's keypoints, for all that is below an image.

    Nobody's have no links, for Rerun could not tell strangers in one frame apart.
    """
    links = [(int(a), int(b)) for a, b in limb_pairs(keypoints)]
    classes = [_class(NOBODY_CLASS, "nobody's", UNCLAIMED, keypoints.keypoints, [])]
    for index, name in enumerate(names):
        classes.append(_class(class_of(index), name, pale_colour(index), keypoints.keypoints, links))
    stream.log(image, rr.AnnotationContext(classes), static=True)


def log_joints_style(stream: rr.RecordingStream, entity: str, index: int) -> None:
    """Log how the joints of a wearer look at ``entity``, and that they are joints, for ever."""
    style = rr.Points3D.from_fields(
        radii=[JOINT_RADIUS_M], class_ids=[class_of(index)], keypoint_ids=np.arange(len(JOINT_NAMES)), show_labels=False
    )
    stream.log(entity, style, static=True)


def log_joints(stream: rr.RecordingStream, entity: str, motion: Motion) -> None:
    """Log where the joints of a motion are."""
    points = motion.state.p_world_joint.astype(np.float32)
    columns = rr.Points3D.columns(positions=points.reshape(-1, 3)).partition([points.shape[1]] * len(points))
    stream.send_columns(entity, indexes=[time_column(motion.time)], columns=columns)


def pale_colour(index: int) -> Colour:
    """A wearer's detections: paler than the body, which they lie on."""
    red, green, blue = wearer_colour(index)
    return (red + 255) // 2, (green + 255) // 2, (blue + 255) // 2


def _class(
    number: int, name: str, colour: Colour, points: Sequence[str], links: Sequence[tuple[int, int]]
) -> rr.ClassDescription:
    return rr.ClassDescription(
        info=rr.AnnotationInfo(number, name, colour),
        keypoint_annotations=[rr.AnnotationInfo(one, point.replace("_", " ")) for one, point in enumerate(points)],
        keypoint_connections=links,
    )
