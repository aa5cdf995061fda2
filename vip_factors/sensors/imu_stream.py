"""Samples of one IMU at its own rate, checks of their times and units, and orientation from force and angular rate."""

from dataclasses import dataclass, replace

import numpy as np

from vip_factors.display import Summarised
from vip_factors.errors import RecordingError
from vip_factors.geometry.quaternions import Order, interpolate_points, interpolate_rotations, matrix_from_quaternion
from vip_factors.geometry.rotations import Array

GAP_FACTOR = 1.5  # sample periods; longer steps are gaps: half a period of jitter is common
ROTATION_TOLERANCE = 1e-3  # of RᵀR from the identity
FORCE_LIMIT = 400.0  # m/s²: above the ±16 g (157 m/s²) or even ±32 g range of body-worn IMUs
RATE_LIMIT = 70.0  # rad/s: the widest gyroscopes measure 4000 °/s; more means degrees per second
SPIKES = 0.01  # share of samples beyond a limit up to which these are blows or broken packets, not another unit


@dataclass(frozen=True, repr=False)
class ImuStream(Summarised):
    """Samples of one body-worn sensor; quantities that it does not measure are None.

    Attributes:
        name: of the sensor, unique in its recording.
        time: ``(N,)`` seconds from the recording's start, strictly increasing; lost samples are absent.
        specific_force: ``(N, 3)`` m/s² in the sensor frame, gravity included (a resting sensor reads +9.81 up). Single
            samples beyond :data:`FORCE_LIMIT` are interpolated and count as not measured.
        R_inertial_sensor: ``(N, 3, 3)`` orientation in the sensor's inertial frame, whose z is up.
        angular_rate: ``(N, 3)`` rad/s in the sensor frame.
        force_measured: ``(N,)`` mask of measured specific forces (within the accelerometer's range); None if all are.
    """

    name: str
    time: Array
    specific_force: Array | None = None
    R_inertial_sensor: Array | None = None
    angular_rate: Array | None = None
    force_measured: np.ndarray | None = None

    def __post_init__(self) -> None:
        N = len(self.time)
        if N == 0 and self.specific_force is None and self.R_inertial_sensor is None:
            return  # a sensor without samples yet, as in the head of a stream
        if N == 0:
            raise RecordingError(f"sensor '{self.name}' has no samples: leave it out or check its file")
        check_times(self.time, f"sensor '{self.name}'")
        for label, values, shape in (
            ("specific force", self.specific_force, (N, 3)),
            ("orientation", self.R_inertial_sensor, (N, 3, 3)),
            ("angular rate", self.angular_rate, (N, 3)),
            ("mask of measured forces", self.force_measured, (N,)),
        ):
            if values is None:
                continue
            if values.shape != shape:
                raise RecordingError(f"sensor '{self.name}': {label} has shape {values.shape}: expected {shape}")
            if not np.all(np.isfinite(values)):
                row = int(np.argwhere(~np.isfinite(values))[0][0])
                raise RecordingError(
                    f"sensor '{self.name}': {label} of sample {row} (t = {self.time[row]:.3f} s) is not finite: "
                    "drop such samples (ImuStream.from_samples does)"
                )
        self._check_values()
        if self.specific_force is None and self.R_inertial_sensor is None:
            raise RecordingError(f"sensor '{self.name}' measures neither orientation nor specific force")

    def _check_values(self) -> None:
        if self.specific_force is not None and np.max(np.abs(self.specific_force)) > FORCE_LIMIT:
            magnitude = np.max(np.abs(self.specific_force), axis=1)
            is_spike = force_spikes(self.specific_force)
            if not np.any(is_spike):
                row = int(magnitude.argmax())
                raise RecordingError(
                    f"sensor '{self.name}': specific force of {magnitude[row]:.3g} m/s² at sample {row}: "
                    f"expected at most {FORCE_LIMIT:g}; check the unit (m/s², not g or mg)"
                )
            force = interpolate_points(self.time[~is_spike], self.specific_force[~is_spike], self.time)
            object.__setattr__(self, "specific_force", force)
            object.__setattr__(self, "force_measured", self.force_measured_mask & ~is_spike)
        if self.R_inertial_sensor is not None:
            error = rotation_errors(self.R_inertial_sensor)
            if np.max(error) > ROTATION_TOLERANCE:
                row = int(np.argmax(error))
                raise RecordingError(f"sensor '{self.name}': orientation of sample {row} is not a rotation matrix")

    @classmethod
    def from_samples(
        cls,
        name: str,
        time: Array,
        specific_force: Array | None = None,
        R_inertial_sensor: Array | None = None,
        angular_rate: Array | None = None,
    ) -> "ImuStream":
        """Make a stream from raw samples; unusable ones are dropped and become gaps.

        Unusable are values that are not finite, single angular rates beyond a gyroscope's range, and impossible times.

        Raises:
            RecordingError: if no sample is usable, and as the constructor does.
        """
        good = usable_times(time)
        for values in (specific_force, R_inertial_sensor, angular_rate):
            if values is None:
                continue
            if len(values) != len(time):
                return cls(name, time, specific_force, R_inertial_sensor, angular_rate)  # raises a precise error
            good &= np.all(np.isfinite(values), axis=tuple(range(1, values.ndim)))
        if angular_rate is not None:
            good &= ~rate_spikes(angular_rate)
        if not np.any(good):
            raise RecordingError(f"sensor '{name}': none of its {len(time)} samples is finite")
        measured = (specific_force, R_inertial_sensor, angular_rate)
        return cls(name, time[good], *(None if values is None else values[good] for values in measured))

    def __len__(self) -> int:
        return len(self.time)

    @property
    def rate(self) -> float:
        """Samples per second, from the median step (0 for a single sample)."""
        return rate_of(self.time)

    @property
    def force_measured_mask(self) -> np.ndarray:
        """Mask ``(N,)`` of measured specific forces."""
        everywhere = np.full(len(self), self.specific_force is not None)
        return everywhere if self.force_measured is None else everywhere & self.force_measured

    @property
    def gaps(self) -> Array:
        """Start and end ``(G, 2)`` of gaps in seconds."""
        return gaps_of(self.time)

    def cut(self, start: float, end: float) -> "ImuStream":
        """Select samples with ``start <= time <= end``; times are unchanged."""
        inside = (self.time >= start) & (self.time <= end)
        measured = {name: values[inside] for name, values in vars(self).items() if isinstance(values, np.ndarray)}
        return replace(self, **measured)  # type: ignore[arg-type]  # all but the name


