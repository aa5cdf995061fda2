"""Recordings, estimates and their truth in Rerun: wearers and cameras of any number, in one world.

Everything goes in as columns, so that minutes of motion are logged in seconds.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import rerun as rr

from vip_factors.atomic import atomic_path
from vip_factors.body.mannequin import ESTIMATE_COLOURS, Colour, Side
from vip_factors.errors import InputError
from vip_factors.sensors.camera import CameraModel
from vip_factors.viz.colours import GHOST_COLOUR, body_colours
from vip_factors.viz.compare import Compare, floor_height
from vip_factors.viz.drawn_scene import NOBODY, DrawnCamera, DrawnScene, DrawnWearer
from vip_factors.viz.rerun_body import (
    FRUSTUM_COLOUR,
    GHOST_COLOURS,
    WORLD,
    cut_skin,
    log_camera,
    log_detections,
    log_image_style,
    log_name,
    log_pinhole,
    log_poses,
    log_projection,
    log_sensors,
    log_skin,
    log_trail,
    log_video,
    people_below,
)
from vip_factors.viz.rerun_layout import (
    SUMMARY,
    Stage,
    centre_path,
    log_centre,
    log_series,
    recorded_panels,
    sensor_colours_of,
)
from vip_factors.viz.summaries import scene_summary
from vip_factors.viz.viewer import APPLICATION, complete, open_viewer

TRUE_FRUSTUM_COLOUR: Colour = (150, 156, 166)


def show(drawn: DrawnScene, save: Path | None = None, overwrite: bool = False) -> None:
    """Show what is drawn, in Rerun.

    Args:
        drawn: a wearer (:func:`~vip_factors.viz.drawn_scene.drawn_wearer`) or a scene.
        save: ``.rrd`` file, written whole or not at all; without one the viewer is opened, in its own process.
        overwrite: replace an existing file.

    Raises:
        InputError: if there is nothing to show, the file exists, or there is no display for the viewer.
        OSError, VipFactorsError: if the file cannot be written.
    """
    stream = rr.RecordingStream(APPLICATION)
    if save is not None:
        with atomic_path(save, overwrite) as partial:
            stream.save(partial)
            _log(stream, drawn)
            complete(stream, partial, save)
        return
    open_viewer(stream, "a file (save) instead of the live viewer")
    _log(stream, drawn)
    stream.flush()


def _log(stream: rr.RecordingStream, drawn: DrawnScene) -> None:
    """Log everything and the layout."""
    filmed = drawn.detections is not None and len(drawn.detections.time) > 0
    bodies = [body for wearer in drawn.wearers if (body := wearer.truth or wearer.shown or wearer.rest) is not None]
    if not filmed and not bodies:
        raise InputError(
            f"scene '{drawn.name}' has no camera with video frames, no truth and no estimate: nothing to show"
        )
    stream.send_recording_name(drawn.name)
    stream.log(WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    floor = min((floor_height(body) for body in bodies), default=0.0)
    colours = sensor_colours_of(
        [wearer.recording for wearer in drawn.wearers], [wearer.estimate for wearer in drawn.wearers]
    )
    for wearer in drawn.wearers:
        _log_wearer(stream, wearer, drawn, floor, colours)
    shown = [wearer.shown for wearer in drawn.wearers if wearer.shown is not None]
    if shown:
        log_centre(stream, *centre_path(shown))
    images = [*_log_camera(stream, drawn), *(_log_further_camera(stream, camera, drawn) for camera in drawn.further)]
    plots = log_series(stream, drawn, colours)
    text = rr.TextDocument(scene_summary(drawn), media_type=rr.MediaType.MARKDOWN)
    stream.log(SUMMARY, text, static=True)
    standing = [body for wearer in drawn.wearers if (body := wearer.shown or wearer.rest) is not None]
    if drawn.compare is Compare.SIDE:
        standing += [wearer.truth for wearer in drawn.wearers if wearer.motion is not None and wearer.truth is not None]
    seen_through = [_body_of(wearer) for wearer in drawn.wearers if wearer.shown is not None and drawn.video is None]
    stage = Stage(standing, floor, images, seen_through, bool(shown), _towards_camera(drawn), drawn.apart)
    panels = recorded_panels(plots, span_of(drawn))
    stream.send_blueprint(stage.blueprint(panels))


def span_of(drawn: DrawnScene) -> tuple[float, float]:
    """Seconds from the first to the last that is drawn: of bodies, video frames, or single sensors."""
    times = [wearer.shown.time for wearer in drawn.wearers if wearer.shown is not None]
    if drawn.detections is not None and len(drawn.detections.time):
        times.append(drawn.detections.time)
    if drawn.one_alone:
        times += [np.array(wearer.recording.interval) for wearer in drawn.wearers if wearer.recording is not None]
    return min(float(time[0]) for time in times), max(float(time[-1]) for time in times)


def _towards_camera(drawn: DrawnScene) -> np.ndarray | None:
    """The horizontal direction to the camera, so that its picture shows the same side of people; None without one."""
    shown = [body for wearer in drawn.wearers if (body := wearer.shown or wearer.rest) is not None]
    if drawn.path is None or not shown:
        return None
    direction = (drawn.path.p_world_camera[0] - centre_path(shown)[1][0]) * [1, 1, 0]
    norm = float(np.linalg.norm(direction))
    return direction / norm if norm > 1e-6 else None


def _below(*parts: str) -> str:
    return "/".join([WORLD, *(rr.escape_entity_path_part(part) for part in parts)])


def _body_of(wearer: DrawnWearer) -> str:
    """The entity of the body as drawn in colour."""
    what = "estimate" if wearer.motion is not None else "truth" if wearer.truth is not None else "body"
    return _below(wearer.name, what)


def _log_wearer(
    stream: rr.RecordingStream, wearer: DrawnWearer, drawn: DrawnScene, floor: float, sensors: Mapping[str, Colour]
) -> None:
    motion = wearer.shown or wearer.rest
    if motion is None:
        return
    body = _body_of(wearer)
    colours = ESTIMATE_COLOURS if drawn.one_alone else body_colours(wearer.index)
    log_poses(stream, body, motion)
    log_skin(stream, body, cut_skin(motion.skeleton), colours)
    if wearer.rest is None:
        path = np.column_stack([motion.p_world_pelvis[:, :2], np.full(len(motion), floor)])
        log_trail(stream, _below(wearer.name, "path"), path, colours[Side.MIDDLE])
    if not drawn.one_alone:
        log_name(stream, body, wearer.name)
    if wearer.motion is not None and wearer.truth is not None:
        truth, entity = wearer.truth, _below(wearer.name, "truth")
        log_poses(stream, entity, truth)
        log_skin(stream, entity, cut_skin(truth.skeleton), GHOST_COLOURS, ghost=drawn.compare is not Compare.SIDE)
        path = np.column_stack([truth.p_world_pelvis[:, :2], np.full(len(truth), floor)])
        log_trail(stream, _below(wearer.name, "true_path"), path, GHOST_COLOUR)
    if wearer.recording is not None:
        true_calibration = wearer.recording.truth.calibration if wearer.recording.truth is not None else None
        calibration = wearer.estimate.calibration if wearer.estimate is not None else true_calibration
        log_sensors(stream, body, wearer.recording.placement, calibration, sensors)


def _log_camera(stream: rr.RecordingStream, drawn: DrawnScene) -> list[tuple[str, str, CameraModel]]:
    """Log the first camera and what it saw; returns title, entity and model of its image if there is one."""
    if drawn.model is None:
        return []
    camera = _below("camera") if drawn.path is not None else "/camera"  # outside the world where its place is unknown
    image = f"{camera}/image"
    if drawn.path is not None:
        log_camera(stream, camera, drawn.path, drawn.model)
        if len(drawn.path) > 1:
            log_trail(stream, _below("camera_path"), drawn.path.p_world_camera, FRUSTUM_COLOUR)
    else:
        log_pinhole(stream, image, drawn.model)
    if drawn.true_path is not None and drawn.path is not None:
        log_camera(stream, _below("true_camera"), drawn.true_path, drawn.model, TRUE_FRUSTUM_COLOUR)
        if len(drawn.true_path) > 1:
            log_trail(stream, _below("true_camera_path"), drawn.true_path.p_world_camera, GHOST_COLOUR)
    detections, labels = drawn.detections, drawn.labels
    if detections is None or labels is None:
        return []
    if drawn.video is not None:
        log_video(stream, image, drawn.video, detections.time)
    names = [wearer.name for wearer in drawn.wearers]
    log_image_style(stream, image, drawn.model, detections.keypoints, names)
    _log_bodies(stream, image, drawn, drawn)
    log_detections(stream, image, detections, labels, names)
    return [("Camera", image, drawn.model)]


def _log_further_camera(
    stream: rr.RecordingStream, camera: DrawnCamera, drawn: DrawnScene
) -> tuple[str, str, CameraModel]:
    """Log a camera beside the first, and bodies and detections in its image, whose title, entity and model return."""
    entity = _below("cameras", camera.name)
    image, names = f"{entity}/image", [wearer.name for wearer in drawn.wearers]
    log_camera(stream, entity, camera.path, camera.model)
    log_image_style(stream, image, camera.model, camera.detections.keypoints, names)
    _log_bodies(stream, image, camera, drawn)
    strangers = np.full(len(camera.detections), NOBODY)
    log_detections(stream, image, camera.detections, strangers, names)
    return camera.name, image, camera.model


def _log_bodies(stream: rr.RecordingStream, image: str, camera: DrawnScene | DrawnCamera, drawn: DrawnScene) -> None:
    """Log the bodies as a camera should have seen them."""
    detections = camera.detections
    entities = people_below(image, "body", [wearer.name for wearer in drawn.wearers])
    for wearer, entity in zip(drawn.wearers, entities, strict=False):
        pixels = camera.reprojected(wearer)
        if pixels is not None and detections is not None:
            log_projection(stream, entity, detections.time, pixels, detections.keypoints)
