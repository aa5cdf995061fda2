"""Settings of all factors in one tree: standard deviations and robust losses."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

from vip_factors.ranges import NotNegative, Share


class Loss(StrEnum):
    """Robust loss of a whitened residual's norm ``r`` beyond the tuning constant ``k``."""

    SQUARE = "square"
    HUBER = "huber"
    CAUCHY = "cauchy"


@dataclass(frozen=True)
class RobustLoss:
    """A loss of the norm of one whitened residual; ``k`` is in standard deviations."""

    loss: Loss = Loss.SQUARE
    k: float = 1.345

    def tempered(self, share: float) -> "RobustLoss":
        """``share`` times this loss, of residuals that are scaled by its root."""
        if self.loss is Loss.SQUARE:
            return self
        return RobustLoss(self.loss, self.k * math.sqrt(share))


SQUARE = RobustLoss()


@dataclass(frozen=True)
class OrientationSettings:
    """Difference between the orientation of a bone and that of its sensor."""

    # Soft tissue and filter errors: 2–8° against optical references on well mounted sensors.
    sigma_deg: float = 4.0
    """Standard deviation in degrees."""
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.HUBER, 2.0))  # hit straps exceed 8°

    @property
    def sigma(self) -> float:
        """Standard deviation in radians, of each row."""
        return math.radians(self.sigma_deg)


@dataclass(frozen=True)
class AccelerationSettings:
    """Difference between the acceleration of the model and that of its sensor."""

    # Each row: soft tissue wobbles by 1–3 at the limbs in brisk motion (1.3–2.5 below 8 Hz on a walk with optical
    # reference), less at rest.
    sigma: float = 1.5
    """Standard deviation in m/s²."""
    # Standard deviation in m/s² with six sensors, where only accelerations determine thighs and upper arms (thesis
    # 3.4.1).
    sparse_sigma: float = 0.5
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.HUBER, 2.0))  # foot strikes shake the straps


@dataclass(frozen=True)
class PosePriorSettings:
    """Weight of the learned Gaussian pose prior."""

    scale: float = 0.4  # factor on the whitened residual, once per correlation time
    mean_scale: float = 0.6  # factor on the whitened residual of the recording's mean pose


@dataclass(frozen=True)
class JointLimitSettings:
    """Stiffness of the ends of the joint ranges."""

    sigma_deg: float = 3.0  # standard deviation beyond a range, degrees; published ranges differ by more
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.CAUCHY, 3.0))  # Kaichi et al. 2020, eqs. 4–5
    # Apply the loss to each axis, as in Kaichi's eq. 4; off: to the norm over the three axes of a joint.
    per_axis: bool = False


@dataclass(frozen=True)
class HeadingPriorSettings:
    """Prior on the initial headings."""

    least_sigma_deg: float = 12.0  # smallest standard deviation of an initial heading, degrees


@dataclass(frozen=True)
class AgreeingHeadingsSettings:
    """Agreement of the inertial frames of a wearer's sensors about the vertical."""

    # Standard deviation of headings about their mean in degrees, for sensors started together (thirteen of one make
    # agreed within −10° to +4°, except one at −33°); none: headings are independent.
    sigma_deg: float | None = None
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.CAUCHY, 2.0))  # a sensor started elsewhere


@dataclass(frozen=True)
class HeadingWalkSettings:
    """Random walk of drifting headings."""

    # Prior drift in degrees per √minute, combined with the drift that the recording shows; consumer sensors without
    # magnetometer drift by 1–5.
    drift_deg: float = 2.0
    # Drift in degrees per √minute before the first solution; large enough for uncalibrated gyroscopes, which drift by
    # tens of degrees in minutes.
    unknown_drift_deg: float = 10.0


@dataclass(frozen=True)
class SensorPositionSettings:
    """Prior on the positions of sensors, along the bone and across it."""

    # Standard deviation along the bone, as a share of its length.
    along: float = 0.05
    across: float = 0.023  # standard deviation across a limb, m
    elsewhere: float = 0.023  # standard deviation on head, trunk, pelvis, feet and hands, m


@dataclass(frozen=True)
class InitialPoseSettings:
    """Accuracy of a declared T- or N-pose."""

    scale: float = 0.6  # factor on the standard deviations measured on two people, per joint and axis
    seconds: float = 1.0  # duration of the pose at the start, s
    # Assume an exact pose, as in the papers; off: arms a little low, rotated and bent, as people hold them.
    nominal: bool = False


@dataclass(frozen=True)
class HingeSettings:
    """Deviation of elbows and knees from hinges."""

    use: bool = True
    sigma_deg: float = 4.0  # standard deviation of elbows and knees from a hinge, degrees
    twist_sigma_deg: float = 8.0  # standard deviation of the axial rotation of the shank, degrees


@dataclass(frozen=True)
class SmoothnessSettings:
    """Angular velocities of the joints."""

    use: bool = True  # off: errors with six sensors grow by a third
    # Time in s in which a joint at one standard deviation of its speed crosses one standard deviation of the pose
    # prior.
    time: float = 0.07


