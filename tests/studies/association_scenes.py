"""Scenes with known owners of all detections, to train the association on."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tests.studies.scenes import begun_late, drawn_scene, slowed
from vip_factors.associate.hypothesis import wearer_points
from vip_factors.body.kinematics import Motion, forward_kinematics, local_rotations
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array, exp, rotation_z
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.camera import CameraModel, CameraPath
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.scene import Scene
from vip_factors.simulate.recording import smooth_process
from vip_factors.simulate.scene import Performer, simulate_scene
from vip_factors.simulate.settings import CameraKind, SceneSettings
from vip_factors.simulate.staging import path_of_standing_feet, staged

SHORTEST_CLIP_S = 3.0  # that can be repeated
DRAWS = 20  # of people, before a scene is given up
NEAR_M, SHOWN_SHARE = 0.12, 0.3  # how near, and how many, keypoints of a detection must be to show a part of somebody
KEYPOINT_SETS = ("openpose18", "coco17", "body25", "halpe26")
CAMERAS: tuple[CameraKind, ...] = ("hand-held", "walking", "hand-held", "fixed")


@dataclass(frozen=True)
class SceneMaking:
    """What the scenes are like."""

    seconds: float = 10.0
    wearers: int = 2
    bystanders: tuple[int, int] = (3, 6)  # fewest and most
    tracker_deg: tuple[float, float] = (10.0, 15.0)  # of an inertial tracker's bones: sensors mounted by eye
    tracker_heading_deg: float = 4.0  # of each of its sensors
    stature_error: float = 0.02  # of the wearers' skeletons: measured in shoes, proportions of others
    fused_deg: tuple[float, float] = (2.0, 6.0)  # of bones after a first fusion
    fused_m: float = 0.06  # of the root after it
    path_deg: float = 0.7  # of the camera after it
    path_m: float = 0.06
    exits: float = 0.4  # share of wearers who are out of the picture for a while, or for good


@dataclass(frozen=True)
class LabelledScene:
    """What the association is given, and what it should find.

    Attributes:
        detections, model, motions, camera, gravity_camera: as of :func:`vip_factors.associate.associate.associate`;
            with a camera the scene trains the second pass, without the first.
        wearer: ``(N,)`` index of the wearer behind each detection, −1 for nobody.
    """

    detections: Detections
    model: CameraModel
    motions: Sequence[Motion]
    wearer: np.ndarray
    camera: CameraPath | None = None
    gravity_camera: Array | None = None


def usable(clips: Iterable[Motion]) -> list[Motion]:
    """Clips, slowed to 60 frames per second, that are long enough to be repeated."""
    known = [slowed(clip) for clip in clips]
    found = [clip for clip in known if len(clip) / clip.rate > SHORTEST_CLIP_S]
    if not found:
        raise InputError(f"scenes need motions longer than {SHORTEST_CLIP_S:g} s: none of {len(known)} is")
    return found


def make_scene(clips: Sequence[Motion], seed: int, making: SceneMaking | None = None) -> Scene:
    """Two wearers and some bystanders who do what random clips show, at random places, filmed by a random camera."""
    making, random = making or SceneMaking(), np.random.default_rng([seed, 0xA550C])
    return drawn_scene(lambda: _draw_scene(clips, seed, making, random), DRAWS)


def _draw_scene(clips: Sequence[Motion], seed: int, making: SceneMaking, random: np.random.Generator) -> Scene:
    people = making.wearers + int(random.integers(making.bystanders[0], making.bystanders[1] + 1))
    chosen = random.choice(len(clips), people, replace=len(clips) < people)
    moving = [begun_late(clips[i], making.seconds, random) for i in chosen]
    moving[making.wearers :] = [_passing(motion, random) for motion in moving[making.wearers :]]
    motions = staged(moving, seed)
    performers = [
        Performer(f"person{number}", motion, preset("sip6", motion.skeleton) if number < making.wearers else None)
        for number, motion in enumerate(motions)
    ]
    settings = SceneSettings(
        camera=CAMERAS[seed % len(CAMERAS)],
        keypoints=KEYPOINT_SETS[seed // 2 % len(KEYPOINT_SETS)],
        fov_deg=float(random.uniform(45, 75)),
    )
    return simulate_scene(performers, settings, seed, name=f"scene{seed}")


def labelled(scene: Scene, seed: int, second_pass: bool, making: SceneMaking | None = None) -> LabelledScene:
    """What the association would be given of a simulated scene: an inertial tracker's motions, or fused ones."""
    making, random = making or SceneMaking(), np.random.default_rng([seed, second_pass, 0x7AC])
    if scene.camera is None or scene.camera.truth is None or any(wearer.truth is None for wearer in scene.wearers):
        raise InputError(f"scene '{scene.name}' lacks a camera or its truth: expected a simulated one")
    true = [wearer.truth.motion for wearer in scene.wearers if wearer.truth is not None]
    detections, owner = scene.camera.detections.timed(scene.camera.truth.clock), scene.camera.truth.wearer
    left = _after_exits(scene, detections, true, random, making)
    detections, owner = detections.select(left), owner[left]
    if not second_pass:
        motions = [inertially_tracked(motion, random, making) for motion in true]
        return LabelledScene(detections, scene.camera.model, motions, owner)
    motions = [_fused(motion, random, making) for motion in true]
    camera = _estimated(scene.camera.truth.path.at(detections.time), random, making)
    return LabelledScene(detections, scene.camera.model, motions, owner, camera)


