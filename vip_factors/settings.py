"""Every room's settings in one tree. The command line and the settings files are made from it."""

from collections.abc import Iterator
from dataclasses import dataclass, field, fields, is_dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any, Literal

from vip_factors.display import Summarised
from vip_factors.errors import InputError
from vip_factors.factor_settings import CameraFactorSettings, FactorSettings
from vip_factors.ranges import NotNegative, NotNegativeInt, RangeError, Rate, Share, check_ranges

MAX_OFFSET_S = 10.0  # of clocks: what two people pressing buttons, or two clocks set by network, differ by
LEAST_OVERLAPS = 2  # to a window: one at each end


@dataclass(frozen=True)
class StartSettings:
    """Settings of the search for headings and mountings."""

    search: bool = True  # off: the straps and the low-passed motion alone, as in the papers


@dataclass(frozen=True)
class CalibrationSettings:
    """Settings of the calibration of sensors and body."""

    # Sensors drift apart by tens of degrees.
    estimate_headings: bool = True
    """Find how sensors are turned about the vertical; off where they agree already."""
    # A calibration pose is held 10–15° off.
    estimate_mountings: bool = True
    """Find how sensors sit on their bones; off where that was measured."""
    # People of one stature differ by 3–6 % in each length.
    estimate_body: bool = True
    """Find the lengths of the body, where a camera sees it."""
    # The axes of elbows and knees as variables: carrying angles are personal. Off: the usual axes.
    estimate_hinges: bool = True
    # Where on their bones sensors sit as variables, where a camera sees the wearer: an arm that is assumed pulls the
    # mounting. Without a camera nothing tells the two apart, and a real knee was 0.5° worse. Off: the placement's.
    estimate_places: bool = True
    # How thick the wearer's soles are as a variable, where a camera sees the wearer. Off: factors.sole.thickness.
    estimate_sole: bool = True
    # What the detector calls hip, shoulder, knee … as variables: 1–3 cm beside the joint, the same in every frame.
    estimate_keypoints: bool = True
    # The focal length of a camera that was not calibrated.
    estimate_lens: bool = True
    # s from which on a recording is long enough that its headings drift (a random walk of factors.heading_walk); none:
    # they are constant, as in the papers.
    heading_drift_from_s: float | None = 20.0
    # Coarse solves: foot contacts that were found with the first headings are found again with better ones.
    passes: NotNegativeInt = 2
    from_truth: bool = False  # start from the recording's true calibration: for experiments
    start: StartSettings = field(default_factory=StartSettings)


@dataclass(frozen=True)
class FusionSettings:
    """Settings of the fusion with cameras."""

    use_camera: bool = True
    """Off: the body-worn sensors alone, each wearer by itself (SIP)."""
    camera_imu: bool = True
    """Off: the sensor on the camera is not used."""
    # Two numbers for a recording, and within 2 ms where clocks agree. Off: as whoever made the recording has them.
    estimate_clock: bool = True
    """Find how far the video's clock is off, within some milliseconds, and how it drifts."""
    # Rounds of association and fusion: the second knows camera, headings and mountings (thesis 4.3).
    rounds: int = 2
    # More solves at most, while the detector turns out much better than believed: true 2D poses, say.
    refits: NotNegativeInt = 2
    # Foot contacts beside a camera that stands still or is known: it holds the root by itself, and contacts found in
    # running are wrong by centimetres. A moving camera needs them: they hold the world.
    contacts_with_standing_camera: bool = False
    contact_loosening: float = 2.5  # contacts in front of a moving camera count so much less than in SIP, in sigmas
    # At the full rate, where calibration is settled and contacts cannot bend it, they count more, before any camera:
    # planted feet slid by 7 cm/s, with 0.2 by 1, for 0.4 mm of MPJPE (29.0 to 29.4) and a better knee on real walks.
    contact_tightening: float = 0.2
    # Below this relative decrease of the cost a solve ends: what is left to gain there is a tenth of a millimetre.
    relative_decrease: float = 5e-3


