"""Scenes like those of Kaichi et al. 2020: one standing camera of known pose over a floor at z = 0, 8 to 13 IMUs."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.ndimage import binary_dilation, gaussian_filter1d

from tests.studies.vip_suite import (
    BLEND_S,
    HOLD_S,
    PLACEMENT,
    POSE,
    as_calibration,
    middle_of,
    nominal_start,
    straps_and_sensors,
    turned,
)
from vip_factors.body.motion import Motion
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array, transpose, wrap_angle, yaw_of
from vip_factors.sensors.placement import preset
from vip_factors.sensors.recording import Recording, Truth
from vip_factors.sensors.scene import Scene
from vip_factors.settings import Settings
from vip_factors.simulate.scene import Performer, simulate_scene
from vip_factors.simulate.scene_settings import SceneSettings
from vip_factors.simulate.settings import SimulateSettings
from vip_factors.simulate.stance import floor_height, with_initial_pose

SETTLED_S = HOLD_S + BLEND_S
VIDEO_RATE = 60.0  # Hz, TotalCapture's
JUMP_M = 0.12  # soles that high are off the ground: the clips' own floors float by up to 8 cm
LEFT_GROUND_S = 0.1  # before and after, for take-off and landing
SMOOTH_S = 0.05  # of the correction: what is left are 1–2 cm, as of soles and carpets
_ARMS, _THIGHS = ("left_upper_arm", "right_upper_arm"), ("left_thigh", "right_thigh")
# By how many IMUs are left: those of the paper's section 4.4 that are not.
REMOVED: dict[int, tuple[str, ...]] = {
    13: (),
    12: ("head",),
    10: ("head", *_ARMS),
    8: ("head", *_ARMS, *_THIGHS),
}


@dataclass(frozen=True)
class KaichiScenes:
    """What is recorded."""

    seconds: float = 8.0  # of each clip, from its middle
    seeds: int = 1  # recordings of each clip
    # Of the held T-pose, per joint and axis: the orientation error of their IMUs alone, 8.75 deg, lies between those of
    # a walk and of an acting clip.
    pose_error_deg: float = 1.5
    sensors: SimulateSettings = field(default_factory=straps_and_sensors)

    @property
    def scene_settings(self) -> SceneSettings:
        """Of the simulator; the camera's pose is known as a board on the floor tells it."""
        return SceneSettings.realistic(camera="fixed", known_pose=True, video_rate=VIDEO_RATE, imu=self.sensors)


def kaichi_scene(motion: Motion, name: str, scenes: KaichiScenes, seed: int) -> Scene:
    """The middle of a clip, on a level floor, after a T-pose, as 13 sensors and the camera record it."""
    middle = grounded(middle_of(motion, scenes.seconds, name))
    posed = with_initial_pose(middle, POSE, HOLD_S, BLEND_S, scenes.pose_error_deg, seed)
    performer = Performer("wearer", posed, preset(PLACEMENT, motion.skeleton), POSE)
    return simulate_scene([performer], scenes.scene_settings, seed, name)


def grounded(motion: Motion) -> Motion:
    """The motion raised and lowered so that its lowest sole is on z = 0, but for jumps.

    The captured floors rise and sink by 3 to 8 cm within a clip, which a contact with the floor would have to take for
    a change of depth; the data set of the paper stands on one floor.
    """
    height = floor_height(motion.skeleton, motion.state)
    near = max(1, round(LEFT_GROUND_S * motion.rate))
    jumps = binary_dilation(height - np.quantile(height, 0.05) > JUMP_M, iterations=near)
    if np.all(jumps):
        raise InputError(f"motion '{motion.name}' is never on the ground: expected one that stands somewhere")
    frames = np.arange(len(motion))
    shift = np.interp(frames, frames[~jumps], height[~jumps])
    path = motion.p_world_pelvis.copy()
    path[:, 2] -= gaussian_filter1d(shift, SMOOTH_S * motion.rate, mode="nearest")
    return replace(motion, p_world_pelvis=path)


def share_off_ground(motion: Motion) -> float:
    """Share of a motion's frames in which both feet are off the floor at z = 0."""
    return float(np.mean(floor_height(motion.skeleton, motion.state) > JUMP_M))


def with_sensors(scene: Scene, count: int) -> Scene:
    """The scene with fewer of its sensors worn.

    Raises:
        InputError: for a number of sensors that the paper does not have.
    """
    if count not in REMOVED:
        raise InputError(f"{count} IMUs: expected one of {', '.join(map(str, REMOVED))}")
    wearer = scene.wearers[0]
    sites = tuple(site for site in wearer.placement.sites if site.sensor not in REMOVED[count])
    names: Sequence[str] = [site.sensor for site in sites]
    imus = {name: stream for name, stream in wearer.imus.items() if name in names}
    return replace(scene, wearers=(replace(wearer, imus=imus, placement=replace(wearer.placement, sites=sites)),))


def without_camera(scene: Scene) -> Scene:
    """The IMUs alone."""
    return replace(scene, camera=None, truth=None)


def told_headings(scene: Scene, settings: Settings) -> Scene:
    """The scene with the paper's own calibration (its eq. 1): mountings off the T-pose, as held, under true headings.

    It stands where the true calibration was. Its sensors share one magnetic north, ours do not.
    """
    wearer: Recording = scene.wearers[0]
    if wearer.truth is None or wearer.truth.calibration is None:
        raise InputError(f"recording '{wearer.name}' has no true calibration: expected a simulated one")
    names, start = nominal_start(wearer, settings)
    true = np.array([wearer.truth.calibration[name].heading for name in names])
    turns = wrap_angle(true - start.headings)
    # Which way the wearer faces in the T-pose is known too: what all headings have in common does not turn mountings.
    if start.R_world_bone is not None:
        first = wearer.truth.motion.frames(slice(0, 1)).state.R_world_bone[0]
        bones = [wearer.placement.site(name).bone_index for name in names]
        turns -= mean_angle(yaw_of(first[bones] @ transpose(start.R_world_bone)))
    known = as_calibration(names, replace(turned(start, turns), headings=true))
    return replace(scene, wearers=(replace(wearer, truth=Truth(wearer.truth.motion, known), initial_pose="none"),))


def told_straps(scene: Scene, settings: Settings) -> Scene:
    """The scene with the calibration of :func:`told_headings` as that of its straps, for who may not be told headings.

    Under such straps the declared T-pose gives the true headings, but for what all of them have in common.
    """
    wearer, known = scene.wearers[0], told_headings(scene, settings).wearers[0].truth
    calibration = {} if known is None else dict(known.calibration or {})
    sites = tuple(
        replace(site, R_bone_sensor=calibration[site.sensor].R_bone_sensor) if site.sensor in calibration else site
        for site in wearer.placement.sites
    )
    return replace(scene, wearers=(replace(wearer, placement=replace(wearer.placement, sites=sites)),))


def mean_angle(angles: Array) -> float:
    """Circular mean, radians."""
    return float(np.angle(np.exp(1j * angles).sum()))
