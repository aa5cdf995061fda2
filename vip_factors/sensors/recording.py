"""A recording: who wore what, and what the sensors said."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from vip_factors.body.anthropometry import LengthPrior, LikelyBody, likely_body
from vip_factors.body.hinges import HingeEstimate, HingePrior
from vip_factors.body.kinematics import Motion
from vip_factors.body.lengths import BodyVariation
from vip_factors.body.skeleton import JOINT_NAMES, Skeleton
from vip_factors.errors import RecordingError
from vip_factors.sensors.calibration import Calibration, Placement
from vip_factors.sensors.imu_stream import ImuStream

DEFAULT_STATURE_M = 1.72  # of logs whose wearers nobody measured, for their sensors' places


@dataclass(frozen=True)
class Subject:
    """The person who wears the sensors.

    Attributes:
        name: unique in a recording.
        stature_m: height in metres; None if unknown.
        mass_kg, sex, segment_lengths_m: optional, as in :func:`~vip_factors.body.anthropometry.likely_body`.
        skeleton: a ready skeleton (from an SMPL file, say), which wins over everything above.
        length_prior: how far the lengths of that skeleton may be off, if it was found; None of one that is known.
        hinges: of elbows and knees, as they were found before.
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
        """The subject's skeleton: the one given, or the likeliest of what is known.

        Raises:
            InputError: for an implausible stature, mass, segment or sex.
        """
        return self.skeleton if self.skeleton is not None else self._likely().skeleton

    def variation(self) -> BodyVariation | None:
        """What is open about :meth:`body`; None of a skeleton that was given and is known.

        Raises:
            InputError: for an implausible stature, mass, segment or sex.
        """
        if self.length_prior is not None:
            return self.length_prior.variation(self.body())
        return None if self.skeleton is not None else self._likely().variation

    def hinge_prior(self) -> HingePrior:
        """What is likely of the axes of elbows and knees."""
        return HingePrior.about(self.hinges)

    @property
    def body_note(self) -> str:
        """A sentence on what is doubtful about the body, such as a stature that is unknown or a child's; or nothing.

        Raises:
            InputError: for an implausible stature, mass, segment or sex.
        """
        return "" if self.skeleton is not None else self._likely().note

    def _likely(self) -> LikelyBody:
        return likely_body(self.stature_m, self.sex, self.segment_lengths_m, self.mass_kg)


@dataclass(frozen=True)
class Truth:
    """What a simulator or an optical system knows: motion, and calibration if it does.

    Attributes:
        motion: of all 24 joints.
        calibration: of the sensors, if known.
        known_bones: names of the bones whose motion is known; None: all. What the rest does is a guess, and nothing to
            measure by: limbs without a sensor in the motion of an inertial system, say.
    """

    motion: Motion
    calibration: Calibration | None = None
    known_bones: frozenset[str] | None = None

    def __post_init__(self) -> None:
        unknown = sorted((self.known_bones or frozenset()) - set(JOINT_NAMES))
        if unknown:
            raise RecordingError(f"truth of unknown bones {', '.join(unknown)}: expected some of SMPL's")


@dataclass(frozen=True)
class Recording:
    """Everything measured in one session of one wearer.

    Attributes:
        name: of the session.
        subject: the wearer.
        imus: one stream per sensor, by sensor name.
        placement: where each sensor sits; sensors without an entry are not used.
        initial_pose: what the wearer declared to hold at the start: ``"t-pose"``, ``"n-pose"`` or ``"none"``.
        truth: reference motion and calibration, if known.
        notes: free text, such as the origin of the file.
        start_ns: absolute time of t = 0 in nanoseconds, 0 if unknown.
        restarts: seconds from and until of pauses after which headings are others, as far as is not known.
    """

    name: str
    subject: Subject
    imus: Mapping[str, ImuStream]
    placement: Placement
    initial_pose: str = "none"
    truth: Truth | None = None
    notes: str = ""
    start_ns: int = 0
    restarts: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        for name, stream in self.imus.items():
            if name != stream.name:
                raise RecordingError(f"recording '{self.name}': stream '{stream.name}' is filed under '{name}'")
        if self.initial_pose not in ("t-pose", "n-pose", "none"):
            raise RecordingError(
                f"recording '{self.name}': initial pose '{self.initial_pose}': expected t-pose, n-pose or none"
            )

    @property
    def placed(self) -> list[str]:
        """Names of the sensors that have both samples and a place on the body, in the placement's order."""
        return [site.sensor for site in self.placement.sites if site.sensor in self.imus]

    @property
    def interval(self) -> tuple[float, float]:
        """Seconds of the first and last sample of any sensor."""
        if not self.imus:
            raise RecordingError(f"recording '{self.name}' has no IMU stream: expected at least one")
        streams = list(self.imus.values())
        return float(min(s.time[0] for s in streams)), float(max(s.time[-1] for s in streams))


def nothing_placed(name: str, imus: Iterable[str]) -> RecordingError:
    """What to raise for a recording none of whose sensors can be used, given their names."""
    sensors = ", ".join(imus)
    if not sensors:
        return RecordingError(f"recording '{name}' holds no samples of any sensor: was its file cut off?")
    return RecordingError(
        f"recording '{name}': none of its sensors ({sensors}) is placed on the body: say where they sit, vip-factors "
        "convert RECORDING.mcap PLACED.mcap --placement PRESET or FILE.toml"
    )
