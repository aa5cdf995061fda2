"""Scenes like those of Kaichi et al. 2020: one standing camera of known pose over a floor at z = 0, 8 to 13 IMUs."""

from dataclasses import replace

import numpy as np
from scipy.ndimage import binary_dilation, gaussian_filter1d

from tests.studies.scenes import as_calibration, mean_angle, nominal_start, true_calibration, true_motion, turned
from vip_factors.body.kinematics import Motion
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import transpose, wrap_angle, yaw_of
from vip_factors.sensors.recording import Truth
from vip_factors.sensors.scene import Scene
from vip_factors.settings import Settings
from vip_factors.simulate.staging import floor_height

VIDEO_RATE = 60.0  # Hz, TotalCapture's
JUMP_M = 0.12  # soles that high are off the ground: the clips' own floors float by up to 8 cm
LEFT_GROUND_S = 0.1  # before and after, for take-off and landing
SMOOTH_S = 0.05  # of the correction: what is left are 1–2 cm, as of soles and carpets
_ARMS, _THIGHS = ("left_upper_arm", "right_upper_arm"), ("left_thigh", "right_thigh")
# By how many IMUs are left: those of the paper's section 4.4 that are not.
REMOVED: dict[int, tuple[str, ...]] = {13: (), 12: ("head",), 10: ("head", *_ARMS), 8: ("head", *_ARMS, *_THIGHS)}


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
    """The scene with fewer of its sensors worn."""
    if count not in REMOVED:
        raise InputError(f"{count} IMUs: expected one of {', '.join(map(str, REMOVED))}")
    wearer = scene.wearers[0]
    sites = tuple(site for site in wearer.placement.sites if site.sensor not in REMOVED[count])
    imus = {site.sensor: wearer.imus[site.sensor] for site in sites if site.sensor in wearer.imus}
    return replace(scene, wearers=(replace(wearer, imus=imus, placement=replace(wearer.placement, sites=sites)),))


def told_headings(scene: Scene, settings: Settings) -> Scene:
    """The scene with the paper's own calibration (its eq. 1): mountings off the T-pose, as held, under true headings.

    It stands where the true calibration was. Its sensors share one magnetic north, ours do not.
    """
    wearer = scene.wearers[0]
    names, start = nominal_start(wearer, settings)
    true = np.array([true_calibration(wearer)[name].heading for name in names])
    turns = wrap_angle(true - start.headings)
    # Which way the wearer faces in the T-pose is known too: what all headings have in common does not turn mountings.
    if start.R_world_bone is not None:
        first = true_motion(wearer).frames(slice(0, 1)).state.R_world_bone[0]
        bones = [wearer.placement.site(name).bone_index for name in names]
        turns -= mean_angle(yaw_of(first[bones] @ transpose(start.R_world_bone)))
    known = as_calibration(names, replace(turned(start, turns), headings=true))
    return replace(scene, wearers=(replace(wearer, truth=Truth(true_motion(wearer), known), initial_pose="none"),))


def told_straps(scene: Scene, settings: Settings) -> Scene:
    """The scene with the calibration of :func:`told_headings` as that of its straps, for who may not be told headings.

    Under such straps the declared T-pose gives the true headings, but for what all of them have in common.
    """
    wearer, calibration = scene.wearers[0], true_calibration(told_headings(scene, settings).wearers[0])
    sites = tuple(
        replace(site, R_bone_sensor=calibration[site.sensor].R_bone_sensor) if site.sensor in calibration else site
        for site in wearer.placement.sites
    )
    return replace(scene, wearers=(replace(wearer, placement=replace(wearer.placement, sites=sites)),))
