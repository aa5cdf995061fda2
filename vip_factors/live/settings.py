"""Settings of the fixed-lag tracker: those of the pipeline, and what only a stream needs, with reasons."""

from dataclasses import dataclass, field, fields

from vip_factors.associate.settings import AssociationSettings
from vip_factors.errors import InputError
from vip_factors.problem.variables import RELINEARISE_DEG, ProcessNoiseSettings
from vip_factors.ranges import NotNegative, NotNegativeInt
from vip_factors.settings import CalibrationSettings, CommonSettings, FusionSettings


@dataclass(frozen=True)
class AssemblySettings:
    """Waiting, silences, clocks; all in seconds of the stream's own time."""

    # Before the first frame: sensors switched on together have all begun by then (radio links take 0.1 s), and the
    # tracker wants a second of samples before its first pose anyway.
    settle: NotNegative = 0.5
    # A frame waits so long for a sensor that has fallen behind the others: three packets at 60 Hz, which is what
    # radio links repeat; a fifth of the lag of a quarter of a second. Sensors slower than 20 Hz need a longer one.
    patience: NotNegative = 0.05
    # A sensor's sample counts as arrived in order, once a sample so much newer has arrived: 0, because TCP, files and
    # drivers keep the order of each sensor. Of sources over UDP, one frame or more: all answers are so much later.
    reordering: NotNegative = 0.0
    # Without a sample for so long a sensor is no longer waited for: longer than a body blocks the radio (0.25 s).
    dead_after: float = 1.0
    # A silence of all sensors: after a longer one nobody knows where the wearers are, and tracking begins anew.
    longest_pause: float = 2.5
    # A step of a clock, between sources or ahead of all others, that no delay explains.
    jump: float = 1.0
    # A smaller one, of a sensor that was there: back behind its own newest sample, as packets seldom overtake one
    # another by more than three, or ahead of it and of all others. Less shows in nothing but the poses.
    step: float = 0.2

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            zero_allowed = one.name in ("settle", "reordering")
            if not (0 <= value < float("inf")) or (value == 0 and not zero_allowed):
                raise InputError(
                    f"assembly setting {one.name} = {value:g} s: expected a finite number, "
                    + ("0 or more" if zero_allowed else "above 0")
                )
        if not self.patience <= self.dead_after <= self.longest_pause:
            raise InputError(
                f"assembly settings: patience {self.patience:g} s, dead_after {self.dead_after:g} s and longest_pause "
                f"{self.longest_pause:g} s: expected each to be no longer than the next"
            )


@dataclass(frozen=True)
class RecalibrationSettings:
    """When a stream's calibration is found again from the data so far."""

    use: bool = True
    # s of data: a start of one second is 60–120 mm off on foreign scenes, and with two it is half as wrong.
    first_s: float = 2.5
    # of data, the most recent: headings of a minute ago are no longer today's. It is found again after as long.
    longest_s: float = 40.0
    # s of the stream between the last of that data and the first answer that has it, at least: on a core of its own one
    # wearer's takes a quarter of what it lasted or less. A replay waits, and gives the same answers on any machine.
    delay_s: NotNegative = 2.0
    # Constant headings: the tracker goes on from the last of them, and follows them by itself.
    calibration: CalibrationSettings = field(default_factory=lambda: CalibrationSettings(heading_drift_from_s=None))


@dataclass(frozen=True)
class RelinearisationSettings:
    """Which frames of the lag are linearised anew."""

    angle_deg: float = 1.0  # a joint that moved by less is linear to some thousandths
    length_m: float = 0.02
    shared_deg: float = RELINEARISE_DEG
    most: NotNegativeInt = 6  # frames at once, the newest: what an update may cost


@dataclass(frozen=True)
class LiveSettings(CommonSettings):
    """All settings of a live session."""

    # Kaichi's users and animators want answers within a blink.
    lag_s: float = 0.25
    """Seconds between the newest pose and the smoothed one."""
    # A step or a gesture shows where the sensors point.
    start_s: float = 1.0
    """Seconds of data before the first answer."""
    # A body does not show within the second that tracking begins with.
    calibration: CalibrationSettings = field(
        default_factory=lambda: CalibrationSettings(
            estimate_body=False,
            estimate_hinges=False,
            estimate_places=False,
            estimate_sole=False,
            estimate_keypoints=False,
        )
    )
    # The second of a start does not tell how clocks differ, and a stream takes its video's as it comes. Which feet
    # stand it tells from the last frames alone: held as hard as in batch they cost 14 mm of 34 (MPJPE).
    fusion: FusionSettings = field(default_factory=lambda: FusionSettings(estimate_clock=False, contact_tightening=1.0))
    association: AssociationSettings = field(default_factory=lambda: AssociationSettings(check=False))
    # Frames to each update; those between are predicted, by how their sensors turned. Of one wearer every frame can be
    # solved: an update takes half of the time between two at 60 Hz.
    solve_every: int = 1
    assembly: AssemblySettings = field(default_factory=AssemblySettings)
    recalibration: RecalibrationSettings = field(default_factory=RecalibrationSettings)
    walk: ProcessNoiseSettings = field(default_factory=ProcessNoiseSettings)
    relinearisation: RelinearisationSettings = field(default_factory=RelinearisationSettings)
