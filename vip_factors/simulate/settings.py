"""Errors of simulated sensors, 2D pose detectors and cameras: each with its unit in its name and a reason beside it.

"Measured" at the detector: OpenPose (BODY_25B) on the 4 cameras of Pose2Sim's balancing trial, 100 frames at 60 Hz, a
person of about 850 pixels, 8306 keypoints without the nose, against the reprojection of the 3D points triangulated from
them (errors times √(8/5), for what the triangulation took of them). With confidence above 0.3 and errors below 3 units:
0.51 units RMS an axis, 0.40 by the median (0.28 at hips, 0.6 at wrists; 1.2 to 1.7 % of stature at any keypoint);
autocorrelation 0.93 after one frame, 0.80 after 0.1 s, 0.71 after 0.2 s, 0.62 after 0.4 s, 0.58 after 0.75 s;
correlation −0.47 with confidence. The defaults give 0.52, 0.45 and −0.50 for a walker without swaps. A *unit* is a
keypoint's OKS sigma times the square root of the person's area in the image.
"""

from dataclasses import dataclass, field, fields, replace
from typing import Annotated, Any, Literal

import numpy as np

from vip_factors.body.keypoints import keypoint_set
from vip_factors.errors import InputError
from vip_factors.ranges import MaybeRate, NotNegative, Range, Rate, Share, check_ranges
from vip_factors.sensors.camera import CameraModel

CameraKind = Literal["fixed", "hand-held", "walking"]
Seconds = Annotated[float, Range(above=0)]
Doubt = Annotated[float, Range()]


@dataclass(frozen=True)
class SimulateSettings:
    """Rates and errors of a simulated recording; by default those of body-worn sensors in use.

    That is 3–6° of orientation error correlated in time, and 1–3 m/s² at moving limbs. Headings and mountings are right
    unless asked for: ``SimulateSettings(heading_offset_deg=45, mounting_error_deg=10)``.

    Sigmas are standard deviations of normal distributions, per axis where a quantity has axes; 0 switches an error
    off. Where an error stands, physically, matters: the *filter* errors are mistakes of the sensor's attitude
    estimate (its accelerometer does not turn along), the *skin* and *wobble* terms really move the sensor on the
    bone (orientation, specific force and angular rate all follow).
    """

    imu_rate: Rate = 100.0  # Hz; Xsens Awinda sends 60–100 Hz
    truth_rate: Rate = 60.0  # Hz of the truth motion: the frame rate of TotalCapture and of most video
    phases: bool = True  # sensors sample at their own instants within a period, as unsynchronised ones do
    angular_rate: bool = True  # whether the streams carry a gyroscope
    # Mocap jitter, zero phase, 4th order: the usual gait cutoff, with which walks of the CMU collection have the 3 m/s²
    # at the pelvis that a real sensor shows; at 10 Hz their jitter adds half as much again.
    lowpass_hz: MaybeRate = 6.0

    heading_offset_deg: NotNegative = 0.0  # uniform in ±; ask for it: the papers' experiment is ±45
    heading_drift_deg: float = 1.0  # random walk, degrees per √minute: consumer magnetometer-free filters, 1–5
    mounting_error_deg: NotNegative = 0.0  # of the placement's mounting; 10–15 for a careless calibration pose
    position_error_m: float = 0.01  # of the placement's position: straps sit a centimetre off the table's place

    filter_heading_deg: float = 2.5  # correlated attitude error about the vertical; data sheets say 1.5–2.5 in motion
    filter_tilt_deg: float = 1.0  # correlated tilt error, each axis; gravity holds it: data sheets say 0.5–1
    filter_time_s: Seconds = 1.5  # correlation time of both: attitude filters average gravity over about a second
    filter_white_deg: float = 0.3  # uncorrelated attitude error, each axis: rounding and time stamps

    skin_deg: float = 2.0  # slow rotation of the sensor on the bone, each axis, at a thigh (see recording.SEGMENTS)
    skin_m: float = 0.004  # slow shift on the bone, each axis, at a thigh; Leardini et al. 2005 report 5–30 mm
    skin_time_s: Seconds = 0.5  # correlation time: muscles and skin follow the steps
    wobble: float = 1.0  # strength of the sprung response to impacts (see recording.py); 1 is the natural one

    acceleration_white: float = 0.3  # m/s² a sample: noise and unmodelled shaking; the bare chip has 0.02–0.05
    acceleration_bias: float = 0.05  # m/s², wandering over bias_time_s; 5 mg is usual without a tumble calibration
    gyro_white_deg_s: float = 0.5  # a sample; MEMS gyroscopes have 0.01 deg/s/√Hz, range and shaking add
    gyro_bias_deg_s: float = 0.1  # after a usual still period
    bias_time_s: Seconds = 100.0  # correlation time of both biases: temperature

    packet_loss: Annotated[float, Range(least=0, most=0.99)] = 0.002  # share of single samples lost; Awinda indoors
    gap_s: float = 0.25  # length of one longer gap per sensor, when the body blocks the radio

    def __post_init__(self) -> None:
        check_ranges(self, zero=True)

    @classmethod
    def noise_free(cls, **changes: Any) -> "SimulateSettings":
        """No error at all, all sensors in step; ``changes`` switches single errors on."""
        kept = {"imu_rate", "truth_rate", "angular_rate", "lowpass_hz", "phases"}
        off = {f.name: 0.0 for f in fields(cls) if f.name not in kept and not f.name.endswith("time_s")}
        return replace(cls(phases=False, **off), **changes)  # type: ignore[arg-type]


