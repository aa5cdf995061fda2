"""Detection of accelerometers with the opposite sign, which measure gravity at rest instead of specific force.

The estimated vertical is then upside down and the motion mirrored. Accelerations still agree with rotations, but the
body does not fit: left and right are exchanged and knees bend backwards. The likelihood of the best start (headings and
mountings) for the given and for the mirrored recording therefore decides.
"""

from dataclasses import replace

import numpy as np

from vip_factors.geometry.rotations import Array
from vip_factors.sensors.frames import ImuFrames
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.sources import frames_of
from vip_factors.settings import CommonSettings
from vip_factors.stages.calibration_start import UPRIGHT
from vip_factors.stages.inertial import find_start

RATE = 15.0  # Hz
R_TURNED_OVER = np.diag([1.0, -1.0, -1.0])


def mirror_stream(stream: ImuStream) -> ImuStream:
    """Negate the specific force and turn the inertial frame over, so that it is upright again."""
    force, R = stream.specific_force, stream.R_inertial_sensor
    return replace(
        stream,
        specific_force=None if force is None else -force,
        R_inertial_sensor=None if R is None else R_TURNED_OVER @ R,
    )


def is_sign_opposite(recording: Recording, settings: CommonSettings) -> bool:
    """Return True if accelerations of the opposite sign explain a wearer's sensors much better.

    Only checked if most sensors on trunk, thighs and shanks are upside down relative to their sites.
    """
    least_gain = 8.0  # nats: correct recordings gain 1 at most, 5 with all straps upside down; a wrong sign 20 to 60
    names, streams = recording.placed, [recording.imus[name] for name in recording.placed]
    if len(names) < 2 or any(stream.R_inertial_sensor is None or stream.specific_force is None for stream in streams):
        return False
    time = np.arange(max(stream.time[0] for stream in streams), min(stream.time[-1] for stream in streams), 1 / RATE)
    if len(time) < 2:
        return False
    frames = frames_of(recording.imus, names, time)
    if not frames.orientation_valid.any(axis=0).all() or not _are_upside_down(recording, frames):
        return False
    mirrored_recording = replace(
        recording, imus={name: mirror_stream(stream) for name, stream in recording.imus.items()}
    )
    other_frames = frames_of(mirrored_recording.imus, names, time)
    _, start = find_start(recording, frames, settings, lambda _: None)
    _, mirrored_start = find_start(mirrored_recording, other_frames, settings, lambda _: None)
    return start is not None and mirrored_start is not None and start.best.cost - mirrored_start.best.cost > least_gain


def _are_upside_down(recording: Recording, frames: ImuFrames) -> bool:
    least_share, largest_cosine = 0.7, -0.5  # of the sensors; of the bone's placed long axis to the vertical
    cosines = [
        _along_vertical(recording.placement.site(name).R_bone_sensor, frames, s)
        for s, name in enumerate(frames.sensors)
        if recording.placement.site(name).bone_index in UPRIGHT
    ]
    return bool(cosines) and float(np.mean(np.array(cosines) < largest_cosine)) >= least_share


def _along_vertical(R_bone_sensor: Array, frames: ImuFrames, s: int) -> float:
    """Mean cosine of a bone's long axis to the vertical for a given mounting."""
    vertical = frames.R_inertial_sensor[frames.orientation_valid[:, s], s, 2]
    return float(np.mean(vertical @ R_bone_sensor[1]))
