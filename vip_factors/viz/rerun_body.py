"""Bodies and cameras in Rerun: poses, skin and sensors; frusta, video frames, detections and projected bodies."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr

from vip_factors.body.body_mesh import BodyMesh, body_mesh
from vip_factors.body.keypoints import KeypointSet
from vip_factors.body.kinematics import Motion, forward_kinematics
from vip_factors.body.mannequin import SENSOR_COLOUR, Colour, Side, side_of
from vip_factors.body.skeleton import JOINT_NAMES, Skeleton, joint_index
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import Array, rotation_z
from vip_factors.sensors.calibration import Calibration, Placement
from vip_factors.sensors.camera import CameraModel, CameraPath
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.scene import Video
from vip_factors.viz.colours import GHOST_COLOUR, UNCLAIMED, mixed, wearer_colour
from vip_factors.viz.drawn_scene import NOBODY
from vip_factors.viz.film import jpeg_bytes, limb_pairs, video_stream

WORLD = "/world"
GHOST_COLOURS: Mapping[Side, Colour] = dict.fromkeys(Side, GHOST_COLOUR)
GHOST_ALPHA, GLASS_ALPHA = 110, 70  # of 255


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
    stream.send_columns(
        entity, indexes=[rr.TimeColumn("time", duration=np.repeat(motion.time, len(frames)))], columns=columns
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


class BodyLog:
    """A body that is logged piece by piece: its skin anew where skeleton or colours change, and the next poses.

    Args:
        stream: where to.
        entity: of the body.
        ghost: see-through, for what another body is compared with.
    """

    def __init__(self, stream: rr.RecordingStream, entity: str, ghost: bool = False) -> None:
        self.entity = entity
        self._stream, self._ghost = stream, ghost
        self._look: tuple[bytes, Mapping[Side, Colour]] | None = None

    def log(self, motion: Motion, colours: Mapping[Side, Colour]) -> None:
        """Log poses of a body in its colours by side."""
        look = motion.skeleton.p_parent_joint.tobytes(), colours
        if look != self._look:
            self._look = look
            self._log_skin(cut_skin(motion.skeleton), colours)
        log_poses(self._stream, self.entity, motion)

    def _log_skin(self, skin: CutSkin, colours: Mapping[Side, Colour]) -> None:
        tones = np.array([colours[side_of(bone)] for bone in range(len(JOINT_NAMES))], np.uint8)[skin.mesh.bone]
        # Where pieces overlap a see-through body would be darker.
        for bone, triangles in enumerate(skin.once if self._ghost else skin.lapped):
            if not len(triangles):
                continue
            used, faces = np.unique(triangles, return_inverse=True)
            R = skin.R_cut_bone[bone]
            shape = rr.Mesh3D(
                vertex_positions=((skin.p_cut[used] - skin.p_cut_bone[bone]) @ R).astype(np.float32),
                vertex_normals=(skin.normal[used] @ R).astype(np.float32),
                vertex_colors=tones[used],
                triangle_indices=faces.reshape(-1, 3).astype(np.uint32),
                albedo_factor=(255, 255, 255, GHOST_ALPHA if self._ghost else 255),
            )
            self._stream.log(f"{self.entity}/{JOINT_NAMES[bone]}", shape, static=True)


FRUSTUM_COLOUR: Colour = (52, 58, 70)  # in the world, which is bright


def log_pinhole(stream: rr.RecordingStream, image: str, model: CameraModel, colour: Colour = FRUSTUM_COLOUR) -> None:
    """Log the lens of the camera whose pose is logged above ``image``."""
    pinhole = rr.Pinhole(
        image_from_camera=model.K,
        resolution=[model.width, model.height],
        camera_xyz=rr.ViewCoordinates.RDF,
        image_plane_distance=0.6,  # metres: seen from afar, but not in front of the wearers
        color=colour,
        line_width=0.004,
    )
    stream.log(image, pinhole, static=True)


def log_camera_poses(stream: rr.RecordingStream, entity: str, path: CameraPath) -> None:
    """Log the poses of a camera, all of them or the next ones."""
    columns = rr.Transform3D.columns(
        translation=path.p_world_camera.astype(np.float32),
        quaternion=quaternion_from_matrix(path.R_world_camera, Order.XYZW).astype(np.float32),
    )
    stream.send_columns(entity, indexes=[rr.TimeColumn("time", duration=path.time)], columns=columns)


def log_camera(
    stream: rr.RecordingStream, entity: str, path: CameraPath, model: CameraModel, colour: Colour = FRUSTUM_COLOUR
) -> None:
    """Log a moving or standing camera: ``entity`` has its pose, ``entity/image`` its lens and pictures."""
    if len(path) > 1:
        log_camera_poses(stream, entity, path)
    else:
        pose = rr.Transform3D(translation=path.p_world_camera[0], mat3x3=path.R_world_camera[0])
        stream.log(entity, pose, static=True)
    log_pinhole(stream, f"{entity}/image", model, colour)


def people_below(image: str, what: str, names: Sequence[str]) -> list[str]:
    """Entities below an image, ``body`` or ``detected``, of the wearers of these names, and of nobody as the last."""
    return [f"{image}/{what}/{rr.escape_entity_path_part(name)}" for name in (*names, "nobody's")]


def log_image_style(
    stream: rr.RecordingStream, image: str, model: CameraModel, keypoints: KeypointSet, names: Sequence[str]
) -> None:
    """Log where an image ends, what its keypoints are called, and how people below it look.

    Bodies are broad lines in their wearer's colour, beneath detections: paler dots and fine lines, grey if nobody's.
    """
    w, h = model.width, model.height
    border = [[0, 0], [w, 0], [w, h], [0, h], [0, 0]]
    # Rerun takes negative radii as points of the screen.
    stream.log(f"{image}/border", rr.LineStrips2D([border], colors=[(150, 157, 168)], radii=[-0.8]), static=True)
    labels = [rr.AnnotationInfo(number, name.replace("_", " ")) for number, name in enumerate(keypoints.keypoints)]
    stream.log(image, rr.AnnotationContext([rr.ClassDescription(info=0, keypoint_annotations=labels)]), static=True)
    bodies, detected = (people_below(image, what, names) for what in ("body", "detected"))
    for index, entity in enumerate(bodies[:-1]):
        lines = rr.LineStrips2D.from_fields(colors=[wearer_colour(index)], radii=[-2.6], draw_order=10.0)
        stream.log(f"{entity}/limbs", lines, static=True)
    pale = [mixed(wearer_colour(index), (255, 255, 255), 0.5) for index in range(len(names))]
    for entity, colour in zip(detected, [*pale, UNCLAIMED], strict=True):
        lines = rr.LineStrips2D.from_fields(colors=[colour], radii=[-0.8], draw_order=20.0)
        stream.log(f"{entity}/limbs", lines, static=True)
        dots = rr.Points2D.from_fields(colors=[colour], radii=[-2.6], draw_order=21.0, class_ids=0, show_labels=False)
        stream.log(f"{entity}/points", dots, static=True)


def log_detections(
    stream: rr.RecordingStream, image: str, detections: Detections, labels: np.ndarray, names: Sequence[str]
) -> None:
    """Log the people detected in an image, all of them or those of the next video frames.

    Args:
        stream: where to.
        image: entity of the camera's image.
        detections: on the recording's clock.
        labels: ``(N,)`` wearer of each detection, :data:`NOBODY` for strangers.
        names: of the wearers.
    """
    wearers = [*range(len(names)), NOBODY]
    for index, entity in zip(wearers, people_below(image, "detected", names), strict=True):
        chosen = labels == index
        pixels = np.where(detections.seen[chosen, :, None], detections.pixels[chosen], np.nan)
        frame = detections.frame[chosen]
        _log_limbs(stream, entity, detections.time, frame, pixels, detections.keypoints)
        is_seen = np.isfinite(pixels).all(axis=2)
        columns = rr.Points2D.columns(positions=pixels[is_seen].astype(np.float32), keypoint_ids=np.nonzero(is_seen)[1])
        _send(stream, f"{entity}/points", detections.time, np.repeat(frame, is_seen.sum(axis=1)), columns)


def log_projection(stream: rr.RecordingStream, entity: str, time: Array, pixels: Array, keypoints: KeypointSet) -> None:
    """Log a body as a camera should have seen it: keypoints ``(F, K, 2)`` in pixels at seconds ``(F,)``."""
    _log_limbs(stream, entity, time, np.arange(len(time)), pixels, keypoints)


def _log_limbs(
    stream: rr.RecordingStream, entity: str, time: Array, frame: np.ndarray, pixels: Array, keypoints: KeypointSet
) -> None:
    """Log lines between the keypoints ``(n, K, 2)`` of people in video frames ``(n,)``, not decreasing."""
    pairs = pixels[:, limb_pairs(keypoints)]
    drawn = np.isfinite(pairs).all(axis=(2, 3))
    columns = rr.LineStrips2D.columns(strips=pairs[drawn].astype(np.float32))
    _send(stream, f"{entity}/limbs", time, np.repeat(frame, drawn.sum(axis=1)), columns)


def _send(
    stream: rr.RecordingStream, entity: str, time: Array, frame: np.ndarray, columns: rr.ComponentColumnList
) -> None:
    """Send what belongs to video frames ``(n,)``; frames without anything are cleared."""
    counts = np.bincount(frame, minlength=len(time))
    stream.send_columns(entity, indexes=[rr.TimeColumn("time", duration=time)], columns=columns.partition(counts))


def log_video(stream: rr.RecordingStream, entity: str, video: Video, time: Array) -> bool:
    """Log video frames at the times ``(F,)`` seconds of the recording's clock; returns whether there was any.

    Embedded images go in as they are; an MP4 file is embedded whole where Rerun can read it, other files are decoded
    here and go in as JPEG.
    """
    images = {index: blob for index, blob in sorted(video.images.items()) if 0 <= index < len(time)}
    if images:
        column = rr.TimeColumn("time", duration=time[list(images)])
        stream.send_columns(entity, indexes=[column], columns=rr.EncodedImage.columns(blob=list(images.values())))
        return True
    if video.path is None or not video.path.is_file():
        return False
    if _log_mp4(stream, entity, video.path, time):
        return True
    count = 0
    for instant, image in zip(time, video_stream(video, range(len(time))), strict=True):
        if image is None:
            break
        picture = rr.EncodedImage.columns(blob=[jpeg_bytes(image, 85)])
        stream.send_columns(entity, indexes=[rr.TimeColumn("time", duration=np.array([instant]))], columns=picture)
        count += 1
    return count > 0


def _log_mp4(stream: rr.RecordingStream, entity: str, path: Path, time: Array) -> bool:
    if path.suffix.lower() != ".mp4":
        return False
    asset = rr.AssetVideo(path=path)
    try:
        stamps = asset.read_frame_timestamps_nanos()
    except RuntimeError:  # a codec that Rerun does not know
        return False
    count = min(len(stamps), len(time))
    stream.log(entity, asset, static=True)
    columns = rr.VideoFrameReference.columns_nanos(stamps[:count])
    stream.send_columns(entity, indexes=[rr.TimeColumn("time", duration=time[:count])], columns=columns)
    return count > 0
