"""A scene in Rerun: camera and image, who was assigned to what, all wearers in one world, headings, errors."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr

from vip_factors.body.mannequin import Colour, Side
from vip_factors.errors import InputError
from vip_factors.estimate import Estimate
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.scene import Scene
from vip_factors.viz.colours import GHOST_COLOUR, UNCLAIMED, body_colours, sensor_colours, wearer_colour
from vip_factors.viz.compare import floor_height
from vip_factors.viz.drawn_scene import NOBODY, DrawnCamera, DrawnScene, DrawnWearer, drawn_scene
from vip_factors.viz.rerun_body import (
    class_of,
    log_body,
    log_joint_names,
    log_joints,
    log_joints_style,
    log_keypoint_names,
    log_sensors,
    log_trail,
    pale_colour,
)
from vip_factors.viz.rerun_camera import (
    FRUSTUM_COLOUR,
    log_camera,
    log_camera_trail,
    log_image_border,
    log_people,
    log_true_camera,
    log_video,
)
from vip_factors.viz.rerun_eye import CENTRE, centre_path, log_centre
from vip_factors.viz.rerun_scene_series import log_scene_series
from vip_factors.viz.rerun_series import log_legend
from vip_factors.viz.rerun_view import LiveViewer, Sink, send
from vip_factors.viz.scene_layout import scene_blueprint
from vip_factors.viz.scene_summary import scene_summary

IMAGE = "world/camera/image"
NAME_COLOUR: Colour = (16, 18, 22)  # on the grey that Rerun puts behind labels
NAME_ABOVE_HEAD_M = 0.32  # in the head's frame, above its joint: clear of the crown


def show_scene(
    scene: Scene | None = None, estimate: Estimate | None = None, sink: Sink | None = None, *, metrics: str = ""
) -> None:
    """Show what is given, in Rerun; the estimate in the truth's world where that is known.

    Args:
        scene: camera, detections, sensors and truth.
        estimate: bodies in their wearers' colours, camera, and who was assigned to what.
        sink: a file or a live viewer (the default).
        metrics: more text for the panel (Markdown).

    Raises:
        InputError: if there is nothing to show, the two do not belong together, or the file exists.
        OSError: if the file cannot be written.
    """
    send(_SceneView(drawn_scene(scene, estimate), metrics), sink or LiveViewer())


@dataclass(frozen=True)
class _SceneView:
    drawn: DrawnScene
    metrics: str

    def log(self, stream: rr.RecordingStream) -> None:
        """Log everything and the layout."""
        drawn = self.drawn
        filmed = drawn.detections is not None and len(drawn.detections.time) > 0
        if not filmed and all(wearer.shown is None for wearer in drawn.wearers):
            raise InputError(
                f"scene '{drawn.name}' has no camera with video frames, no truth and no estimate: nothing to show"
            )
        stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        bodies = [wearer.truth or wearer.shown for wearer in drawn.wearers]
        floor = min((floor_height(body) for body in bodies if body is not None), default=0.0)
        colours = _sensor_colours(drawn)
        log_joint_names(stream, "world", [wearer.name for wearer in drawn.wearers])
        for wearer in drawn.wearers:
            _log_wearer(stream, wearer, floor, colours)
        entities = [_body_of(wearer) for wearer in drawn.wearers if wearer.shown is not None]
        follow = _log_centre(stream, drawn)
        _log_world_camera(stream, drawn)
        _log_image(stream, drawn)
        images = {"Camera": IMAGE}
        for camera in drawn.further:
            images[camera.name] = _log_further_camera(stream, camera, drawn)
        plots = log_scene_series(stream, drawn, colours)
        legend = log_legend(stream, colours)
        text = scene_summary(drawn, self.metrics)
        stream.log("summary", rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=True)
        stream.send_recording_name(drawn.name)
        stream.send_blueprint(scene_blueprint(drawn, images, floor, plots, follow, legend, entities))


def _sensor_colours(drawn: DrawnScene) -> dict[str, Colour]:
    """One colour for sensors of the same name, whoever wears them."""
    names: list[str] = []
    for wearer in drawn.wearers:
        if wearer.recording is not None:
            names += [site.sensor for site in wearer.recording.placement.sites]
        elif wearer.estimate is not None:
            names += wearer.estimate.calibration
    return sensor_colours(list(dict.fromkeys(names)))


def _log_centre(stream: rr.RecordingStream, drawn: DrawnScene) -> str | None:
    """Log the point between the wearers, which the eye follows; returns its entity."""
    shown = [wearer.shown for wearer in drawn.wearers if wearer.shown is not None]
    if not shown:
        return None
    log_centre(stream, *centre_path(shown))
    return CENTRE


def _body_of(wearer: DrawnWearer) -> str:
    """The entity of the body as drawn in colour."""
    return f"world/{rr.escape_entity_path_part(wearer.name)}/{'estimate' if wearer.motion is not None else 'truth'}"


def _log_wearer(stream: rr.RecordingStream, wearer: DrawnWearer, floor: float, sensors: dict[str, Colour]) -> None:
    if wearer.shown is None:
        return
    below = f"world/{rr.escape_entity_path_part(wearer.name)}"
    colours = body_colours(wearer.index)
    body = _body_of(wearer)
    log_body(stream, body, wearer.shown, colours)
    log_joints_style(stream, f"{body}/joints", wearer.index)
    log_joints(stream, f"{body}/joints", wearer.shown)
    log_trail(stream, f"{below}/path", wearer.shown, floor, colours[Side.MIDDLE])
    name = rr.Points3D([[0.0, NAME_ABOVE_HEAD_M, 0.0]], labels=[wearer.name], radii=0.004, colors=[NAME_COLOUR])
    stream.log(f"{body}/head/name", name, static=True)
    if wearer.motion is not None and wearer.truth is not None:
        log_body(stream, f"{below}/truth", wearer.truth, dict.fromkeys(Side, GHOST_COLOUR), ghost=True)
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
    """Detections as fine lines with dots, the projected bodies as broad lines beneath them."""
    detections, labels = drawn.detections, drawn.labels
    if detections is None or labels is None:
        return
    if drawn.video is not None:
        log_video(stream, IMAGE, drawn.video, detections.time)
    if drawn.model is not None:
        log_image_border(stream, f"{IMAGE}/border", drawn.model)
    log_keypoint_names(stream, IMAGE, detections.keypoints, [wearer.name for wearer in drawn.wearers])
    _log_bodies(stream, IMAGE, drawn, detections, drawn.wearers)
    for index in range(NOBODY, len(drawn.wearers)):
        chosen = labels == index
        if np.any(chosen):
            name = drawn.wearers[index].name if index >= 0 else "nobody's"
            entity = f"{IMAGE}/detected/{rr.escape_entity_path_part(name)}"
            _log_detected(stream, entity, detections.select(chosen), index)


def _log_further_camera(stream: rr.RecordingStream, camera: DrawnCamera, drawn: DrawnScene) -> str:
    """A camera beside the first: its frustum, and bodies and detections in its image, whose entity is returned."""
    entity = f"world/cameras/{rr.escape_entity_path_part(camera.name)}"
    log_camera(stream, entity, camera.path, camera.model)
    image = f"{entity}/image"
    log_image_border(stream, f"{image}/border", camera.model)
    _log_bodies(stream, image, camera, camera.detections, drawn.wearers)
    log_keypoint_names(stream, image, camera.detections.keypoints, ())
    _log_detected(stream, f"{image}/detected", camera.detections, NOBODY)
    return image


def _log_bodies(
    stream: rr.RecordingStream, image: str, camera: DrawnScene | DrawnCamera, detections: Detections,
    wearers: Sequence[DrawnWearer],
) -> None:  # fmt: skip
    frames = np.arange(len(detections.time))
    for wearer in wearers:
        pixels = camera.reprojected(wearer)
        if pixels is not None:
            log_people(
                stream, f"{image}/body/{rr.escape_entity_path_part(wearer.name)}", detections.time, frames, pixels,
                detections.keypoints, wearer_colour(wearer.index), line=2.6, dot=0.0, order=10.0,
            )  # fmt: skip


def _log_detected(stream: rr.RecordingStream, entity: str, detections: Detections, index: int) -> None:
    """Those of a wearer, whose links Rerun draws, or of −1, nobody: several people in a frame, linked here."""
    seen = np.where(detections.seen[..., None], detections.pixels, np.nan)
    colour = UNCLAIMED if index < 0 else pale_colour(index)
    log_people(
        stream, entity, detections.time, detections.frame, seen, detections.keypoints, colour,
        line=0.8 if index < 0 else 0.0, dot=2.6, order=20.0, names=class_of(index),
    )  # fmt: skip
