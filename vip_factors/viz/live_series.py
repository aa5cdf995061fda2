"""Curves of a stream: headings, how sure headings and poses are, and what the updates take."""

import numpy as np
import rerun as rr

from vip_factors.body.mannequin import Colour
from vip_factors.geometry.rotations import Array
from vip_factors.live_estimate import LiveEstimate, LiveWearerEstimate
from vip_factors.sensors.live import LiveSetup
from vip_factors.viz.colours import sensor_colours, wearer_colour
from vip_factors.viz.rerun_body import time_column

HEADINGS, HEADING_SIGMAS = "plots/heading", "plots/heading_sigma"
POSE_SIGMAS, UPDATE_MS = "plots/pose_sigma", "plots/update_ms"
EVERY_S = 0.1  # seconds between points of a heading: they change slowly, and there are many
UPDATE_COLOUR: Colour = (120, 170, 240)


class LiveSeries:
    """Draws the curves of a stream; each one's looks are sent with its first point."""

    def __init__(self, stream: rr.RecordingStream, setup: LiveSetup) -> None:
        self._stream = stream
        self._parts = [rr.escape_entity_path_part(one.name) for one in setup.wearers]
        self._names = [one.name for one in setup.wearers]
        self._colours = colours_of(setup)
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
        told = [one for one in estimates if any(wearer.calibration for wearer in one.wearers)]
        if told and told[-1].time - self._headings >= EVERY_S:
            self._headings = told[-1].time
            for index, wearer in enumerate(told[-1].wearers):
                self._log_headings(index, wearer, np.array([told[-1].time]))

    def _log_headings(self, index: int, wearer: LiveWearerEstimate, time: Array) -> None:
        for sensor, one in wearer.calibration.items():
            colour = self._colours.get(sensor, UPDATE_COLOUR)
            below = f"{self._parts[index]}/{rr.escape_entity_path_part(sensor)}"
            heading = np.rad2deg(np.angle(np.exp(1j * one.heading_at(time))))
            self._curve(f"{HEADINGS}/{below}", sensor, colour, time, heading)
            self._curve(f"{HEADING_SIGMAS}/{below}", sensor, colour, time, np.rad2deg([one.heading_sigma]))

    def _curve(self, entity: str, name: str, colour: Colour, time: Array, values: Array) -> None:
        good = np.isfinite(values)
        if not np.any(good):
            return
        if entity not in self._known:
            self._known.add(entity)
            self._stream.log(entity, rr.SeriesLines(colors=[colour], names=[name], widths=[1.5]), static=True)
        columns = rr.Scalars.columns(scalars=values[good])
        self._stream.send_columns(entity, indexes=[time_column(time[good])], columns=columns)


def colours_of(setup: LiveSetup) -> dict[str, Colour]:
    """One colour for sensors of the same name, whoever wears them."""
    return sensor_colours(list(dict.fromkeys(site.sensor for one in setup.wearers for site in one.placement.sites)))


def _sigma_deg(wearer: LiveWearerEstimate) -> float:
    """Root mean square standard deviation of all joints of the newest pose."""
    covariance = wearer.newest.joint_covariance
    if covariance is None:
        return float("nan")
    return float(np.rad2deg(np.sqrt(np.trace(covariance, axis1=-2, axis2=-1).mean() / 3)))
