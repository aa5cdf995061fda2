"""The settings of all terms in one tree: how exact each statement is, and how an outlier of it is taken."""

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
    """Orientation of a bone against that of its sensor."""

    # Soft tissue and filter errors: 2–8° against optical references on well mounted sensors.
    sigma_deg: float = 4.0
    """Standard deviation in degrees."""
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.HUBER, 2.0))  # a knocked strap exceeds 8°

    @property
    def sigma(self) -> float:
        """Standard deviation in radians, of each row."""
        return math.radians(self.sigma_deg)


@dataclass(frozen=True)
class AccelerationSettings:
    """Acceleration of a model point against that of its sensor."""

    # Each row: soft tissue wobbles by 1–3 at the limbs in brisk motion (1.3–2.5 below 8 Hz on a walk with optical
    # reference), less at rest.
    sigma: float = 1.5
    """Standard deviation in m/s²."""
    # With six sensors acceleration alone tells where thighs and upper arms are, and is worth its bias: as in the
    # thesis, whose weight of it is larger for SIP (3.4.1) than for VIP (4.4.1).
    sparse_sigma: float = 0.5
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.HUBER, 2.0))  # foot strikes ring the straps


@dataclass(frozen=True)
class PosePriorSettings:
    """Weight of the learned Gaussian pose prior."""

    scale: float = 0.4  # of the whitened residual, once in a correlation time: a pose lasts for some two seconds
    mean_scale: float = 0.6  # of the recording's mean: a recording of one activity is off by more than one pose is


@dataclass(frozen=True)
class JointLimitSettings:
    """Stiffness of the ends of the joint ranges."""

    sigma_deg: float = 3.0  # people differ by more than this in every published table of ranges
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.CAUCHY, 3.0))  # Kaichi et al. 2020, eqs. 4–5
    # Whether the loss is of each axis by itself, as in their eq. 4; off: of a joint's three, whichever way axes are put
    per_axis: bool = False


@dataclass(frozen=True)
class HeadingPriorSettings:
    """Prior on the initial headings."""

    least_sigma_deg: float = 12.0  # of the initial headings, however sure they claim to be


@dataclass(frozen=True)
class AgreeingHeadingsSettings:
    """Agreement of the inertial frames of a wearer's sensors about the vertical."""

    # Degrees, standard deviation about their mean; none: nothing is known. Thirteen sensors of one make lay within −10°
    # to +4° of each other, one of them at −33°; sensors that each found a north of their own may lie anyhow.
    sigma_deg: float | None = None
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.CAUCHY, 2.0))  # one that was started elsewhere


@dataclass(frozen=True)
class HeadingWalkSettings:
    """Random walk of drifting headings."""

    # Degrees per √minute: magnetometer-free filters of consumer sensors drift by 1–5. What a recording shows of each
    # sensor's is weighed against this.
    drift_deg: float = 2.0
    # Degrees per √minute, before the first solution shows how each sensor drifts: too small a number would hold back
    # one that drifts by tens of degrees in minutes, as gyroscopes do that were never calibrated.
    unknown_drift_deg: float = 10.0


@dataclass(frozen=True)
class SensorPositionSettings:
    """Prior on the positions of sensors, along the bone and across it."""

    # Of the bone's length: a shank's sensor was found at half of it that was to sit at three tenths.
    along: float = 0.05
    across: float = 0.023  # m: limbs differ in thickness, thighs' sensors were 4–8 cm off in depth
    elsewhere: float = 0.023  # m, on bones that are no limb: head, trunk, pelvis, feet, hands


@dataclass(frozen=True)
class InitialPoseSettings:
    """Accuracy of a declared T- or N-pose."""

    scale: float = 0.6  # of the standard deviations measured on two people, joint by joint and axis by axis
    seconds: float = 1.0  # of holding still at the start; people do so for a breath at least
    # To the letter, as the papers and our simulator take poses; off: arms low, turned and bent, as people hold them.
    nominal: bool = False


@dataclass(frozen=True)
class HingeSettings:
    """Deviation of elbows and knees from hinges."""

    use: bool = True
    sigma_deg: float = 4.0  # optical elbows and knees stay within a few degrees of one axis
    twist_sigma_deg: float = 8.0  # of shanks, which turn by 10° against the thigh as the knee bends and by more bent


