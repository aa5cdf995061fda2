"""Curves of a scene in Rerun: reprojection and joint errors by wearer, the camera's error, headings over time."""

from collections.abc import Mapping

import numpy as np
import rerun as rr

from vip_factors.body.mannequin import Colour
from vip_factors.geometry.rotations import angle_between
from vip_factors.viz.charts import headings_image
from vip_factors.viz.colours import wearer_colour
from vip_factors.viz.drawn_scene import DrawnScene
from vip_factors.viz.headings import heading_paths, implied_headings
from vip_factors.viz.rerun_camera import CAMERA_COLOUR
from vip_factors.viz.rerun_series import log_curve

HEADINGS_IMAGE = "charts/headings"


def log_scene_series(stream: rr.RecordingStream, drawn: DrawnScene, colours: Mapping[str, Colour]) -> dict[str, str]:
    """Log all curves that can be drawn below ``plots/``; returns their entities and titles, the main ones first.

    ``colours`` are the sensors'.
    """
    found: dict[str, str] = {}
    for wearer in drawn.wearers:
        part, colour = rr.escape_entity_path_part(wearer.name), wearer_colour(wearer.index)
        pixels = drawn.reprojection_px(wearer) if drawn.estimate is not None else None
        if pixels is not None and drawn.detections is not None:
            entity = f"plots/reprojection_px/{part}"
            log_curve(stream, entity, drawn.detections.time, pixels, colour, wearer.name, gaps=True)
            found["plots/reprojection_px"] = "Reprojection error (px)"
        if wearer.error_mm is not None and wearer.motion is not None:
            log_curve(stream, f"plots/joint_error_mm/{part}", wearer.motion.time, wearer.error_mm, colour, wearer.name)
            found["plots/joint_error_mm"] = "Joint error (mm)"
    _log_camera_error(stream, drawn, found)
    _log_headings(stream, drawn, found, colours)
    picture = headings_image(drawn)
    if picture is not None:
        stream.log(HEADINGS_IMAGE, rr.EncodedImage(contents=picture, media_type="image/png"), static=True)
    return found


def _log_camera_error(stream: rr.RecordingStream, drawn: DrawnScene, found: dict[str, str]) -> None:
    if drawn.path is None or drawn.true_path is None:
        return
    time = drawn.path.time if len(drawn.path) > 1 else drawn.true_path.time
    one, other = drawn.path.at(time), drawn.true_path.at(time)
    metres = np.linalg.norm(one.p_world_camera - other.p_world_camera, axis=1)
    degrees = np.rad2deg(angle_between(one.R_world_camera, other.R_world_camera))
    log_curve(stream, "plots/camera_error/cm", time, 100 * metres, CAMERA_COLOUR, "position (cm)")
    log_curve(stream, "plots/camera_error/degrees", time, degrees, (120, 170, 240), "rotation (°)")
    found["plots/camera_error"] = "Camera error (cm, °)"


def _log_headings(
    stream: rr.RecordingStream, drawn: DrawnScene, found: dict[str, str], colours: Mapping[str, Colour]
) -> None:
    for wearer in drawn.wearers:
        implied = implied_headings(wearer)
        if implied is None or not implied[1]:
            continue
        part = rr.escape_entity_path_part(wearer.name)
        for sensor, degrees in implied[1].items():
            entity = f"plots/heading/{part}/{rr.escape_entity_path_part(sensor)}"
            log_curve(stream, entity, implied[0], degrees, colours[sensor], sensor, gaps=True)
        for sensor, (time, degrees) in heading_paths(wearer).items():
            entity = f"plots/heading/{part}/{rr.escape_entity_path_part(f'{sensor}_estimated')}"
            log_curve(stream, entity, time, degrees, colours.get(sensor, (120, 120, 120)), f"{sensor}, estimated")
        found[f"plots/heading/{part}"] = f"Heading over time, {wearer.name} (° off the estimate)"
