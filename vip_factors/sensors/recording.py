"""Recording of one wearer: subject, placement and sensor streams."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from vip_factors.body.anthropometry import LengthPrior, LikelyBody, likely_body
from vip_factors.body.joint_priors import HingeEstimate, HingePrior
from vip_factors.body.kinematics import Motion
from vip_factors.body.lengths import BodyVariation
from vip_factors.body.skeleton import JOINT_NAMES, Skeleton
from vip_factors.display import Summarised
from vip_factors.errors import InputError, RecordingError
from vip_factors.sensors.calibration import Calibration, Placement, placement_of
from vip_factors.sensors.imu_stream import ImuStream, rotations_of, with_orientation

DEFAULT_STATURE_M = 1.72  # for sensor positions in logs without a stature


@dataclass(frozen=True, repr=False)
class Subject(Summarised):
    """The person who wears the sensors.

    Attributes:
        name: unique in a recording.
        stature_m: height in metres; None if unknown.
        mass_kg, sex, segment_lengths_m: optional, as in :func:`~vip_factors.body.anthropometry.likely_body`.
        skeleton: a given skeleton, from an SMPL file for example; replaces all of the above.
        length_prior: uncertainty of the skeleton's lengths if it was estimated; None if it is exact.
        hinges: earlier estimates of the axes of elbows and knees.
    """

    name: str = "subject"
    stature_m: float | None = None
    mass_kg: float | None = None
    sex: str | None = None
    segment_lengths_m: Mapping[str, float] = field(default_factory=dict)
    skeleton: Skeleton | None = None
    length_prior: LengthPrior | None = None
    hinges: tuple[HingeEstimate, ...] = ()

    def body(self) -> Skeleton:
        """Return the subject's skeleton: the given one, or the likeliest for stature, sex, mass and lengths.

        Raises:
            InputError: for an implausible stature, mass, segment or sex.
        """
        return self.skeleton if self.skeleton is not None else self._likely().skeleton

    def variation(self) -> BodyVariation | None:
        """Return the prior over changes of :meth:`body`; None if the skeleton is exact."""
        if self.length_prior is not None:
            return self.length_prior.variation(self.body())
        return None if self.skeleton is not None else self._likely().variation

    def hinge_prior(self) -> HingePrior:
        """Return the prior over the axes of elbows and knees."""
        return HingePrior.about(self.hinges)

    @property
    def body_note(self) -> str:
        """Sentence about a doubtful body (unknown stature, a child's stature), or an empty string."""
        return "" if self.skeleton is not None else self._likely().note

    def _likely(self) -> LikelyBody:
        return likely_body(self.stature_m, self.sex, self.segment_lengths_m, self.mass_kg)


@dataclass(frozen=True, repr=False)
class Truth(Summarised):
    """Reference motion and calibration from a simulator or an optical system.

    Attributes:
        motion: of all 24 joints.
        calibration: of the sensors, if known.
        known_bones: names of the bones whose motion is measured; None: all. Others (limbs without a sensor in an
            inertial motion) are not evaluated.
    """

    motion: Motion
    calibration: Calibration | None = None
    known_bones: frozenset[str] | None = None

    def __post_init__(self) -> None:
        unknown = sorted((self.known_bones or frozenset()) - set(JOINT_NAMES))
        if unknown:
            raise RecordingError(f"truth with unknown bones {', '.join(unknown)}: expected names of SMPL joints")


@dataclass(frozen=True)
class Pause:
    """Time without samples: start and end in seconds, and the silent sensors."""

    start: float
    end: float
    silent: frozenset[str]


@dataclass(frozen=True, repr=False)
class Recording(Summarised):
    """Everything measured in one session of one wearer.

    Attributes:
        name: of the session.
        subject: the wearer.
        imus: one stream per sensor, by sensor name.
        placement: sites of the sensors; sensors without an entry are not used.
        initial_pose: declared pose at the start: ``"t-pose"``, ``"n-pose"`` or ``"none"``.
        truth: reference motion and calibration, if known.
        notes: free text, such as the origin of the file.
        start_ns: absolute time of t = 0 in nanoseconds, 0 if unknown.
        clock_s: time of t = 0 on the log's own clock, seconds.
        pauses: times without samples; headings may change during them.
    """

    name: str
    subject: Subject
    imus: Mapping[str, ImuStream]
    placement: Placement
    initial_pose: str = "none"
    truth: Truth | None = None
    notes: str = ""
    start_ns: int = 0
    clock_s: float = 0.0
    pauses: tuple[Pause, ...] = ()

    def __post_init__(self) -> None:
        for name, stream in self.imus.items():
            if name != stream.name:
                raise RecordingError(f"recording '{self.name}': stream '{stream.name}' has the key '{name}'")
        if self.initial_pose not in ("t-pose", "n-pose", "none"):
            raise RecordingError(
                f"recording '{self.name}': initial pose '{self.initial_pose}': expected t-pose, n-pose or none"
            )

    @classmethod
    def worn(
        cls,
        placement: Placement | Mapping[str, str] | str,
        subject: Subject | None = None,
        initial_pose: str = "none",
        name: str = "recording",
    ) -> "Recording":
        """Declare subject and placement without samples: the head of a stream.

        Args:
            placement: name of a preset (``"sip6"`` …), or site → sensor name.
            subject: the wearer; by default an adult of unknown stature.
            initial_pose: ``"t-pose"``, ``"n-pose"`` or ``"none"``.
            name: of the recording.

        Raises:
            InputError: for an unknown preset or site.
            RecordingError: for an unknown pose.
        """
        subject = subject or Subject()
        notes = subject.body_note
        return cls(name, subject, {}, placement_of(placement, subject.body()), initial_pose, notes=notes)

    @classmethod
    def from_arrays(
        cls,
        time: ArrayLike | Mapping[str, ArrayLike],
        *,
        orientation: Mapping[str, ArrayLike] | None = None,
        acceleration: Mapping[str, ArrayLike] | None = None,
        gyroscope: Mapping[str, ArrayLike] | None = None,
        placement: Placement | Mapping[str, str] | str | None = None,
        subject: Subject | None = None,
        initial_pose: str = "none",
        name: str = "recording",
    ) -> "Recording":
        """Make a recording from arrays by sensor name.

        Samples that are not finite become gaps. Missing orientations are computed from gyroscope and acceleration (VQF
        without magnetometer).

        Args:
            time: ``(N,)`` seconds, common to all sensors or by sensor.
            orientation: ``(N, 3, 3)`` R_inertial_sensor, in the sensor's inertial frame whose z is up, or ``(N, 4)``
                unit quaternions w, x, y, z.
            acceleration: ``(N, 3)`` m/s² in the sensor's axes, gravity included (a resting sensor reads +9.81 up).
            gyroscope: ``(N, 3)`` rad/s in the sensor's axes.
            placement: name of a preset, or site → sensor name; by default sensors have the names of their sites.
            subject: the wearer; by default an adult of unknown stature.
            initial_pose: declared pose at the start: ``"t-pose"``, ``"n-pose"`` or ``"none"``.
            name: of the recording.

        Raises:
            InputError: for an unknown preset or site, or a placed sensor without samples.
            RecordingError: for samples that cannot be used: shapes, units, times.
        """
        measured = [dict(values or {}) for values in (acceleration, orientation, gyroscope)]
        sensors = list(dict.fromkeys(sensor for values in measured for sensor in values))
        head = cls.worn(
            {sensor: sensor for sensor in sensors} if placement is None else placement, subject, initial_pose, name
        )
        absent = [site.sensor for site in head.placement.sites if site.sensor not in sensors]
        if absent:
            raise InputError(f"placed sensors without samples: {', '.join(absent)}; sensors are {', '.join(sensors)}")
        streams = {}
        for sensor in sensors:
            sensor_time = time.get(sensor) if isinstance(time, Mapping) else time
            if sensor_time is None:
                raise InputError(f"sensor '{sensor}' has no times: expected them by the sensors' names")
            force, R, rate = (np.asarray(values[sensor], float) if sensor in values else None for values in measured)
            R = None if R is None else rotations_of(R)
            streams[sensor] = with_orientation(
                ImuStream.from_samples(sensor, np.asarray(sensor_time, float), force, R, rate)
            )
        return replace(head, imus=streams)

    @property
    def placed(self) -> list[str]:
        """Names of the placed sensors that have samples, in the placement's order."""
        return [site.sensor for site in self.placement.sites if site.sensor in self.imus]

    def summary(self) -> list[str]:
        """Describe subject, sensors and duration."""
        rates = [stream.rate for stream in self.imus.values()]
        lasts = f", {self.interval[0]:.1f} to {self.interval[1]:.1f} s, {np.median(rates):.0f} Hz" if rates else ""
        return [
            f"recording '{self.name}'",
            f"subject: {self.subject.name}, initial pose {self.initial_pose}",
            f"sensors: {len(self.imus)}{lasts}",
            f"placed: {', '.join(self.placed or (site.sensor for site in self.placement.sites)) or 'none'}",
            f"truth: {'none' if self.truth is None else 'in it'}",
        ]

    @property
    def interval(self) -> tuple[float, float]:
        """Seconds of the first and last sample of any sensor."""
        if not self.imus:
            raise RecordingError(f"recording '{self.name}' has no IMU stream: expected at least one")
        streams = list(self.imus.values())
        return float(min(s.time[0] for s in streams)), float(max(s.time[-1] for s in streams))


def nothing_placed(name: str, imus: Iterable[str]) -> RecordingError:
    """Make the error for a recording without a usable sensor, given the sensors' names."""
    sensors = ", ".join(imus)
    if not sensors:
        return RecordingError(f"recording '{name}' holds no samples of any sensor: was its file cut off?")
    return RecordingError(
        f"recording '{name}': none of its sensors ({sensors}) is placed on the body: say where they sit, vip-factors "
        "convert RECORDING.mcap PLACED.mcap --placement PRESET or FILE.toml"
    )