@dataclass(frozen=True)
class SmoothnessSettings:
    """Angular velocities of the joints."""

    use: bool = True  # without it six sensors lose a third more: see the changelog
    # s in which a joint crosses one standard deviation of the pose prior, at one standard deviation of its speed.
    time: float = 0.07


@dataclass(frozen=True)
class SoleSettings:
    """Thickness of soles: log-normal with mean 18 mm and standard deviation 12 mm."""

    # m, the median. Bare feet and socks have 0–5 mm, canvas shoes 10–20, trainers 25–35 under the heel and a centimetre
    # less under the ball; ergonomists add 25 mm for men's shoes (Pheasant & Haslegrave, Bodyspace), captured motions
    # have their feet 6–15 mm over the floor, and one measured walker's ankles stood 36 mm higher than a table's.
    thickness: NotNegative = 0.015
    spread: float = 0.6  # of its logarithm: two thirds of all people are within 8–27 mm, nearly all within 5–50

    def of(self, log_ratio: float) -> float:
        """Metres, of a value ``x`` of the variable."""
        return self.thickness * math.exp(log_ratio)


@dataclass(frozen=True)
class FootContactSettings:
    """Velocity of a foot in contact."""

    use: bool = True  # without it only accelerations place the root, and it drifts by metres in a minute
    sigma: float = 0.15  # m/s: the rolling ankle of a planted foot, and contacts found a frame late
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.CAUCHY, 2.0))  # a wrong contact must let go


@dataclass(frozen=True)
class FloorContactSettings:
    """Height of a foot in contact above the floor."""

    use: bool = True  # off for slopes and stairs, where it only costs: a robust loss lets a storey go, not a ramp
    sigma: float = 0.15  # m: 3–5 cm of soles, carpets and late contacts, which last: not so many independent facts
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.CAUCHY, 2.0))  # a step or a chair must let go


@dataclass(frozen=True)
class GaugePriorSettings:
    """Prior that fixes the free translation of an inertial reconstruction."""

    position_sigma: float = 0.01  # m: the first root position is a choice, so any small number does


@dataclass(frozen=True)
class FactorSettings:
    """The settings of the terms on a wearer."""

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
    # s. Errors of tissue, joints and detectors last as long as postures do: frames nearer than this are one statement,
    # and each of them counts as its share of it; so the frame rate, which is nobody's evidence, changes no weight.
    correlation_s: float = 0.35
    # Of the prior over bodies, in sigmas: what a table calls a joint's centre is not quite what keypoints follow.
    length_scale: float = 1.5


@dataclass(frozen=True)
class AdaptiveBiweightSettings:
    """Loss of keypoints far from their prediction."""

    use: bool = False
    reach: float = 2.0  # β_d: no weight beyond so many standard deviations
    # s in pixels of an image 1920 wide (the paper: 140, for people about 330 pixels tall); none: each person's own size
    scale_px: float | None = None


@dataclass(frozen=True)
class ReprojectionSettings:
    """Accuracy of the detector's keypoints."""

    # Standard deviation of a fully confident keypoint before anything is known of the detector, in OKS sigmas of that
    # keypoint times the square root of the person's area: OpenPose's scatter is 0.5.
    spread: float = 0.5
    # The part of a detector's errors that lasts for longer than a correlation time is so many times what changes.
    persistence: NotNegative = 2.0
    adaptive: bool = True  # after a first fit the spread is that of the residuals: detectors differ
    least_px: NotNegative = 1.0  # detectors answer on a grid of a few pixels
    # m: joint centres, clothes and a detector's habits are no better known, however sharply it sees; without it perfect
    # keypoints bend the body.
    point_sigma: NotNegative = 0.015
    least_confidence: Share = 0.1  # below it detectors guess
    # px, standard deviation of every fully confident keypoint alike; none: by its OKS sigma and the person's size.
    fixed_px: float | None = None
    biweight: AdaptiveBiweightSettings = field(default_factory=AdaptiveBiweightSettings)
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.CAUCHY, 2.0))  # left and right swap, limbs hide


@dataclass(frozen=True)
class CameraOrientationSettings:
    """Orientation of the camera against that of its sensor."""

    sigma_deg: float = 1.5  # a rigid mount: what remains are the errors of the attitude filter (data sheets: 0.5–2.5)
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.HUBER, 2.0))  # magnets in doors and cars

    def sigma(self, weight: float) -> float:
        """Standard deviation in radians, of each row, whose variance is divided by a weight."""
        return math.radians(self.sigma_deg) / math.sqrt(weight)


