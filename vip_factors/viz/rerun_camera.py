"""A camera in Rerun: its frustum and path, video frames, detections, and the bodies projected over them."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr

from vip_factors.body.keypoints import KeypointSet
from vip_factors.body.mannequin import Colour
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.camera_model import CameraModel
from vip_factors.sensors.camera_path import CameraPath
from vip_factors.sensors.scene import Video
from vip_factors.viz.colours import UNCLAIMED, wearer_colour
from vip_factors.viz.images import jpeg_bytes, limb_pairs, video_stream
from vip_factors.viz.rerun_body import (
    NOBODY_CLASS,
    TRAIL_RADIUS_M,
    class_of,
    log_keypoint_names,
    pale_colour,
    time_column,
)

TRUE_FRUSTUM_COLOUR: Colour = (150, 156, 166)
FRUSTUM_M = 0.6  # from the camera to its image plane as drawn: seen from afar, but not in front of the wearers
CAMERA_COLOUR: Colour = (240, 210, 90)  # of its curves
FRUSTUM_COLOUR: Colour = (52, 58, 70)  # in the world, which is bright


def log_camera(stream: rr.RecordingStream, entity: str, path: CameraPath, model: CameraModel) -> None:
    """Log a moving (or standing) camera: ``entity`` carries its pose, ``entity/image`` its pinhole and pictures."""
    log_camera_poses(stream, entity, path, still=len(path) == 1)
    log_frustum(stream, entity, model)


def log_frustum(stream: rr.RecordingStream, entity: str, model: CameraModel) -> None:
    """Log the pinhole of a camera whose pose is logged at ``entity``."""
    stream.log(f"{entity}/image", _pinhole(model, FRUSTUM_COLOUR), static=True)


def log_true_camera(stream: rr.RecordingStream, entity: str, path: CameraPath, model: CameraModel) -> None:
    """Log where the camera really was: a grey frustum."""
    log_camera_poses(stream, entity, path, still=len(path) == 1)
    stream.log(f"{entity}/frustum", _pinhole(model, TRUE_FRUSTUM_COLOUR), static=True)


def log_camera_trail(stream: rr.RecordingStream, entity: str, path: CameraPath, colour: Colour) -> None:
    """Log the way of the camera as one static line; nothing for one that stands still."""
    if len(path) > 1:
        strip = rr.LineStrips3D([path.p_world_camera], colors=[colour], radii=TRAIL_RADIUS_M)
        stream.log(entity, strip, static=True)


def log_camera_poses(stream: rr.RecordingStream, entity: str, path: CameraPath, still: bool = False) -> None:
    """Log the poses of a camera, or a part of them; of one that stands ``still``, for ever."""
    if still:
        pose = rr.Transform3D(translation=path.p_world_camera[0], mat3x3=path.R_world_camera[0])
        stream.log(entity, pose, static=True)
        return
    columns = rr.Transform3D.columns(
        translation=path.p_world_camera.astype(np.float32),
        quaternion=quaternion_from_matrix(path.R_world_camera, Order.XYZW).astype(np.float32),
    )
    stream.send_columns(entity, indexes=[time_column(path.time)], columns=columns)


def _pinhole(model: CameraModel, colour: Colour) -> rr.Pinhole:
    return rr.Pinhole(
        image_from_camera=model.K,
        resolution=[model.width, model.height],
        camera_xyz=rr.ViewCoordinates.RDF,
        image_plane_distance=FRUSTUM_M,
        color=colour,
        line_width=0.004,
    )


BORDER_COLOUR: Colour = (150, 157, 168)
NOBODYS = "nobody's"


def log_image_style(
    stream: rr.RecordingStream, image: str, model: CameraModel, keypoints: KeypointSet, names: Sequence[str]
) -> None:
    """Log, for ever, where an image ends and how people below it look: ``body/<name>``, ``detected/<name>``.

    Bodies are broad lines, beneath detections: dots that Rerun links and names. Nobody's have fine lines of their own,
    for Rerun could not tell strangers in one frame apart.
    """
    w, h = model.width, model.height
    edge = rr.LineStrips2D([[[0, 0], [w, 0], [w, h], [0, h], [0, 0]]], colors=[BORDER_COLOUR], radii=[-0.8])
    stream.log(f"{image}/border", edge, static=True)
    log_keypoint_names(stream, image, keypoints, names)
    # Rerun takes negative radii as points of the screen.
    for index, name in enumerate(names):
        lines = rr.LineStrips2D.from_fields(colors=[wearer_colour(index)], radii=[-2.6], draw_order=10.0)
        stream.log(f"{body_in(image, name)}/limbs", lines, static=True)
        _log_dots(stream, detected_in(image, name), pale_colour(index), class_of(index))
    lines = rr.LineStrips2D.from_fields(colors=[UNCLAIMED], radii=[-0.8], draw_order=20.0)
    stream.log(f"{detected_in(image, NOBODYS)}/limbs", lines, static=True)
    _log_dots(stream, detected_in(image, NOBODYS), UNCLAIMED, NOBODY_CLASS)


def _log_dots(stream: rr.RecordingStream, entity: str, colour: Colour, number: int) -> None:
    points = rr.Points2D.from_fields(
        colors=[colour], radii=[-2.6], draw_order=21.0, class_ids=number, show_labels=False
    )  # fmt: skip
    stream.log(f"{entity}/points", points, static=True)


def body_in(image: str, name: str) -> str:
    """Entity of a wearer's body projected into an image."""
    return f"{image}/body/{rr.escape_entity_path_part(name)}"


