"""Registry of all terms of the objective."""

from collections.abc import Sequence

from vip_factors.problem.scene import ExtraTerms, SceneProblem
from vip_factors.problem.wearer import WearerProblem
from vip_factors.terms.acceleration import ACCELERATION
from vip_factors.terms.agreeing_headings import AGREEING_HEADINGS
from vip_factors.terms.body_prior import BODY_PRIOR
from vip_factors.terms.camera_acceleration import CAMERA_ACCELERATION
from vip_factors.terms.camera_odometry import CAMERA_ODOMETRY, ODOMETRY_SCALE_PRIOR
from vip_factors.terms.camera_orientation import CAMERA_ORIENTATION
from vip_factors.terms.camera_velocity import CAMERA_VELOCITY
from vip_factors.terms.constant_velocity_prior import PELVIS_TURN, ROOT_VELOCITY
from vip_factors.terms.equations import Term
from vip_factors.terms.evaluation import CameraEvaluation, ViewEvaluation, WearerEvaluation
from vip_factors.terms.floor_contact import FLOOR_CONTACT
from vip_factors.terms.foot_contact import FOOT_CONTACT
from vip_factors.terms.gauge_prior import GAUGE_PRIOR
from vip_factors.terms.ground_contact import GROUND_CONTACT
from vip_factors.terms.heading_prior import CAMERA_HEADING_PRIOR, HEADING_PRIOR
from vip_factors.terms.heading_walk import HEADING_WALK
from vip_factors.terms.hinge import HINGE, HINGE_PRIOR
from vip_factors.terms.joint_limit import JOINT_LIMIT
from vip_factors.terms.keypoint_offset import KEYPOINT_OFFSET_PRIOR
from vip_factors.terms.lens import LENS_PRIOR
from vip_factors.terms.orientation import ORIENTATION
from vip_factors.terms.pose_prior import POSE_MEAN, POSE_PRIOR
from vip_factors.terms.reprojection import REPROJECTION
from vip_factors.terms.rotation_prior import CAMERA_MOUNTING_PRIOR, INITIAL_POSE, MOUNTING_PRIOR
from vip_factors.terms.sensor_position import SENSOR_POSITION_PRIOR
from vip_factors.terms.smoothness import SMOOTHNESS
from vip_factors.terms.sole import SOLE_PRIOR
from vip_factors.terms.video_clock import CLOCK_DRIFT_PRIOR, CLOCK_PRIOR

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
    CAMERA_ODOMETRY,
    ODOMETRY_SCALE_PRIOR,
    CAMERA_HEADING_PRIOR,
    CAMERA_MOUNTING_PRIOR,
    CLOCK_PRIOR,
    CLOCK_DRIFT_PRIOR,
    LENS_PRIOR,
    KEYPOINT_OFFSET_PRIOR,
)


def unfilmed_problem(wearers: Sequence[WearerProblem], extra: ExtraTerms | None = None) -> SceneProblem:
    """Build the problem of wearers without cameras."""
    return SceneProblem(tuple(wearers), (), (), extra=extra)
