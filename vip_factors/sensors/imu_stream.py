"""The samples of one IMU, on its own clock and at its own rate."""

from dataclasses import dataclass, replace

import numpy as np

from vip_factors.errors import RecordingError
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.times import check_times, usable_times

GAP_FACTOR = 1.5  # a step longer than this many sample periods is a gap: half a period of jitter is common
ROTATION_TOLERANCE = 1e-3  # of RᵀR from the identity: beyond it the matrix was never a rotation
FORCE_LIMIT = 400.0  # m/s²: above the ±16 g (157 m/s²) or even ±32 g range of body-worn IMUs


@dataclass(frozen=True)
class ImuStream:
    """Samples of one body-worn sensor; anything it does not measure is None.

    Attributes:
        name: of the sensor, unique in its recording.
        time: ``(N,)`` seconds from the recording's start, strictly increasing; lost samples are simply absent.
        specific_force: ``(N, 3)`` m/s² in the sensor frame, gravity included (a resting sensor reads +9.81 up).
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
            row = int(np.argmax(np.max(np.abs(self.specific_force), axis=1)))
            raise RecordingError(
                f"sensor '{self.name}': specific force of {np.max(np.abs(self.specific_force)):.3g} m/s² at sample "
                f"{row}: expected at most {FORCE_LIMIT:g}; check the unit (m/s², not g or mg)"
            )
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
        """A stream from raw samples: those with a value that is not finite, or a time no clock shows, are dropped and
        become gaps.

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
        if not np.any(good):
            raise RecordingError(f"sensor '{name}': none of its {len(time)} samples is finite")

        def keep(values: Array | None) -> Array | None:
            return None if values is None else values[good]

        return cls(name, time[good], keep(specific_force), keep(R_inertial_sensor), keep(angular_rate))

    def __len__(self) -> int:
        return len(self.time)

    @property
    def rate(self) -> float:
        """Samples per second: one over the median step (0 for a single sample)."""
        return float(1 / np.median(np.diff(self.time))) if len(self) > 1 else 0.0

    @property
    def force_measured_mask(self) -> np.ndarray:
        """``(N,)`` whether specific force was measured."""
        everywhere = np.full(len(self), self.specific_force is not None)
        return everywhere if self.force_measured is None else everywhere & self.force_measured

    @property
    def gaps(self) -> Array:
        """Start and end ``(G, 2)`` in seconds of the stretches without samples."""
        step = np.diff(self.time)
        wide = np.flatnonzero(step > GAP_FACTOR / self.rate) if len(self) > 1 else np.zeros(0, int)
        return np.stack([self.time[wide], self.time[wide + 1]], axis=1)

    def cut(self, start: float, end: float) -> "ImuStream":
        """Samples with ``start <= time <= end``, still on the recording's clock."""
        inside = (self.time >= start) & (self.time <= end)

        def keep(values: Array | None) -> Array | None:
            return None if values is None else values[inside]

        return replace(
            self,
            time=self.time[inside],
            specific_force=keep(self.specific_force),
            R_inertial_sensor=keep(self.R_inertial_sensor),
            angular_rate=keep(self.angular_rate),
            force_measured=keep(self.force_measured),
        )
