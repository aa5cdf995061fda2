"""Height of the floor, and standing feet as a camera sees them.

A camera that was found knows of no floor, so the world's zero goes under the soles that stand. A camera that stands may
have been found tilted, and is turned until the floor is level. Before a camera of known pose the floor is declared, and
a finding reports soles that stand elsewhere.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.body.keypoints import KeypointSet
from vip_factors.body.kinematics import BodyState, forward_kinematics
from vip_factors.body.skeleton import SIDES, Skeleton, contact_points, joint_index
from vip_factors.errors import InputError
from vip_factors.factor_settings import ContactFrom, GroundContactSettings, Weighing
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array, exp
from vip_factors.initialise.calibration import contact_confidence
from vip_factors.problem.scene import Foot, GroundView, KeypointView
from vip_factors.problem.state import CameraPoses, CameraState, SceneState, WearerState
from vip_factors.problem.wearer import BodyPoint, WearerProblem
from vip_factors.sensors.camera import CameraModel
from vip_factors.sensors.scene import Camera, Scene
from vip_factors.stages.inertial_model import place_on_floor
from vip_factors.terms.acceleration import GRAVITY
from vip_factors.terms.ground_contact import (
    acceleration_confidence,
    ground_contact_whitening,
    pixel_rays,
    rays_meet_floor,
)

UNSURE_M = 0.02  # reported from here on: standard deviation, or distance from the declared floor
SOLE_M = 0.01  # how well a wearer's soles and height are known, as long as they stand: of the floor under one alone
SLOPED, UNEVEN_M = np.deg2rad(3.0), 0.05  # reported from here on: 5 cm to the metre, or about the median


@dataclass(frozen=True)
class Floor:
    """Plane on which soles rest.

    Attributes:
        height, sigma: the median in metres, and its standard deviation.
        uneven: half of the range in metres that two of three resting soles are in.
        gradient: ``(2,)`` by how much a plane through them rises along x and y.
        slope_sigma: standard deviation of how steep that is, radians.
    """

    height: float
    sigma: float
    uneven: float
    gradient: Array
    slope_sigma: float

    @property
    def slope(self) -> float:
        """Slope of the plane in radians."""
        return float(np.arctan(np.linalg.norm(self.gradient)))

    def findings(self, is_declared: bool) -> Iterator[Finding]:
        """Return the finding about the floor: z = 0 is declared, and soles rest elsewhere."""
        height, sigma = 100 * self.height, 100 * self.sigma
        phrases, numbers = list[str](), dict[str, float]()
        if is_declared and abs(self.height) > max(UNSURE_M, 2 * self.sigma):
            phrases.append(f"soles stand {height:+.0f} cm (± {sigma:.0f}) from the floor of the camera's known pose")
            numbers["height_cm"] = height
        if not is_declared and self.sigma > UNSURE_M:
            phrases.append(
                f"the height of the floor is uncertain by {sigma:.0f} cm: soles stand at different heights (stairs, "
                "jumps, a slope), or hardly stand"
            )
            numbers["sigma_cm"] = sigma
        if self.uneven > UNEVEN_M or self.slope > max(SLOPED, 3 * self.slope_sigma):
            slope, sigma = np.rad2deg([self.slope, self.slope_sigma]).tolist()
            phrases.append(
                f"soles rest at heights that differ by ± {100 * self.uneven:.0f} cm, on ground that rises by "
                f"{slope:.0f}° (± {sigma:.0f}): steps, stairs or a slope, or a camera that is not where it seems"
            )
            numbers |= {"uneven_cm": 100 * self.uneven, "slope_deg": slope}
        if phrases:
            yield Finding("floor", numbers=numbers, words={"what": "; ".join(phrases)})


def floor_under(models: Sequence[WearerProblem], states: Sequence[WearerState]) -> Floor | None:
    """The floor under the soles: the median height of the lowest points of all bodies while those points rest.

    None where nothing rests for long enough to tell. Of the steps of stairs it is the middle one.
    """
    stance_s = 0.5  # frames of one stance share one error
    least_frames = 10  # that tell a height
    still = 0.12, 0.25  # m/s, of a sole that stands: the slower where it is enough, for pixels make feet tremble
    lows, speeds, seconds = list[Array](), list[Array](), 0.0
    for model, state in zip(models, states, strict=True):
        body = forward_kinematics(model.skeleton, state.R_parent_child, state.p_world_pelvis)
        soles = contact_points(model.skeleton, model.settings.sole.of(state.sole))
        points = np.stack([body.point(bone, p) for bone, p in soles], axis=1)
        if len(points) < least_frames:
            continue
        lowest = np.arange(len(points)), np.argmin(points[..., 2], axis=1)
        lows.append(points[lowest])
        speeds.append(np.linalg.norm(np.gradient(points, model.frames.step, axis=0), axis=2)[lowest])
        seconds += len(points) * model.frames.step
    low, speed = np.concatenate([np.zeros((0, 3)), *lows]), np.concatenate([np.zeros(0), *speeds])
    for limit in still:
        resting = low[speed < limit]
        if len(resting) >= least_frames:
            return _plane(resting, max(seconds / stance_s * len(resting) / len(low), 1.0))
    return None


def _plane(points: Array, stances: float) -> Floor:
    """Through points ``(N, 3)`` of so many stances; the slope by regression, with the prior that it is level."""
    rounds = 5  # of the slope, with the scatter that it leaves
    level = np.deg2rad(1.0)  # how level floors of rooms are, and what the world's own tilt may be
    height = float(np.median(points[:, 2]))
    sigma = _spread(points[:, 2] - height) / float(np.sqrt(stances))
    place, over = points[:, :2] - points[:, :2].mean(axis=0), points[:, 2] - points[:, 2].mean()
    gradient, covariance = np.zeros(2), np.eye(2)
    for _ in range(rounds):
        weight = stances / len(points) / max(_spread(over - place @ gradient), UNSURE_M / 2) ** 2
        covariance = np.linalg.inv(weight * place.T @ place + np.eye(2) / level**2)
        gradient = covariance @ (weight * place.T @ over)
    along = gradient / max(float(np.linalg.norm(gradient)), np.finfo(float).tiny)
    uneven = float(np.diff(np.quantile(points[:, 2], [1 / 6, 5 / 6]))[0]) / 2
    return Floor(height, sigma, uneven, gradient, float(np.sqrt(along @ covariance @ along)))


def _spread(values: Array) -> float:
    """Standard deviation about the median, whatever a few say."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))


