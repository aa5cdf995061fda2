"""The video's clock as it was found: what was seen is put onto the frames anew with it, and a drift is told."""

from collections.abc import Iterator

import numpy as np

from vip_factors.estimate import CameraEstimate
from vip_factors.problem.state import CameraState
from vip_factors.sensors.scene import Camera
from vip_factors.sensors.video_clock import VideoClock

TOLD_S = 0.010  # over a recording: hands that swing at 2 m/s are 2 cm elsewhere
SURE = 3.0  # standard deviations of a drift that is told
DRIFTS = "the video's clock drifts from the sensors'"


def middle_of(camera: Camera) -> float:
    """The sensors' time in the middle of a video; 0 of none."""
    time = camera.timed_detections.time
    return float(time[0] + time[-1]) / 2 if len(time) else 0.0


def found_clock(state: CameraState, middle: float, supposed: VideoClock | None = None) -> VideoClock:
    """The clock that was found of a video, beyond the one it was ``supposed`` to have or together with it."""
    return (supposed or VideoClock()).corrected(state.clock, state.clock_drift, middle)


def clock_findings(camera: Camera, found: CameraEstimate, video_s: float | None = None) -> Iterator[str]:
    """A sentence about a video whose clock drifts from the sensors' further than the scene said.

    Args:
        camera: as the scene has it.
        found: as it was estimated.
        video_s: length of the video, if the camera does not have all of its frames.
    """
    if video_s is None:
        video_s = float(np.ptp(camera.detections.time)) if len(camera.detections.time) else 0.0
    drift = found.time_drift - camera.time_drift
    if found.clock_sigma is None:
        return
    seconds = drift * video_s
    if abs(seconds) > TOLD_S and abs(drift) > SURE * found.clock_sigma[1]:
        yield (
            f"{DRIFTS} by {1e3 * seconds:+.0f} ms from its start to its end "
            f"({1e6 * drift:+.0f} ± {1e6 * found.clock_sigma[1]:.0f} ppm); the estimate follows it"
        )
