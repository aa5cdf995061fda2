"""Orientation from specific force and angular rate, for sensors that do not fuse on board."""

from dataclasses import dataclass, replace

import numpy as np

from vip_factors.errors import RecordingError
from vip_factors.geometry.quaternions import Order, interpolate_rotations, matrix_from_quaternion
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.imu_stream import ImuStream

RATE_LIMIT = 70.0  # rad/s: the widest gyroscopes measure 4000 °/s; more means degrees per second


@dataclass(frozen=True)
class AttitudeSettings:
    """How a stream's orientation is found.

    Attributes:
        longest_gap: seconds; over a longer gap the turn about the vertical is a guess, and no later sample undoes it.
            In one second a limb can turn by any angle, but packets lost by radio come back sooner.
        tilt_time: seconds over which gravity corrects the tilt; 3 s is the value VQF was tuned to on human motion.
    """

    longest_gap: float = 1.0
    tilt_time: float = 3.0


def with_orientation(stream: ImuStream, settings: AttitudeSettings | None = None) -> ImuStream:
    """The stream with ``R_inertial_sensor`` filled in; one that has it already comes back as it is.

    Both directions of time are used (offline VQF: Laidig & Seel, Information Fusion 91, 2023) and no magnetometer,
    so the inertial frame has its z up and an arbitrary heading. Samples are laid onto an even grid first, and what
    short gaps lost is interpolated; the times of the stream stay. Angular rate is taken as measured at its time, as
    specific force is: where both are means over the step before, the orientation is half a step late with them.

    Raises:
        RecordingError: if specific force or angular rate is missing, angular rate is implausible, there is but
            one sample, or a gap is too long to carry the heading across.
    """
    if stream.R_inertial_sensor is not None:
        return stream
    settings = settings or AttitudeSettings()
    specific_force, angular_rate = _checked(stream, settings)
    grid = np.linspace(stream.time[0], stream.time[-1], round((stream.time[-1] - stream.time[0]) * stream.rate) + 1)
    from vqf import offlineVQF

    estimate = offlineVQF(
        _rate_over_step(_resample(stream.time, angular_rate, grid)),
        _resample(stream.time, specific_force, grid),
        None,
        float(grid[1] - grid[0]),
        {"tauAcc": settings.tilt_time},
    )
    R_inertial_sensor = matrix_from_quaternion(estimate["quat6D"], Order.WXYZ)
    return replace(stream, R_inertial_sensor=interpolate_rotations(grid, R_inertial_sensor, stream.time))


def _checked(stream: ImuStream, settings: AttitudeSettings) -> tuple[Array, Array]:
    name = stream.name
    if stream.angular_rate is None or stream.specific_force is None:
        missing = "angular rate" if stream.angular_rate is None else "specific force"
        raise RecordingError(
            f"sensor '{name}' has neither orientation nor {missing}: its orientation needs both specific force and "
            f"angular rate; export {missing} or the orientation too"
        )
    if len(stream) < 2:
        raise RecordingError(f"sensor '{name}' has a single sample: expected at least two to find its orientation")
    fastest = float(np.max(np.abs(stream.angular_rate)))
    if fastest > RATE_LIMIT:
        raise RecordingError(
            f"sensor '{name}': angular rate of {fastest:.3g} rad/s: expected at most {RATE_LIMIT:g}; "
            "check the unit (rad/s, not degrees per second)"
        )
    for start, end in stream.gaps:
        if end - start > settings.longest_gap:
            raise RecordingError(
                f"sensor '{name}' lost {end - start:.2f} s of samples at t = {start:.2f} s: its heading cannot be "
                f"carried over more than {settings.longest_gap:g} s; cut the recording there, or export orientations"
            )
    return stream.specific_force, stream.angular_rate


def _rate_over_step(angular_rate: Array) -> Array:
    """Mean rate ``(N, 3)`` over the step before each sample: VQF turns by rate times step from one to the next.

    By the sample's own rate instead, orientation would run half a step ahead of its time.
    """
    return np.concatenate([angular_rate[:1], (angular_rate[:-1] + angular_rate[1:]) / 2])


def _resample(time: Array, values: Array, grid: Array) -> Array:
    return np.stack([np.interp(grid, time, column) for column in values.T], axis=1)
