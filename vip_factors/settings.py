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

    search: bool = True  # off: initial values from the placement and the low-passed motion only, as in the papers


@dataclass(frozen=True)
class CalibrationSettings:
    """Settings of the calibration of sensors and body."""

    # Sensors drift apart by tens of degrees.
    estimate_headings: bool = True
    """Estimate the headings of sensors; off: the headings already agree."""
    # A calibration pose is held 10–15° off.
    estimate_mountings: bool = True
    """Estimate the mountings of sensors; off: they were measured."""
    # People of one stature differ by 3–6 % in each length.
    estimate_body: bool = True
    """Estimate the lengths of the body, with a camera."""
    # Estimate the axes of elbows and knees; off: average axes.
    estimate_hinges: bool = True
    # Estimate the positions of sensors on their bones, with a camera; off: those of the placement.
    estimate_places: bool = True
    # Estimate the thickness of the soles, with a camera; off: factors.sole.thickness.
    estimate_sole: bool = True
    # Estimate constant offsets between the detector's keypoints and the joints (1–3 cm).
    estimate_keypoints: bool = True
    # Estimate the focal length of an uncalibrated camera.
    estimate_lens: bool = True
    # Duration in s above which headings drift (factors.heading_walk); none: headings are constant, as in the papers.
    heading_drift_from_s: float | None = 20.0
    # Number of coarse solves; each detects foot contacts again with better headings.
    passes: NotNegativeInt = 2
    from_truth: bool = False  # start from the true calibration of a simulated recording
    start: StartSettings = field(default_factory=StartSettings)


@dataclass(frozen=True)
class FusionSettings:
    """Settings of the fusion with cameras."""

    use_camera: bool = True
    """Use the cameras; off: body-worn sensors only, each wearer alone (SIP)."""
    camera_imu: bool = True
    """Use the sensor on the camera."""
    # Two variables per recording.
    estimate_clock: bool = True
    """Estimate the offset and drift of the video's clock."""
    # Rounds of association and fusion; later rounds use the estimated camera, headings and mountings (thesis 4.3).
    rounds: int = 2
    # Maximum number of further solves while the detector's errors are much smaller than assumed.
    refits: NotNegativeInt = 2
    # Use foot contacts with a standing or known camera, which determines the position without them. With a moving
    # camera they are always used.
    contacts_with_standing_camera: bool = False
    contact_loosening: float = 2.5  # factor on the sigma of contacts with a moving camera
    # Factor on the sigma of contacts in the full-rate solve, where the calibration is fixed; it keeps planted feet
    # still.
    contact_tightening: float = 0.2
    # Relative decrease of the cost below which a solve stops.
    relative_decrease: float = 5e-3


@dataclass(frozen=True)
class WindowSettings:
    """Settings of the overlapping windows in which a long recording is solved after its calibration."""

    # Shorter recordings are calibrated from all coarse frames (four minutes with a camera take 3 GB).
    above_s: float = 300.0
    """Duration in seconds above which a recording is calibrated from stretches and read in windows."""
    use: bool = True  # off: every recording is solved at once, with 0.4 MB per frame
    # Duration in s of a window at the full rate (60 s: 1 GB). Overlaps are solved twice, so shorter windows take
    # longer.
    window_s: float = 60.0
    # Overlap of windows in s. With 13 sensors, 2 s change the motion by 1 mm and 0.2°, 6 s by 0.06 mm and 0.004°.
    overlap_s: NotNegative = 6.0
    # Number of stretches, spread over the recording, for the calibration (8 of 25 s take 1.5 GB). With a camera, the
    # calibration uses one piece of the same total duration.
    calibration_stretches: int = 8
    calibration_stretch_s: float = 25.0  # duration of a stretch, s

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
    """Number of most likely hypotheses per wearer and frame."""
    offsets: tuple[int, ...] = (1, 2, 4, 8, 16, 30)
    """Distances in frames, at 30 per second, between linked detections (thesis 4.4.1)."""
    window_s: float = 4.0
    """Duration in s of an assignment window."""
    overlap_s: NotNegative = 1.2
    """Overlap of assignment windows in s; longer than the largest offset."""
    least_confidence: Share = 0.9
    """Probability below which an assignment is discarded."""
    by_place: bool = True
    """With a known camera, also assign detections by position, for people who are partly hidden. Off: by motion
    only."""
    by_clothes: bool = True
    """Also assign detections by the colours of clothes, if the recording was converted with its video. Off: by motion
    only."""
    check: bool = True
    """Report swapped keypoints, unassigned detections, and people who move alike."""
    weights: Path | None = None
    """File with weights instead of the default ones."""

    def __post_init__(self) -> None:
        if self.rivals < 1 or not self.offsets or min(self.offsets) < 1:
            raise InputError("association: rivals and offsets must be at least 1")
        if not self.window_s > self.overlap_s >= 0:
            raise InputError(
                f"association: window of {self.window_s:g} s with overlap {self.overlap_s:g} s: must be longer"
            )