# The square root of a person's area in the image, over the height at which their whole stature would appear.
ROOT_AREA_PER_HEIGHT = 0.45  # COCO's areas are those of masks: a standing body fills about 0.2 of height squared


@dataclass(frozen=True)
class DetectorSettings:
    """Errors of a simulated detector; by default one such as OpenPose on ordinary video.

    Sizes of errors are in units (see above), so that they grow with the person in the image and are larger at hips
    than at eyes. Shares are shares of time; what happens, lasts for about its time constant. *Doubt* is how unsure
    the detector is of a keypoint, a slow random number, 0 if sure: confidence falls with ``exp(−doubt)`` and errors
    grow with ``1 + doubt_error · doubt``.
    """

    bias_m: float = 0.012  # each axis of the bone, constant for a person: a detector's idea of a hip differs by 1–2 cm
    # Each image axis: measured as the sum of what lasts (0.41 units with the bias, depending on pose and view), what
    # forgets (0.28), and what changes from frame to frame (0.10, second differences). The first two are taken by 0.7:
    # measured errors have long tails, which are doubt's here, and together they have the measured RMS again.
    drift_error: float = 0.26
    slow_error: float = 0.20
    slow_time_s: Seconds = 0.14
    white_error: float = 0.10

    confidence: Share = 0.64  # of a keypoint without doubt; measured median 0.63, 5 to 95 %: 0.38 to 0.71
    confidence_spread: float = 0.07  # lasting slow_time_s; measured within a keypoint 0.07, 0.47 of it after 0.1 s
    plain_doubt: Doubt = -0.4  # mean of a keypoint in plain sight; below 0 is none: with this spread 16 % of the time
    hidden_doubt: Doubt = 0.3  # behind the person's own body; measured confidence below 0.3 for 3 % of all keypoints
    behind_doubt: Doubt = 1.2  # behind somebody else; ours: mostly a guess
    doubt_spread: float = 0.4
    # Measured RMS error by confidence: 0.65: 0.4 units, 0.45: 0.65, 0.35: 1.2, 0.25: 2.1, 0.15: 3.0, 0.05: 4.6.
    doubt_error: float = 4.0
    least_confidence: Share = 0.05  # OpenPose's own default for drawing a keypoint

    missed: Share = 0.005  # share of keypoints in plain sight not found; measured 0 to 2 % by camera, all keypoints
    hidden_missed: Share = 0.05  # behind the person's own body: an open side of the trial's cameras
    behind_missed: Share = 0.6  # behind somebody else; ours: detectors mostly leave them out
    # Left for right, arms or legs. Measured: 0.5 % of limb keypoints, nearly all knees. PoseFix
    # (Moon et al. 2019) trains with 3 % at arms and 6 % at legs for COCO's pictures. Between the two; by view is ours.
    swap_side: Share = 0.04  # an eighth of it from the front
    swap_back: Share = 0.02
    event_time_s: Seconds = 0.25  # ours: bursts of several frames, as one sees them in OpenPose's videos

    # What follows is ours, to see what an estimator makes of it: no real recording of several people was measured.
    missed_person: Share = 0.01  # share of time that a person in sight is not found
    least_keypoints: int = 4  # fewer do not make a person; OpenPose asks for 3 or 4
    merge: Share = 0.15  # share of the time two people overlap, that one detection has limbs of both
    exchange: Share = 0.10  # share of that time, that both are found with limbs exchanged
    false_people: float = 0.03  # detections of nobody, per frame

    def __post_init__(self) -> None:
        check_ranges(self, "detector.", zero=True)

    @classmethod
    def noise_free(cls, **changes: Any) -> "DetectorSettings":
        """Every keypoint inside the image, hidden or not, exactly where it is, with confidence one."""
        off = {one.name: 0.0 for one in fields(cls) if not one.name.endswith("time_s")}
        return cls(**(off | {"confidence": 1.0, "least_keypoints": 1} | changes))


