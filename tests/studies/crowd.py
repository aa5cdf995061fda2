"""Scenes of several people, some with sensors, made of motions that nothing was trained on."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from tests.studies.sip import find_clips
from tests.studies.vip_suite import BLEND_S, HOLD_S, POSE, straps_and_sensors
from vip_factors.body.held_out_clips import held_out_names
from vip_factors.body.motion import Motion
from vip_factors.errors import RecordingError
from vip_factors.io.motions.files import read_motion
from vip_factors.sensors.placement import preset
from vip_factors.sensors.scene import Scene
from vip_factors.settings import Settings
from vip_factors.simulate.scene import Performer, simulate_scene
from vip_factors.simulate.scene_settings import CameraKind, SceneSettings
from vip_factors.simulate.settings import SimulateSettings
from vip_factors.simulate.staging import from_time, lasting, staged
from vip_factors.simulate.stance import with_initial_pose

DRAWS = 10  # of people: clips have single faults that no sensor could measure
MOTION_HZ = 60.0
SHORTEST_S = 2.0  # of a clip that is to be repeated


@dataclass(frozen=True)
class CrowdTrials:
    """Which scenes are made."""

    seconds: float = 20.0  # after the initial pose
    wearers: int = 2
    bystanders: int = 4
    seeds: int = 3
    camera: CameraKind = "hand-held"
    placement: str = "totalcapture13"
    keypoints: str = "openpose18"
    fov_deg: float = 60.0
    pose_error_deg: float = 4.0  # of the held T-pose, as in the suite of single wearers
    passing: float = 0.5  # share of bystanders who come and go
    sensors: SimulateSettings = field(default_factory=straps_and_sensors)
    settings: Settings = field(default_factory=Settings)  # of the estimator


def held_out_motions(folder: Path) -> dict[str, Motion]:
    """The clips held out of all training, at 60 Hz or a little more.

    Raises:
        InputError: if one has no file in the folder.
    """
    motions = {name: read_motion(file) for name, file in find_clips(folder, held_out_names()).items()}
    slowed = {
        name: motion.frames(slice(None, None, max(1, round(motion.rate / MOTION_HZ))))
        for name, motion in motions.items()
    }
    return {name: motion for name, motion in slowed.items() if len(motion) / motion.rate >= SHORTEST_S}


def crowd_scene(clips: Mapping[str, Motion], trials: CrowdTrials, seed: int) -> Scene:
    """Wearers who hold a T-pose and then do what random clips show, among bystanders, of whom some come and go.

    Raises:
        RecordingError: if no draw of clips can be recorded.
    """
    random = np.random.default_rng([seed, 0xC40D])
    for draw in range(DRAWS):
        people = trials.wearers + trials.bystanders
        chosen = random.choice(sorted(clips), people, replace=len(clips) < people)
        try:
            return _scene([clips[name] for name in chosen], trials, seed, random)
        except RecordingError:
            if draw == DRAWS - 1:
                raise
    raise AssertionError  # not reached


def _scene(clips: Sequence[Motion], trials: CrowdTrials, seed: int, random: np.random.Generator) -> Scene:
    moving = []
    for number, clip in enumerate(clips):
        late = float(random.uniform(0, len(clip) / clip.rate))  # two people with one clip are not in step
        if number < trials.wearers:
            motion = from_time(lasting(clip, trials.seconds + late), late)
            pose_seed = seed + 1009 * number
            moving.append(with_initial_pose(motion, POSE, HOLD_S, BLEND_S, trials.pose_error_deg, pose_seed))
        else:
            motion = from_time(lasting(clip, trials.seconds + HOLD_S + late), late)
            moving.append(_passing(motion, random) if random.random() < trials.passing else motion)
    motions = staged(moving, seed)
    performers = [
        Performer(f"wearer{number + 1}", motion, preset(trials.placement, motion.skeleton), POSE)
        if number < trials.wearers
        else Performer(f"bystander{number + 1 - trials.wearers}", motion)
        for number, motion in enumerate(motions)
    ]
    settings = SceneSettings.realistic(
        camera=trials.camera, keypoints=trials.keypoints, fov_deg=trials.fov_deg, imu=trials.sensors
    )
    return simulate_scene(performers, settings, seed, f"crowd{seed}")


def _passing(motion: Motion, random: np.random.Generator) -> Motion:
    """There for a half of the time or more, from the beginning or to the end or neither."""
    first, last = random.uniform(0, 0.4), random.uniform(0.6, 1.0)
    part = motion.frames(slice(int(first * len(motion)), int(last * len(motion))))
    return replace(part, name=motion.name)
