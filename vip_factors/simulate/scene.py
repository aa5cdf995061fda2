"""A scene with truth: wearers of sensors, bystanders, and a camera that films them.

How a camera moves that films people: on a tripod, in the hands of somebody who stands, or who follows them.

Every component is smooth (twice differentiable paths), so that an IMU on the camera feels finite accelerations. The
result is a body of one bone: the simulated sensors of people work on it unchanged.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from scipy.interpolate import make_interp_spline
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation, RotationSpline

from vip_factors.body.keypoints import keypoint_set
from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import JOINT_COUNT, Skeleton
from vip_factors.errors import InputError
from vip_factors.geometry.quaternions import interpolate_points
from vip_factors.geometry.rotations import Array, exp, transpose
from vip_factors.sensors.calibration import Placement, SensorCalibration, SensorSite
from vip_factors.sensors.camera import UNCALIBRATED_FOCAL_SIGMA, CameraPath, VideoClock, uncalibrated_camera
from vip_factors.sensors.scene import CAMERA_MOUNTING_SIGMA, Camera, CameraMount, CameraTruth, Scene
from vip_factors.simulate.dense import DenseMotion, dense_motion
from vip_factors.simulate.detector import detect
from vip_factors.simulate.detector_view import Person
from vip_factors.simulate.recording import simulate_recording, simulate_sensor, smooth_process
from vip_factors.simulate.settings import SceneSettings

GRID_HZ = 120.0  # of the nodes of the splines
HAND_HEIGHT_M = 1.45  # of a phone held before the chest or the chin
FILL = 0.6  # share of the image's height that a person may fill before the camera steps back
NEAREST_M, FARTHEST_M = 2.5, 7.0  # where one stands to film people indoors; wider action leaves the image

# Sway of a standing person: about 5 mm RMS at the centre of mass in quiet stance (Winter 1995, Gait & Posture 3), and
# as an inverted pendulum half as much again at the chin; arms that hold a phone double it.
SWAY_M, SWAY_TIME_S = 0.015, 1.2
# Tremor of arms that hold something: ours, 1 mm with 5 σ/τ² = 0.13 m/s² RMS each axis, about what a phone in the hand
# of somebody who stands reads beside its noise.
HAND_M, HAND_TIME_S = 0.001, 0.2
# Walking: bounce of the trunk, 2–4 cm from lowest to highest, twice per stride; sway to the sides once (Inman 1981).
WALK_STEP_HZ, BOUNCE_M, LATERAL_M, WALK_SPEED = 1.8, 0.015, 0.02, 1.2
# The IMU on the camera's back: its x right, y up, z towards the operator, as a phone's own in landscape.
R_CAMERA_IMU = np.diag([1.0, -1.0, -1.0])
P_CAMERA_IMU = np.array([0.03, 0.02, -0.015])  # metres from the lens: somewhere on a phone
CAMERA_IMU = "camera"


@dataclass(frozen=True)
class Performer:
    """Somebody in a scene.

    Attributes:
        name: unique in the scene.
        motion: in the scene's world (see :mod:`~vip_factors.simulate.staging`) and on its clock.
        placement: of the sensors worn; None for a bystander.
        initial_pose: what a wearer declares to hold at the start.
    """

    name: str
    motion: Motion
    placement: Placement | None = None
    initial_pose: str = "none"


def simulate_scene(
    performers: Sequence[Performer], settings: SceneSettings | None = None, seed: int = 0, name: str = "scene"
) -> Scene:
    """What sensors, camera and detector would have recorded of people's motions.

    Cameras look from all around, the first one from where the settings say. The video lasts as long as all wearers
    move; bystanders come and go with their motions. In the truth, ``CameraTruth.wearer`` gives a detection to the
    person who has most of its keypoints, at least seven major joints (thesis 4.4.3), and is −1 for bystanders and for
    nobody.

    Args:
        performers: wearers and bystanders, in one world; the recordings keep the order of the wearers.
        settings: camera, detector and sensors; realistic ones if absent.
        seed: same seed, same scene. Every wearer, camera and detector draws from its own streams: the first camera
            sees the same with and without further ones.
        name: of the scene.

    Raises:
        InputError: without a wearer, if names repeat, or if the wearers' motions share less than two video frames.
    """
    seed_step = 7919  # between the seeds of wearers; the first has the scene's: a scene of one is the recording of one
    settings = settings or SceneSettings()
    if all(performer.placement is None for performer in performers):
        raise InputError(f"scene '{name}' has nobody with sensors: expected at least one performer with a placement")
    if len({performer.name for performer in performers}) < len(performers):
        raise InputError(
            f"scene '{name}': performers {', '.join(performer.name for performer in performers)}: names repeat"
        )
    dense = [dense_motion(performer.motion, settings.imu.lowpass_hz) for performer in performers]
    wearer_numbers = [number for number, performer in enumerate(performers) if performer.placement is not None]
    recordings = []
    for order, number in enumerate(wearer_numbers):
        performer, placement = performers[number], performers[number].placement
        assert placement is not None
        recording = simulate_recording(
            dense[number], placement, settings.imu, seed + seed_step * order, performer.name, performer.initial_pose
        )
        recordings.append(replace(recording, subject=replace(recording.subject, name=performer.name)))
    time = _video_times([dense[number] for number in wearer_numbers], settings, name)
    people = []
    for motion in dense:  # before and after their motion people are not there
        present = (time >= motion.start - 1e-9) & (time <= motion.end + 1e-9)
        people.append(Person(motion.skeleton, motion.state(np.clip(time, motion.start, motion.end)), present))
    wearer = np.array(
        [wearer_numbers.index(number) if number in wearer_numbers else -1 for number in (*range(len(performers)), -1)]
    )

    cameras, azimuth = list[Camera](), None
    for number, film in enumerate(_films(settings)):
        film = film if azimuth is None else replace(film, azimuth_deg=azimuth + 360.0 * number / settings.cameras)
        # A hand moves by itself; tripods stand as far away as they did without carried cameras.
        own_seed = seed + number if film.camera == "hand-held" else seed
        body, first_azimuth = _camera_body(dense, wearer_numbers, film, own_seed)
        azimuth = first_azimuth if azimuth is None else azimuth
        cameras.append(_film(body, people, wearer, time, film, seed, number))
    return Scene(name, tuple(recordings), tuple(cameras))


def _films(settings: SceneSettings) -> list[SceneSettings]:
    """Settings of each camera: the first one, then the carried ones and those on tripods, all without a sensor."""
    tripod = replace(settings, camera="fixed", camera_imu=False, known_camera_pose=settings.calibrated)
    carried = replace(settings, camera="hand-held", camera_imu=False, known_camera_pose=False)
    return [settings, *[carried] * settings.carried, *[tripod] * (settings.cameras - 1 - settings.carried)]


def _film(
    body: DenseMotion,
    people: Sequence[Person],
    wearer: np.ndarray,
    time: Array,
    settings: SceneSettings,
    seed: int,
    number: int,
) -> Camera:
    """A camera and what its detector finds; ``wearer`` is the wearer's index by person, −1 for others and nobody."""
    camera_seed_step = 104_729  # between the seeds of cameras; the first has the scene's
    state, own_seed = body.bone(0, time), seed + camera_seed_step * number
    path = CameraPath(time, state.R_world_bone, state.position)
    keypoints = keypoint_set(settings.keypoints)
    detections, owner, pixels = detect(people, path, settings.model, keypoints, settings.detector, own_seed, seed)
    mount, calibration = camera_mount(body, settings, seed) if settings.has_camera_imu else (None, None)
    moving = settings.camera != "fixed"
    if not moving:
        path = CameraPath(path.time[:1], path.R_world_camera[:1], path.p_world_camera[:1])
    known_path = _known_pose(path, settings, own_seed) if settings.has_known_pose else None
    name = "camera" if number == 0 else f"camera_{number + 1}"
    detections = detections.shifted(-settings.time_offset_s)
    clock = VideoClock(settings.time_offset_s)
    truth = CameraTruth(path, wearer[owner], pixels, calibration, clock, settings.model)
    camera = Camera(name, settings.model, detections, moving=moving, mount=mount, known_path=known_path, truth=truth)
    if settings.calibrated:
        return camera
    lens = uncalibrated_camera(settings.width, settings.height)
    return replace(camera, model=lens, focal_sigma=UNCALIBRATED_FOCAL_SIGMA)