def with_declared_floor(scene: Scene, floor: str | float) -> Scene:
    """The scene with the zero of its cameras' known poses on the floor, whose height in their world may be declared.

    Raises:
        InputError: for a height where no camera's pose is known.
    """
    if isinstance(floor, str):
        return scene
    if not any(camera.known_path is not None for camera in scene.cameras):
        raise InputError(
            f"floor is {floor:g}: a height counts in the world of a camera of known pose, and there is none: expected "
            "found or none"
        )

    def lifted(camera: Camera) -> Camera:
        path = camera.known_path
        if path is None:
            return camera
        return replace(camera, known_path=replace(path, p_world_camera=path.p_world_camera - np.array([0, 0, floor])))

    return replace(scene, cameras=tuple(map(lifted, scene.cameras)))


def levelled(models: Sequence[WearerProblem], state: SceneState) -> SceneState | None:
    """The state with roots and cameras that stand turned about the first of them, until the floor is level.

    Bones keep their orientations, of which sensors know the vertical: pictures hardly tell how far each leans towards
    the camera. None if the floor is level within twice its uncertainty, or too steep for the tilt of a world.
    """
    floor = floor_under(models, state.wearers)
    if floor is None or not 2 * floor.slope_sigma < floor.slope < SLOPED:
        return None
    x, y = floor.gradient / np.linalg.norm(floor.gradient) * floor.slope
    turn, p_world_camera = exp(np.array([-y, x, 0.0])), state.cameras[0].poses.p_world_camera[0]
    wearers = tuple(
        replace(wearer, p_world_pelvis=p_world_camera + (wearer.p_world_pelvis - p_world_camera) @ turn.T)
        for wearer in state.wearers
    )
    cameras = tuple(
        replace(
            camera,
            poses=CameraPoses(
                turn @ poses.R_world_camera, p_world_camera + (poses.p_world_camera - p_world_camera) @ turn.T
            ),
        )
        for camera in state.cameras
        for poses in [camera.poses]
    )
    return replace(state, wearers=wearers, cameras=cameras)


def on_floor(
    models: Sequence[WearerProblem], state: SceneState, floor: str | float, is_declared: bool
) -> tuple[SceneState, tuple[Finding, ...]]:
    """The state of a scene with its floor at z = 0, and what is odd about the floor.

    Args:
        models, state: of the scene.
        floor: as the settings have it; ``"none"`` leaves everything where it is.
        is_declared: whether a camera's pose is known: the floor is at z = 0 then, and stays there.
    """
    plane = None if floor == "none" else floor_under(models, state.wearers)
    if plane is None:
        return state, ()
    if not is_declared:
        shift = np.array([0.0, 0.0, -plane.height])
        wearers = tuple(replace(wearer, p_world_pelvis=wearer.p_world_pelvis + shift) for wearer in state.wearers)
        cameras = tuple(replace(camera, poses=camera.poses.shifted(shift)) for camera in state.cameras)
        state = replace(state, wearers=wearers, cameras=cameras)
    return state, (*plane.findings(is_declared), *distance_findings(models, state))


def distance_findings(models: Sequence[WearerProblem], state: SceneState) -> Iterator[Finding]:
    """Wearers whose distance from the first one is contradicted, or left open, by the floor that they share.

    Who is taken to be nearer to the camera than true stands higher: feet and pixels lie on one ray, which falls by the
    camera's height over the distance between the two.
    """
    unsure_distance_m = 0.15  # between two wearers, reported from here on: half a step
    reference, *distances = (_on_its_ray(model, state, number) for number, model in enumerate(models))
    for model, distance in zip(models[1:], distances, strict=True):
        if reference is None or distance is None:
            continue
        nearer, sigma = reference[0] - distance[0], float(np.hypot(reference[1], distance[1]))
        if max(abs(nearer) - 2 * sigma, sigma) > unsure_distance_m:
            numbers = {"metres": nearer, "sigma": sigma}
            yield Finding("distance of wearers", models[0].name, subject=model.name, numbers=numbers)


