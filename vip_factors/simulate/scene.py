"""A scene with truth: wearers of sensors, bystanders, and a camera that films them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.body.keypoints import keypoint_set
from vip_factors.body.kinematics import Motion
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array, exp
from vip_factors.sensors.calibration import Placement, SensorCalibration, SensorSite
from vip_factors.sensors.camera_path import CameraPath
from vip_factors.sensors.scene import CAMERA_MOUNTING_SIGMA, Camera, CameraMount, Scene, SceneTruth
from vip_factors.simulate.camera_motion import camera_motion
from vip_factors.simulate.dense import DenseMotion, dense_motion
from vip_factors.simulate.detector import detect
from vip_factors.simulate.detector_view import Person
from vip_factors.simulate.recording import record, simulate_sensor
from vip_factors.simulate.scene_settings import SceneSettings

# The IMU on the camera's back: its x right, y up, z towards the operator, as a phone's own in landscape.
R_CAMERA_IMU = np.diag([1.0, -1.0, -1.0])
P_CAMERA_IMU = np.array([0.03, 0.02, -0.015])  # metres from the lens: somewhere on a phone
CAMERA_IMU = "camera"
CAMERA_SEED_STEP = 104_729  # between the seeds of cameras; the first has the scene's
SEED_STEP = 7919  # between the seeds of wearers; the first has the scene's: a scene of one is the recording of one
PATH_HZ = 30.0  # at which the camera's operator watches the people


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
    move; bystanders come and go with their motions. In the truth, ``SceneTruth.wearer`` gives a detection to the
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
    settings = settings or SceneSettings()
    if all(one.placement is None for one in performers):
        raise InputError(f"scene '{name}' has nobody with sensors: expected at least one performer with a placement")
    if len({one.name for one in performers}) < len(performers):
        raise InputError(f"scene '{name}': performers {', '.join(one.name for one in performers)}: names repeat")
    dense = [dense_motion(one.motion, settings.imu.lowpass_hz) for one in performers]
    worn = [number for number, one in enumerate(performers) if one.placement is not None]
    recordings = []
    for order, number in enumerate(worn):
        performer, placement = performers[number], performers[number].placement
        assert placement is not None
        own = record(
            dense[number], placement, settings.imu, seed + SEED_STEP * order, performer.name, performer.initial_pose
        )
        recordings.append(replace(own, subject=replace(own.subject, name=performer.name)))
    time = _video_times([dense[number] for number in worn], settings, name)
    people = [_person(one, time) for one in dense]
    wearer = np.array([worn.index(number) if number in worn else -1 for number in (*range(len(performers)), -1)])

    films, azimuth = [], None
    # Further cameras stand on tripods, without sensors, at known poses.
    fixed = replace(settings, camera="fixed", camera_imu=False, known_pose=True)
    for number, one in enumerate([settings, *[fixed] * (settings.cameras - 1)]):
        one = one if azimuth is None else replace(one, azimuth_deg=azimuth + 360.0 * number / settings.cameras)
        body, around = _camera_body(dense, worn, one, seed)
        azimuth = around if azimuth is None else azimuth
        films.append(_film(body, people, wearer, time, one, seed, number))
    (camera, truth), *further = films
    truth = replace(truth, further=tuple(known for _, known in further))
    return Scene(name, tuple(recordings), camera, truth, tuple(camera for camera, _ in further))


def _film(
    body: DenseMotion, people: Sequence[Person], wearer: np.ndarray, time: Array, settings: SceneSettings, seed: int,
    number: int,
) -> tuple[Camera, SceneTruth]:  # fmt: skip
    """What one camera's detector finds; ``wearer`` is the index of the wearer by person, −1 for others and nobody."""
    state, own_seed = body.bone(0, time), seed + CAMERA_SEED_STEP * number
    path = CameraPath(time, state.R_world_bone, state.position)
    keypoints = keypoint_set(settings.keypoints)
    detections, owner, pixels = detect(people, path, settings.model, keypoints, settings.detector, own_seed, seed)
    mount, calibration = camera_mount(body, settings, seed) if settings.has_camera_imu else (None, None)
    moving = settings.camera != "fixed"
    if not moving:
        path = CameraPath(path.time[:1], path.R_world_camera[:1], path.p_world_camera[:1])
    known = _known_pose(path, settings, own_seed) if settings.has_known_pose else None
    name = "camera" if number == 0 else f"camera_{number + 1}"
    detections = detections.shifted(-settings.time_offset_s)
    camera = Camera(name, settings.model, detections, moving=moving, mount=mount, known_path=known)
    return camera, SceneTruth(path, wearer[owner], pixels, calibration, settings.time_offset_s)