@dataclass(frozen=True)
class CameraAccelerationSettings:
    """Acceleration of the camera against that of its sensor."""

    sigma: float = 0.5  # m/s², each row: no soft tissue; a tilt error of 1.5° lets 0.25 of gravity through
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.HUBER, 2.0))  # knocks against the phone


@dataclass(frozen=True)
class CameraVelocitySettings:
    """Velocity of a camera; a broad prior, which only matters without measurements."""

    turn_sigma_deg_s: float = 60.0  # a pan that keeps a runner in view
    speed_sigma: float = 1.5  # m/s: who films walks
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.CAUCHY, 3.0))  # a cut in the video is a jump


@dataclass(frozen=True)
class CameraOdometrySettings:
    """Drift of a camera path from visual odometry: standard deviations of its error after one second."""

    turn_sigma_deg: float = 0.2  # of relative rotation, about each axis
    shift_sigma: float = 0.02  # m, of relative position, along each axis
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
    """When and how firmly an ankle is held where its pixel meets the floor."""

    # Of cameras of known pose only: the others' height over the floor is what the feet would tell. In four simulated
    # scenes (13 sensors, standing camera) joints were 57 mm from where they were in the room instead of 135 mm, for
    # detectors' habits and bone lengths put people 3 % too near; their poses stayed as they were.
    use: bool = True
    contact_from: ContactFrom = ContactFrom.JOINT_STATE  # what tells that a foot stands: a sensor on it, or the pose
    weighing: Weighing = Weighing.PIXELS  # how far the ankle may be from there: as its pixel says, or sigma everywhere
    sigma: float = 0.15  # m, where weighed by distance
    # m, where weighed by pixels: soles, carpets, late contacts, which last. Streams of twelve scenes on a level floor
    # were 5.4 cm off (without contact 5.4, at 0.03 and feet on the floor 6.3), four with people seen too near 11.9
    # (13.7, 9.5); at 0.01 poses bend to it.
    floor_sigma: float = 0.06
    acceleration_scale: float = 5.0  # m/s²: feet that accelerate more are believed in proportion less (Kaichi: β_G)
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.CAUCHY, 2.0))  # a foot on a step must let go


class LearnedOffsets:
    """Keypoint offsets from a file, read by :func:`vip_factors.io.keypoint_offsets_file.read_keypoint_offsets`.

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

    # m about each axis. Detectors lie 1–3 cm beside markers, all axes together; with 15 mm offsets took up what is the
    # skeleton's, whose joint centres are less certain still (foreign scenes: 28.4 mm against 27.1).
    sigma: float = 0.010
    elbow_wrist_sigma: float = 0.008  # m, of elbows and wrists, where a limb is thin and the joint shows
    hip_sigma: float = 0.020  # m: nobody sees a hip, detectors put it up to 4 cm above the joint

    # File with a detector's own means and sigmas instead (docs/factors.md).
    learned: LearnedOffsets | None = None


@dataclass(frozen=True)
class VideoClockSettings:
    """Prior on the video clock."""

    offset_sigma: float = 0.05  # s: an offset found by eye is good to a video frame or two
    # s/s. Quartz clocks are a few 1e-5 apart, those of warm phones 1e-4; a rate given as 30 for 29.97 Hz is off by
    # 1e-3, the usual mistake. A minute of walking determines a drift to 2e-4.
    drift_sigma: NotNegative = 1e-3


@dataclass(frozen=True)
class CameraFactorSettings:
    """The settings of the terms on a camera and what it saw."""

    reprojection: ReprojectionSettings = field(default_factory=ReprojectionSettings)
    orientation: CameraOrientationSettings = field(default_factory=CameraOrientationSettings)
    acceleration: CameraAccelerationSettings = field(default_factory=CameraAccelerationSettings)
    velocity: CameraVelocitySettings = field(default_factory=CameraVelocitySettings)
    odometry: CameraOdometrySettings = field(default_factory=CameraOdometrySettings)
    ground_contact: GroundContactSettings = field(default_factory=GroundContactSettings)
    keypoint_offset: KeypointOffsetSettings = field(default_factory=KeypointOffsetSettings)
    clock: VideoClockSettings = field(default_factory=VideoClockSettings)
    correlation_s: float = 0.35  # s, of what the camera's own sensor says, as factors.correlation_s
    heading_sigma_deg: float = 45.0  # of the camera IMU's heading, which nothing but the picture tells
