"""A scene in Rerun: camera and image, who was assigned to what, all wearers in one world, headings, errors."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr

from vip_factors.body.mannequin import TRUTH_COLOUR, Colour, Side
from vip_factors.errors import InputError
from vip_factors.estimate import SceneEstimate
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.scene import Scene
from vip_factors.viz.compare import floor_height
from vip_factors.viz.rerun_body import log_body, log_sensors, log_trail
from vip_factors.viz.rerun_camera import CAMERA_COLOUR, log_camera, log_camera_trail, log_true_camera
from vip_factors.viz.rerun_image import log_image_border, log_people, log_video
from vip_factors.viz.rerun_scene_series import log_scene_series
from vip_factors.viz.rerun_view import LiveViewer, Sink, send
from vip_factors.viz.scene_layout import scene_blueprint
from vip_factors.viz.scene_summary import scene_summary
from vip_factors.viz.scene_world import NOBODY, DrawnCamera, DrawnScene, DrawnWearer, drawn_scene
from vip_factors.viz.wearer_colours import UNCLAIMED, body_colours, wearer_colour

IMAGE = "world/camera/image"
NAME_ABOVE_HEAD_M = 0.32  # in the head's frame, above its joint: clear of the crown


def show_scene(
    scene: Scene | None = None, estimate: SceneEstimate | None = None, sink: Sink | None = None, *, metrics: str = ""
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
        if drawn.detections is None and all(wearer.shown is None for wearer in drawn.wearers):
            raise InputError(f"scene '{drawn.name}' has no camera, no truth and no estimate: nothing to show")
        stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        bodies = [wearer.truth or wearer.shown for wearer in drawn.wearers]
        floor = min((floor_height(body) for body in bodies if body is not None), default=0.0)
        for wearer in drawn.wearers:
            _log_wearer(stream, wearer, floor)
        _log_world_camera(stream, drawn)
        _log_image(stream, drawn)
        images = {"Camera": IMAGE}
        for camera in drawn.further:
            images[camera.name] = _log_further_camera(stream, camera, drawn)
        plots = log_scene_series(stream, drawn)
        text = scene_summary(drawn, self.metrics)
        stream.log("summary", rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=True)
        stream.send_recording_name(drawn.name)
        stream.send_blueprint(scene_blueprint(drawn, images, floor, plots))


def _log_wearer(stream: rr.RecordingStream, wearer: DrawnWearer, floor: float) -> None:
    if wearer.shown is None:
        return
    below = f"world/{rr.escape_entity_path_part(wearer.name)}"
    colours = body_colours(wearer.index)
    body = f"{below}/estimate" if wearer.motion is not None else f"{below}/truth"
    log_body(stream, body, wearer.shown, colours)
    log_trail(stream, f"{below}/path", wearer.shown, floor, colours[Side.MIDDLE])
    name = rr.Points3D(
        [[0.0, NAME_ABOVE_HEAD_M, 0.0]], labels=[wearer.name], radii=0.004, colors=[wearer_colour(wearer.index)]
    )
    stream.log(f"{body}/head/name", name, static=True)
    if wearer.motion is not None and wearer.truth is not None:
        log_body(stream, f"{below}/truth", wearer.truth, dict.fromkeys(Side, TRUTH_COLOUR), ghost=True)
        log_trail(stream, f"{below}/true_path", wearer.truth, floor, TRUTH_COLOUR)
    if wearer.recording is not None:
        known = wearer.recording.truth.calibration if wearer.recording.truth is not None else None
        calibration = wearer.estimate.calibration if wearer.estimate is not None else known
        log_sensors(stream, body, wearer.recording.placement, calibration)


def _log_world_camera(stream: rr.RecordingStream, drawn: DrawnScene) -> None:
    if drawn.model is None:
        return
    if drawn.path is None:  # nobody knows where it was: its image is still worth looking at
        pinhole = rr.Pinhole(image_from_camera=drawn.model.K, resolution=[drawn.model.width, drawn.model.height])
        stream.log(IMAGE, pinhole, static=True)
        return
    log_camera(stream, "world/camera", drawn.path, drawn.model)
    log_camera_trail(stream, "world/camera_path", drawn.path, CAMERA_COLOUR)
    if drawn.true_path is not None:
        log_true_camera(stream, "world/true_camera", drawn.true_path, drawn.model)
        log_camera_trail(stream, "world/true_camera_path", drawn.true_path, TRUTH_COLOUR)


def _log_image(stream: rr.RecordingStream, drawn: DrawnScene) -> None:
    """Detections as fine lines with dots, the projected bodies as broad lines beneath them."""
    detections, labels = drawn.detections, drawn.labels
    if detections is None or labels is None:
        return
    if drawn.video is not None:
        log_video(stream, IMAGE, drawn.video, detections.time)
    if drawn.model is not None:
        log_image_border(stream, f"{IMAGE}/border", drawn.model)
    _log_bodies(stream, IMAGE, drawn, detections, drawn.wearers)
    for index in range(NOBODY, len(drawn.wearers)):
        chosen = labels == index
        if not np.any(chosen):
            continue
        name = drawn.wearers[index].name if index >= 0 else "nobody's"
        colour = UNCLAIMED if index < 0 else _pale(index)
        _log_detected(stream, f"{IMAGE}/detected/{rr.escape_entity_path_part(name)}", detections.select(chosen), colour)


def _log_further_camera(stream: rr.RecordingStream, camera: DrawnCamera, drawn: DrawnScene) -> str:
    """A camera beside the first: its frustum, and bodies and detections in its image, whose entity is returned."""
    entity = f"world/cameras/{rr.escape_entity_path_part(camera.name)}"
    log_camera(stream, entity, camera.path, camera.model)
    image = f"{entity}/image"
    log_image_border(stream, f"{image}/border", camera.model)
    _log_bodies(stream, image, camera, camera.detections, drawn.wearers)
    _log_detected(stream, f"{image}/detected", camera.detections, UNCLAIMED)
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


def _log_detected(stream: rr.RecordingStream, entity: str, detections: Detections, colour: Colour) -> None:
    seen = np.where(detections.seen[..., None], detections.pixels, np.nan)
    log_people(
        stream, entity, detections.time, detections.frame, seen, detections.keypoints, colour, line=0.8, dot=2.6,
        order=20.0,
    )  # fmt: skip


def _pale(index: int) -> tuple[int, int, int]:
    red, green, blue = wearer_colour(index)
    return (red + 255) // 2, (green + 255) // 2, (blue + 255) // 2