def _known_pose(path: CameraPath, settings: SceneSettings, seed: int) -> CameraPath:
    """The pose of a fixed camera as it was measured."""
    random = np.random.default_rng([seed, 0xB0A2D])
    R = path.R_world_camera @ exp(np.deg2rad(settings.pose_error_deg) * random.standard_normal(3))
    p = path.p_world_camera + settings.pose_error_m * random.standard_normal(3)
    return CameraPath(path.time, R, p)


def _video_times(wearers: Sequence[DenseMotion], settings: SceneSettings, name: str) -> Array:
    """Instants ``(F,)`` of the video frames on the sensors' clock."""
    start, end = max(one.start for one in wearers), min(one.end for one in wearers)
    count = int(np.floor((end - start) * settings.video_rate + 1e-6)) + 1
    if count < 2:
        raise InputError(f"scene '{name}': its wearers' motions share {max(end - start, 0):.2f} s: expected two frames")
    return start + np.arange(count) / settings.video_rate


def _camera_body(
    people: Sequence[DenseMotion], worn: Sequence[int], settings: SceneSettings, seed: int
) -> tuple[DenseMotion, float]:
    """The camera's path: it films the wearers, from a place that nobody runs into; and from which side, degrees."""
    start = max(people[number].start for number in worn)
    end = min(people[number].end for number in worn)
    time = np.linspace(start, end, max(8, int(np.ceil((end - start) * PATH_HZ)) + 1))
    pelves = np.stack([one.root(np.clip(time, one.start, one.end)) for one in people])
    there = np.stack([(time >= one.start) & (time <= one.end) for one in people])
    others = np.where(there[..., None], pelves, np.nan)
    random = np.random.default_rng([seed, 0xCA3E7A])
    filmed = pelves[list(worn)]
    body = camera_motion(filmed, time, settings, random, others)
    away = body.bone(0, time[:1]).position[0] - filmed.mean(axis=(0, 1))
    return body, float(np.rad2deg(np.arctan2(away[1], away[0])))


def _person(dense: DenseMotion, time: Array) -> Person:
    """Somebody at the video's instants; before and after their motion they are not there."""
    present = (time >= dense.start - 1e-9) & (time <= dense.end + 1e-9)
    return Person(dense.skeleton, dense.state(np.clip(time, dense.start, dense.end)), present)


def camera_mount(body: DenseMotion, settings: SceneSettings, seed: int) -> tuple[CameraMount, SensorCalibration]:
    """The IMU on the camera and its true calibration: nothing wobbles on it, all else is as on people."""
    imu = replace(
        settings.imu, mounting_error_deg=settings.camera_mounting_error_deg, position_error_m=0.0, skin_deg=0.0,
        skin_m=0.0, wobble=0.0,
    )  # fmt: skip
    site = SensorSite(CAMERA_IMU, "pelvis", P_CAMERA_IMU, R_CAMERA_IMU)  # bone 0 is the camera itself
    stream, calibration = simulate_sensor(body, site, imu, seed)
    sigma = max(CAMERA_MOUNTING_SIGMA, np.deg2rad(settings.camera_mounting_error_deg))
    return CameraMount(stream, R_CAMERA_IMU, P_CAMERA_IMU, float(sigma)), calibration
