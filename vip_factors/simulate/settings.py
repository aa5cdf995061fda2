"""Errors of simulated sensors, 2D pose detectors and cameras.

"Measured" at the detector: OpenPose (BODY_25B) on the 4 cameras of Pose2Sim's balancing trial, 100 frames at 60 Hz, a
person of about 850 pixels, 8306 keypoints without the nose, against the reprojection of the 3D points triangulated from
them (errors times √(8/5), for what the triangulation took of them). With confidence above 0.3 and errors below 3 units:
0.51 units RMS an axis, 0.40 by the median (0.28 at hips, 0.6 at wrists; 1.2 to 1.7 % of stature at any keypoint);
autocorrelation 0.93 after one frame, 0.80 after 0.1 s, 0.71 after 0.2 s, 0.62 after 0.4 s, 0.58 after 0.75 s;
correlation −0.47 with confidence. The defaults give 0.52, 0.45 and −0.50 for a walker without swaps. A *unit* is a
keypoint's OKS sigma times the square root of the person's area in the image.
"""

from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

from vip_factors.errors import InputError
from vip_factors.ranges import MaybeRate, NotNegative, Range, Rate, check_ranges

if TYPE_CHECKING:
    from vip_factors.sensors.camera import CameraModel

CameraKind = Literal["fixed", "hand-held", "walking"]


@dataclass(frozen=True)
class SimulateSettings:
    """Rates and errors of a simulated recording; by default those of body-worn sensors in use.

    That is 3–6° of orientation error correlated in time, and 1–3 m/s² at moving limbs. Headings and mountings are right
    unless asked for: ``SimulateSettings(heading_offset_deg=45, mounting_error_deg=10)``.

    Sigmas are standard deviations of normal distributions, per axis where a quantity has axes; what has no unit is a
    strength, 1 as usual. 0 switches an error off. *Attitude errors* are mistakes of the sensor's filter (its
    accelerometer does not turn along); *skin* and *wobble* really move the sensor on the bone (orientation, specific
    force and angular rate all follow).
    """

    imu_rate: Rate = 100.0  # samples per second; Xsens Awinda: 60–100
    phases: bool = True  # each sensor samples at another instant within a period
    angular_rate: bool = True  # simulate gyroscopes
    # Cutoff in Hz of the zero-phase low-pass filter on the motion, which removes motion capture jitter (6 Hz is usual
    # for gait); none: unfiltered.
    lowpass_hz: MaybeRate = 6.0

    heading_offset_deg: NotNegative = 0.0  # largest heading of a sensor, degrees; uniform in ±. The papers use 45
    heading_drift_deg: float = 1.0  # random walk of the heading, degrees per √minute; consumer sensors: 1–5
    mounting_error_deg: NotNegative = 0.0  # standard deviation of the mounting per axis, degrees
    position_error_m: float = 0.01  # standard deviation of the sensor position per axis, m

    attitude_error: NotNegative = 1.0  # strength of the slow orientation error: 1 is 2.5° of heading, 1° of tilt
    skin: NotNegative = 1.0  # strength of soft tissue motion: 1 is 2° and 4 mm at a thigh
    wobble: float = 1.0  # strength of strap oscillation after impacts
    white_noise: NotNegative = 1.0  # strength of white noise: 1 is 0.3°, 0.3 m/s², 0.5 °/s
    bias: NotNegative = 1.0  # strength of slow bias: 1 is 0.05 m/s² and 0.1 °/s

    packet_loss: Annotated[float, Range(least=0, most=0.99)] = 0.002  # share of lost samples
    gap_s: float = 0.25  # duration of one longer gap per sensor, s

    def __post_init__(self) -> None:
        check_ranges(self, zero=True)

    @classmethod
    def noise_free(cls, **changes: Any) -> "SimulateSettings":
        """No error at all, all sensors in step; ``changes`` switches single errors on."""
        unchanged = {"imu_rate", "angular_rate", "lowpass_hz", "phases"}
        off = {f.name: 0.0 for f in fields(cls) if f.name not in unchanged}
        return replace(cls(phases=False, **off), **changes)  # type: ignore[arg-type]


@dataclass(frozen=True)
class DetectorSettings:
    """Errors of a simulated detector; by default one such as OpenPose on ordinary video.

    All but the bias are strengths: 1 is usual, 0 is none.
    """

    bias_m: NotNegative = 0.012  # constant keypoint offset per person and axis, standard deviation in m
    error: NotNegative = 1.0  # strength of keypoint errors in the image: 1 is 0.34 OKS sigmas per axis
    doubt: NotNegative = 1.0  # strength of confidence loss and larger errors
    missed: NotNegative = 1.0  # strength of missed keypoints: 1 is 0.5 % visible, 60 % behind another person
    swapped: NotNegative = 1.0  # strength of left-right swaps: 1 is 4 % of the time from the side, 2 % from behind
    mixed: NotNegative = 1.0  # strength of mixed people while they overlap: 1 is 15 % merged, 10 % exchanged limbs
    people: NotNegative = 1.0  # strength of missed (1 %) and invented people (0.03 per frame)

    def __post_init__(self) -> None:
        check_ranges(self, "detector.", zero=True)

    @classmethod
    def noise_free(cls, **changes: Any) -> "DetectorSettings":
        """Every keypoint inside the image, hidden or not, exactly where it is, with confidence one."""
        return cls(**({setting.name: 0.0 for setting in fields(cls)} | changes))