@dataclass(frozen=True)
class SoleSettings:
    """Thickness of soles: log-normal with mean 18 mm and standard deviation 12 mm."""

    # Median thickness in m: bare feet and socks 0–5 mm, canvas shoes 10–20, trainers 25–35 under the heel (Pheasant &
    # Haslegrave, Bodyspace).
    thickness: NotNegative = 0.015
    spread: float = 0.6  # standard deviation of its logarithm: two thirds of people within 8–27 mm

    def of(self, log_ratio: float) -> float:
        """Metres, of a value ``x`` of the variable."""
        return self.thickness * math.exp(log_ratio)


@dataclass(frozen=True)
class FootContactSettings:
    """Velocity of a foot in contact."""

    use: bool = True  # off: without a camera the position drifts by metres in a minute
    sigma: float = 0.15  # standard deviation of the velocity of a foot in contact, m/s
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.CAUCHY, 2.0))  # wrong contacts


@dataclass(frozen=True)
class FloorContactSettings:
    """Height of a foot in contact above the floor."""

    use: bool = True  # off: for slopes and stairs
    sigma: float = 0.15  # standard deviation of the height, m: soles, carpets and late contacts, correlated over time
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.CAUCHY, 2.0))  # steps and chairs


@dataclass(frozen=True)
class GaugePriorSettings:
    """Prior that fixes the free translation of an inertial reconstruction."""

    position_sigma: float = 0.01  # m; the first root position is arbitrary, so any small number works


@dataclass(frozen=True)
class FactorSettings:
    """Settings of the factors of a wearer."""

    orientation: OrientationSettings = field(default_factory=OrientationSettings)
    acceleration: AccelerationSettings = field(default_factory=AccelerationSettings)
    pose_prior: PosePriorSettings = field(default_factory=PosePriorSettings)
    joint_limit: JointLimitSettings = field(default_factory=JointLimitSettings)
    heading_prior: HeadingPriorSettings = field(default_factory=HeadingPriorSettings)
    agreeing_headings: AgreeingHeadingsSettings = field(default_factory=AgreeingHeadingsSettings)
    sensor_place: SensorPositionSettings = field(default_factory=SensorPositionSettings)
    heading_walk: HeadingWalkSettings = field(default_factory=HeadingWalkSettings)
    initial_pose: InitialPoseSettings = field(default_factory=InitialPoseSettings)
    hinge: HingeSettings = field(default_factory=HingeSettings)
    smoothness: SmoothnessSettings = field(default_factory=SmoothnessSettings)
    sole: SoleSettings = field(default_factory=SoleSettings)
    foot_contact: FootContactSettings = field(default_factory=FootContactSettings)
    floor_contact: FloorContactSettings = field(default_factory=FloorContactSettings)
    gauge_prior: GaugePriorSettings = field(default_factory=GaugePriorSettings)
    # Correlation time in s of the errors of soft tissue, joints and detectors. Each frame is weighted by its share of
    # this time, so results do not depend on the frame rate.
    correlation_s: float = 0.35
    # Factor on the standard deviations of the body prior, because joint centres in tables differ from keypoints.
    length_scale: float = 1.5


@dataclass(frozen=True)
class AdaptiveBiweightSettings:
    """Loss of keypoints far from their prediction."""

    use: bool = False
    reach: float = 2.0  # β_d: standard deviations beyond which a keypoint has no weight
    # Scale in pixels of an image 1920 wide (paper: 140, for people 330 pixels tall); none: the size of each person.
    scale_px: float | None = None


@dataclass(frozen=True)
class ReprojectionSettings:
    """Accuracy of the detector's keypoints."""

    # Initial standard deviation of a fully confident keypoint, in OKS sigmas of the keypoint times the square root of
    # the person's area; OpenPose has 0.5.
    spread: float = 0.5
    # Ratio of detector errors that last longer than the correlation time to those that change.
    persistence: NotNegative = 2.0
    adaptive: bool = True  # estimate the spread from the residuals of a first fit
    least_px: NotNegative = 1.0  # smallest standard deviation in pixels: detectors quantise
    # Standard deviation in m at the body, for joint centres, clothes and constant detector errors; added to that in the
    # image.
    point_sigma: NotNegative = 0.015
    least_confidence: Share = 0.1  # keypoints below this confidence are ignored
    # Standard deviation in pixels of every fully confident keypoint; none: from its OKS sigma and the person's size.
    fixed_px: float | None = None
    biweight: AdaptiveBiweightSettings = field(default_factory=AdaptiveBiweightSettings)
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.CAUCHY, 2.0))  # swapped sides, hidden limbs


@dataclass(frozen=True)
class CameraOrientationSettings:
    """Difference between the orientation of the camera and that of its sensor."""

    sigma_deg: float = 1.5  # standard deviation in degrees, of the attitude filter (data sheets: 0.5–2.5)
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.HUBER, 2.0))  # magnetic disturbances

    def sigma(self, weight: float) -> float:
        """Standard deviation in radians, of each row, whose variance is divided by a weight."""
        return math.radians(self.sigma_deg) / math.sqrt(weight)