def _known_pose(path: CameraPath, settings: SceneSettings, seed: int) -> CameraPath:
    """The pose of a fixed camera as it was measured."""
    random = np.random.default_rng([seed, 0xB0A2D])
    # What a board on the floor tells of a camera four metres away: half a metre of board, corners to 0.2 pixels.
    turn, shift = np.deg2rad(0.1), 0.005
    R = path.R_world_camera @ exp(settings.camera_pose_error * turn * random.standard_normal(3))
    p = path.p_world_camera + settings.camera_pose_error * shift * random.standard_normal(3)
    return CameraPath(path.time, R, p)


def _video_times(wearers: Sequence[DenseMotion], settings: SceneSettings, name: str) -> Array:
    """Instants ``(F,)`` of the video frames on the sensors' clock."""
    start, end = max(motion.start for motion in wearers), min(motion.end for motion in wearers)
    count = int(np.floor((end - start) * settings.video_rate + 1e-6)) + 1
    if count < 2:
        raise InputError(f"scene '{name}': its wearers' motions share {max(end - start, 0):.2f} s: expected two frames")
    return start + np.arange(count) / settings.video_rate


def _camera_body(
    people: Sequence[DenseMotion], wearer_numbers: Sequence[int], settings: SceneSettings, seed: int
) -> tuple[DenseMotion, float]:
    """The camera's path: it films the wearers, from a place that nobody runs into; and from which side, degrees."""
    path_hz = 30.0  # at which the camera's operator watches the people
    start = max(people[number].start for number in wearer_numbers)
    end = min(people[number].end for number in wearer_numbers)
    time = np.linspace(start, end, max(8, int(np.ceil((end - start) * path_hz)) + 1))
    pelves = np.stack([motion.root(np.clip(time, motion.start, motion.end)) for motion in people])
    is_present = np.stack([(time >= motion.start) & (time <= motion.end) for motion in people])
    visible_pelves = np.where(is_present[..., None], pelves, np.nan)
    random = np.random.default_rng([seed, 0xCA3E7A])
    filmed = pelves[list(wearer_numbers)]
    body = camera_motion(filmed, time, settings, random, visible_pelves)
    away = body.bone(0, time[:1]).position[0] - filmed.mean(axis=(0, 1))
    return body, float(np.rad2deg(np.arctan2(away[1], away[0])))