def rotation_errors(R: Array) -> Array:
    """Largest difference ``(N,)`` of RᵀR from the identity; 2 for a reflection, which is orthogonal but no rotation."""
    error = np.abs(np.einsum("nji,njk->nik", R, R) - np.eye(3)).max(axis=(1, 2))
    return np.where(np.linalg.det(R) > 0, error, 2.0)


def force_spikes(specific_force: Array) -> np.ndarray:
    """Mask of samples ``(N, 3)`` m/s² beyond any accelerometer's range; none if many are: the unit is wrong then."""
    exceeds_limit = np.max(np.abs(specific_force), axis=1) > FORCE_LIMIT
    return exceeds_limit & (np.mean(exceeds_limit) <= SPIKES)


def rate_spikes(angular_rate: Array) -> np.ndarray:
    """Mask of samples ``(N, 3)`` rad/s beyond any gyroscope's range; none if many are fast: these are degrees then."""
    magnitude = np.max(np.abs(angular_rate), axis=1)
    return (magnitude > RATE_LIMIT) & (np.mean(magnitude > RATE_LIMIT / 2) <= SPIKES)


def rotations_of(orientation: Array, order: Order = Order.WXYZ) -> Array:
    """Convert unit quaternions ``(N, 4)`` to rotations ``(N, 3, 3)``; NaN stays NaN, rotations unchanged."""
    if orientation.ndim != 2 or orientation.shape[1] != 4:
        return orientation  # the stream checks its shape
    finite = np.all(np.isfinite(orientation), axis=1)
    R = np.full((len(orientation), 3, 3), np.nan)
    R[finite] = matrix_from_quaternion(orientation[finite], order)
    return R


def rate_of(time: Array) -> float:
    """Samples per second from times ``(N,)``: one over the median step (0 for a single sample)."""
    return float(1 / np.median(np.diff(time))) if len(time) > 1 else 0.0


def gaps_of(time: Array) -> Array:
    """Start and end ``(G, 2)`` of the gaps between samples at times ``(N,)``, in seconds."""
    wide = np.flatnonzero(np.diff(time) > GAP_FACTOR / rate_of(time)) if len(time) > 1 else np.zeros(0, int)
    return np.stack([time[wide], time[wide + 1]], axis=1)


LATEST_S = 4e9  # 127 years: above seconds since 1970, and small enough for nanoseconds in 64 bits


def runs(is_inside: np.ndarray) -> np.ndarray:
    """First index and the one after the last ``(n, 2)`` of each stretch of a mask ``(N,)``."""
    return np.flatnonzero(np.diff(np.r_[False, is_inside, False].astype(int))).reshape(-1, 2)


def low_passed(values: Array, rate: float, cut_hz: float) -> Array:
    """Values ``(T, …)`` without what is quicker, nowhere delayed; as they are if there is nothing quicker in them."""
    from scipy.signal import butter, sosfiltfilt  # late: it takes long to import

    shortest = 16  # frames: the filter runs in over fewer, at both ends
    if cut_hz >= 0.5 * rate or len(values) < shortest:
        return values
    return np.asarray(sosfiltfilt(butter(2, cut_hz, fs=rate, output="sos"), values, axis=0))


def usable_times(time: Array) -> np.ndarray:
    """Mask of possible times, in seconds from a recording's start or since 1970."""
    return np.asarray(np.abs(time) <= LATEST_S)  # NaN is not