@dataclass(frozen=True)
class FilmSettings:
    """What films a simulated scene, and how well its place is known."""

    camera: CameraKind | None = "hand-held"
    """On a tripod, in the hands of somebody who stands, or of somebody who walks along; nothing films if None."""
    cameras: Annotated[int, Range(least=1)] = 1
    """Cameras in all: further ones stand on tripods around the action, evenly spread, at known poses."""
    known_camera_pose: bool | None = None
    """Whether a fixed first camera's pose is known too; if None, if there are further cameras."""
    video_rate: Rate = 30.0
    """Frames per second: what phones film at, and 3DPW was."""
    width: int = 1920
    """Pixels of the image, across."""
    height: int = 1080
    """Pixels of the image, down."""
    fov_deg: Annotated[float, Range(least=5, most=150)] = 60.0
    """Horizontal field of view: a phone's main camera (65 to 70) less what filming crops."""
    distortion: tuple[float, ...] = ()
    """OpenCV's coefficients; phones correct theirs."""
    azimuth_deg: float | None = None
    """Direction from the action to the camera, about the vertical; drawn if None."""
    distance_m: Annotated[float | None, Range(above=0, most=1_000)] = None
    """From the action to the camera; if None, as far as it takes to see it."""
    keypoints: str = "openpose18"
    """Keypoint set of the simulated detector: coco17, openpose18, body25, body25b, halpe26 …"""
    time_offset_s: float = 0.0
    """To be added to the video's times to get the sensors'; what is written says 0."""
    camera_imu: bool | None = None
    """Whether the camera carries an IMU; if None, if it moves."""
    # What a board on the floor tells of a camera four metres away, each axis: half a metre of board, corners to 0.2 px.
    camera_pose_error_deg: float = 0.1
    """Of a known pose of a camera, each axis."""
    camera_pose_error_m: float = 0.005
    """The same of its position."""
    camera_mounting_error_deg: float = 5.0
    """Of the IMU on the camera, each axis: taped along the edges by eye."""

    def __post_init__(self) -> None:
        keypoint_set(self.keypoints)
        if self.camera not in (None, "fixed", "hand-held", "walking"):
            raise InputError(f"camera '{self.camera}': expected fixed, hand-held or walking")
        check_ranges(self, zero=True)
        if self.known_camera_pose and self.camera not in (None, "fixed"):
            raise InputError(f"a known pose of a {self.camera} camera: only that of a fixed one can be known")
        self.model  # its own checks  # noqa: B018

    @property
    def model(self) -> CameraModel:
        """Intrinsics with square pixels and the principal point in the middle of the image."""
        focal = self.width / 2 / np.tan(np.deg2rad(self.fov_deg) / 2)
        return CameraModel(
            self.width, self.height, (focal, focal), (self.width / 2, self.height / 2), tuple(self.distortion)
        )

    @property
    def has_camera_imu(self) -> bool:
        """Whether the camera carries an IMU."""
        return self.camera != "fixed" if self.camera_imu is None else self.camera_imu

    @property
    def has_known_pose(self) -> bool:
        """Whether the first camera's pose is known."""
        if self.known_camera_pose is None:
            return self.cameras > 1 and self.camera == "fixed"
        return self.known_camera_pose


@dataclass(frozen=True)
class SceneSettings(FilmSettings):
    """Camera, detector and sensors of a simulated scene; by default with the errors that they have in use."""

    imu: SimulateSettings = field(default_factory=SimulateSettings)
    detector: DetectorSettings = field(default_factory=DetectorSettings)

    @classmethod
    def noise_free(cls, film: FilmSettings | None = None, **changes: Any) -> "SceneSettings":
        """No error of any sensor, of the camera's mounting, or of the detector; the camera moves all the same."""
        perfect = {"camera_mounting_error_deg": 0.0, "camera_pose_error_deg": 0.0, "camera_pose_error_m": 0.0}
        errors = {"imu": SimulateSettings.noise_free(), "detector": DetectorSettings.noise_free()}
        return cls(**(vars(film or FilmSettings()) | perfect | errors | changes))