def camera_mount(body: DenseMotion, settings: SceneSettings, seed: int) -> tuple[CameraMount, SensorCalibration]:
    """The IMU on the camera and its true calibration: nothing wobbles on it, all else is as on people."""
    error_deg = settings.camera_mounting_error_deg
    imu = replace(settings.imu, mounting_error_deg=error_deg, position_error_m=0.0, skin=0.0, wobble=0.0)
    site = SensorSite(CAMERA_IMU, "pelvis", P_CAMERA_IMU, R_CAMERA_IMU)  # bone 0 is the camera itself
    stream, calibration = simulate_sensor(body, site, imu, seed)
    sigma = max(CAMERA_MOUNTING_SIGMA, np.deg2rad(error_deg))
    return CameraMount(stream, R_CAMERA_IMU, P_CAMERA_IMU, float(sigma)), calibration


def camera_motion(
    people: Array, time: Array, settings: SceneSettings, random: np.random.Generator, obstacles: Array | None = None
) -> DenseMotion:
    """The path of the camera from the first to the last instant, as a body whose bone 0 is the camera.

    Args:
        people: ``(P, T, 3)`` metres, the pelves of whom the camera films, in the world.
        time: ``(T,)`` seconds, evenly spaced.
        settings: the kind of camera and its lens.
        random: where sway, tremor and the side to film from come from.
        obstacles: ``(Q, T, 3)`` pelves of people whom a standing camera must not run into, NaN where absent.
    """
    # Pointing of a hand-held camera: a slow part (the operator's aim) and a fast one. The fast one's angular rate of
    # 0.25·1.3/0.25 = 1.3 deg/s RMS is a calm hand; hand-held phone videos show 1–5 deg/s.
    aim_deg, aim_time_s = 2.0, 1.5
    tremor_deg, tremor_time_s = 0.25, 0.25
    aim_height_m = 0.95  # of the middle of a standing person
    grid = np.linspace(time[0], time[-1], max(8, int(np.ceil((time[-1] - time[0]) * GRID_HZ)) + 1))
    middle = interpolate_points(time, people.mean(axis=0), grid)
    azimuth = 2 * np.pi * random.random() if settings.azimuth_deg is None else np.deg2rad(settings.azimuth_deg)
    if settings.camera == "walking":
        p = _following(middle, azimuth, grid, settings, random)
    else:
        everybody = people if obstacles is None else np.concatenate([people, obstacles])
        p = np.repeat(_stand(people, everybody, azimuth, settings)[None], len(grid), axis=0)
    if settings.camera == "fixed":
        aim = np.repeat(_middle_of(people)[None], len(grid), axis=0)
    else:
        p = p + _noise(random, grid, SWAY_M, SWAY_TIME_S) * [1, 1, 0.3] + _noise(random, grid, HAND_M, HAND_TIME_S)
        aim = _lagging(middle, grid)
    aim = np.concatenate([aim[:, :2], np.full((len(grid), 1), aim_height_m)], axis=1)
    R = looking_at(p, aim)
    if settings.camera != "fixed":
        shake = _noise(random, grid, aim_deg, aim_time_s) + _noise(random, grid, tremor_deg, tremor_time_s)
        R = R @ exp(np.deg2rad(shake))
    turns, path = RotationSpline(grid, Rotation.from_matrix(R)), make_interp_spline(grid, p, 5)
    body = Skeleton(np.zeros((JOINT_COUNT, 3)), source="camera")
    return DenseMotion(body, (turns,), path, float(grid[0]), float(grid[-1]), "camera")


