"""Time series in Rerun: error, residuals, and what the sensors measured."""

from collections.abc import Mapping

import numpy as np
import rerun as rr

from vip_factors.body.mannequin import Colour
from vip_factors.estimate import WearerEstimate
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.recording import Recording
from vip_factors.viz.rerun_body import time_column

LEGEND = "legend/sensors"


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
    good = np.isfinite(values)
    stream.log(entity, rr.SeriesLines(colors=[colour], names=[name], widths=[1.5]), static=True)
    if not np.any(good):
        return
    if not gaps:
        time, values = time[good], values[good]
    stream.send_columns(entity, indexes=[time_column(time)], columns=rr.Scalars.columns(scalars=values))


def log_residuals(stream: rr.RecordingStream, estimate: WearerEstimate, colours: dict[str, Colour]) -> list[str]:
    """Log the residual of every kind and sensor below ``plots/residual/<kind>/<sensor>``; returns the kinds."""
    time = estimate.motion.time
    for kind, values in estimate.residuals.items():
        for column, sensor in enumerate(estimate.sensors):
            log_curve(stream, f"plots/residual/{kind}/{sensor}", time, values[:, column], colours[sensor], sensor)
    return list(estimate.residuals)


def log_measurements(stream: rr.RecordingStream, recording: Recording, colours: dict[str, Colour]) -> list[str]:
    """Log the norms of specific force and angular rate of every sensor; returns which of the two exist."""
    found: set[str] = set()
    for sensor, imu in recording.imus.items():
        for kind, values in (("specific_force_m_s2", imu.specific_force), ("angular_rate_rad_s", imu.angular_rate)):
            if values is not None:
                found.add(kind)
                norm = np.linalg.norm(values, axis=1)
                log_curve(stream, f"plots/imu/{kind}/{sensor}", imu.time, norm, colours[sensor], sensor)
    return sorted(found, reverse=True)