def detected_in(image: str, name: str) -> str:
    """Entity of the detections in an image that were given to a wearer, or are :data:`NOBODYS`."""
    return f"{image}/detected/{rr.escape_entity_path_part(name)}"


def log_people(
    stream: rr.RecordingStream,
    entity: str,
    time: Array,
    frame: np.ndarray,
    pixels: Array,
    keypoints: KeypointSet,
    *,
    lines: bool = True,
    dots: bool = True,
) -> None:
    """Log 2D skeletons below ``entity`` as ``limbs`` and ``points``; :func:`log_image_style` says how they look.

    Args:
        stream: where to.
        entity: below the camera's image.
        time: ``(F,)`` seconds of the video frames; frames without people are cleared.
        frame: ``(n,)`` video frame of each skeleton, not decreasing.
        pixels: ``(n, K, 2)``, NaN where a keypoint is missing.
        keypoints: their order.
        lines, dots: which of both.
    """
    pairs = pixels[:, limb_pairs(keypoints)]
    drawn = np.isfinite(pairs).all(axis=(2, 3))
    if lines:
        columns = rr.LineStrips2D.columns(strips=pairs[drawn].astype(np.float32))
        _send(stream, f"{entity}/limbs", time, np.repeat(frame, drawn.sum(axis=1)), columns)
    seen = np.isfinite(pixels).all(axis=2)
    if dots:
        columns = rr.Points2D.columns(positions=pixels[seen].astype(np.float32), keypoint_ids=np.nonzero(seen)[1])
        _send(stream, f"{entity}/points", time, np.repeat(frame, seen.sum(axis=1)), columns)


def _send(
    stream: rr.RecordingStream, entity: str, time: Array, frame: np.ndarray, columns: rr.ComponentColumnList
) -> None:
    counts = np.bincount(frame, minlength=len(time))
    stream.send_columns(entity, indexes=[time_column(time)], columns=columns.partition(counts))


def log_video(stream: rr.RecordingStream, entity: str, video: Video, time: Array) -> bool:
    """Log video frames at the times ``(F,)`` seconds of the recording's clock; returns whether there was any.

    Embedded images go in as they are; an MP4 file is embedded whole where Rerun can read it, other files are decoded
    here and go in as JPEG.
    """
    images = {index: blob for index, blob in sorted(video.images.items()) if 0 <= index < len(time)}
    if images:
        at = time_column(time[list(images)])
        stream.send_columns(entity, indexes=[at], columns=rr.EncodedImage.columns(blob=list(images.values())))
        return True
    if video.path is None or not video.path.is_file():
        return False
    return _log_mp4(stream, entity, video.path, time) or _log_decoded(stream, entity, video, time)


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
    stream.send_columns(entity, indexes=[time_column(time[:count])], columns=columns)
    return count > 0


def _log_decoded(stream: rr.RecordingStream, entity: str, video: Video, time: Array) -> bool:
    found = 0
    for instant, image in zip(time, video_stream(video, range(len(time))), strict=True):
        if image is None:
            break
        column = rr.EncodedImage.columns(blob=[jpeg_bytes(image, 85)])
        stream.send_columns(entity, indexes=[time_column(np.array([instant]))], columns=column)
        found += 1
    return found > 0