@dataclass(frozen=True)
class SolveSettings:
    """Stopping criteria of the solver."""

    max_iterations: int = 30  # IT and SIP converge in 5–20
    relative_decrease: float = 1e-3  # relative decrease of the cost below which it stops


@dataclass(frozen=True, repr=False)
class CommonSettings(Summarised):
    """Settings that smoothing and streaming share."""

    # Brisk motion has its power below 10 Hz.
    frame_rate: Rate = 60.0
    """Frames per second of the estimated motion."""
    acceleration: bool = True  # off: the inertial tracker alone (IT; SOP with six sensors)
    # Approximate frame rate of the calibration in Hz; it uses every n-th frame. At 5 Hz the mountings are worse.
    calibration_rate: Rate = 15.0

    calibration: CalibrationSettings = field(default_factory=CalibrationSettings)
    factors: FactorSettings = field(default_factory=FactorSettings)
    fusion: FusionSettings = field(default_factory=FusionSettings)
    camera: CameraFactorSettings = field(default_factory=CameraFactorSettings)
    association: AssociationSettings = field(default_factory=AssociationSettings)
    solve: SolveSettings = field(default_factory=SolveSettings)
    floor: Literal["found", "none"] | float = "found"
    """Height z = 0: under the soles, or that of a known camera pose (found); the camera's initial position (none); or
    this height in metres in the frame of a known camera pose (-0.74 if the board lay on a table of 74 cm)."""

    def __post_init__(self) -> None:
        check_ranges(self)

    def summary(self) -> list[str]:
        """The settings that are not the default."""
        default = flatten(type(self)())
        changed = [f"{name}: {text}" for name, text in flatten(self).items() if text != default[name]]
        return [f"{type(self).__name__}, {'all by default' if not changed else 'by default but for'}", *changed]

    @property
    def coarse_factor(self) -> int:
        """Number of frames between those of the calibration."""
        ratio = self.frame_rate / self.calibration_rate
        below = max(1, int(ratio))
        return below if ratio / below < (below + 1) / ratio else below + 1


@dataclass(frozen=True)
class AccelerometerSettings:
    """Settings of the accelerometer checks."""

    check: bool = True  # correct wrong axes, scales and ranges


@dataclass(frozen=True)
class SensorClockSettings:
    """Settings of the check for sensors whose clocks differ from their neighbours'."""

    check: bool = True  # compare the clocks of neighbouring sensors
    correct: bool = True  # off: delays are only reported


@dataclass(frozen=True)
class AssignmentSettings:
    """Settings of the check for exchanged sensors."""

    check: bool = True  # compare the placement with the motion


