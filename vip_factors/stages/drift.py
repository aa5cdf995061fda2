"""What drifts or leaps, as it was found and told: headings, mountings, and the video's clock against the sensors'."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from vip_factors.estimate import CameraEstimate
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array, log, rotation_z, transpose
from vip_factors.problem.state import CameraState, WearerState
from vip_factors.problem.wearer import WearerProblem
from vip_factors.sensors.calibration import Calibration
from vip_factors.sensors.camera import VideoClock
from vip_factors.sensors.frames import ImuFrames
from vip_factors.sensors.recording import Recording
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


def drift_findings(
    wearer: str, calibration: Calibration, restarts: Sequence[tuple[float, float]] = ()
) -> Iterator[Finding]:
    """The headings that drifted far, but for what they did over pauses from and until some seconds."""
    told_deg = 10.0  # over a recording: more than mountings and tissue leave open
    pauses = [start for start, _ in restarts]
    drifted = {
        name: float(np.rad2deg(np.diff(one.heading_path)[~np.isin(one.heading_time[:-1], pauses)].sum()))
        for name, one in calibration.items()
        if len(one.heading_path)
    }
    far = {name: degrees for name, degrees in drifted.items() if abs(degrees) > told_deg}
    if far:
        yield Finding("heading drift", wearer, numbers=far)


EDGE, LEAST_LEAP_FRAMES = 0.15, 60  # of the frames, before and after


def leap_findings(
    wearer: str, recording: Recording, frames: ImuFrames, bones: Array, calibration: Calibration
) -> Iterator[Finding]:
    """The sensor that from some instant on sits otherwise on its bone, or has another heading, if there is one.

    The body gives way to such a sensor, and its neighbours' bones do: the one that leaps furthest is told. A slip is
    the same in the sensor's axes, a heading in the world's, about the vertical. ``bones`` is ``(T, 24, 3, 3)``
    ``R_world_bone`` at the frames.
    """
    upright = 0.9  # cosine to the vertical of a turn that is the heading's
    # Degrees by which a sensor's mean turn against its bone differs before and after an instant: up to 5.4 in 13
    # foreign scenes and 9 walks, but for one that was solved wrongly (61); seven slips and heading jumps of 50° left
    # 6.4 to 14.
    leapt_deg = 6.0
    found = list[tuple[float, str, float, bool]]()
    for column, (name, one) in enumerate(calibration.items()):
        known = frames.orientation_valid[:, column]
        time = frames.time[known]
        if len(time) < LEAST_LEAP_FRAMES:
            continue
        R_world_sensor = rotation_z(one.heading_at(time)) @ frames.R_inertial_sensor[known, column]
        expected = bones[known, recording.placement.site(name).bone_index] @ one.R_bone_sensor
        slip, jump = log(transpose(expected) @ R_world_sensor), log(R_world_sensor @ transpose(expected))
        for vectors, in_world in ((slip, False), (jump, True)):
            frame, leap = _largest_leap(vectors)
            size = float(np.linalg.norm(leap))
            if not in_world or abs(leap[2]) > upright * size:
                found.append((float(np.rad2deg(size)), name, float(time[frame]), in_world))
    degrees, name, at, in_world = max(found, default=(0.0, "", 0.0, False))
    if degrees > leapt_deg:
        words = {"how": "its heading jumped" if in_world else "it slipped or was turned on its bone"}
        yield Finding("sensor turned", wearer, subject=name, numbers={"degrees": degrees, "time": at}, words=words)


def _largest_leap(vectors: Array) -> tuple[int, Array]:
    """The frame from which on the mean of vectors ``(T, 3)`` is most surely another one, and by what ``(3,)``."""
    count = len(vectors)
    at = np.arange(count)[round(EDGE * count) : count - round(EDGE * count)]
    before = np.cumsum(vectors, axis=0)[at - 1]
    leaps = (vectors.sum(axis=0) - before) / (count - at)[:, None] - before / at[:, None]
    best = int(np.argmax(np.linalg.norm(leaps, axis=1) * np.sqrt(at * (count - at))))
    return int(at[best]), leaps[best]


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
