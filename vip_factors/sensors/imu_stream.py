"""The samples of one IMU, on its own clock and at its own rate.

Which times samples may have, and orientation from specific force and angular rate where none was fused on board.
"""

from dataclasses import dataclass, replace

import numpy as np

from vip_factors.display import Summarised
from vip_factors.errors import RecordingError
from vip_factors.geometry.quaternions import Order, interpolate_points, interpolate_rotations, matrix_from_quaternion
from vip_factors.geometry.rotations import Array

GAP_FACTOR = 1.5  # a step longer than this many sample periods is a gap: half a period of jitter is common
ROTATION_TOLERANCE = 1e-3  # of RᵀR from the identity: beyond it the matrix was never a rotation
FORCE_LIMIT = 400.0  # m/s²: above the ±16 g (157 m/s²) or even ±32 g range of body-worn IMUs
RATE_LIMIT = 70.0  # rad/s: the widest gyroscopes measure 4000 °/s; more means degrees per second
SPIKES = 0.01  # of the samples: fewer beyond a limit are blows or broken packets, more another unit


@dataclass(frozen=True, repr=False)
class ImuStream(Summarised):
    """Samples of one body-worn sensor; anything it does not measure is None. Without samples it is a name alone.

    Attributes:
        name: of the sensor, unique in its recording.
        time: ``(N,)`` seconds from the recording's start, strictly increasing; lost samples are simply absent.
        specific_force: ``(N, 3)`` m/s² in the sensor frame, gravity included (a resting sensor reads +9.81 up). Single
            samples beyond :data:`FORCE_LIMIT` are not measured: what stands there is interpolated.
        R_inertial_sensor: ``(N, 3, 3)`` orientation in this sensor's own inertial frame, whose z is up.
        angular_rate: ``(N, 3)`` rad/s in the sensor frame.
        force_measured: ``(N,)`` whether specific force was measured, or was beyond the accelerometer's range say; None
            if it was all along.
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
            return  # a sensor by its name: nothing is measured yet, as in the head of a stream
        if N == 0:
            raise RecordingError(f"sensor '{self.name}' has no samples: leave it out or check its file")
        check_times(self.time, f"sensor '{self.name}'")
        for label, values, shape in (
            ("specific force", self.specific_force, (N, 3)),
            ("orientation", self.R_inertial_sensor, (N, 3, 3)),
            ("angular rate", self.angular_rate, (N, 3)),
            ("whether force was measured", self.force_measured, (N,)),
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
            most = np.max(np.abs(self.specific_force), axis=1)
            beyond = force_spikes(self.specific_force)
            if not np.any(beyond):
                raise RecordingError(
                    f"sensor '{self.name}': specific force of {most.max():.3g} m/s² at sample {int(most.argmax())}: "
                    f"expected at most {FORCE_LIMIT:g}; check the unit (m/s², not g or mg)"
                )
            force = interpolate_points(self.time[~beyond], self.specific_force[~beyond], self.time)
            object.__setattr__(self, "specific_force", force)
            object.__setattr__(self, "force_measured", self.force_measured_mask & ~beyond)
        if self.R_inertial_sensor is not None:
            R = self.R_inertial_sensor
            error = np.abs(np.einsum("nji,njk->nik", R, R) - np.eye(3)).max(axis=(1, 2))
            error = np.where(np.linalg.det(R) > 0, error, 2.0)  # a mirror is orthogonal, but no rotation
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
        """A stream from raw samples: those with a value that is not finite, a single angular rate beyond a gyroscope's
        range, or a time no clock shows, are dropped and become gaps.

        Raises:
            RecordingError: if nothing is left, and as the constructor does.
        """
        good = usable_times(time)
        for values in (specific_force, R_inertial_sensor, angular_rate):
            if values is None:
                continue
            if len(values) != len(time):
                return cls(name, time, specific_force, R_inertial_sensor, angular_rate)  # it says which and how long
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
        """Samples per second: one over the median step (0 for a single sample)."""
        return rate_of(self.time)

    @property
    def force_measured_mask(self) -> np.ndarray:
        """``(N,)`` whether specific force was measured."""
        everywhere = np.full(len(self), self.specific_force is not None)
        return everywhere if self.force_measured is None else everywhere & self.force_measured

    @property
    def gaps(self) -> Array:
        """Start and end ``(G, 2)`` in seconds of the stretches without samples."""
        return gaps_of(self.time)

    def cut(self, start: float, end: float) -> "ImuStream":
        """Samples with ``start <= time <= end``, still on the recording's clock."""
        inside = (self.time >= start) & (self.time <= end)
        measured = {name: values[inside] for name, values in vars(self).items() if isinstance(values, np.ndarray)}
        return replace(self, **measured)  # type: ignore[arg-type]  # all but the name


def force_spikes(specific_force: Array) -> np.ndarray:
    """Which samples ``(N, 3)`` m/s² are beyond any range; none of them where many are, for then the unit is another."""
    beyond = np.max(np.abs(specific_force), axis=1) > FORCE_LIMIT
    return beyond & (np.mean(beyond) <= SPIKES)


def rate_spikes(angular_rate: Array) -> np.ndarray:
    """Which samples ``(N, 3)`` rad/s are beyond any range; none where many are fast, for then these are degrees."""
    most = np.max(np.abs(angular_rate), axis=1)
    return (most > RATE_LIMIT) & (np.mean(most > RATE_LIMIT / 2) <= SPIKES)