@dataclass(frozen=True, repr=False)
class Settings(CommonSettings):
    """All settings of the pipeline."""

    # Marginals cost about one more iteration a minute.
    covariance: bool = True
    """Estimate the uncertainty of every joint in every frame."""
    assign: bool = False
    """Exchange sensors that are listed in each other's place."""
    # Include model errors in the reported standard deviations; off: the covariance of the solution only.
    model_errors: bool = True
    accelerometers: AccelerometerSettings = field(default_factory=AccelerometerSettings)
    sensor_clocks: SensorClockSettings = field(default_factory=SensorClockSettings)
    assignment: AssignmentSettings = field(default_factory=AssignmentSettings)
    windows: WindowSettings = field(default_factory=WindowSettings)
    # gtsam: the optimiser of GTSAM; a hundred times slower.
    solver: SolverName = SolverName.OWN


@dataclass(frozen=True)
class AssemblySettings:
    """Waiting times, pauses and clock steps; all in seconds of the stream's time."""

    # Wait for further sensors before the first frame.
    settle: NotNegative = 0.5
    # Wait for a sensor that is behind the others: three packets at 60 Hz. Sensors below 20 Hz need a longer wait.
    patience: NotNegative = 0.05
    # Wait for samples out of order; it delays all answers. 0 for TCP, files and drivers; one frame or more for UDP.
    reordering: NotNegative = 0.0
    # Silence after which frames no longer wait for a sensor; longer than a body blocks the radio (0.25 s).
    dead_after: float = 1.0
    # Silence of all sensors after which tracking starts again.
    longest_pause: float = 2.5
    # Smallest step of a clock, between sources or ahead of all others, that counts as a clock jump.
    jump: float = 1.0
    # Smallest step of the clock of one running sensor that counts as a clock jump.
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
    """Times of the recalibration of a stream from its data."""

    use: bool = True
    # Duration of the data in s of the first recalibration.
    first_s: float = 2.5
    # Largest duration of the data in s, and interval of the later recalibrations.
    longest_s: float = 40.0
    # Smallest time in s from the end of the data to the first answer with the new calibration. A replay waits for it,
    # so its answers are the same on any machine.
    delay_s: NotNegative = 2.0
    # Headings are constant; the tracker follows their drift.
    calibration: CalibrationSettings = field(default_factory=lambda: CalibrationSettings(heading_drift_from_s=None))


@dataclass(frozen=True)
class ProcessNoiseSettings:
    """Process noise of the variables that all frames of a stream share, per √second.

    It represents drift and errors that are correlated over frames, which would otherwise make headings and mountings
    overconfident within seconds.
    """

    every_s: float = 0.5  # s between steps of the random walk
    heading_deg: float = 0.3  # degrees per √second
    mounting_deg: float = 0.3  # degrees per √second


@dataclass(frozen=True)
class RelinearisationSettings:
    """Changes above which a frame of the lag is linearised again."""

    angle_deg: float = 1.0  # joint rotation, degrees
    length_m: float = 0.02
    shared_deg: float = 0.3  # headings and mountings, degrees
    most: NotNegativeInt = 6  # maximum number of frames per update, the newest first


@dataclass(frozen=True, repr=False)
class LiveSettings(CommonSettings):
    """All settings of a live session."""

    # Short enough for animation.
    lag_s: float = 0.25
    """Seconds between the newest pose and the smoothed one."""
    # A step or a gesture shows the headings.
    start_s: float = 1.0
    """Seconds of data before the first answer."""
    # The first second does not determine the body.
    calibration: CalibrationSettings = field(
        default_factory=lambda: CalibrationSettings(
            estimate_body=False,
            estimate_hinges=False,
            estimate_places=False,
            estimate_sole=False,
            estimate_keypoints=False,
        )
    )
    # One second of data does not determine clocks. Contacts come from the last frames only, so they have less weight
    # than in ``smooth``.
    fusion: FusionSettings = field(default_factory=lambda: FusionSettings(estimate_clock=False, contact_tightening=1.0))
    association: AssociationSettings = field(default_factory=lambda: AssociationSettings(check=False))
    # Frames per update; the frames between are predicted from the sensors' rotation.
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