def _after_exits(
    scene: Scene, detections: Detections, true: Sequence[Motion], random: np.random.Generator, making: SceneMaking
) -> np.ndarray:
    """Which detections ``(N,)`` are left once some wearers are out of the picture for a while, or for good."""
    left, time = np.ones(len(detections), bool), detections.time[detections.frame]
    for motion in true:
        leaves, for_good = random.random(2) < [making.exits, 0.5]
        start, stop = np.sort(random.uniform(time[0], time[-1], 2))
        if leaves:
            left &= ~((for_good | ((time >= start) & (time <= stop))) & _shows(scene, detections, motion))
    return left


def _shows(scene: Scene, detections: Detections, motion: Motion) -> np.ndarray:
    """Which detections ``(N,)`` show somebody, if only a part: some keypoints are where that person's are."""
    assert scene.camera is not None
    assert scene.camera.truth is not None
    points = wearer_points(motion, detections.keypoints, detections.time)
    path = scene.camera.truth.path.at(detections.time)
    p_camera = path.to_camera(points.p_world_keypoint)[detections.frame]
    depth = path.to_camera(points.p_world_pelvis[:, None])[detections.frame, 0, 2]
    near = NEAR_M * scene.camera.model.focal[0] / np.maximum(depth, 0.3)
    gap = np.linalg.norm(scene.camera.model.project(p_camera) - detections.pixels, axis=-1)
    with np.errstate(invalid="ignore"):
        return np.sum(gap < near[:, None], axis=1) >= SHOWN_SHARE * np.maximum(detections.seen.sum(axis=1), 1)


def inertially_tracked(motion: Motion, random: np.random.Generator, making: SceneMaking) -> Motion:
    """The motion as an inertial tracker would have it: bones turned by mountings and headings, a path of its own."""
    bones = motion.R_parent_child.shape[1]
    heading = np.deg2rad(making.tracker_heading_deg) * random.standard_normal(bones)
    R_world_bone = rotation_z(heading) @ motion.state.R_world_bone @ _turns(random, bones, making.tracker_deg)
    R_world_bone = rotation_z(random.uniform(-np.pi, np.pi)) @ R_world_bone
    lengths = motion.skeleton.p_parent_joint * (1 + making.stature_error * random.standard_normal())
    skeleton = replace(motion.skeleton, p_parent_joint=lengths)
    R = local_rotations(R_world_bone)
    path = path_of_standing_feet(skeleton, forward_kinematics(skeleton, R, np.zeros((len(motion), 3))))
    return replace(motion, skeleton=skeleton, R_parent_child=R, p_world_pelvis=path)


def _fused(motion: Motion, random: np.random.Generator, making: SceneMaking) -> Motion:
    R_world_bone = motion.state.R_world_bone @ _turns(random, motion.R_parent_child.shape[1], making.fused_deg)
    wander = smooth_process(random, len(motion), 1 / motion.rate, making.fused_m, 1.0)
    return replace(motion, R_parent_child=local_rotations(R_world_bone), p_world_pelvis=motion.p_world_pelvis + wander)


def _estimated(path: CameraPath, random: np.random.Generator, making: SceneMaking) -> CameraPath:
    step = float(np.median(np.diff(path.time)))
    turn = smooth_process(random, len(path), step, np.deg2rad(making.path_deg), 0.7)
    shift = smooth_process(random, len(path), step, making.path_m, 1.0)
    return CameraPath(path.time, path.R_world_camera @ exp(turn), path.p_world_camera + shift)


def _turns(random: np.random.Generator, count: int, degrees: tuple[float, float]) -> Array:
    axis = random.standard_normal((count, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    return exp(axis * np.deg2rad(random.uniform(*degrees, (count, 1))))


def _passing(motion: Motion, random: np.random.Generator) -> Motion:
    """Bystanders come and go: one in three is there for a part of the time only."""
    if random.random() > 1 / 3:
        return motion
    first, last = np.sort(random.uniform(0, 1, 2)) * [0.5, 0.5] + [0.0, 0.5]
    return motion.frames(slice(int(first * len(motion)), max(int(last * len(motion)), 60)))
