"""Which feet a camera saw standing on the ground, and where."""

from collections.abc import Sequence

import numpy as np

from vip_factors.body.keypoints import KeypointSet
from vip_factors.body.kinematics import BodyState, forward_kinematics
from vip_factors.body.skeleton import Skeleton, contact_points, joint_index
from vip_factors.geometry.rotations import Array
from vip_factors.initialise.calibration import contact_confidence
from vip_factors.problem.scene import Foot, GroundView, KeypointView
from vip_factors.problem.state import CameraPoses, SceneState, WearerState
from vip_factors.problem.wearer import BodyPoint, WearerProblem
from vip_factors.sensors.camera import CameraModel
from vip_factors.stages.inertial_model import placed_on_floor
from vip_factors.terms.acceleration import GRAVITY
from vip_factors.terms.ground_contact import (
    ContactFrom,
    GroundContactSettings,
    Weighing,
    acceleration_confidence,
    ground_contact_whitening,
    pixel_rays,
    rays_meet_floor,
)

SIDES = ("left", "right")


def seen_feet(keypoints: KeypointSet, skeleton: Skeleton) -> tuple[tuple[Foot, ...], list[int]]:
    """The feet whose ankles are among the keypoints, and the column of each among those that are on the body."""
    places = keypoints.on_body(skeleton)
    on_body = [name for name, place in zip(keypoints.keypoints, places, strict=True) if place is not None]
    soles, feet, columns = contact_points(skeleton), [], []
    for side in SIDES:
        name = f"{side}_ankle"
        place = dict(zip(keypoints.keypoints, places, strict=True)).get(name)
        if place is not None:
            sole = np.stack([p for bone, p in soles if bone == place.bone])
            feet.append(Foot(place.bone, place.p_bone_point, sole))
            columns.append(on_body.index(name))
    return tuple(feet), columns


def seen_standing(
    model: WearerProblem, scene: SceneState, number: int, keypoints: KeypointSet, view: KeypointView,
    lens: CameraModel, path_known: bool, settings: GroundContactSettings,
) -> GroundView:  # fmt: skip
    """The ground contacts of one wearer before the camera of a scene's state, over a whole recording."""
    state = scene.wearers[number]
    feet, columns = seen_feet(keypoints, model.skeleton)
    confidence = standing_confidence(model, state, feet, path_known, settings)
    body = forward_kinematics(model.skeleton, state.R_parent_child, state.p_world_pelvis)
    poses = scene.camera.at_frames(slice(0, len(confidence)))
    sole = model.settings.sole.of(state.sole)
    return ground_view(view, feet, columns, confidence, body, sole, poses, lens, settings)


def standing_confidence(
    model: WearerProblem, state: WearerState, feet: tuple[Foot, ...], path_known: bool, settings: GroundContactSettings
) -> Array:
    """How surely each foot ``(T, G)`` stands on the ground; by its sensor up to two, by the joint state up to one.

    Without a known path, of a camera say, contact shows in the pose alone. A foot without a sensor counts as at rest
    only while it is the lower one.
    """
    grounded = state if path_known else placed_on_floor(model, state)
    body = forward_kinematics(model.skeleton, state.R_parent_child, grounded.p_world_pelvis)
    if settings.contact_from is ContactFrom.ACCELERATION:
        free = free_accelerations(
            model.sensors, feet, model.frames.specific_force_inertial, model.frames.acceleration_valid
        )
        return foot_acceleration_confidence(body, feet, free, settings)
    return joint_state_confidence(model.skeleton, body, feet, model.frames.step)


def joint_state_confidence(skeleton: Skeleton, body: BodyState, feet: tuple[Foot, ...], step: float) -> Array:
    """How surely each foot ``(T, G)`` of a placed body stands on the floor, in [0, 1]: it neither moves nor is high."""
    floor_band = 0.15  # m over the floor: jumps and stairs are higher, a root path before its last solve is as wrong
    points, lowest = contact_points(skeleton), _lowest(body, feet)
    each = contact_confidence(body, points, step)
    bones = np.array([bone for bone, _ in points])
    surest = np.stack([each[:, bones == foot.bone].max(axis=1) for foot in feet], axis=1)
    return np.asarray(surest * np.exp(-0.5 * (np.maximum(lowest, 0.0) / floor_band) ** 2))


def ground_view(
    view: KeypointView, feet: tuple[Foot, ...], columns: list[int], confidence: Array, body: BodyState,
    sole: float, camera: CameraPoses, model: CameraModel, settings: GroundContactSettings,
) -> GroundView:  # fmt: skip
    """Where the rays of standing feet meet the floor.

    Args:
        view: of one wearer, from one camera.
        feet, columns: of :func:`seen_feet`.
        confidence: ``(T, G)`` of :func:`standing_confidence`.
        body: of which the rotations count.
        sole: its thickness, metres.
        camera: at the ``T`` frames.
        model: its intrinsics.
        settings: of the factor.
    """
    seen = view.seen[:, columns]
    sureness = confidence * np.where(seen, view.confidence[:, columns], 0.0)
    # Weighed by pixels, the keypoint's sigma has the detector's confidence in it already.
    weight = sureness if settings.weighing is Weighing.DISTANCE else confidence
    rays, whitening = pixel_rays(model, view.pixels[:, columns]), np.zeros((*seen.shape, 3, 3))
    stands = seen & (sureness >= settings.least_confidence)
    for g, foot in enumerate(feet):
        _, height = foot.ankle(body, sole)
        stands[:, g] &= rays_meet_floor(height, camera, rays[:, g], settings)
        frames = np.flatnonzero(stands[:, g])
        poses = CameraPoses(camera.R_world_camera[frames], camera.p_world_camera[frames])
        whitening[frames, g] = ground_contact_whitening(
            height[frames], poses, rays[frames, g], view.sigma[frames, columns[g]], model, weight[frames, g], settings
        )
    return GroundView(feet, rays, whitening, stands)


def foot_acceleration_confidence(
    body: BodyState, feet: tuple[Foot, ...], free_acceleration: Array, settings: GroundContactSettings
) -> Array:
    """How surely each foot ``(T, G)`` of a placed body stands, up to two, by :func:`free_accelerations`."""
    return acceleration_confidence(free_acceleration, _lowest(body, feet), settings)


def free_accelerations(
    sensors: Sequence[BodyPoint], feet: tuple[Foot, ...], specific_force_inertial: Array, valid: np.ndarray
) -> Array:
    """Norms ``(T, G)`` of the acceleration of the sensor on each foot, gravity removed; NaN without one.

    Args:
        sensors: ``S`` of them, where they sit.
        feet: whose they are.
        specific_force_inertial, valid: ``(T, S, 3)`` m/s² and ``(T, S)``.
    """
    norms = np.full((len(valid), len(feet)), np.nan)
    for g, foot in enumerate(feet):
        side = SIDES[0] if foot.bone == joint_index("left_ankle") else SIDES[1]
        for s, sensor in enumerate(sensors):
            if sensor.bone in (foot.bone, joint_index(f"{side}_foot")):
                free = np.linalg.norm(specific_force_inertial[:, s] + GRAVITY, axis=1)
                norms[:, g] = np.where(valid[:, s], free, np.nan)
    return norms


def _lowest(body: BodyState, feet: Sequence[Foot]) -> Array:
    """Height of the lowest point of each foot's sole ``(T, G)``."""
    soles = [np.stack([body.point(foot.bone, p)[:, 2] for p in foot.p_bone_sole], axis=1) for foot in feet]
    return np.stack([sole.min(axis=1) for sole in soles], axis=1) if soles else np.zeros((len(body.p_world_joint), 0))