def rotations_of(orientation: Array) -> Array:
    """Rotations ``(N, 3, 3)`` of such, or of unit quaternions w, x, y, z ``(N, 4)``; NaN where a quaternion is none."""
    if orientation.ndim != 2 or orientation.shape[1] != 4:
        return orientation  # a stream says what is wrong with it
    finite = np.all(np.isfinite(orientation), axis=1)
    R = np.full((len(orientation), 3, 3), np.nan)
    R[finite] = matrix_from_quaternion(orientation[finite], Order.WXYZ)
    return R


def rate_of(time: Array) -> float:
    """Samples per second of samples at times ``(N,)``: one over the median step (0 for a single sample)."""
    return float(1 / np.median(np.diff(time))) if len(time) > 1 else 0.0


def gaps_of(time: Array) -> Array:
    """Start and end ``(G, 2)`` of the stretches without samples, of samples at times ``(N,)``, in seconds."""
    wide = np.flatnonzero(np.diff(time) > GAP_FACTOR / rate_of(time)) if len(time) > 1 else np.zeros(0, int)
    return np.stack([time[wide], time[wide + 1]], axis=1)


LATEST_S = 4e9  # 127 years: seconds since 1970 are less, and together with such a start they fit into nanoseconds


def usable_times(time: Array) -> np.ndarray:
    """Which of some times, in seconds from a recording's start or since 1970, a clock can have shown."""
    return np.asarray(np.abs(time) <= LATEST_S)  # NaN is not


def check_times(time: Array, whose: str) -> None:
    """Times ``(N,)`` in seconds, one after the other.

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


# Over a longer gap the turn about the vertical is a guess, and no later sample undoes it. In one second a limb can turn
# by any angle, but packets lost by radio come back sooner.
LONGEST_GAP_S = 1.0
TILT_TIME_S = 3.0  # over which gravity corrects the tilt: the value VQF was tuned to on human motion


def with_orientation(stream: ImuStream) -> ImuStream:
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
    specific_force, angular_rate = _checked(stream)
    grid = np.linspace(stream.time[0], stream.time[-1], round((stream.time[-1] - stream.time[0]) * stream.rate) + 1)
    from vqf import offlineVQF

    estimate = offlineVQF(
        _rate_over_step(interpolate_points(stream.time, angular_rate, grid)),
        interpolate_points(stream.time, specific_force, grid),
        None,
        float(grid[1] - grid[0]),
        {"tauAcc": TILT_TIME_S},
    )
    R_inertial_sensor = matrix_from_quaternion(estimate["quat6D"], Order.WXYZ)
    return replace(stream, R_inertial_sensor=interpolate_rotations(grid, R_inertial_sensor, stream.time))


def _checked(stream: ImuStream) -> tuple[Array, Array]:
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
    """Orientation of one sensor while its samples arrive: VQF as :func:`with_orientation` has it, looking back only.

    Tilt is there with the first samples; what the gyroscope reads at rest is learnt in the first seconds, and until
    then the heading drifts more than it does afterwards.
    """

    def __init__(self) -> None:
        self._first: list[tuple[float, Array, Array]] = []

    def orientation(self, time: float, specific_force: Array, angular_rate: Array) -> Array | None:
        """``R_inertial_sensor`` ``(3, 3)`` at a sample: seconds, ``(3,)`` m/s², ``(3,)`` rad/s.

        None for a sample that is not newer than the one before. After a gap, or where time has stepped back, that is
        longer than a heading can be carried over, a new one begins.
        """
        rate_told_at = (1, 2, 8, 32)  # samples after which a stream's rate is looked at
        if self._first and abs(time - self._last[0]) > LONGEST_GAP_S:
            self._first = []
        if self._first and time <= self._last[0]:
            return None
        if len(self._first) < max(rate_told_at):
            self._first.append((time, specific_force, angular_rate))
            if len(self._first) in rate_told_at:
                self._begin()
                return self._estimated()
        self._take(time, specific_force, angular_rate)
        return self._estimated()

    def _begin(self) -> None:
        """All samples so far, now that the step between them is better known."""
        from vqf import VQF

        self._step = float(np.median(np.diff([time for time, _, _ in self._first]))) if len(self._first) > 1 else 0.01
        self._filter = VQF(self._step, tauAcc=TILT_TIME_S)
        self._last = self._first[0][0] - self._step, self._first[0][2]
        for sample in self._first:
            self._take(*sample)

    def _take(self, time: float, specific_force: Array, angular_rate: Array) -> None:
        before, rate = self._last
        turned = (rate + angular_rate) / 2 * ((time - before) / self._step)  # as much as in the real step
        self._filter.update(np.ascontiguousarray(turned), np.ascontiguousarray(specific_force))
        self._last = time, angular_rate

    def _estimated(self) -> Array:
        return matrix_from_quaternion(self._filter.getQuat6D(), Order.WXYZ)


def _rate_over_step(angular_rate: Array) -> Array:
    """Mean rate ``(N, 3)`` over the step before each sample: VQF turns by rate times step from one to the next.

    By the sample's own rate instead, orientation would run half a step ahead of its time.
    """
    return np.concatenate([angular_rate[:1], (angular_rate[:-1] + angular_rate[1:]) / 2])