@dataclass(frozen=True)
class WindowSettings:
    """Settings of the overlapping windows in which a long recording is solved after its calibration."""

    # What is shorter is calibrated by all of its coarse frames (four minutes before a camera take 3 GB), and its
    # sensors' clocks and accelerometers are looked over first, which wants the whole.
    above_s: float = 300.0
    """What is longer, in seconds, is calibrated from stretches of it, and read window by window."""
    use: bool = True  # off: every recording is solved at once, in 0.4 MB a frame
    # Of what is solved at the full rate together: 3,600 frames, 1 GB; overlaps are solved twice, so shorter windows
    # take longer.
    window_s: float = 60.0
    # Windows settle from either end of it and meet in the middle: what lies beyond a window's end shows in its last
    # two seconds. Of 13 sensors, overlaps of 2 s left a millimetre and 0.2° in the motion, 6 s 0.06 mm and 0.004°.
    overlap_s: NotNegative = 6.0
    # Stretches, spread over the recording, of whose frames headings, mountings and the mean pose are found together:
    # three minutes and 20 s, coarsely, take 1.5 GB. A scene with a camera is calibrated from as many seconds in one
    # piece, which shows who is who: from its beginning, where a pose may be declared, or from where everybody is seen.
    calibration_stretches: int = 8
    calibration_stretch_s: float = 25.0  # long enough for gestures of all limbs

    def __post_init__(self) -> None:
        check_ranges(self, "windows.")
        if not self.window_s >= LEAST_OVERLAPS * self.overlap_s:
            raise RangeError(
                "windows.window_s",
                f"is {self.window_s:g}: expected {LEAST_OVERLAPS} times windows.overlap_s ({self.overlap_s:g}) or more",
            )


class SolverName(StrEnum):
    """Solver of the nonlinear least-squares problem."""

    OWN = "own"
    GTSAM = "gtsam"


@dataclass(frozen=True)
class AssociationSettings:
    """Settings of the association of detections with wearers."""

    rivals: NotNegativeInt = 3
    """Hypotheses kept per wearer and frame, the likeliest: the right one is hardly ever fourth."""
    offsets: tuple[int, ...] = (1, 2, 4, 8, 16, 30)
    """Frames, at 30 per second, that edges span: up to a second (thesis 4.4.1), thinned as neighbours are alike."""
    window_s: float = 4.0
    """Seconds decided at once."""
    overlap_s: NotNegative = 1.2
    """Seconds decided again by the next window: more than the longest edge."""
    least_confidence: Share = 0.9
    """Choices less sure are dropped: a frame without a person costs little, a wrong person much."""
    by_place: bool = True
    """Where the camera is known, detections that are nobody's are given to whom they fit where they stand: half hidden
    people show too few joints to be recognised by their motion. Off: by motion alone."""
    by_clothes: bool = True
    """Where the recording was converted with its video, clothes count beside motion, as far as those of the surely
    found differ from others'. Off: motion alone."""
    check: bool = True
    """Whether oddities of detections are reported: in another order, of nobody, of two who move alike. Streams find
    who is who again and again and tell none of it: a tenth of what their start takes."""
    weights: Path | None = None
    """Weights to use instead of the shipped ones."""

    def __post_init__(self) -> None:
        if self.rivals < 1 or not self.offsets or min(self.offsets) < 1:
            raise InputError("association: rivals and offsets must be at least 1")
        if not self.window_s > self.overlap_s >= 0:
            raise InputError(
                f"association: window of {self.window_s:g} s with overlap {self.overlap_s:g} s: must be longer"
            )


@dataclass(frozen=True)
class SolveSettings:
    """When to stop, and how far to trust the linearisation."""

    max_iterations: int = 30  # IT and SIP settle in 5–20; the thesis used 20
    relative_decrease: float = 1e-3  # steps below it move joints by a millimetre in all and take half of the time


