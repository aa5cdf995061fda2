"""Simulated scenes for the on-line association: true poses, made wrong as predictions are, and what came of them."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.kinematics import BodyState, Motion, forward_kinematics, local_rotations
from vip_factors.geometry.quaternions import interpolate_rotations
from vip_factors.geometry.rotations import Array, exp
from vip_factors.live.association import Belief, OnlineAssociation
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.live import VideoFrame
from vip_factors.sensors.scene import Scene
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import smooth_process
from vip_factors.simulate.scene import Performer, simulate_scene
from vip_factors.simulate.settings import SceneSettings
from vip_factors.simulate.staging import from_time, placed

STATURES = (1.70, 1.82, 1.75, 1.62, 1.78, 1.68)
LAG_S = 0.25
POSE_DEG, CAMERA_DEG, ROOT_M, GROWS_M_S = 10.0, 2.0, 0.05, 0.25  # the last: while the wearer is not seen
CHANGES_S = 1.5  # how long such errors last

Person = tuple[float, float, tuple[float, float]]  # from which moment of the gestures, turned by, where


def person(number: int, late: float, yaw: float, at: tuple[float, float], seconds: float) -> Motion:
    skeleton = skeleton_from_stature(STATURES[number % len(STATURES)])
    return placed(from_time(gestures(late + seconds + 0.1, 60.0, skeleton), late), yaw, at)


def crossing(motion: Motion, start: tuple[float, float], speed: tuple[float, float]) -> Motion:
    """Somebody who gesticulates on the way along a straight line."""
    way = np.array(start) + motion.time[:, None] * np.array(speed)
    return replace(motion, p_world_pelvis=np.concatenate([way, motion.p_world_pelvis[:, 2:]], axis=1))


def scene_of(wearers: list[Motion], bystanders: list[Motion], seed: int = 0) -> Scene:
    performers = [
        Performer(f"wearer{n}", one, preset("totalcapture13", one.skeleton)) for n, one in enumerate(wearers)
    ] + [Performer(f"bystander{n}", one) for n, one in enumerate(bystanders)]
    settings = SceneSettings(camera="hand-held", azimuth_deg=-90.0, distance_m=6.5)
    return simulate_scene(performers, settings, seed)


@dataclass(frozen=True)
class Predictions:
    """What a tracker would predict at each video frame, and where everybody is seen."""

    frames: list[VideoFrame]
    owners: list[np.ndarray]
    bodies: list[BodyState]
    R_world_camera: Array
    p_world_camera: Array
    root_m: Array

    def at(self, f: int, bodies: list[BodyState] | None = None) -> tuple[VideoFrame, Belief]:
        """Arguments of ``choose``, by video frame."""
        (frame,), belief = self.during(range(f, f + 1), bodies)
        return frame, belief

    def during(self, window: range, bodies: list[BodyState] | None = None) -> tuple[list[VideoFrame], Belief]:
        """Arguments of ``revise``."""
        own = slice(window.start, window.stop)
        part = [BodyState(one.R_world_bone[own], one.p_world_joint[own]) for one in (bodies or self.bodies)]
        covariance = np.eye(3) * self.root_m.T[own, :, None, None] ** 2
        pose = self.R_world_camera[own], self.p_world_camera[own]
        return self.frames[own], Belief(window.start, part, covariance, *pose)


def predictions(
    scene: Scene, seed: int = 0, hidden: Callable[[float], bool] = lambda time: False, wrong: float = 1.0
) -> Predictions:
    """The truth, ``wrong`` times as wrong as predictions are; the first wearer is not found while ``hidden``."""
    random = np.random.default_rng([seed, 0xA550C])
    detections, truth = scene.camera.detections, scene.camera.truth
    time, F = detections.time, len(detections.time)
    step = 1 / detections.rate
    frames, owners = [], []
    for f in range(F):
        rows = detections.of_frame(f)
        keep = ~((truth.wearer[rows] == 0) & hidden(time[f]))
        frames.append(
            VideoFrame("camera", float(time[f]), detections.pixels[rows][keep], detections.confidence[rows][keep])
        )
        owners.append(truth.wearer[rows][keep])

    def noise(sigma: float, axes: int) -> Array:
        return wrong * smooth_process(random, F, step, sigma, CHANGES_S, axes)

    bodies, root_m = [], []
    for w, wearer in enumerate(scene.wearers):
        motion = wearer.truth.motion
        R = np.stack([interpolate_rotations(motion.time, one, time) for one in motion.R_parent_child.swapaxes(0, 1)], 1)
        p = np.stack([np.interp(time, motion.time, column) for column in motion.p_world_pelvis.T], axis=1)
        error = noise(np.deg2rad(POSE_DEG) / np.sqrt(3), 72).reshape(F, 24, 3)
        bent = forward_kinematics(motion.skeleton, R, p).R_world_bone @ exp(error)
        unseen = np.zeros(F)
        for f in range(1, F):
            unseen[f] = 0.0 if (owners[f] == w).any() else unseen[f - 1] + step
        sigma = ROOT_M + GROWS_M_S * unseen
        bodies.append(forward_kinematics(motion.skeleton, local_rotations(bent), p + sigma[:, None] * noise(1.0, 3)))
        root_m.append(sigma)
    camera = truth.path.at(time)
    R_camera = camera.R_world_camera @ exp(noise(np.deg2rad(CAMERA_DEG), 3))
    return Predictions(frames, owners, bodies, R_camera, camera.p_world_camera, np.array(root_m))


def association_of(scene: Scene) -> OnlineAssociation:
    skeletons = [wearer.truth.motion.skeleton for wearer in scene.wearers]
    return OnlineAssociation(scene.camera.detections.keypoints, scene.camera.model, skeletons)


@dataclass(frozen=True)
class Outcome:
    """Choices ``(F, W)`` at once, and what they were when they left the lag."""

    at_once: np.ndarray
    lagged: np.ndarray


def run(scene: Scene, given: Predictions) -> Outcome:
    """As a tracker would go on."""
    association = association_of(scene)
    at_once, lagged = [], np.full((len(given.frames), len(given.bodies)), -1)
    first = 0
    for f, frame in enumerate(given.frames):
        at_once.append(association.choose(*given.at(f)))
        while given.frames[first].time < frame.time - LAG_S - 1e-6:
            first += 1
        lagged[first : f + 1] = association.revise(*given.during(range(first, f + 1)))
    return Outcome(np.array(at_once), lagged)


def precision_and_recall(chosen: np.ndarray, owners: list[np.ndarray]) -> tuple[float, float]:
    """Of all choices, how many show the wearer; of all frames with a detection of the wearer, how many have it."""
    right = taken = there = 0
    for choice, owner in zip(chosen, owners, strict=True):
        for w, n in enumerate(choice):
            taken += n >= 0
            right += n >= 0 and owner[n] == w
            there += (owner == w).any()
    return right / max(taken, 1), right / max(there, 1)
