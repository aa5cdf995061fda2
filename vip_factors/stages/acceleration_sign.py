"""Accelerometers of the opposite sign: at rest they measure gravity, −9.81 m/s² upwards, instead of specific force.

The estimated vertical is upside down then, and all motion mirrored. Accelerations agree with rotations in the mirror as
well. Bodies do not: the left leg is left of the right one, and knees bend one way. How likely the start of headings and
mountings is therefore decides, as given against in the mirror.
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


def mirrored(stream: ImuStream) -> ImuStream:
    """The stream with specific force of the opposite sign, and the inertial frame turned over until it is upright."""
    force, R = stream.specific_force, stream.R_inertial_sensor
    return replace(
        stream,
        specific_force=None if force is None else -force,
        R_inertial_sensor=None if R is None else R_TURNED_OVER @ R,
    )


def is_sign_opposite(recording: Recording, settings: CommonSettings) -> bool:
    """Whether accelerations of the opposite sign explain a wearer's sensors much better.

    It is looked into where most sensors on trunk, thighs and shanks are upside down against their sites.
    """
    # Nats: sound recordings have 1 at most, with all straps upside down 5; 20 to 60 where the sign is wrong
    sure = 8.0
    names, streams = recording.placed, [recording.imus[name] for name in recording.placed]
    if len(names) < 2 or any(one.R_inertial_sensor is None or one.specific_force is None for one in streams):
        return False
    time = np.arange(max(one.time[0] for one in streams), min(one.time[-1] for one in streams), 1 / RATE)
    if len(time) < 2:
        return False
    frames = frames_of(recording.imus, names, time)
    if not frames.orientation_valid.any(axis=0).all() or not _are_upside_down(recording, frames):
        return False
    turned = replace(recording, imus={name: mirrored(one) for name, one in recording.imus.items()})
    other_frames = frames_of(turned.imus, names, time)
    _, given = find_start(recording, frames, settings, lambda _: None)
    _, other = find_start(turned, other_frames, settings, lambda _: None)
    return given is not None and other is not None and given.best.cost - other.best.cost > sure


def _are_upside_down(recording: Recording, frames: ImuFrames) -> bool:
    most, far = 0.7, -0.5  # of the sensors; cosine of the bone's long axis, as placed, to the vertical
    along = [
        _along_vertical(recording.placement.site(name).R_bone_sensor, frames, s)
        for s, name in enumerate(frames.sensors)
        if recording.placement.site(name).bone_index in UPRIGHT
    ]
    return bool(along) and float(np.mean(np.array(along) < far)) >= most


def _along_vertical(R_bone_sensor: Array, frames: ImuFrames, s: int) -> float:
    """Mean cosine of a bone's long axis to the vertical, were the sensor mounted so."""
    vertical = frames.R_inertial_sensor[frames.orientation_valid[:, s], s, 2]
    return float(np.mean(vertical @ R_bone_sensor[1]))