@dataclass(frozen=True)
class CameraAccelerationSettings:
    """Difference between the acceleration of the camera and that of its sensor."""

    sigma: float = 0.5  # standard deviation per axis, m/s²; a tilt error of 1.5° gives 0.25
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.HUBER, 2.0))  # knocks against the phone


@dataclass(frozen=True)
class CameraVelocitySettings:
    """Velocity of a camera; a broad prior, which only matters without measurements."""

    turn_sigma_deg_s: float = 60.0  # standard deviation, degrees/s
    speed_sigma: float = 1.5  # standard deviation, m/s: walking speed
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.CAUCHY, 3.0))  # a cut in the video is a jump


@dataclass(frozen=True)
class CameraOdometrySettings:
    """Drift of a camera path from visual odometry: standard deviations of its error after one second."""

    turn_sigma_deg: float = 0.2  # relative rotation about each axis, degrees
    shift_sigma: float = 0.02  # relative position along each axis, m
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.CAUCHY, 3.0))  # a reset is a jump


class ContactFrom(StrEnum):
    """Evidence that a foot stands."""

    ACCELERATION = "acceleration"  # of the sensor on it, and which foot is lower: one always stands (Kaichi)
    JOINT_STATE = "joint-state"  # neither moves nor is high: both feet may be off the ground


class Weighing(StrEnum):
    """Weight of the end of the ray."""

    DISTANCE = "distance"  # alike in all directions, near and far (Kaichi)
    PIXELS = "pixels"  # from the pixel and the floor: long along a flat ray, short across it


@dataclass(frozen=True)
class GroundContactSettings:
    """Contact of an ankle with the floor at the ray of its pixel."""

    # Only for cameras of known pose. It corrects the distance of people from the camera: in four simulated scenes,
    # joint errors in the room fell from 135 to 57 mm.
    use: bool = True
    contact_from: ContactFrom = ContactFrom.JOINT_STATE  # evidence of contact: foot sensor or pose
    weighing: Weighing = Weighing.PIXELS  # standard deviation of the ankle: from the pixel's, or sigma
    sigma: float = 0.15  # standard deviation with weighing by distance, m
    # Standard deviation of the floor's height in m with weighing by pixels: soles, carpets and late contacts,
    # correlated over time.
    floor_sigma: float = 0.06
    acceleration_scale: float = 5.0  # foot acceleration above which the weight falls, m/s² (Kaichi: β_G)
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.CAUCHY, 2.0))  # feet on steps


class LearnedOffsets:
    """Keypoint offsets from a file, read by :func:`vip_factors.io.detections.read_keypoint_offsets`.

    Attributes:
        path: path of the file.
        by_set: by the name of a keypoint set, means and sigmas ``(K, 3)`` m.
    """

    def __init__(self, path: Path, by_set: Mapping[str, tuple[Sequence[Sequence[float]], ...]]) -> None:
        self.path, self.by_set = path, by_set

    def __str__(self) -> str:
        return str(self.path)


@dataclass(frozen=True)
class KeypointOffsetSettings:
    """Prior on the offset of a detector's keypoints from the joints."""

    # Standard deviation along each axis in m; detectors differ from markers by 1–3 cm over all axes.
    sigma: float = 0.010
    elbow_wrist_sigma: float = 0.008  # standard deviation of elbows and wrists, m
    hip_sigma: float = 0.020  # standard deviation of hips, m; detectors place them up to 4 cm high

    # File with the means and standard deviations of a detector (docs/factors.md).
    learned: LearnedOffsets | None = None


@dataclass(frozen=True)
class VideoClockSettings:
    """Prior on the video clock."""

    offset_sigma: float = 0.05  # standard deviation of the offset, s: one or two video frames
    # Standard deviation of the drift in s/s: quartz clocks differ by a few 1e-5, and a rate of 30 given for 29.97 Hz by
    # 1e-3.
    drift_sigma: NotNegative = 1e-3


@dataclass(frozen=True)
class CameraFactorSettings:
    """Settings of the factors of a camera and its detections."""

    reprojection: ReprojectionSettings = field(default_factory=ReprojectionSettings)
    orientation: CameraOrientationSettings = field(default_factory=CameraOrientationSettings)
    acceleration: CameraAccelerationSettings = field(default_factory=CameraAccelerationSettings)
    velocity: CameraVelocitySettings = field(default_factory=CameraVelocitySettings)
    odometry: CameraOdometrySettings = field(default_factory=CameraOdometrySettings)
    ground_contact: GroundContactSettings = field(default_factory=GroundContactSettings)
    keypoint_offset: KeypointOffsetSettings = field(default_factory=KeypointOffsetSettings)
    clock: VideoClockSettings = field(default_factory=VideoClockSettings)
    correlation_s: float = 0.35  # correlation time of the camera's sensor, s, as factors.correlation_s
    heading_sigma_deg: float = 45.0  # standard deviation of the initial heading of the camera's sensor
