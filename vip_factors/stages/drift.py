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
    for a minute's worth, so that few steps do not make it nought. Steps of some time are looked at: the smoother shares
    a drift out among shorter ones.
    """
    usual_minutes = 1.0  # the usual drift counts as much as this long a look at the sensor's own
    least_s = 40.0
    if not model.headings_drift:
        return model
    minutes, squares = 0.0, np.zeros(len(state.headings))
    pieces = np.split(np.arange(len(model.heading_times)), np.flatnonzero(~model.drifts_on) + 1)
    for time, path in ((model.heading_times[one], state.heading_path[one]) for one in pieces):
        ends = np.linspace(time[0], time[-1], max(round(float(time[-1] - time[0]) / least_s), 1) + 1)
        at_ends = np.array([np.interp(ends, time, column) for column in path.T])
        minutes += float(time[-1] - time[0]) / 60
        squares += np.sum(np.rad2deg(np.diff(at_ends)) ** 2, axis=1)
    usual = model.settings.heading_walk.drift_deg
    drift = np.sqrt((usual**2 * usual_minutes + squares) / (usual_minutes + minutes))
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
    middle, told, numbers = float(time[0] + time[-1]) / 2, list[str](), dict[str, float]()
    off = clock.clock.late(middle) - camera.clock.late(middle)
    if abs(off) > max(off_s, sure * clock.clock_sigma[0]):
        numbers |= {"off_ms": 1e3 * off, "sigma_ms": 1e3 * clock.clock_sigma[0]}
        told.append(f"is {numbers['off_ms']:+.0f} ± {numbers['sigma_ms']:.0f} ms off what the scene says")
    drift = clock.time_drift - camera.time_drift
    seconds = drift * float(time[-1] - time[0])
    if abs(seconds) > told_s and abs(drift) > sure * clock.clock_sigma[1]:
        numbers |= {"drifted_ms": 1e3 * seconds, "ppm": 1e6 * drift, "sigma_ppm": 1e6 * clock.clock_sigma[1]}
        told.append(
            f"drifts from the sensors' by {numbers['drifted_ms']:+.0f} ms from its start to its end "
            f"({numbers['ppm']:+.0f} ± {numbers['sigma_ppm']:.0f} ppm)"
        )
    if told:
        yield Finding("video clock", numbers=numbers, words={"off": " and ".join(told)})
