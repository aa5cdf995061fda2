"""What is to be found, one row a variable: layout, columns, GTSAM's keys and values, covariances derive from it.

Values stand in an attribute of that name of the owner's state (:mod:`vip_factors.problem.state`).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from vip_factors.body.hinges import HINGE_VARIABLES
from vip_factors.body.keypoints import OFFSET_KEYPOINTS
from vip_factors.body.lengths import LENGTHS
from vip_factors.body.pose_prior import POSE_SIZE
from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.problem.layout import FRAME, POSE, ROOT, FrameBlock, Layout, Manifold, Owner, OwnerId, StaticBlock
from vip_factors.problem.scene import SceneProblem
from vip_factors.settings import ProcessNoiseSettings, RelinearisationSettings

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
class Row:
    """One kind of variable.

    Attributes:
        name: of the block, and of the attribute of the owner's state.
        title: in words, of counts and drawings.
        letter: of its GTSAM keys.
        owner: whose it is.
        manifold: of each item.
        step: one unit of damping is a prior of this size on a step (rad, m, s).
        count: how many items, given the owner's problem.
        free: whether they move, given the owner's problem.
        process_noise: how far each may wander in a stream, per √second.
        relinearise: linearised anew in a stream where it moved by more; None: by the angle that the stream sets.
        one_vector: all items are one variable of GTSAM.
        of_sensors: there is one for each of the wearer's sensors.
    """

    name: str
    title: str
    letter: str
    owner: Owner
    manifold: Manifold
    step: float | tuple[float, ...]
    count: Callable[[Any], int]
    free: Callable[[Any], bool]
    process_noise: Callable[[ProcessNoiseSettings], float | tuple[float, ...]] = lambda noise: 0.0
    relinearise: float | None = None
    one_vector: bool = False
    of_sensors: bool = False

    def block(self, problem: Any, noise: ProcessNoiseSettings, angle: float) -> StaticBlock:
        """The block of one owner, whose ``problem`` says how many there are and whether they move."""
        count, free, relinearise = self.count(problem), self.free(problem), self.relinearise
        limit = angle if relinearise is None else relinearise
        return StaticBlock(self.name, self.manifold, count, free, self.step, self.process_noise(noise), limit)


def _rows() -> tuple[Row, ...]:
    wearer, camera, detector = Owner.WEARER, Owner.CAMERA, Owner.DETECTOR
    vector, point, rotation, pose = Manifold.VECTOR, Manifold.POINT, Manifold.ROTATION, Manifold.POSE

    def sensors(problem: Any) -> int:
        return len(problem.sensors)

    def one(problem: Any) -> int:
        return 1

    def so_many(count: int) -> Callable[[Any], int]:
        return lambda problem: count

    def has_imu(problem: Any) -> bool:
        return problem.imu is not None

    def heading(noise: ProcessNoiseSettings) -> float:
        return float(np.deg2rad(noise.heading_deg))

    def mounting(noise: ProcessNoiseSettings) -> float:
        return float(np.deg2rad(noise.mounting_deg))

    def camera_pose(noise: ProcessNoiseSettings) -> tuple[float, ...]:
        degrees, metres = 0.05, 0.002  # of a camera that stands still
        return (float(np.deg2rad(degrees)),) * 3 + (metres,) * 3

    return (
        Row("headings", "heading", "h", wearer, vector, STEP_ANGLE, sensors, lambda own: own.free_headings, heading,
            of_sensors=True),
        Row("R_bone_sensor", "mounting", "b", wearer, rotation, STEP_ANGLE, sensors, lambda own: own.free_mountings,
            mounting, of_sensors=True),
        Row("body", "body", "s", wearer, vector, STEP_BODY, so_many(len(LENGTHS)), lambda own: own.body_moves,
            relinearise=BODY_MOVED, one_vector=True),
        Row("sensor_positions", "place of a sensor", "p", wearer, point, STEP_BODY, sensors,
            lambda own: own.free_places, relinearise=BODY_MOVED, of_sensors=True),
        Row("sole", "sole", "f", wearer, vector, STEP_SOLE, one, lambda own: own.free_sole, relinearise=SOLE_MOVED),
        Row("hinges", "axes of elbows and knees", "e", wearer, vector, STEP_ANGLE, so_many(HINGE_VARIABLES),
            lambda own: own.free_hinges, one_vector=True),
        Row("pose_mean", "mean pose", "m", wearer, vector, STEP_ANGLE, so_many(POSE_SIZE),
            lambda own: own.free_pose_mean, one_vector=True),
        # Of a camera that moves every frame has a pose.
        Row("poses", "camera pose", "c", camera, pose, (STEP_ANGLE,) * 3 + (STEP_LENGTH,) * 3, one,
            lambda own: own.free_pose and not own.moving, camera_pose),
        Row("heading", "camera heading", "g", camera, vector, STEP_ANGLE, one, has_imu, heading),
        Row("R_camera_imu", "camera mounting", "q", camera, rotation, STEP_ANGLE, one, has_imu, heading),
        Row("clock", "clock offset", "o", camera, vector, STEP_CLOCK, one, lambda own: own.free_clock, heading),
        Row("clock_drift", "clock drift", "d", camera, vector, STEP_CLOCK_DRIFT, one, lambda own: own.free_clock),
        Row("keypoint_offsets", "offset of a keypoint", "k", detector, point, STEP_BODY, so_many(len(OFFSET_KEYPOINTS)),
            lambda scene: scene.free_keypoints, relinearise=BODY_MOVED),
    )  # fmt: skip


ROWS = {row.name: row for row in _rows()}


def scene_layout(
    scene: SceneProblem,
    noise: ProcessNoiseSettings | None = None,
    relinearise_deg: float = RelinearisationSettings.shared_deg,
    wearers_move: bool = True,
) -> Layout:
    """All variables of a scene that move; without the wearers' if these are kept as they are."""
    noise, limit = noise or ProcessNoiseSettings(), float(np.deg2rad(relinearise_deg))

    def rows(owner: OwnerId, problem: Any) -> tuple[OwnerId, tuple[StaticBlock, ...]]:
        return owner, tuple(row.block(problem, noise, limit) for row in ROWS.values() if row.owner is owner.kind)

    chains, blocks = list[FrameBlock](), list[tuple[OwnerId, tuple[StaticBlock, ...]]]()
    if wearers_move:
        for number, wearer in enumerate(scene.wearers):
            owner = OwnerId(Owner.WEARER, number)
            chains.append(_wearer_frame(owner))
            blocks.append(rows(owner, wearer))
    if scene.camera.free_pose and scene.camera.moving:
        step = np.repeat([STEP_ANGLE, STEP_LENGTH], 3)
        chains.append(FrameBlock(CAMERA, POSE, step, {"poses": slice(0, POSE)}))
    blocks.append(rows(CAMERA, scene.camera))
    blocks.append(rows(DETECTOR, scene))
    return Layout(tuple(chains), tuple(blocks))


def _wearer_frame(owner: OwnerId) -> FrameBlock:
    step = np.repeat([STEP_ANGLE, STEP_LENGTH], [ROOT, 3])
    names = {name: slice(3 * joint, 3 * joint + 3) for joint, name in enumerate(JOINT_NAMES)}
    names["root"] = slice(ROOT, FRAME)
    return FrameBlock(owner, FRAME, step, names)
