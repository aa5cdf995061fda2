"""Table of static variables, from which layout, columns, GTSAM's keys and values, and covariances derive.

The owner's state (:mod:`vip_factors.problem.state`) has an attribute of each row's name.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from vip_factors.body.joint_priors import HINGE_VARIABLES, POSE_SIZE
from vip_factors.body.keypoints import OFFSET_KEYPOINTS
from vip_factors.body.lengths import LENGTHS
from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.problem.layout import FRAME, POSE, ROOT, FrameBlock, Layout, Manifold, Owner, OwnerId, StaticBlock
from vip_factors.problem.scene import CameraProblem, SceneProblem
from vip_factors.problem.wearer import WearerProblem
from vip_factors.settings import ProcessNoiseSettings, RelinearisationSettings

# One unit of damping, in physical units, is a prior of this size on every step.
STEP_ANGLE = 0.1  # rad
STEP_LENGTH = 0.5  # m
STEP_CLOCK = 0.05  # s
STEP_CLOCK_DRIFT = 1e-3  # s/s
STEP_ZOOM = 0.1  # of its logarithm
STEP_BODY = 0.05  # m
STEP_SOLE = 0.5  # of its logarithm
BODY_MOVED = 0.003  # m: change of a length in a stream, beyond which it is linearised again
SOLE_MOVED = 0.1  # the same for the sole's logarithm
ZOOM_MOVED = 0.005  # and for that of the focal length
DETECTOR = OwnerId(Owner.DETECTOR)


Problem = TypeVar("Problem", WearerProblem, CameraProblem, SceneProblem)


@dataclass(frozen=True)
class Row(Generic[Problem]):
    """One kind of variable.

    Attributes:
        name: name of the block, and of the attribute of the owner's state.
        title: kind of variable in words.
        letter: letter of the GTSAM keys.
        owner: kind of owner.
        manifold: manifold of each item.
        step: one unit of damping is a prior of this size on a step (rad, m, s).
        count: number of items; None for one of each sensor of the wearer.
        free: function of the owner's problem; True if these are variables.
        process_noise: random walk in a stream, per √second.
        relinearise: change in a stream beyond which it is linearised again; None for the stream's angle.
        one_vector: True if all items are one variable of GTSAM.
    """

    name: str
    title: str
    letter: str
    owner: Owner
    manifold: Manifold
    step: float | tuple[float, ...]
    count: int | None
    free: Callable[[Problem], bool]
    process_noise: Callable[[ProcessNoiseSettings], float | tuple[float, ...]] = lambda noise: 0.0
    relinearise: float | None = None
    one_vector: bool = False

    @property
    def of_sensors(self) -> bool:
        """True if each sensor of the wearer has an item."""
        return self.count is None

    def block(self, problem: Problem, sensors: int, noise: ProcessNoiseSettings, angle: float) -> StaticBlock:
        """Make the block of the owner of a ``problem``."""
        count, free = sensors if self.count is None else self.count, self.free(problem)
        limit = angle if self.relinearise is None else self.relinearise
        return StaticBlock(self.name, self.manifold, count, free, self.step, self.process_noise(noise), limit)


def _heading_noise(noise: ProcessNoiseSettings) -> float:
    return float(np.deg2rad(noise.heading_deg))


def _mounting_noise(noise: ProcessNoiseSettings) -> float:
    return float(np.deg2rad(noise.mounting_deg))


def _pose_noise(noise: ProcessNoiseSettings) -> tuple[float, ...]:
    degrees, metres = 0.05, 0.002  # of a camera that stands still
    return (float(np.deg2rad(degrees)),) * 3 + (metres,) * 3


VECTOR, POINT, ROTATION = Manifold.VECTOR, Manifold.POINT, Manifold.ROTATION
WEARER_ROWS: tuple[Row[WearerProblem], ...] = (
    Row("headings", "heading", "h", Owner.WEARER, VECTOR, STEP_ANGLE, None, lambda wearer: wearer.free_headings,
        _heading_noise),
    Row("R_bone_sensor", "mounting", "b", Owner.WEARER, ROTATION, STEP_ANGLE, None,
        lambda wearer: wearer.free_mountings, _mounting_noise),
    Row("body", "body", "s", Owner.WEARER, VECTOR, STEP_BODY, len(LENGTHS), lambda wearer: wearer.body_moves,
        relinearise=BODY_MOVED, one_vector=True),
    Row("sensor_positions", "place of a sensor", "p", Owner.WEARER, POINT, STEP_BODY, None,
        lambda wearer: wearer.free_places, relinearise=BODY_MOVED),
    Row("sole", "sole", "f", Owner.WEARER, VECTOR, STEP_SOLE, 1, lambda wearer: wearer.free_sole,
        relinearise=SOLE_MOVED),
    Row("hinges", "axes of elbows and knees", "e", Owner.WEARER, VECTOR, STEP_ANGLE, HINGE_VARIABLES,
        lambda wearer: wearer.free_hinges, one_vector=True),
    Row("pose_mean", "mean pose", "m", Owner.WEARER, VECTOR, STEP_ANGLE, POSE_SIZE,
        lambda wearer: wearer.free_pose_mean, one_vector=True),
)  # fmt: skip
CAMERA_ROWS: tuple[Row[CameraProblem], ...] = (
    # A moving camera has a pose in every frame instead.
    Row("poses", "camera pose", "c", Owner.CAMERA, Manifold.POSE, (STEP_ANGLE,) * 3 + (STEP_LENGTH,) * 3, 1,
        lambda camera: camera.free_pose and not camera.moving, _pose_noise),
    Row("heading", "camera heading", "g", Owner.CAMERA, VECTOR, STEP_ANGLE, 1, lambda camera: camera.imu is not None,
        _heading_noise),
    Row("R_camera_imu", "camera mounting", "q", Owner.CAMERA, ROTATION, STEP_ANGLE, 1,
        lambda camera: camera.imu is not None, _heading_noise),
    Row("clock", "clock offset", "o", Owner.CAMERA, VECTOR, STEP_CLOCK, 1, lambda camera: camera.free_clock,
        _heading_noise),
    Row("clock_drift", "clock drift", "d", Owner.CAMERA, VECTOR, STEP_CLOCK_DRIFT, 1, lambda camera: camera.free_clock),
    Row("zoom", "focal length", "z", Owner.CAMERA, VECTOR, STEP_ZOOM, 1, lambda camera: camera.focal_sigma > 0,
        relinearise=ZOOM_MOVED),
    Row("path_scale", "scale of odometry", "w", Owner.CAMERA, VECTOR, STEP_ZOOM, 1,
        lambda camera: camera.odometry is not None and camera.odometry.is_scale_free),
)  # fmt: skip
DETECTOR_ROWS: tuple[Row[SceneProblem], ...] = (
    Row("keypoint_offsets", "offset of a keypoint", "k", Owner.DETECTOR, POINT, STEP_BODY, len(OFFSET_KEYPOINTS),
        lambda scene: scene.free_keypoints, relinearise=BODY_MOVED),
)  # fmt: skip
ROWS: dict[str, Row[WearerProblem] | Row[CameraProblem] | Row[SceneProblem]] = {
    **{row.name: row for row in WEARER_ROWS},
    **{row.name: row for row in CAMERA_ROWS},
    **{row.name: row for row in DETECTOR_ROWS},
}


def scene_layout(
    scene: SceneProblem,
    noise: ProcessNoiseSettings | None = None,
    relinearise_deg: float = RelinearisationSettings.shared_deg,
    wearers_move: bool = True,
) -> Layout:
    """Build the layout of a scene's variables, without those of the wearers if these do not move."""
    noise, limit = noise or ProcessNoiseSettings(), float(np.deg2rad(relinearise_deg))
    chains, blocks = list[FrameBlock](), list[tuple[OwnerId, tuple[StaticBlock, ...]]]()
    if wearers_move:
        for number, wearer in enumerate(scene.wearers):
            owner = OwnerId(Owner.WEARER, number)
            chains.append(_wearer_frame(owner))
            blocks.append((owner, tuple(row.block(wearer, len(wearer.sensors), noise, limit) for row in WEARER_ROWS)))
    for number, camera in enumerate(scene.cameras):
        owner = camera_owner(number)
        if camera.free_pose and camera.moving:
            step = np.repeat([STEP_ANGLE, STEP_LENGTH], 3)
            chains.append(FrameBlock(owner, POSE, step, {"poses": slice(0, POSE)}))
        blocks.append((owner, tuple(row.block(camera, 0, noise, limit) for row in CAMERA_ROWS)))
    blocks.append((DETECTOR, tuple(row.block(scene, 0, noise, limit) for row in DETECTOR_ROWS)))
    return Layout(tuple(chains), tuple(blocks))


def camera_owner(number: int) -> OwnerId:
    """Owner of a camera's variables."""
    return OwnerId(Owner.CAMERA, number)


def _wearer_frame(owner: OwnerId) -> FrameBlock:
    step = np.repeat([STEP_ANGLE, STEP_LENGTH], [ROOT, 3])
    names = {name: slice(3 * joint, 3 * joint + 3) for joint, name in enumerate(JOINT_NAMES)}
    names["root"] = slice(ROOT, FRAME)
    return FrameBlock(owner, FRAME, step, names)
