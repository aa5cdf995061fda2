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
from vip_factors.viz.drawn_scene import DrawnCamera, DrawnScene, DrawnWearer, floor_height
from vip_factors.viz.rerun_body import (
    FRUSTUM_COLOUR,
    GHOST_COLOURS,
    WORLD,
    BodyLog,
    log_camera,
    log_detections,
    log_image_style,
    log_name,
    log_pinhole,
    log_projection,
    log_sensors,
    log_trail,
    log_video,
    people_below,
)
from vip_factors.viz.rerun_layout import (
    SUMMARY,
    Stage,
    centre_path,
    horizontal,
    log_centre,
    log_series,
    recorded_panels,
    scene_summary,
    sensor_colours_of,
)
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
    bodies = [body for wearer in drawn.wearers if (body := wearer.truth or wearer.shown or wearer.rest) is not None]
    has_frames = any(camera.detections is not None and len(camera.detections.time) for camera in drawn.cameras)
    if not bodies and not has_frames:
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
    images = [image for camera in drawn.cameras if (image := _log_camera(stream, camera, drawn)) is not None]
    plots = log_series(stream, drawn, colours)
    text = rr.TextDocument(scene_summary(drawn), media_type=rr.MediaType.MARKDOWN)
    stream.log(SUMMARY, text, static=True)
    standing = [body for wearer in drawn.wearers if (body := wearer.shown or wearer.rest) is not None]
    has_video = any(camera.video is not None for camera in drawn.cameras)
    seen_through = [_body_of(wearer) for wearer in drawn.wearers if wearer.shown is not None and not has_video]
    # The picture of the first camera of known path shows the same side of people as the eye.
    path = next((camera.path for camera in drawn.cameras if camera.path is not None), None)
    ahead = None
    if path is not None and standing:
        ahead = horizontal(path.p_world_camera[0] - centre_path(standing)[1][0])
    stage = Stage(standing, floor, images, seen_through, bool(shown), ahead, drawn.apart)
    panels = recorded_panels(plots, span_of(drawn))
    stream.send_blueprint(stage.blueprint(panels))


def span_of(drawn: DrawnScene) -> tuple[float, float]:
    """Seconds from the first to the last that is drawn: of bodies, video frames, or single sensors."""
    times = [wearer.shown.time for wearer in drawn.wearers if wearer.shown is not None]
    detections = [camera.detections for camera in drawn.cameras if camera.detections is not None]
    times += [film.time for film in detections if len(film.time)]
    if drawn.one_alone:
        times += [np.array(wearer.recording.interval) for wearer in drawn.wearers if wearer.recording is not None]
    return min(float(time[0]) for time in times), max(float(time[-1]) for time in times)


def _below(*names: str) -> str:
    return "/".join([WORLD, *(rr.escape_entity_path_part(name) for name in names)])


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
    BodyLog(stream, body).log(motion, colours)
    if wearer.rest is None:
        path = np.column_stack([motion.p_world_pelvis[:, :2], np.full(len(motion), floor)])
        log_trail(stream, _below(wearer.name, "path"), path, colours[Side.MIDDLE])
    if not drawn.one_alone:
        log_name(stream, body, wearer.name)
    if wearer.motion is not None and wearer.truth is not None:
        truth, entity = wearer.truth, _below(wearer.name, "truth")
        BodyLog(stream, entity, ghost=True).log(truth, GHOST_COLOURS)
        path = np.column_stack([truth.p_world_pelvis[:, :2], np.full(len(truth), floor)])
        log_trail(stream, _below(wearer.name, "true_path"), path, GHOST_COLOUR)
    if wearer.recording is not None:
        true_calibration = wearer.recording.truth.calibration if wearer.recording.truth is not None else None
        calibration = wearer.estimate.calibration if wearer.estimate is not None else true_calibration
        log_sensors(stream, body, wearer.recording.placement, calibration, sensors)


def _log_camera(
    stream: rr.RecordingStream, camera: DrawnCamera, drawn: DrawnScene
) -> tuple[str, str, CameraModel] | None:
    """Log a camera, what it saw, and bodies as it should have seen them; returns title, entity and model of its image
    if there is one.
    """
    is_alone = len(drawn.cameras) == 1
    where = "camera" if is_alone else f"cameras/{rr.escape_entity_path_part(camera.name)}"
    entity = f"{WORLD}/{where}"
    if camera.path is None:
        entity = f"/{where}"  # outside the world: its place is unknown
        log_pinhole(stream, f"{entity}/image", camera.model)
    paths = (
        (entity, camera.path, FRUSTUM_COLOUR, FRUSTUM_COLOUR),
        (f"{WORLD}/true_{where}", camera.true_path, TRUE_FRUSTUM_COLOUR, GHOST_COLOUR),
    )
    for where, path, frustum, trail in paths:
        if path is not None:
            log_camera(stream, where, path, camera.model, frustum)
            if len(path) > 1:
                log_trail(stream, f"{where}_path", path.p_world_camera, trail)
    detections, image = camera.detections, f"{entity}/image"
    if detections is None or camera.labels is None:
        return None
    if camera.video is not None:
        log_video(stream, image, camera.video, detections.time)
    log_image_style(stream, image, camera.model, detections.keypoints, drawn.names)
    for wearer, body in zip(drawn.wearers, people_below(image, "body", drawn.names), strict=False):
        pixels = camera.reprojected(wearer)
        if pixels is not None:
            log_projection(stream, body, detections.time, pixels, detections.keypoints)
    log_detections(stream, image, detections, camera.labels, drawn.names)
    return "Camera" if is_alone else camera.name, image, camera.model
