"""Curves in Rerun: errors and residuals of recordings; standard deviations and update times of streams."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import rerun as rr

from vip_factors.body.mannequin import Colour
from vip_factors.estimate import WearerEstimate
from vip_factors.geometry.rotations import Array
from vip_factors.live_estimate import LiveEstimate, LiveWearerEstimate
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene
from vip_factors.viz.colours import sensor_colours, wearer_colour
from vip_factors.viz.drawn_scene import DrawnScene, DrawnWearer
from vip_factors.viz.rerun_body import time_column


def sensor_colours_of(
    wearers: Iterable[Recording | None], estimates: Iterable[WearerEstimate | None] = ()
) -> dict[str, Colour]:
    """One colour for sensors of the same name, whoever wears them."""
    names: dict[str, None] = {}
    for recording in wearers:
        if recording is not None:
            names |= dict.fromkeys([*(site.sensor for site in recording.placement.sites), *recording.imus])
    for estimate in estimates:
        if estimate is not None:
            names |= dict.fromkeys([*estimate.calibration, *estimate.sensors])
    return sensor_colours(list(names))


def log_curves(
    stream: rr.RecordingStream, entity: str, time: Array, values: Array, curves: Mapping[str, Colour]
) -> None:
    """Log curves with the same times: values ``(T, n)``, and the ``n`` names with their colours."""
    log_curve_style(stream, entity, curves)
    log_points(stream, entity, time, values)


def log_curve_style(stream: rr.RecordingStream, entity: str, curves: Mapping[str, Colour]) -> None:
    """Log names and colours of the curves of an entity."""
    style = rr.SeriesLines(colors=list(curves.values()), names=list(curves), widths=[1.5] * len(curves))
    stream.log(entity, style, static=True)


def log_points(stream: rr.RecordingStream, entity: str, time: Array, values: Array) -> None:
    """Log points ``(T, n)`` of curves, all of them or the next ones; curves are interrupted where they are NaN."""
    if np.any(np.isfinite(values)):
        columns = rr.Scalars.columns(scalars=values.reshape(-1)).partition([values.shape[1]] * len(values))
        stream.send_columns(entity, indexes=[time_column(time)], columns=columns)


def log_series(stream: rr.RecordingStream, drawn: DrawnScene, colours: Mapping[str, Colour]) -> dict[str, str]:
    """Log all curves that can be drawn below ``/plots``; returns their entities and titles, the main ones first.

    ``colours`` are the sensors'.
    """
    titles: dict[str, str] = {}
    for wearer in drawn.wearers:
        part, curve = rr.escape_entity_path_part(wearer.name), {wearer.name: wearer_colour(wearer.index)}
        pixels = drawn.reprojection_px(wearer) if drawn.estimate is not None else None
        if pixels is not None and drawn.detections is not None:
            entity = "/plots/reprojection_px"
            log_curves(stream, f"{entity}/{part}", drawn.detections.time, pixels[:, None], curve)
            titles[entity] = "Reprojection error (px)"
        if wearer.error_mm is not None and wearer.motion is not None:
            entity = "/plots/joint_error_mm"
            log_curves(stream, f"{entity}/{part}", wearer.motion.time, wearer.error_mm[:, None], curve)
            titles[entity] = "Joint error (mm)"
        if drawn.one_alone:
            titles |= _log_residuals(stream, wearer, colours)
    return titles


def _log_residuals(stream: rr.RecordingStream, wearer: DrawnWearer, colours: Mapping[str, Colour]) -> dict[str, str]:
    estimate = wearer.estimate
    if estimate is None:
        return {}
    names = {
        "orientation_deg": "Orientation residual (°)",
        "acceleration_m_s2": "Acceleration residual (m/s²)",
    }  # fmt: skip
    titles = {}
    for kind, values in estimate.residuals.items():
        entity = f"/plots/residual/{kind}"
        curves = {sensor: colours[sensor] for sensor in estimate.sensors}
        log_curves(stream, entity, estimate.motion.time, values, curves)
        titles[entity] = names.get(kind, kind)
    return titles


HEADING_SIGMAS, POSE_SIGMAS, UPDATE_MS = "/plots/heading_sigma", "/plots/pose_sigma", "/plots/update_ms"


class LiveSeries:
    """Curves of a stream: its updates, and standard deviations of poses and headings."""

    def __init__(self, stream: rr.RecordingStream, setup: Scene, colours: Mapping[str, Colour]) -> None:
        self._stream = stream
        self._parts = [rr.escape_entity_path_part(name) for name in setup.names]
        self._sensors = [[site.sensor for site in wearer.placement.sites] for wearer in setup.wearers]
        log_curve_style(stream, UPDATE_MS, {"update": (120, 170, 240)})
        for index, (part, sensors) in enumerate(zip(self._parts, self._sensors, strict=True)):
            log_curve_style(stream, f"{POSE_SIGMAS}/{part}", {setup.names[index]: wearer_colour(index)})
            log_curve_style(stream, f"{HEADING_SIGMAS}/{part}", {sensor: colours[sensor] for sensor in sensors})

    def log(self, estimates: Sequence[LiveEstimate]) -> None:
        """Log the points of the next frames; of headings, which change slowly, the last ones."""
        time = np.array([estimate.time for estimate in estimates])
        milliseconds = 1e3 * np.array([[estimate.seconds] for estimate in estimates])
        log_points(self._stream, UPDATE_MS, time, milliseconds)
        for index, part in enumerate(self._parts):
            wearers = [estimate.wearers[index] for estimate in estimates]
            sigmas = np.array([[_sigma_deg(wearer)] for wearer in wearers])
            log_points(self._stream, f"{POSE_SIGMAS}/{part}", time, sigmas)
            self._log_heading_sigmas(part, self._sensors[index], time[-1:], wearers[-1])

    def _log_heading_sigmas(self, part: str, sensors: Sequence[str], time: Array, wearer: LiveWearerEstimate) -> None:
        known = (wearer.calibration.get(sensor) for sensor in sensors)
        radians = [[np.nan if calibration is None else calibration.heading_sigma for calibration in known]]
        log_points(self._stream, f"{HEADING_SIGMAS}/{part}", time, np.rad2deg(radians))


def _sigma_deg(wearer: LiveWearerEstimate) -> float:
    """Root mean square standard deviation of all joints of the newest pose; NaN if unknown."""
    covariance = wearer.newest.joint_covariance
    if covariance is None:
        return float("nan")
    return float(np.rad2deg(np.sqrt(np.trace(covariance, axis1=-2, axis2=-1).mean() / 3)))