def looking_at(p_world_camera: Array, p_world_aim: Array) -> Array:
    """``R_world_camera`` ``(T, 3, 3)`` of a level camera (x right, y down, z forward) that looks at a point."""
    forward = p_world_aim - p_world_camera
    forward = forward / np.linalg.norm(forward, axis=1, keepdims=True)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    return transpose(np.stack([right, np.cross(forward, right), forward], axis=1))


def _middle_of(people: Array) -> Array:
    """Middle ``(3,)`` of where people spend their time."""
    low, high = np.quantile(people.reshape(-1, 3), [0.02, 0.98], axis=0)
    return (low + high) / 2


def _stand(people: Array, everybody: Array, azimuth: float, settings: SceneSettings) -> Array:
    """Where ``(3,)`` a standing camera is.

    At its given distance; otherwise from where it sees most of the action and people have room to pass.
    """
    margin_m = 0.5  # beside the outermost pelvis, for arms
    clearance_m = 1.5  # from a standing camera to anybody's pelvis
    tripod_height_m = 1.4  # of a tripod drawn out
    toward = np.array([np.cos(azimuth), np.sin(azimuth)])
    middle, distance = _middle_of(people), settings.distance_m
    if distance is None:
        away = (people.reshape(-1, 3) - middle)[:, :2]
        across, depth = away @ [-toward[1], toward[0]], away @ toward
        focal = settings.model.focal[0]
        wide = depth + (np.abs(across) + margin_m) * 2 * focal / settings.width
        tall = 1.75 * focal / (FILL * settings.height)
        distance = float(np.clip(max(np.quantile(wide, 0.95), tall), NEAREST_M, FARTHEST_M))
        ground = everybody.reshape(-1, 3)[:, :2] - middle[:2]
        while np.nanmin(np.linalg.norm(ground - distance * toward, axis=1)) < clearance_m and distance < 2 * FARTHEST_M:
            distance += 0.25
    height = tripod_height_m if settings.camera == "fixed" else HAND_HEIGHT_M
    return np.array([*(middle[:2] + distance * toward), height])


def _following(
    middle: Array, azimuth: float, grid: Array, settings: SceneSettings, random: np.random.Generator
) -> Array:
    """Path ``(T, 3)`` of somebody who walks along at a distance and round the people now and then."""
    circle_deg, circle_time_s = 35.0, 6.0  # how far somebody who follows goes round the people
    distance = settings.distance_m or 1.75 * settings.model.focal[0] / (FILL * settings.height)
    around = azimuth + np.deg2rad(_noise(random, grid, circle_deg, circle_time_s)[:, 0])
    around += azimuth - around[0]
    path = _lagging(middle, grid) + distance * np.stack([np.cos(around), np.sin(around), 0 * around], axis=1)
    velocity = np.gradient(path, grid, axis=0)
    step = grid[1] - grid[0]
    pace = gaussian_filter1d(np.linalg.norm(velocity[:, :2], axis=1), 0.5 / step, mode="nearest") / WALK_SPEED
    pace = np.minimum(pace, 1.5)
    phase = 2 * np.pi * WALK_STEP_HZ * grid
    side = np.stack([-np.sin(around), np.cos(around)], axis=1)
    path[:, :2] += (LATERAL_M * pace * np.sin(phase / 2))[:, None] * side
    path[:, 2] = HAND_HEIGHT_M + BOUNCE_M * pace * np.sin(phase)
    return path


def _lagging(path: Array, grid: Array) -> Array:
    """The path as somebody follows it: three first-order lags, in equilibrium at the start."""
    lag_s = 0.3  # of the operator's following, three times in a row: about a second behind
    keep = np.exp(-(grid[1] - grid[0]) / lag_s)
    for _ in range(3):
        state = np.stack([scipy.signal.lfiltic([1 - keep], [1, -keep], [start]) for start in path[0]], axis=1)
        path, _ = scipy.signal.lfilter([1 - keep], [1, -keep], path, axis=0, zi=state)
    return path


def _noise(random: np.random.Generator, grid: Array, sigma: float, time_constant: float) -> Array:
    return smooth_process(random, len(grid), float(grid[1] - grid[0]), sigma, time_constant)
