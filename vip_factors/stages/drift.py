"""Drift and slip: headings, mountings, and the video's clock relative to the sensors'."""

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


def with_estimated_drift(model: WearerProblem, state: WearerState) -> WearerProblem:
    """Return the model with each heading's random walk scaled to its estimated drift.

    The variance per minute is the sum of squared steps over their minutes, regularised by one minute of usual drift.
    Steps span some time, because the smoother distributes a drift over shorter ones.
    """
    usual_minutes = 1.0  # weight of the usual drift, as minutes of data
    least_s = 40.0
    if not model.headings_drift:
        return model
    minutes, squares = 0.0, np.zeros(len(state.headings))
    pieces = np.split(np.arange(len(model.heading_times)), model.restart_steps + 1)
    for time, path in ((model.heading_times[piece], state.heading_path[piece]) for piece in pieces):
        ends = np.linspace(time[0], time[-1], max(round(float(time[-1] - time[0]) / least_s), 1) + 1)
        at_ends = np.array([np.interp(ends, time, column) for column in path.T])
        minutes += float(time[-1] - time[0]) / 60
        squares += np.sum(np.rad2deg(np.diff(at_ends)) ** 2, axis=1)
    usual = model.settings.heading_walk.drift_deg
    drift = np.sqrt((usual**2 * usual_minutes + squares) / (usual_minutes + minutes))
    return replace(model, heading_drift_deg=drift)


def middle_time(camera: Camera) -> float:
    """Sensor time in the middle of a video; 0 for an empty one."""
    time = camera.timed_detections.time
    return float(time[0] + time[-1]) / 2 if len(time) else 0.0


def estimated_clock(state: CameraState, middle: float, supposed: VideoClock | None = None) -> VideoClock:
    """Estimated clock of a video: its correction alone, or applied to the ``supposed`` clock."""
    return (supposed or VideoClock()).corrected(state.clock, state.clock_drift, middle)


def clock_findings(
    camera: Camera, clock: CameraEstimate, video: tuple[float, float] | None = None
) -> Iterator[Finding]:
    """Report a video whose clock has an offset or drift relative to the sensors beyond those given in the scene.

    Args:
        camera: camera of the scene.
        clock: its estimate.
        video: first and last second of the video, if the camera does not have all of its frames.
    """
    significance = 3.0  # standard deviations
    largest_offset_s = 0.030  # a video frame at 30 Hz
    largest_drift_s = 0.010  # over a recording: 2 cm for hands that swing at 2 m/s
    time = camera.detections.time if video is None else np.array(video)
    if not len(time) or clock.clock_sigma is None:
        return
    middle, deviations, numbers = float(time[0] + time[-1]) / 2, list[str](), dict[str, float]()
    off = clock.clock.late(middle) - camera.clock.late(middle)
    if abs(off) > max(largest_offset_s, significance * clock.clock_sigma[0]):
        numbers |= {"off_ms": 1e3 * off, "sigma_ms": 1e3 * clock.clock_sigma[0]}
        deviations.append(
            f"is {numbers['off_ms']:+.0f} ± {numbers['sigma_ms']:.0f} ms off the clock given in the scene"
        )
    drift = clock.clock.drift - camera.clock.drift
    seconds = drift * float(time[-1] - time[0])
    if abs(seconds) > largest_drift_s and abs(drift) > significance * clock.clock_sigma[1]:
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
    """Report headings that drifted far, excluding changes over pauses (first and last second of each)."""
    drifted_deg = 10.0  # over a recording: more than mountings and soft tissue explain
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
    """Report the sensor whose mounting or heading changes most at some instant, if it changes enough.

    The body adapts to such a sensor and so do the neighbouring bones, so only the largest change is reported. A slip is
    constant in the sensor's axes, a heading jump is a rotation about the vertical in the world's. ``R_world_bone`` is
    ``(T, 24, 3, 3)`` at the frames.
    """
    least_frames, upright = 60, 0.9  # cosine of a heading jump's axis to the vertical
    slipped_deg = 6.0  # correct recordings have up to 5.4; the body absorbs most of a slip: 50° leave 6.4 to 14
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
    """First frame after the most significant step in the mean of vectors ``(T, 3)``, and the step ``(3,)``."""
    count, edge = len(vectors), round(0.15 * len(vectors))  # least frames before and after
    split = np.arange(edge, count - edge)
    sums = np.cumsum(vectors, axis=0)[split - 1]
    steps = (vectors.sum(axis=0) - sums) / (count - split)[:, None] - sums / split[:, None]
    largest = int(np.argmax(np.linalg.norm(steps, axis=1) * np.sqrt(split * (count - split))))
    return int(split[largest]), steps[largest]
