"""What drifts: headings, and the video's clock against the sensors'."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from vip_factors.estimate import CameraEstimate
from vip_factors.findings import Finding
from vip_factors.problem.state import CameraState, WearerState
from vip_factors.problem.wearer import WearerProblem
from vip_factors.sensors.camera import VideoClock
from vip_factors.sensors.scene import Camera


def with_found_drift(model: WearerProblem, state: WearerState) -> WearerProblem:
    """The model that expects of each heading to drift as it was found to: a few minutes tell a calm sensor from a bad.

    Of a random walk the mean square of its steps by their minutes is the variance per minute; the usual one is added
    for a minute's worth, so that few knots do not make it nought.
    """
    usual_minutes = 1.0  # the usual drift counts as much as this long a look at the sensor's own
    if not model.headings_walk:
        return model
    on = model.walks_on
    minutes = np.diff(model.heading_knots)[on] / 60
    squares = np.sum(np.rad2deg(np.diff(state.heading_knots, axis=0)[on]) ** 2, axis=0)
    usual = model.settings.heading_walk.drift_deg
    drift = np.sqrt((usual**2 * usual_minutes + squares) / (usual_minutes + float(minutes.sum())))
    return replace(model, heading_drift_deg=drift)


def middle_of(camera: Camera) -> float:
    """The sensors' time in the middle of a video; 0 of none."""
    time = camera.timed_detections.time
    return float(time[0] + time[-1]) / 2 if len(time) else 0.0


def found_clock(state: CameraState, middle: float, supposed: VideoClock | None = None) -> VideoClock:
    """The clock that was found of a video, beyond the one it was ``supposed`` to have or together with it."""
    return (supposed or VideoClock()).corrected(state.clock, state.clock_drift, middle)


def clock_findings(
    camera: Camera, clock: CameraEstimate, video: tuple[float, float] | None = None
) -> Iterator[Finding]:
    """Of a video whose clock is off the sensors', or drifts from them, further than the scene said.

    Args:
        camera: as the scene has it.
        clock: as it was estimated.
        video: its seconds from and until, if the camera does not have all of its frames.
    """
    sure = 3.0  # standard deviations of what is told
    off_s = 0.030  # a video frame at 30 Hz
    told_s = 0.010  # over a recording: hands that swing at 2 m/s are 2 cm elsewhere
    time = camera.detections.time if video is None else np.array(video)
    if not len(time) or clock.clock_sigma is None:
        return
    middle = float(time[0] + time[-1]) / 2
    off = clock.clock.late(middle) - camera.clock.late(middle)
    if abs(off) > max(off_s, sure * clock.clock_sigma[0]):
        numbers = {"off_ms": 1e3 * off, "sigma_ms": 1e3 * clock.clock_sigma[0]}
        yield Finding("video clock off", numbers=numbers)
    drift = clock.time_drift - camera.time_drift
    seconds = drift * float(time[-1] - time[0])
    if abs(seconds) > told_s and abs(drift) > sure * clock.clock_sigma[1]:
        numbers = {"drifted_ms": 1e3 * seconds, "ppm": 1e6 * drift, "sigma_ppm": 1e6 * clock.clock_sigma[1]}
        yield Finding("video clock drift", numbers=numbers)
