"""The true initial pose, as the thesis means it: mountings read off the first frame (eq. 3.3)."""

from dataclasses import replace

import numpy as np

from vip_factors.errors import InputError
from vip_factors.evaluate.frames import resample
from vip_factors.geometry.rotations import rotation_z, transpose
from vip_factors.sensors.calibration import SensorCalibration
from vip_factors.sensors.recording import Recording, Truth


def calibrated_at_first_frame(recording: Recording) -> Recording:
    """The recording with the calibration that its true first pose and true headings give.

    ``R_bone_sensor = R_world_boneᵀ Rz(γ) R_inertial_sensor`` at each sensor's first sample. Unlike the simulator's own
    mountings these carry the errors of the attitude filter and of soft tissue in that moment.

    Raises:
        InputError: if the recording has no truth with a calibration, or a sensor no orientation.
    """
    truth = recording.truth
    if truth is None or truth.calibration is None:
        raise InputError(f"recording '{recording.name}' has no true motion and headings: expected a simulated one")
    calibration = {}
    for site in (recording.placement.site(name) for name in recording.placed):
        stream = recording.imus[site.sensor]
        if stream.R_inertial_sensor is None:
            raise InputError(f"sensor '{site.sensor}' gives no orientation: the benchmark cannot calibrate it")
        time = float(np.clip(stream.time[0], truth.motion.time[0], truth.motion.time[-1]))
        R_world_bone = resample(truth.motion, time, truth.motion.rate, 1).state.R_world_bone[0, site.bone_index]
        heading = truth.calibration[site.sensor].heading
        R_world_sensor = rotation_z(heading) @ stream.R_inertial_sensor[0]
        calibration[site.sensor] = SensorCalibration(heading, transpose(R_world_bone) @ R_world_sensor)
    return replace(recording, truth=Truth(truth.motion, calibration))
