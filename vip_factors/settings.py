"""Every room's settings in one tree. The command line and the settings files are made from it."""

from collections.abc import Iterator
from dataclasses import dataclass, field, fields, is_dataclass
from enum import StrEnum
from typing import Any, Literal

from vip_factors.associate.settings import AssociationSettings
from vip_factors.initialise.sensor_assignment import AssignmentSettings
from vip_factors.initialise.sensor_clocks import AccelerometerSettings, SensorClockSettings
from vip_factors.initialise.start_candidates import StartSettings
from vip_factors.ranges import NotNegative, NotNegativeInt, RangeError, Rate, check_ranges
from vip_factors.solve.levenberg_marquardt import SolveSettings
from vip_factors.terms.registry import CameraFactorSettings, FactorSettings

LEAST_OVERLAPS = 2  # to a window: one at each end


@dataclass(frozen=True)
class CalibrationSettings:
    """What is found about sensors and body."""

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
    # Sigmas of foot contacts are so many times as large while mountings are free: a shod foot's are off in the same way
    # at every step, and mountings would bend to make up for it.
    contact_loosening: float = 2.0
    # s from which on a recording is long enough that its headings drift (a random walk of factors.heading_walk); none:
    # they are constant, as in the papers.
    heading_drift_from_s: float | None = 20.0
    # Coarse solves: foot contacts that were found with the first headings are found again with better ones.
    passes: NotNegativeInt = 2
    from_truth: bool = False  # start from the recording's true calibration: for experiments
    start: StartSettings = field(default_factory=StartSettings)


@dataclass(frozen=True)
class FusionSettings:
    """What is done with a camera, where the recording has one."""

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
    """How a long recording is solved without all of it in memory: in overlapping windows, after its calibration."""

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
    """Who minimises the cost."""

    OWN = "own"
    GTSAM = "gtsam"


@dataclass(frozen=True)
class CommonSettings:
    """What smoothing a recording and tracking a stream both honour."""

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

    @property
    def coarse_factor(self) -> int:
        """Every so-manieth frame is one on which the calibration is found."""
        ratio = self.frame_rate / self.calibration_rate
        below = max(1, int(ratio))
        return below if ratio / below < (below + 1) / ratio else below + 1


@dataclass(frozen=True)
class Settings(CommonSettings):
    """All settings of the pipeline."""

    # Marginals cost about one more iteration a minute.
    covariance: bool = False
    """Also say how sure every joint of every frame is."""
    assign: bool = False
    """Take sensors for one another that are found in each other's places."""
    # Standard deviations are told with what models leave out (body/model_errors.py). Off: those of the solution alone.
    model_errors: bool = True
    accelerometers: AccelerometerSettings = field(default_factory=AccelerometerSettings)
    sensor_clocks: SensorClockSettings = field(default_factory=SensorClockSettings)
    assignment: AssignmentSettings = field(default_factory=AssignmentSettings)
    windows: WindowSettings = field(default_factory=WindowSettings)
    # gtsam: GTSAM's own optimiser, on the same factors one by one: a hundred times slower, for seconds of a recording.
    solver: SolverName = SolverName.OWN


def flatten(settings: CommonSettings) -> dict[str, str]:
    """Dotted name and text of every effective setting, to be written beside every result."""
    return dict(_flat(settings, ""))


def _flat(settings: Any, prefix: str) -> Iterator[tuple[str, str]]:
    for one in fields(settings):
        value = getattr(settings, one.name)
        if is_dataclass(value):
            yield from _flat(value, f"{prefix}{one.name}.")
        else:
            yield f"{prefix}{one.name}", str(value)
