"""The list of terms, and their settings in one tree: what sums, counts, tests or draws terms takes them from here."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from vip_factors.problem.scene import CameraProblem, ExtraTerms, KeypointView, SceneProblem
from vip_factors.problem.wearer import WearerProblem
from vip_factors.sensors.camera import CameraModel
from vip_factors.terms.acceleration import ACCELERATION, AccelerationSettings
from vip_factors.terms.agreeing_headings import AGREEING_HEADINGS, AgreeingHeadingsSettings
from vip_factors.terms.body_prior import BODY_PRIOR
from vip_factors.terms.camera_acceleration import CAMERA_ACCELERATION, CameraAccelerationSettings
from vip_factors.terms.camera_orientation import CAMERA_ORIENTATION, CameraOrientationSettings
from vip_factors.terms.camera_velocity import CAMERA_VELOCITY, CameraVelocitySettings
from vip_factors.terms.constant_velocity_prior import PELVIS_TURN, ROOT_VELOCITY, ConstantVelocitySettings
from vip_factors.terms.equations import Term
from vip_factors.terms.evaluation import CameraEvaluation, ViewEvaluation, WearerEvaluation
from vip_factors.terms.floor_contact import FLOOR_CONTACT, FloorContactSettings
from vip_factors.terms.foot_contact import FOOT_CONTACT, FootContactSettings
from vip_factors.terms.gauge_prior import GAUGE_PRIOR, GaugePriorSettings
from vip_factors.terms.ground_contact import GROUND_CONTACT, GroundContactSettings
from vip_factors.terms.heading_prior import CAMERA_HEADING_PRIOR, HEADING_PRIOR, HeadingPriorSettings
from vip_factors.terms.heading_walk import HEADING_WALK, HeadingWalkSettings
from vip_factors.terms.hinge import HINGE, HINGE_PRIOR, HingeSettings
from vip_factors.terms.joint_limit import JOINT_LIMIT, JointLimitSettings
from vip_factors.terms.keypoint_offset import KEYPOINT_OFFSET_PRIOR, KeypointOffsetSettings
from vip_factors.terms.orientation import ORIENTATION, OrientationSettings
from vip_factors.terms.pose_prior import POSE_MEAN, POSE_PRIOR, PosePriorSettings
from vip_factors.terms.reprojection import REPROJECTION, ReprojectionSettings
from vip_factors.terms.rotation_prior import CAMERA_MOUNTING_PRIOR, INITIAL_POSE, MOUNTING_PRIOR, InitialPoseSettings
from vip_factors.terms.sensor_position import SENSOR_POSITION_PRIOR, SensorPositionSettings
from vip_factors.terms.smoothness import SMOOTHNESS, SmoothnessSettings
from vip_factors.terms.sole import SOLE_PRIOR, SoleSettings
from vip_factors.terms.video_clock import CLOCK_DRIFT_PRIOR, CLOCK_PRIOR, VideoClockSettings

WEARER_TERMS: tuple[Term[WearerEvaluation], ...] = (
    ORIENTATION,
    POSE_PRIOR,
    JOINT_LIMIT,
    HINGE,
    FLOOR_CONTACT,
    INITIAL_POSE,
    SMOOTHNESS,
    PELVIS_TURN,
    ACCELERATION,
    FOOT_CONTACT,
    ROOT_VELOCITY,
    HEADING_PRIOR,
    AGREEING_HEADINGS,
    HEADING_WALK,
    MOUNTING_PRIOR,
    POSE_MEAN,
    BODY_PRIOR,
    HINGE_PRIOR,
    SENSOR_POSITION_PRIOR,
    SOLE_PRIOR,
    GAUGE_PRIOR,
)
VIEW_TERMS: tuple[Term[ViewEvaluation], ...] = (REPROJECTION, GROUND_CONTACT)
CAMERA_TERMS: tuple[Term[CameraEvaluation], ...] = (
    CAMERA_ORIENTATION,
    CAMERA_ACCELERATION,
    CAMERA_VELOCITY,
    CAMERA_HEADING_PRIOR,
    CAMERA_MOUNTING_PRIOR,
    CLOCK_PRIOR,
    CLOCK_DRIFT_PRIOR,
    KEYPOINT_OFFSET_PRIOR,
)


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
    constant_velocity: ConstantVelocitySettings = field(default_factory=ConstantVelocitySettings)
    # s. Errors of tissue, joints and detectors last as long as postures do: frames nearer than this are one statement,
    # and each of them counts as its share of it; so the frame rate, which is nobody's evidence, changes no weight.
    correlation_s: float = 0.35
    # Of the prior over bodies, in sigmas: what a table calls a joint's centre is not quite what keypoints follow.
    length_scale: float = 1.5


@dataclass(frozen=True)
class CameraFactorSettings:
    """The settings of the terms on a camera and what it saw."""

    reprojection: ReprojectionSettings = field(default_factory=ReprojectionSettings)
    orientation: CameraOrientationSettings = field(default_factory=CameraOrientationSettings)
    acceleration: CameraAccelerationSettings = field(default_factory=CameraAccelerationSettings)
    velocity: CameraVelocitySettings = field(default_factory=CameraVelocitySettings)
    ground_contact: GroundContactSettings = field(default_factory=GroundContactSettings)
    keypoint_offset: KeypointOffsetSettings = field(default_factory=KeypointOffsetSettings)
    clock: VideoClockSettings = field(default_factory=VideoClockSettings)
    correlation_s: float = 0.35  # s, of what the camera's own sensor says, as factors.correlation_s
    heading_sigma_deg: float = 45.0  # of the camera IMU's heading, which nothing but the picture tells


def unfilmed_problem(wearers: Sequence[WearerProblem], extra: ExtraTerms | None = None) -> SceneProblem:
    """The problem of wearers before no camera: the one that it has sees nobody and has no free variables."""
    lens = CameraModel(640, 480, (500.0, 500.0), (320.0, 240.0))
    camera = CameraProblem(lens, moving=False, settings=CameraFactorSettings(), free_pose=False)
    views = tuple(KeypointView.unseen((), len(wearer.frames)) for wearer in wearers)
    return SceneProblem(tuple(wearers), camera, views, extra=extra)
