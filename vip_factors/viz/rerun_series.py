"""Curves in Rerun: errors, residuals, headings, what sensors measured, and how sure a stream is of them."""

from collections.abc import Iterable, Mapping

import numpy as np
import rerun as rr

from vip_factors.body.mannequin import Colour
from vip_factors.estimate import WearerEstimate
from vip_factors.geometry.rotations import Array, angle_between
from vip_factors.live_estimate import LiveEstimate, LiveWearerEstimate
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene
from vip_factors.viz.colours import sensor_colours, wearer_colour
from vip_factors.viz.drawn_scene import DrawnScene, DrawnWearer, heading_paths, implied_headings
from vip_factors.viz.rerun_body import time_column
from vip_factors.viz.rerun_camera import CAMERA_COLOUR

LEGEND, HEADINGS_IMAGE = "legend/sensors", "charts/headings"


def log_legend(stream: rr.RecordingStream, colours: Mapping[str, Colour]) -> bool:
    """Log the legend of the sensors' colours for ever; returns whether there is any sensor to tell of."""
    if colours:
        from vip_factors.viz.charts import colour_legend, png

        picture = rr.EncodedImage(contents=png(colour_legend(colours)), media_type="image/png")
        stream.log(LEGEND, picture, static=True)
    return bool(colours)


def log_curve(
    stream: rr.RecordingStream, entity: str, time: Array, values: Array, colour: Colour, name: str, gaps: bool = False
) -> None:
    """Log one curve; over values that are not finite it is drawn through, or with ``gaps`` interrupted."""
    stream.log(entity, rr.SeriesLines(colors=[colour], names=[name], widths=[1.5]), static=True)
    log_points(stream, entity, time, values, gaps)


def log_points(stream: rr.RecordingStream, entity: str, time: Array, values: Array, gaps: bool = False) -> None:
    """Log more points of a curve."""
    good = np.isfinite(values)
    if np.any(good):
        time, values = (time, values) if gaps else (time[good], values[good])
        stream.send_columns(entity, indexes=[time_column(time)], columns=rr.Scalars.columns(scalars=values))


KIND_TITLES = {
    "joint_error_mm": "Joint error (mm)",
    "orientation_deg": "Orientation residual (°)",
    "acceleration_m_s2": "Acceleration residual (m/s²)",
    "specific_force_m_s2": "Specific force (m/s²)",
    "angular_rate_rad_s": "Angular rate (rad/s)",
}


def _log_sensors(stream: rr.RecordingStream, wearer: DrawnWearer, colours: Mapping[str, Colour]) -> dict[str, str]:
    """Log residuals of every kind and sensor, and norms of what was measured; returns entities and titles."""
    titles: dict[str, str] = {}
    estimate, recording = wearer.estimate, wearer.recording
    for kind, values in estimate.residuals.items() if estimate is not None else ():
        for sensor, column in zip(estimate.sensors if estimate is not None else (), values.T, strict=True):
            assert estimate is not None
            entity = f"plots/residual/{kind}/{rr.escape_entity_path_part(sensor)}"
            log_curve(stream, entity, estimate.motion.time, column, colours[sensor], sensor)
        titles[f"plots/residual/{kind}"] = KIND_TITLES.get(kind, kind)
    for sensor, imu in recording.imus.items() if recording is not None else ():
        for kind, measured in (("specific_force_m_s2", imu.specific_force), ("angular_rate_rad_s", imu.angular_rate)):
            if measured is not None:
                entity = f"plots/imu/{kind}/{rr.escape_entity_path_part(sensor)}"
                log_curve(stream, entity, imu.time, np.linalg.norm(measured, axis=1), colours[sensor], sensor)
                titles[f"plots/imu/{kind}"] = KIND_TITLES[kind]
    return titles


def log_series(stream: rr.RecordingStream, drawn: DrawnScene, colours: Mapping[str, Colour]) -> dict[str, str]:
    """Log all curves that can be drawn below ``plots/``; returns their entities and titles, the main ones first.

    ``colours`` are the sensors'.
    """
    titles: dict[str, str] = {}
    for wearer in drawn.wearers:
        part, colour = rr.escape_entity_path_part(wearer.name), wearer_colour(wearer.index)
        pixels = drawn.reprojection_px(wearer) if drawn.estimate is not None else None
        if pixels is not None and drawn.detections is not None:
            entity = f"plots/reprojection_px/{part}"
            log_curve(stream, entity, drawn.detections.time, pixels, colour, wearer.name, gaps=True)
            titles["plots/reprojection_px"] = "Reprojection error (px)"
        if wearer.error_mm is not None and wearer.motion is not None:
            log_curve(stream, f"plots/joint_error_mm/{part}", wearer.motion.time, wearer.error_mm, colour, wearer.name)
            titles["plots/joint_error_mm"] = KIND_TITLES["joint_error_mm"]
        if drawn.one_alone:
            titles |= _log_sensors(stream, wearer, colours)
    _log_camera_error(stream, drawn, titles)
    _log_headings(stream, drawn, titles, colours)
    from vip_factors.viz.charts import headings_image

    picture = headings_image(drawn)
    if picture is not None:
        stream.log(HEADINGS_IMAGE, rr.EncodedImage(contents=picture, media_type="image/png"), static=True)
    return titles


