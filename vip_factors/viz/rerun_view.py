"""Recordings, estimates and their truth in Rerun: wearers and cameras of any number, in one world.

Everything goes in as columns, so that minutes of motion are logged in seconds.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import rerun as rr

from vip_factors.atomic import atomic_path
from vip_factors.body.mannequin import ESTIMATE_COLOURS, Colour, Side
from vip_factors.errors import InputError
from vip_factors.sensors.detections import Detections
from vip_factors.viz.colours import GHOST_COLOUR, body_colours
from vip_factors.viz.compare import Compare, floor_height
from vip_factors.viz.drawn_scene import NOBODY, DrawnCamera, DrawnScene, DrawnWearer
from vip_factors.viz.rerun_body import log_body, log_joint_names, log_joints, log_joints_style, log_sensors, log_trail
from vip_factors.viz.rerun_camera import (
    FRUSTUM_COLOUR,
    NOBODYS,
    body_in,
    detected_in,
    log_camera,
    log_camera_trail,
    log_image_style,
    log_people,
    log_true_camera,
    log_video,
)
from vip_factors.viz.rerun_layout import CENTRE, centre_path, log_centre, scene_blueprint
from vip_factors.viz.rerun_series import colours_of, log_legend, log_series
from vip_factors.viz.summaries import scene_summary
from vip_factors.viz.viewer import check_display, complete, quiet, rerun_command

APPLICATION = "vip_factors"
IMAGE = "world/camera/image"
NAME_COLOUR: Colour = (16, 18, 22)  # on the grey that Rerun puts behind labels
NAME_ABOVE_HEAD_M = 0.32  # in the head's frame, above its joint: clear of the crown


def show(drawn: DrawnScene, save: Path | None = None, overwrite: bool = False) -> None:
    """Show what is drawn, in Rerun.

    Args:
        drawn: a wearer (:func:`~vip_factors.viz.drawn_scene.drawn_wearer`) or a scene.
        save: ``.rrd`` file, written whole or not at all; without one the viewer is opened, in its own process.
        overwrite: replace an existing file.

    Raises:
        InputError: if there is nothing to show, the file exists, or there is no display for the viewer.
        OSError: if the file cannot be written.
    """
    if save is not None:
        with atomic_path(save, overwrite) as partial:
            stream = rr.RecordingStream(APPLICATION)
            stream.save(partial)
            _log(stream, drawn)
            complete(stream, partial, save)
        return
    check_display("a file (save) instead of the live viewer")
    stream = rr.RecordingStream(APPLICATION)
    with quiet():
        rr.spawn(executable_path=rerun_command(), recording=stream)
    _log(stream, drawn)
    stream.flush()


def _log(stream: rr.RecordingStream, drawn: DrawnScene) -> None:
    """Log everything and the layout."""
    filmed = drawn.detections is not None and len(drawn.detections.time) > 0
    bodies = [body for one in drawn.wearers if (body := one.truth or one.shown or one.rest) is not None]
    if not filmed and not bodies:
        raise InputError(
            f"scene '{drawn.name}' has no camera with video frames, no truth and no estimate: nothing to show"
        )
    stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    floor = min((floor_height(body) for body in bodies), default=0.0)
    colours = colours_of([one.recording for one in drawn.wearers], [one.estimate for one in drawn.wearers])
    log_joint_names(stream, "world", [wearer.name for wearer in drawn.wearers])
    for wearer in drawn.wearers:
        _log_wearer(stream, wearer, drawn, floor, colours)
    shown = [wearer.shown for wearer in drawn.wearers if wearer.shown is not None]
    if shown:
        log_centre(stream, *centre_path(shown))
    _log_world_camera(stream, drawn)
    _log_image(stream, drawn)
    images = {"Camera": IMAGE}
    for camera in drawn.further:
        images[camera.name] = _log_further_camera(stream, camera, drawn)
    plots = log_series(stream, drawn, colours)
    legend = log_legend(stream, colours)
    text = rr.TextDocument(scene_summary(drawn), media_type=rr.MediaType.MARKDOWN)
    stream.log("summary", text, static=True)
    stream.send_recording_name(drawn.name)
    entities = [_body_of(wearer) for wearer in drawn.wearers if wearer.shown is not None]
    follow = CENTRE if shown else None
    stream.send_blueprint(scene_blueprint(drawn, images, floor, plots, follow, legend, entities))


def _body_of(wearer: DrawnWearer) -> str:
    """The entity of the body as drawn in colour."""
    what = "estimate" if wearer.motion is not None else "truth" if wearer.truth is not None else "body"
    return f"world/{rr.escape_entity_path_part(wearer.name)}/{what}"


def _log_wearer(
    stream: rr.RecordingStream, wearer: DrawnWearer, view: DrawnScene, floor: float, sensors: Mapping[str, Colour]
) -> None:
    shown = wearer.shown or wearer.rest
    if shown is None:
        return
    below, body = f"world/{rr.escape_entity_path_part(wearer.name)}", _body_of(wearer)
    colours = ESTIMATE_COLOURS if view.one_alone else body_colours(wearer.index)
    log_body(stream, body, shown, colours)
    if wearer.rest is None:
        log_joints_style(stream, f"{body}/joints", wearer.index)
        log_joints(stream, f"{body}/joints", shown)
        log_trail(stream, f"{below}/path", shown, floor, colours[Side.MIDDLE])
    if not view.one_alone:
        name = rr.Points3D([[0.0, NAME_ABOVE_HEAD_M, 0.0]], labels=[wearer.name], radii=0.004, colors=[NAME_COLOUR])
        stream.log(f"{body}/head/name", name, static=True)
    if wearer.motion is not None and wearer.truth is not None:
        ghost = view.compare is not Compare.SIDE
        log_body(stream, f"{below}/truth", wearer.truth, dict.fromkeys(Side, GHOST_COLOUR), ghost=ghost)
        log_trail(stream, f"{below}/true_path", wearer.truth, floor, GHOST_COLOUR)
    if wearer.recording is not None:
        known = wearer.recording.truth.calibration if wearer.recording.truth is not None else None
        calibration = wearer.estimate.calibration if wearer.estimate is not None else known
        log_sensors(stream, body, wearer.recording.placement, calibration, sensors)


def _log_world_camera(stream: rr.RecordingStream, drawn: DrawnScene) -> None:
    if drawn.model is None:
        return
    if drawn.path is None:  # nobody knows where it was: its image is still worth looking at
        pinhole = rr.Pinhole(image_from_camera=drawn.model.K, resolution=[drawn.model.width, drawn.model.height])
        stream.log(IMAGE, pinhole, static=True)
        return
    log_camera(stream, "world/camera", drawn.path, drawn.model)
    log_camera_trail(stream, "world/camera_path", drawn.path, FRUSTUM_COLOUR)
    if drawn.true_path is not None:
        log_true_camera(stream, "world/true_camera", drawn.true_path, drawn.model)
        log_camera_trail(stream, "world/true_camera_path", drawn.true_path, GHOST_COLOUR)


def _log_image(stream: rr.RecordingStream, drawn: DrawnScene) -> None:
    """What the first camera saw, whose it was, and the bodies as it should have seen them."""
    detections, labels = drawn.detections, drawn.labels
    if detections is None or labels is None or drawn.model is None:
        return
    if drawn.video is not None:
        log_video(stream, IMAGE, drawn.video, detections.time)
    names = [wearer.name for wearer in drawn.wearers]
    log_image_style(stream, IMAGE, drawn.model, detections.keypoints, names)
    _log_bodies(stream, IMAGE, drawn, detections, drawn.wearers)
    for index, name in enumerate([*names, NOBODYS]):
        mine = index < len(names)
        chosen = labels == (index if mine else NOBODY)
        if np.any(chosen):
            _log_detected(stream, detected_in(IMAGE, name), detections.select(chosen), lines=not mine)


def _log_further_camera(stream: rr.RecordingStream, camera: DrawnCamera, drawn: DrawnScene) -> str:
    """A camera beside the first: its frustum, and bodies and detections in its image, whose entity is returned."""
    entity = f"world/cameras/{rr.escape_entity_path_part(camera.name)}"
    log_camera(stream, entity, camera.path, camera.model)
    image, names = f"{entity}/image", [wearer.name for wearer in drawn.wearers]
    log_image_style(stream, image, camera.model, camera.detections.keypoints, names)
    _log_bodies(stream, image, camera, camera.detections, drawn.wearers)
    _log_detected(stream, detected_in(image, NOBODYS), camera.detections, lines=True)
    return image


def _log_bodies(
    stream: rr.RecordingStream, image: str, camera: DrawnScene | DrawnCamera, detections: Detections,
    wearers: Sequence[DrawnWearer],
) -> None:  # fmt: skip
    frames = np.arange(len(detections.time))
    for wearer in wearers:
        pixels = camera.reprojected(wearer)
        if pixels is not None:
            entity = body_in(image, wearer.name)
            log_people(stream, entity, detections.time, frames, pixels, detections.keypoints, dots=False)


def _log_detected(stream: rr.RecordingStream, entity: str, detections: Detections, lines: bool) -> None:
    seen = np.where(detections.seen[..., None], detections.pixels, np.nan)
    log_people(stream, entity, detections.time, detections.frame, seen, detections.keypoints, lines=lines)