def _on_its_ray(model: WearerProblem, state: SceneState, number: int) -> tuple[float, float] | None:
    """Distance in metres by which a wearer stands nearer to the camera than soles on z = 0 would, and its sigma."""
    least_height_m = 0.1  # of a camera over the floor, below which its rays hardly fall
    wearer = state.wearers[number]
    floor = floor_under([model], [wearer])
    if floor is None:
        return None
    p_camera_world = state.cameras[0].poses.p_world_camera
    away = float(np.median(np.linalg.norm((wearer.p_world_pelvis - p_camera_world)[:, :2], axis=1)))
    slope = away / max(abs(float(np.median(p_camera_world[:, 2])) - floor.height), least_height_m)
    return slope * floor.height, slope * float(np.hypot(floor.sigma, SOLE_M))


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
    model: WearerProblem,
    state: WearerState,
    camera: CameraState,
    keypoints: KeypointSet,
    view: KeypointView,
    lens: CameraModel,
    path_known: bool,
    settings: GroundContactSettings,
) -> GroundView:
    """The ground contacts of one wearer before one camera, over a whole recording."""
    feet, columns = seen_feet(keypoints, model.skeleton)
    confidence = standing_confidence(model, state, feet, path_known, settings)
    body = forward_kinematics(model.skeleton, state.R_parent_child, state.p_world_pelvis)
    poses = camera.at_frames(slice(0, len(confidence)))
    sole = model.settings.sole.of(state.sole)
    return ground_view(view, feet, columns, confidence, body, sole, poses, lens, settings)


def standing_confidence(
    model: WearerProblem, state: WearerState, feet: tuple[Foot, ...], path_known: bool, settings: GroundContactSettings
) -> Array:
    """Confidence that each foot ``(T, G)`` stands: up to two by its sensor, up to one by the joint state.

    Without a known path, of a camera say, contact shows in the pose alone. A foot without a sensor counts as at rest
    only while it is the lower one.
    """
    grounded = state if path_known else place_on_floor(model, state)
    body = forward_kinematics(model.skeleton, state.R_parent_child, grounded.p_world_pelvis)
    if settings.contact_from is ContactFrom.ACCELERATION:
        free = free_accelerations(
            model.sensors, feet, model.frames.specific_force_inertial, model.frames.acceleration_valid
        )
        return foot_acceleration_confidence(body, feet, free, settings)
    return joint_state_confidence(model.skeleton, body, feet, model.frames.step)


def joint_state_confidence(skeleton: Skeleton, body: BodyState, feet: tuple[Foot, ...], step: float) -> Array:
    """Confidence in [0, 1] that each foot ``(T, G)`` of a placed body stands on the floor: it is low and still."""
    floor_band = 0.15  # m over the floor: jumps and stairs are higher, a root path before its last solve is as wrong
    points, lowest = contact_points(skeleton), _lowest(body, feet)
    confidence = contact_confidence(body, points, step)
    bones = np.array([bone for bone, _ in points])
    surest = np.stack([confidence[:, bones == foot.bone].max(axis=1) for foot in feet], axis=1)
    return np.asarray(surest * np.exp(-0.5 * (np.maximum(lowest, 0.0) / floor_band) ** 2))


def ground_view(
    view: KeypointView,
    feet: tuple[Foot, ...],
    columns: list[int],
    confidence: Array,
    body: BodyState,
    sole: float,
    camera: CameraPoses,
    model: CameraModel,
    settings: GroundContactSettings,
) -> GroundView:
    """Intersections of the rays of standing feet with the floor.

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
    is_seen = view.seen[:, columns]
    sureness = confidence * np.where(is_seen, view.confidence[:, columns], 0.0)
    # Weighed by pixels, the keypoint's sigma has the detector's confidence in it already.
    weight = sureness if settings.weighing is Weighing.DISTANCE else confidence
    rays, whitening = pixel_rays(model, view.pixels[:, columns]), np.zeros((*is_seen.shape, 3, 3))
    least_sureness = 0.05  # below it nothing is left to say
    stands = is_seen & (sureness >= least_sureness)
    for g, foot in enumerate(feet):
        _, height = foot.ankle(body, sole)
        stands[:, g] &= rays_meet_floor(height, camera, rays[:, g])
        frames = np.flatnonzero(stands[:, g])
        poses = CameraPoses(camera.R_world_camera[frames], camera.p_world_camera[frames])
        whitening[frames, g] = ground_contact_whitening(
            height[frames], poses, rays[frames, g], view.sigma[frames, columns[g]], model, weight[frames, g], settings
        )
    return GroundView(feet, rays, whitening, stands)


def foot_acceleration_confidence(
    body: BodyState, feet: tuple[Foot, ...], free_acceleration: Array, settings: GroundContactSettings
) -> Array:
    """Confidence that each foot ``(T, G)`` of a placed body stands, up to two, by :func:`free_accelerations`."""
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