def check_times(time: Array, whose: str) -> None:
    """Check that times ``(N,)`` in seconds are possible and increasing.

    Raises:
        RecordingError: if one is not finite or beyond :data:`LATEST_S`, or if they do not increase strictly.
    """
    usable = usable_times(time)
    if not np.all(usable):
        row = int(np.argmin(usable))
        raise RecordingError(
            f"{whose}: sample {row} has a time of {time[row]:.4g} s: expected seconds from the recording's start"
        )
    backwards = np.flatnonzero(np.diff(time) <= 0)
    if len(backwards):
        row = int(backwards[0]) + 1
        raise RecordingError(
            f"{whose}: time goes from {time[row - 1]:.4f} s to {time[row]:.4f} s at sample {row}: expected strictly "
            "increasing times; sort the samples and drop duplicates"
        )


LONGEST_GAP_S = 1.0  # longer gaps lose the heading; packets lost by radio are shorter
TILT_TIME_S = 3.0  # VQF's time constant of the tilt correction, as tuned to human motion


def with_orientation(stream: ImuStream) -> ImuStream:
    """Estimate ``R_inertial_sensor`` of a stream that lacks it.

    Offline VQF without magnetometer (Laidig & Seel, Information Fusion 91, 2023): the inertial frame has its z up and
    an arbitrary heading. Samples are interpolated to an even grid first, across short gaps; the result has the times
    of the stream. Angular rate and specific force are taken as instantaneous values.

    Raises:
        RecordingError: if specific force or angular rate is missing, angular rate is implausible, there is only one
            sample, or a gap is too long.
    """
    if stream.R_inertial_sensor is not None:
        return stream
    specific_force, angular_rate = _checked_input(stream)
    grid = np.linspace(stream.time[0], stream.time[-1], round((stream.time[-1] - stream.time[0]) * stream.rate) + 1)
    rate = interpolate_points(stream.time, angular_rate, grid)
    from vqf import offlineVQF

    estimate = offlineVQF(
        np.concatenate([rate[:1], (rate[:-1] + rate[1:]) / 2]),  # mean over the step before each sample
        interpolate_points(stream.time, specific_force, grid),
        None,
        float(grid[1] - grid[0]),
        {"tauAcc": TILT_TIME_S},
    )
    R_inertial_sensor = matrix_from_quaternion(estimate["quat6D"], Order.WXYZ)
    return replace(stream, R_inertial_sensor=interpolate_rotations(grid, R_inertial_sensor, stream.time))


def _checked_input(stream: ImuStream) -> tuple[Array, Array]:
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
        if end - start > LONGEST_GAP_S:
            raise RecordingError(
                f"sensor '{name}' lost {end - start:.2f} s of samples at t = {start:.2f} s: its heading cannot be "
                f"carried over more than {LONGEST_GAP_S:g} s; cut the recording there (--end-s {start:.2f}, or "
                f"--start-s {end:.2f}), or export orientations"
            )
    return stream.specific_force, stream.angular_rate


class AttitudeFilter:
    """Causal counterpart of :func:`with_orientation` for one sensor of a stream.

    The heading drifts more in the first seconds, until the gyroscope's bias is estimated.
    """

    def __init__(self) -> None:
        self._first: list[tuple[float, Array, Array]] = []

    def orientation(self, time: float, specific_force: Array, angular_rate: Array) -> Array | None:
        """Add a sample (seconds, ``(3,)`` m/s², ``(3,)`` rad/s) and return ``R_inertial_sensor`` ``(3, 3)``.

        None for a sample that is not newer than the previous one. A gap or a step back in time longer than
        :data:`LONGEST_GAP_S` restarts the filter with a new heading.
        """
        rate_updates = (1, 2, 8, 32)  # numbers of samples after which the rate is estimated
        if self._first and abs(time - self._last[0]) > LONGEST_GAP_S:
            self._first = []
        if self._first and time <= self._last[0]:
            return None
        if len(self._first) < max(rate_updates):
            self._first.append((time, specific_force, angular_rate))
            if len(self._first) in rate_updates:
                self._begin()
                return self._orientation()
        self._take(time, specific_force, angular_rate)
        return self._orientation()

    def _begin(self) -> None:
        """Restart the filter on all samples so far, with a better estimate of the step."""
        from vqf import VQF

        self._step = float(np.median(np.diff([time for time, _, _ in self._first]))) if len(self._first) > 1 else 0.01
        self._filter = VQF(self._step, tauAcc=TILT_TIME_S)
        self._last = self._first[0][0] - self._step, self._first[0][2]
        for sample in self._first:
            self._take(*sample)

    def _take(self, time: float, specific_force: Array, angular_rate: Array) -> None:
        previous_time, rate = self._last
        turned = (rate + angular_rate) / 2 * ((time - previous_time) / self._step)  # scaled to the nominal step
        self._filter.update(np.ascontiguousarray(turned), np.ascontiguousarray(specific_force))
        self._last = time, angular_rate

    def _orientation(self) -> Array:
        return matrix_from_quaternion(self._filter.getQuat6D(), Order.WXYZ)
