"""Cameras in Rerun: frustum and path, video frames, detections, and the bodies projected over them."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr

from vip_factors.body.keypoints import KeypointSet
from vip_factors.body.mannequin import Colour
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.camera import CameraModel, CameraPath
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.scene import Video
from vip_factors.viz.colours import UNCLAIMED, mixed, wearer_colour
from vip_factors.viz.drawn_scene import NOBODY
from vip_factors.viz.images import jpeg_bytes, limb_pairs, video_stream
from vip_factors.viz.rerun_body import time_column

FRUSTUM_COLOUR: Colour = (52, 58, 70)  # in the world, which is bright


def log_pinhole(
    stream: rr.RecordingStream, image: str, model: CameraModel, colour: Colour = FRUSTUM_COLOUR
) -> None:  # fmt: skip
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
    stream.send_columns(entity, indexes=[time_column(path.time)], columns=columns)


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
        dots = rr.Points2D.from_fields(
            colors=[colour], radii=[-2.6], draw_order=21.0, class_ids=0, show_labels=False
        )  # fmt: skip
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
        seen = np.isfinite(pixels).all(axis=2)
        columns = rr.Points2D.columns(positions=pixels[seen].astype(np.float32), keypoint_ids=np.nonzero(seen)[1])
        _send(stream, f"{entity}/points", detections.time, np.repeat(frame, seen.sum(axis=1)), columns)


def log_projection(
    stream: rr.RecordingStream, entity: str, time: Array, pixels: Array, keypoints: KeypointSet
) -> None:  # fmt: skip
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
    stream.send_columns(entity, indexes=[time_column(time)], columns=columns.partition(counts))


def log_video(stream: rr.RecordingStream, entity: str, video: Video, time: Array) -> bool:
    """Log video frames at the times ``(F,)`` seconds of the recording's clock; returns whether there was any.

    Embedded images go in as they are; an MP4 file is embedded whole where Rerun can read it, other files are decoded
    here and go in as JPEG.
    """
    images = {index: blob for index, blob in sorted(video.images.items()) if 0 <= index < len(time)}
    if images:
        column = time_column(time[list(images)])
        stream.send_columns(entity, indexes=[column], columns=rr.EncodedImage.columns(blob=list(images.values())))
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
    count = 0
    for instant, image in zip(time, video_stream(video, range(len(time))), strict=True):
        if image is None:
            break
        column = rr.EncodedImage.columns(blob=[jpeg_bytes(image, 85)])
        stream.send_columns(entity, indexes=[time_column(np.array([instant]))], columns=column)
        count += 1
    return count > 0
