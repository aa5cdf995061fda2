"""The frames on which a scene is estimated: evenly spaced, and in step with the video."""

from dataclasses import dataclass

import numpy as np

from vip_factors.errors import RecordingError
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.frames import frame_count
from vip_factors.sensors.scene import Scene


@dataclass(frozen=True)
class SceneFrames:
    """Instants of the estimate, in seconds: ``fine`` ``(T,)``, and every ``factor``-th of them, ``coarse``."""

    fine: Array
    factor: int

    @property
    def coarse(self) -> Array:
        """The instants on which the calibration is found."""
        return self.fine[:: self.factor]


def scene_frames(scene: Scene, frame_rate: float, coarse_factor: int) -> SceneFrames:
    """Frames over the time that all wearers' sensors cover.

    A whole number of frames goes to each video frame (or of video frames to each frame), at about ``frame_rate`` Hz,
    and the frames meet the video's: what the camera saw then need not be interpolated.

    Raises:
        RecordingError: if the wearers share less than four coarse frames, or more than a day.
    """
    intervals = [wearer.interval for wearer in scene.wearers]
    interval = max(one[0] for one in intervals), min(one[1] for one in intervals)
    first, rate, count = in_step(scene, interval, frame_rate, coarse_factor)
    return SceneFrames(first + np.arange(count) / rate, coarse_factor)


def in_step(
    scene: Scene, interval: tuple[float, float], frame_rate: float, coarse_factor: int
) -> tuple[float, float, int]:
    """Frames within an interval (seconds) as :func:`scene_frames` places them: the first's seconds, rate and count.

    Args:
        scene: whose first camera's first video frames the frames are to meet.
        interval: to cover.
        frame_rate: Hz, about.
        coarse_factor: every so-manieth frame is a coarse one: these are to meet video frames, not to lie between them.

    Raises:
        RecordingError: for less than four coarse frames, or more than a day.
    """
    start, end = interval
    rate, phase = frame_rate, start
    if scene.camera is not None and scene.camera.detections.rate > 0:
        video = scene.camera.detections.rate
        ratio = frame_rate / video
        rate = video * round(ratio) if ratio >= 1 else video / round(1 / ratio)
        phase = float(scene.camera.timed_detections.time[0])
    first = phase + float(np.ceil((start - phase) * rate - 1e-6)) / rate
    if scene.camera is not None:  # coarse frames are to meet video frames, not to lie between them
        first += ((-round((first - phase) * rate)) % coarse_factor) / rate
    count = frame_count(first, end, rate)
    if count < 3 * coarse_factor + 1:
        raise RecordingError(
            f"scene '{scene.name}': the sensors of all wearers together cover {max(end - start, 0.0):.2f} s: expected "
            f"{(3 * coarse_factor + 1) / rate:.2f} s or more"
        )
    return first, rate, count
