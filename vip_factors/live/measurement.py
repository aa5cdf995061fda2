"""What was measured in one frame of a stream. Plain data."""

from dataclasses import dataclass

import numpy as np

from vip_factors.geometry.rotations import Array
from vip_factors.sensors.live import VideoFrame


@dataclass(frozen=True)
class PlacedVideoFrame:
    """A video frame and the number of the frame nearest to it in time (half a frame off at most)."""

    frame: int
    video: VideoFrame


@dataclass(frozen=True)
class FrameMeasurement:
    """Measurements of ``S`` sensors in one frame: what :class:`~vip_factors.sensors.frames.ImuFrames` has in a row.

    Attributes:
        frame: number, from 0, without holes.
        time: seconds from the start of the stream; evenly spaced, but for restarts.
        R_inertial_sensor: ``(S, 3, 3)``; identity where not valid.
        orientation_valid: ``(S,)`` whether the orientation was measured here.
        specific_force_inertial: ``(S, 3)`` m/s² of the frame *before* this one, in each sensor's inertial frame
            (gravity included): its triangular window, of half-width one frame, ends only here. Zero where not valid.
        acceleration_valid: ``(S,)`` whether all of that window was measured.
        video: what has become available since the frame before; each with its own frame, this one or an earlier one
            within the lag. A frame may get several, of several cameras or of a fast one.
        restart: whether frames have been left out before this one: track anew from here.
    """

    frame: int
    time: float
    R_inertial_sensor: Array
    orientation_valid: np.ndarray
    specific_force_inertial: Array
    acceleration_valid: np.ndarray
    video: tuple[PlacedVideoFrame, ...] = ()
    restart: bool = False
