"""The video's clock as it was found: what was seen is put onto the frames anew with it, and a drift is told."""

from collections.abc import Iterator

import numpy as np

from vip_factors.estimate import CameraEstimate
from vip_factors.problem.state import CameraState
from vip_factors.sensors.camera_model import VideoClock
from vip_factors.sensors.scene import Camera

TOLD_S = 0.010  # over a recording: hands that swing at 2 m/s are 2 cm elsewhere
OFF_S = 0.030  # a video frame at 30 Hz
SURE = 3.0  # standard deviations of what is told
CLOCK = "the video's clock "


def middle_of(camera: Camera) -> float:
    """The sensors' time in the middle of a video; 0 of none."""
    time = camera.timed_detections.time
    return float(time[0] + time[-1]) / 2 if len(time) else 0.0


def found_clock(state: CameraState, middle: float, supposed: VideoClock | None = None) -> VideoClock:
    """The clock that was found of a video, beyond the one it was ``supposed`` to have or together with it."""
    return (supposed or VideoClock()).corrected(state.clock, state.clock_drift, middle)


def clock_findings(camera: Camera, found: CameraEstimate, video: tuple[float, float] | None = None) -> Iterator[str]:
    """Sentences about a video whose clock is off the sensors', or drifts from them, further than the scene said.

    Args:
        camera: as the scene has it.
        found: as it was estimated.
        video: its seconds from and until, if the camera does not have all of its frames.
    """
    time = camera.detections.time if video is None else np.array(video)
    if not len(time) or found.clock_sigma is None:
        return
    middle = float(time[0] + time[-1]) / 2
    off = found.clock.late(middle) - camera.clock.late(middle)
    if abs(off) > max(OFF_S, SURE * found.clock_sigma[0]):
        yield (
            f"{CLOCK}is {1e3 * off:+.0f} ± {1e3 * found.clock_sigma[0]:.0f} ms off what the scene says, and was put "
            "right; if it is off by more than 100 ms, find its offset first (vip-factors sync)"
        )
    drift = found.time_drift - camera.time_drift
    seconds = drift * float(time[-1] - time[0])
    if abs(seconds) > TOLD_S and abs(drift) > SURE * found.clock_sigma[1]:
        yield (
            f"{CLOCK}drifts from the sensors' by {1e3 * seconds:+.0f} ms from its start to its end "
            f"({1e6 * drift:+.0f} ± {1e6 * found.clock_sigma[1]:.0f} ppm); the estimate follows it"
        )
