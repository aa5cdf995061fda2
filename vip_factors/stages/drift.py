"""What drifts or slips: headings, mountings, and the video's clock against the sensors'."""

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
    for a minute's worth, so that few steps do not make it nought. Steps of some time are looked at: the smoother shares
    a drift out among shorter ones.
    """
    usual_minutes = 1.0  # the usual drift counts as much as this long a look at the sensor's own
    least_s = 40.0
    if not model.headings_drift:
        return model
    minutes, squares = 0.0, np.zeros(len(state.headings))
    pieces = np.split(np.arange(len(model.heading_times)), model.restart_steps + 1)
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
    sure = 3.0  # standard deviations from which on a deviation is reported
    off_s = 0.030  # a video frame at 30 Hz
    told_s = 0.010  # over a recording: hands that swing at 2 m/s are 2 cm elsewhere
    time = camera.detections.time if video is None else np.array(video)
    if not len(time) or clock.clock_sigma is None:
        return
    middle, deviations, numbers = float(time[0] + time[-1]) / 2, list[str](), dict[str, float]()
    off = clock.clock.late(middle) - camera.clock.late(middle)
    if abs(off) > max(off_s, sure * clock.clock_sigma[0]):
        numbers |= {"off_ms": 1e3 * off, "sigma_ms": 1e3 * clock.clock_sigma[0]}
        deviations.append(f"is {numbers['off_ms']:+.0f} ± {numbers['sigma_ms']:.0f} ms off what the scene says")
    drift = clock.clock.drift - camera.clock.drift
    seconds = drift * float(time[-1] - time[0])
    if abs(seconds) > told_s and abs(drift) > sure * clock.clock_sigma[1]:
        numbers |= {"drifted_ms": 1e3 * seconds, "ppm": 1e6 * drift, "sigma_ppm": 1e6 * clock.clock_sigma[1]}
        deviations.append(
            f"drifts from the sensors' by {numbers['drifted_ms']:+.0f} ms from its start to its end "
            f"({numbers['ppm']:+.0f} ± {numbers['sigma_ppm']:.0f} ppm)"
        )
    if deviations:
        yield Finding("video clock", numbers=numbers, words={"off": " and ".join(deviations)})


def drift_findings(
    wearer: str, calibration: Calibration, restarts: Sequence[tuple[float, float]] = ()
) -> Iterator[Finding]:
    """The headings that drifted far, but for what they did over pauses from and until some seconds."""
    drifted_deg = 10.0  # over a recording: more than mountings and tissue leave open
    pauses = [start for start, _ in restarts]
    steps = {
        name: np.diff(sensor.heading_path)[~np.isin(sensor.heading_time[:-1], pauses)]
        for name, sensor in calibration.items()
        if len(sensor.heading_path)
    }
    drifts = {name: float(np.rad2deg(step.sum())) for name, step in steps.items()}
    far = {name: degrees for name, degrees in drifts.items() if abs(degrees) > drifted_deg}
    if far:
        yield Finding("heading drift", wearer, numbers=far)


def slip_findings(
    wearer: str, recording: Recording, frames: ImuFrames, R_world_bone: Array, calibration: Calibration
) -> Iterator[Finding]:
    """The sensor that from some instant on sits otherwise on its bone, or has another heading, if there is one.

    The body gives way to such a sensor, and its neighbours' bones do: the one that turns furthest is told. A slip is
    the same in the sensor's axes, a heading in the world's, about the vertical. ``R_world_bone`` is ``(T, 24, 3, 3)``
    at the frames.
    """
    least_frames, upright = 60, 0.9  # cosine to the vertical of a turn that is the heading's
    # Degrees by which a sensor's mean turn against its bone differs before and after an instant: up to 5.4 in 13
    # foreign scenes and 9 walks, but for one that was solved wrongly (61); seven slips and heading jumps of 50° left
    # 6.4 to 14.
    slipped_deg = 6.0
    turns = list[tuple[float, str, float, str]]()
    for column, (name, sensor) in enumerate(calibration.items()):
        valid = frames.orientation_valid[:, column]
        time = frames.time[valid]
        if len(time) < least_frames:
            continue
        R_world_sensor = rotation_z(sensor.heading_at(time)) @ frames.R_inertial_sensor[valid, column]
        expected = R_world_bone[valid, recording.placement.site(name).bone_index] @ sensor.R_bone_sensor
        frame, slip = _largest_step(log(transpose(expected) @ R_world_sensor))
        turns.append((float(np.linalg.norm(slip)), name, time[frame], "it slipped or was turned on its bone"))
        frame, jump = _largest_step(log(R_world_sensor @ transpose(expected)))
        if abs(jump[2]) > upright * np.linalg.norm(jump):
            turns.append((float(np.linalg.norm(jump)), name, time[frame], "its heading jumped"))
    angle, name, instant, how = max(turns, default=(0.0, "", 0.0, ""))
    if np.rad2deg(angle) > slipped_deg:
        numbers = {"degrees": float(np.rad2deg(angle)), "time": float(instant)}
        yield Finding("sensor turned", wearer, subject=name, numbers=numbers, words={"how": how})


def _largest_step(vectors: Array) -> tuple[int, Array]:
    """The frame from which on the mean of vectors ``(T, 3)`` is most surely another one, and by what ``(3,)``."""
    count, edge = len(vectors), round(0.15 * len(vectors))  # frames left before and after
    split = np.arange(edge, count - edge)
    before = np.cumsum(vectors, axis=0)[split - 1]
    steps = (vectors.sum(axis=0) - before) / (count - split)[:, None] - before / split[:, None]
    best = int(np.argmax(np.linalg.norm(steps, axis=1) * np.sqrt(split * (count - split))))
    return int(split[best]), steps[best]