@dataclass(frozen=True, repr=False)
class CommonSettings(Summarised):
    """Settings that smoothing and streaming share."""

    # Brisk motion has its power below 10 Hz.
    frame_rate: Rate = 60.0
    """Frames per second of the estimated motion."""
    acceleration: bool = True  # off: the inertial tracker alone (IT; SOP with six sensors)
    # Hz, about, at which the calibration is found first, on every n-th frame: what is found is the same at any frame
    # rate. At 5 Hz a band of accelerations is lost that tells mountings: 31.4 mm instead of 26.0.
    calibration_rate: Rate = 15.0

    calibration: CalibrationSettings = field(default_factory=CalibrationSettings)
    factors: FactorSettings = field(default_factory=FactorSettings)
    fusion: FusionSettings = field(default_factory=FusionSettings)
    camera: CameraFactorSettings = field(default_factory=CameraFactorSettings)
    association: AssociationSettings = field(default_factory=AssociationSettings)
    solve: SolveSettings = field(default_factory=SolveSettings)
    floor: Literal["found", "none"] | float = "found"
    """Where z = 0 is: under the soles, or where a known camera pose has it (found); where the camera was put at the
    start (none); at this height in metres in the world of a known camera pose (-0.74: its board lay on a table)."""

    def __post_init__(self) -> None:
        check_ranges(self)

    def summary(self) -> list[str]:
        """The settings that are not the default."""
        default = flatten(type(self)())
        changed = [f"{name}: {text}" for name, text in flatten(self).items() if text != default[name]]
        return [f"{type(self).__name__}, {'all by default' if not changed else 'by default but for'}", *changed]

    @property
    def coarse_factor(self) -> int:
        """Every so-manieth frame is one on which the calibration is found."""
        ratio = self.frame_rate / self.calibration_rate
        below = max(1, int(ratio))
        return below if ratio / below < (below + 1) / ratio else below + 1


@dataclass(frozen=True)
class AccelerometerSettings:
    """Settings of the accelerometer checks."""

    check: bool = True  # off: they are taken as they are


@dataclass(frozen=True)
class SensorClockSettings:
    """Settings of the check for sensors whose clocks differ from their neighbours'."""

    check: bool = True  # off: clocks agree, whatever the motion says
    correct: bool = True  # off: delays are reported, not corrected


@dataclass(frozen=True)
class AssignmentSettings:
    """Settings of the check for exchanged sensors."""

    check: bool = True  # off: they are where the placement has them, whatever the motion says


@dataclass(frozen=True, repr=False)
class Settings(CommonSettings):
    """All settings of the pipeline."""

    # Marginals cost about one more iteration a minute.
    covariance: bool = True
    """Estimate the uncertainty of every joint in every frame."""
    assign: bool = False
    """Take sensors for one another that are found in each other's places."""
    # Reported standard deviations include model errors (body/model_errors.py). Off: those of the solution alone.
    model_errors: bool = True
    accelerometers: AccelerometerSettings = field(default_factory=AccelerometerSettings)
    sensor_clocks: SensorClockSettings = field(default_factory=SensorClockSettings)
    assignment: AssignmentSettings = field(default_factory=AssignmentSettings)
    windows: WindowSettings = field(default_factory=WindowSettings)
    # gtsam: GTSAM's own optimiser, on the same factors one by one: a hundred times slower, for seconds of a recording.
    solver: SolverName = SolverName.OWN


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
        check_ranges(self, "assembly.")
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
class ProcessNoiseSettings:
    """Process noise of the variables that all frames of a stream share, per √second.

    Beyond drift it stands for what repeats from frame to frame: taken as new each time it would make headings and
    mountings surer than they are within seconds, and hold them where the first seconds put them.
    """

    every_s: float = 0.5  # the walk goes in steps: one elimination more at each
    heading_deg: float = 0.3  # 2.3° in a minute: twice what a good filter drifts
    mounting_deg: float = 0.3  # straps creep, skin moves


@dataclass(frozen=True)
class RelinearisationSettings:
    """Which frames of the lag are linearised anew."""

    angle_deg: float = 1.0  # a joint that moved by less is linear to some thousandths
    length_m: float = 0.02
    shared_deg: float = 0.3  # headings and mountings: they are seen by all frames, 1.0 costs 2 mm
    most: NotNegativeInt = 6  # frames at once, the newest: what an update may cost


@dataclass(frozen=True, repr=False)
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


def flatten(settings: CommonSettings) -> dict[str, str]:
    """Dotted name and text of every effective setting, to be written beside every result."""
    return dict(_flat(settings, ""))


def _flat(settings: Any, prefix: str) -> Iterator[tuple[str, str]]:
    for declared in fields(settings):
        value = getattr(settings, declared.name)
        if is_dataclass(value):
            yield from _flat(value, f"{prefix}{declared.name}.")
        else:
            yield f"{prefix}{declared.name}", str(value)