@dataclass(frozen=True)
class FilmSettings:
    """Cameras of a simulated scene, and how well their poses are known."""

    camera: CameraKind | None = "hand-held"
    """Camera on a tripod (fixed), or held by somebody who stands (hand-held) or walks along (walking); None: no
    camera."""
    cameras: Annotated[int, Range(least=1)] = 1
    """Number of cameras; further ones stand evenly around the people, on tripods of known pose."""
    carried: Annotated[int, Range(least=0)] = 0
    """Number of further cameras that are hand-held, at unknown poses."""
    known_camera_pose: bool | None = None
    """The pose of a fixed first camera is known; None: if there are further cameras."""
    calibrated: bool = True
    """Lenses and tripod poses are known; off: the lens is that of an average phone, with its uncertainty."""
    video_rate: Rate = 30.0
    """Frames per second of the video."""
    width: int = 1920
    """Width of the image in pixels."""
    height: int = 1080
    """Height of the image in pixels."""
    fov_deg: Annotated[float, Range(least=5, most=150)] = 60.0
    """Horizontal field of view in degrees; a phone while filming has about 60."""
    distortion: tuple[float, ...] = ()
    """Distortion coefficients of OpenCV."""
    azimuth_deg: float | None = None
    """Direction from the people to the camera, degrees about the vertical; None: random."""
    distance_m: Annotated[float | None, Range(above=0, most=1_000)] = None
    """Distance from the people to the camera in m; None: far enough to see them."""
    keypoints: str = "openpose18"
    """Keypoint set of the simulated detector: coco17, openpose18, body25, body25b, halpe26 …"""
    time_offset_s: float = 0.0
    """Seconds to add to the video's times to match the sensors; the recording states 0."""
    camera_imu: bool | None = None
    """The camera carries an IMU; None: if it moves."""
    camera_pose_error: NotNegative = 1.0
    """Strength of the error of a known camera pose: 1 is 0.1° and 5 mm per axis."""
    camera_mounting_error_deg: float = 5.0
    """Standard deviation of the mounting of the camera's IMU per axis, degrees."""

    def __post_init__(self) -> None:
        if self.camera not in (None, "fixed", "hand-held", "walking"):
            raise InputError(f"camera '{self.camera}': expected fixed, hand-held or walking")
        check_ranges(self, zero=True)
        if self.carried >= self.cameras:
            raise InputError(f"{self.carried} carried cameras: expected fewer than cameras in all ({self.cameras})")
        if self.known_camera_pose and self.camera not in (None, "fixed"):
            raise InputError(f"a known pose of a {self.camera} camera: only that of a fixed one can be known")

    @property
    def has_camera_imu(self) -> bool:
        """Whether the camera carries an IMU."""
        return self.camera != "fixed" if self.camera_imu is None else self.camera_imu

    @property
    def has_known_pose(self) -> bool:
        """Whether the first camera's pose is known."""
        if self.known_camera_pose is None:
            return self.calibrated and self.cameras > 1 and self.camera == "fixed"
        return self.known_camera_pose


@dataclass(frozen=True)
class SceneSettings(FilmSettings):
    """Camera, detector and sensors of a simulated scene; by default with the errors that they have in use."""

    imu: SimulateSettings = field(default_factory=SimulateSettings)
    detector: DetectorSettings = field(default_factory=DetectorSettings)

    def __post_init__(self) -> None:
        from vip_factors.body.keypoints import keypoint_set

        super().__post_init__()
        keypoint_set(self.keypoints)
        self.model  # its own checks  # noqa: B018

    @property
    def model(self) -> "CameraModel":
        """Intrinsics with square pixels and the principal point in the middle of the image."""
        import numpy as np

        from vip_factors.sensors.camera import CameraModel  # imported here: help shows settings without NumPy

        focal = self.width / 2 / np.tan(np.deg2rad(self.fov_deg) / 2)
        return CameraModel(
            self.width, self.height, (focal, focal), (self.width / 2, self.height / 2), tuple(self.distortion)
        )

    @classmethod
    def noise_free(cls, film: FilmSettings | None = None, **changes: Any) -> "SceneSettings":
        """No error of any sensor, of the camera's mounting, or of the detector; the camera moves all the same."""
        perfect = {"camera_mounting_error_deg": 0.0, "camera_pose_error": 0.0}
        errors = {"imu": SimulateSettings.noise_free(), "detector": DetectorSettings.noise_free()}
        return cls(**(vars(film or FilmSettings()) | perfect | errors | changes))
