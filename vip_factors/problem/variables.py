"""What all frames share, block by block: the one place where a static variable is declared."""

from dataclasses import dataclass

import numpy as np

from vip_factors.body.hinges import HINGE_VARIABLES
from vip_factors.body.keypoints import OFFSET_KEYPOINTS
from vip_factors.body.lengths import LENGTHS
from vip_factors.body.pose_prior import POSE_SIZE
from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.problem.layout import (
    FRAME,
    POSE,
    ROOT,
    FrameBlock,
    Layout,
    Manifold,
    Owner,
    OwnerId,
    StaticBlock,
)
from vip_factors.problem.scene import CameraProblem, SceneProblem
from vip_factors.problem.wearer import WearerProblem

# One unit of damping, in physical units, is a prior of this size on every step.
STEP_ANGLE = 0.1  # rad
STEP_LENGTH = 0.5  # m
STEP_CLOCK = 0.05  # s
STEP_CLOCK_DRIFT = 1e-3  # s/s
STEP_BODY = 0.05  # m
STEP_SOLE = 0.5  # of its logarithm
BODY_MOVED = 0.003  # m: from where on a length is linearised anew in a stream
SOLE_MOVED = 0.1  # and a sole's logarithm
CAMERA = OwnerId(Owner.CAMERA)
DETECTOR = OwnerId(Owner.DETECTOR)


@dataclass(frozen=True)
class ProcessNoiseSettings:
    """How fast what all frames share may wander in a stream, per √second.

    Beyond drift it stands for what repeats from frame to frame: taken as new each time it would make headings and
    mountings surer than they are within seconds, and hold them where the first seconds put them.
    """

    every_s: float = 0.5  # the walk goes in steps: one elimination more at each
    heading_deg: float = 0.3  # 2.3° in a minute: twice what a good filter drifts
    mounting_deg: float = 0.3  # straps creep, skin moves
    camera_deg: float = 0.05  # a camera that stands still does
    camera_m: float = 0.002


RELINEARISE_DEG = 0.3  # heading or mounting: they are seen by all frames, 1.0 costs 2 mm


def wearer_blocks(wearer: WearerProblem, wander: ProcessNoiseSettings, relinearise: float) -> tuple[StaticBlock, ...]:
    """A wearer's."""
    S, limit = len(wearer.sensors), relinearise
    heading, mounting = float(np.deg2rad(wander.heading_deg)), float(np.deg2rad(wander.mounting_deg))
    return (
        StaticBlock("headings", Manifold.VECTOR, S, wearer.free_headings, STEP_ANGLE, heading, limit),
        StaticBlock("R_bone_sensor", Manifold.ROTATION, S, wearer.free_mountings, STEP_ANGLE, mounting, limit),
        StaticBlock("body", Manifold.VECTOR, len(LENGTHS), wearer.body_moves, STEP_BODY, 0.0, BODY_MOVED),
        StaticBlock("sensor_places", Manifold.POINT, S, wearer.free_places, STEP_BODY, 0.0, BODY_MOVED),
        StaticBlock("sole", Manifold.VECTOR, 1, wearer.free_sole, STEP_SOLE, 0.0, SOLE_MOVED),
        StaticBlock("hinges", Manifold.VECTOR, HINGE_VARIABLES, wearer.free_hinges, STEP_ANGLE, 0.0, limit),
        StaticBlock("pose_mean", Manifold.VECTOR, POSE_SIZE, wearer.free_pose_mean, STEP_ANGLE, 0.0, limit),
    )


def camera_blocks(camera: CameraProblem, wander: ProcessNoiseSettings, relinearise: float) -> tuple[StaticBlock, ...]:
    """The camera's; its pose only where it stands still."""
    limit, has_imu, turn = relinearise, camera.imu is not None, float(np.deg2rad(wander.camera_deg))
    heading, standing = float(np.deg2rad(wander.heading_deg)), camera.free_pose and not camera.moving
    return (
        StaticBlock(
            "poses", Manifold.POSE, 1, standing, (STEP_ANGLE,) * 3 + (STEP_LENGTH,) * 3,
            (turn,) * 3 + (wander.camera_m,) * 3, limit,
        ),
        StaticBlock("heading", Manifold.VECTOR, 1, has_imu, STEP_ANGLE, heading, limit),
        StaticBlock("R_camera_imu", Manifold.ROTATION, 1, has_imu, STEP_ANGLE, heading, limit),
        StaticBlock("clock", Manifold.VECTOR, 1, camera.free_clock, STEP_CLOCK, heading, limit),
        StaticBlock("clock_drift", Manifold.VECTOR, 1, camera.free_clock, STEP_CLOCK_DRIFT, 0.0, limit),
    )  # fmt: skip


def detector_blocks(scene: SceneProblem) -> tuple[StaticBlock, ...]:
    """The detector's, which all wearers and cameras share."""
    count = len(OFFSET_KEYPOINTS)
    return (StaticBlock("keypoint_offsets", Manifold.POINT, count, scene.free_keypoints, STEP_BODY, 0.0, BODY_MOVED),)


def scene_layout(
    scene: SceneProblem,
    wander: ProcessNoiseSettings | None = None,
    relinearise_deg: float = RELINEARISE_DEG,
    wearers_move: bool = True,
) -> Layout:
    """All variables of a scene that move; without the wearers' if these are kept as they are."""
    wander, limit = wander or ProcessNoiseSettings(), float(np.deg2rad(relinearise_deg))
    chains, blocks = list[FrameBlock](), list[tuple[OwnerId, tuple[StaticBlock, ...]]]()
    if wearers_move:
        for number, wearer in enumerate(scene.wearers):
            owner = OwnerId(Owner.WEARER, number)
            chains.append(_wearer_frame(owner))
            blocks.append((owner, wearer_blocks(wearer, wander, limit)))
    if scene.camera.free_pose and scene.camera.moving:
        step = np.repeat([STEP_ANGLE, STEP_LENGTH], 3)
        chains.append(FrameBlock(CAMERA, POSE, step, {"poses": slice(0, POSE)}))
    blocks.append((CAMERA, camera_blocks(scene.camera, wander, limit)))
    blocks.append((DETECTOR, detector_blocks(scene)))
    return Layout(tuple(chains), tuple(blocks))


def _wearer_frame(owner: OwnerId) -> FrameBlock:
    step = np.repeat([STEP_ANGLE, STEP_LENGTH], [ROOT, 3])
    names = {name: slice(3 * joint, 3 * joint + 3) for joint, name in enumerate(JOINT_NAMES)}
    names["root"] = slice(ROOT, FRAME)
    return FrameBlock(owner, FRAME, step, names)