def _log_camera_error(stream: rr.RecordingStream, drawn: DrawnScene, titles: dict[str, str]) -> None:
    if drawn.path is None or drawn.true_path is None:
        return
    time = drawn.path.time if len(drawn.path) > 1 else drawn.true_path.time
    one, other = drawn.path.at(time), drawn.true_path.at(time)
    metres = np.linalg.norm(one.p_world_camera - other.p_world_camera, axis=1)
    degrees = np.rad2deg(angle_between(one.R_world_camera, other.R_world_camera))
    log_curve(stream, "plots/camera_error/cm", time, 100 * metres, CAMERA_COLOUR, "position (cm)")
    log_curve(stream, "plots/camera_error/degrees", time, degrees, (120, 170, 240), "rotation (°)")
    titles["plots/camera_error"] = "Camera error (cm, °)"


def _log_headings(
    stream: rr.RecordingStream, drawn: DrawnScene, titles: dict[str, str], colours: Mapping[str, Colour]
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
        titles[f"plots/heading/{part}"] = f"Heading over time, {wearer.name} (° off the estimate)"


HEADINGS, HEADING_SIGMAS = "plots/heading", "plots/heading_sigma"
POSE_SIGMAS, UPDATE_MS = "plots/pose_sigma", "plots/update_ms"
EVERY_S = 0.1  # seconds between points of a heading: they change slowly, and there are many
UPDATE_COLOUR: Colour = (120, 170, 240)


class LiveSeries:
    """Draws the curves of a stream; each one's looks are sent with its first point."""

    def __init__(self, stream: rr.RecordingStream, setup: Scene) -> None:
        self._stream = stream
        self._parts = [rr.escape_entity_path_part(name) for name in setup.names]
        self._names = setup.names
        self._colours = colours_of(setup.wearers)
        self._known: set[str] = set()
        self._headings = -EVERY_S  # when the last points were sent

    def log(self, estimates: list[LiveEstimate]) -> None:
        """Log the points of frames that follow each other."""
        time = np.array([one.time for one in estimates])
        self._curve(UPDATE_MS, "update", UPDATE_COLOUR, time, np.array([1e3 * one.seconds for one in estimates]))
        for index, name in enumerate(self._names):
            sure = [one for one in estimates if one.wearers[index].newest.joint_covariance is not None]
            if sure:
                degrees = np.array([_sigma_deg(one.wearers[index]) for one in sure])
                at = np.array([one.time for one in sure])
                self._curve(f"{POSE_SIGMAS}/{self._parts[index]}", name, wearer_colour(index), at, degrees)
        calibrated = [one for one in estimates if any(wearer.calibration for wearer in one.wearers)]
        if calibrated and calibrated[-1].time - self._headings >= EVERY_S:
            self._headings = calibrated[-1].time
            for index, wearer in enumerate(calibrated[-1].wearers):
                self._log_headings(index, wearer, np.array([calibrated[-1].time]))

    def _log_headings(self, index: int, wearer: LiveWearerEstimate, time: Array) -> None:
        for sensor, one in wearer.calibration.items():
            colour = self._colours.get(sensor, UPDATE_COLOUR)
            below = f"{self._parts[index]}/{rr.escape_entity_path_part(sensor)}"
            heading = np.rad2deg(np.angle(np.exp(1j * one.heading_at(time))))
            self._curve(f"{HEADINGS}/{below}", sensor, colour, time, heading)
            self._curve(f"{HEADING_SIGMAS}/{below}", sensor, colour, time, np.rad2deg([one.heading_sigma]))

    def _curve(self, entity: str, name: str, colour: Colour, time: Array, values: Array) -> None:
        if entity in self._known:
            log_points(self._stream, entity, time, values)
        elif np.isfinite(values).any():
            self._known.add(entity)
            log_curve(self._stream, entity, time, values, colour, name)


def colours_of(
    wearers: Iterable[Recording | None], estimates: Iterable[WearerEstimate | None] = ()
) -> dict[str, Colour]:
    """One colour for sensors of the same name, whoever wears them."""
    names: dict[str, None] = {}
    for one in wearers:
        if one is not None:
            names |= dict.fromkeys([*(site.sensor for site in one.placement.sites), *one.imus])
    for estimate in estimates:
        if estimate is not None:
            names |= dict.fromkeys([*estimate.calibration, *estimate.sensors])
    return sensor_colours(list(names))


def _sigma_deg(wearer: LiveWearerEstimate) -> float:
    """Root mean square standard deviation of all joints of the newest pose."""
    covariance = wearer.newest.joint_covariance
    if covariance is None:
        return float("nan")
    return float(np.rad2deg(np.sqrt(np.trace(covariance, axis1=-2, axis2=-1).mean() / 3)))
