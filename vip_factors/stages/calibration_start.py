"""Choice of the start of headings and mountings: the search of ``initialise`` over a stretch with brisk motion."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from vip_factors.body.joint_priors import load_joint_limits, load_pose_prior
from vip_factors.body.skeleton import PARENTS, Skeleton, held_pose, joint_index
from vip_factors.estimate import StartChoice
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array, angle_between
from vip_factors.initialise.calibration import InitialCalibration, initial_calibration, orientation_at_start
from vip_factors.initialise.sensor_tree import Link, sensor_tree
from vip_factors.initialise.start_candidates import BONE_SIGMA, START_RATE
from vip_factors.initialise.start_search import SensorPrior, Starts, StartSearch
from vip_factors.sensors.frames import ImuFrames, resample_streams
from vip_factors.sensors.recording import Recording
from vip_factors.settings import CommonSettings
from vip_factors.stages.inertial_model import gauge_sensor

UPRIGHT = tuple(
    joint_index(name)
    for name in (
        "pelvis",
        "spine1",
        "spine2",
        "spine3",
        "neck",
        "head",
        "left_hip",
        "right_hip",
        "left_knee",
        "right_knee",
    )
)
BRISK = 0.5  # of the briskest stretch: takes an early one, before headings have drifted


def search_start(
    recording: Recording,
    frames: ImuFrames,
    usual: InitialCalibration,
    settings: CommonSettings,
    stretch: ImuFrames | None = None,
) -> Starts | None:
    """Search the likeliest start; None if there is nothing to choose from, such as with one sensor.

    If no pose is declared but the wearer is still at first, standing upright with hanging arms is tried as well. The
    default ``stretch`` is :func:`brisk_stretch`.
    """
    if len(frames.sensors) < 2:
        return None
    stretch = brisk_stretch(recording, frames) if stretch is None else stretch
    search = start_search(recording, stretch, settings, not settings.calibration.estimate_mountings)
    declared = settings.factors.initial_pose
    R_inertial_sensor = orientation_at_start(frames, declared.seconds)
    if recording.initial_pose != "none" or search.known_mountings or not _is_still(frames, declared.seconds):
        return search.best(usual, R_inertial_sensor)
    bones = [recording.placement.site(name).bone_index for name in frames.sensors]
    standing = initial_calibration(
        frames,
        recording.placement,
        recording.subject.body(),
        held_pose("n-pose", declared.nominal),
        declared.seconds,
        gauge_sensor(bones),
    )
    as_standing = search.best(standing, R_inertial_sensor).best.calibration
    return search.best(usual, R_inertial_sensor, (as_standing,))


def start_search(
    recording: Recording, stretch: ImuFrames, settings: CommonSettings, known_mountings: bool
) -> StartSearch:
    """Prepare the search over a stretch of evenly spaced frames with the placed sensors of a recording."""
    sites = [recording.placement.site(name) for name in stretch.sensors]
    bones, body = [site.bone_index for site in sites], recording.subject.body()
    prior = SensorPrior(
        sensor_links(recording, stretch.sensors),
        np.stack([site.R_bone_sensor for site in sites]),
        np.array([site.mounting_sigma for site in sites]),
        np.stack([_bone_axis(body, bone) for bone in bones]),
        np.isin(bones, UPRIGHT),
    )
    search, stated = StartSearch(stretch, prior, known_mountings), settings.factors.agreeing_headings.sigma_deg
    return search if stated is None else replace(search, agree_deg=stated)


def sensor_links(recording: Recording, sensors: Sequence[str]) -> tuple[Link, ...]:
    """Tree of some placed sensors of a recording, by their numbers."""
    sites = [recording.placement.site(name) for name in sensors]
    p_bone_sensor = np.stack([site.p_bone_sensor for site in sites])
    bones, body = [site.bone_index for site in sites], recording.subject.body()
    return sensor_tree(bones, p_bone_sensor, body, load_pose_prior(), load_joint_limits(), BONE_SIGMA)


def _bone_axis(body: Skeleton, bone: int) -> Array:
    """Unit vector along a bone in its axes; trunk and head are vertical, feet and hands follow their last joint."""
    limb = body.limb(bone)
    if limb is None and bone not in UPRIGHT and bone in PARENTS:
        limb = body.p_parent_joint[PARENTS.index(bone)]
    if limb is None or not np.any(limb):
        return np.array([0.0, 1.0, 0.0])
    return np.asarray(limb / np.linalg.norm(limb))


def brisk_stretch(recording: Recording, frames: ImuFrames) -> ImuFrames:
    """Frames of the first stretch at least half as brisk as the briskest; all frames of a shorter recording."""
    seconds, rate = 30.0, START_RATE
    begin, end = float(frames.time[0]), float(frames.time[-1])
    if end - begin > seconds:
        are_valid = frames.orientation_valid[1:] & frames.orientation_valid[:-1]
        turned = angle_between(frames.R_inertial_sensor[:-1], frames.R_inertial_sensor[1:]) * are_valid
        sums = np.concatenate([[0.0], np.cumsum(turned.sum(axis=1))])
        length = round(seconds / frames.step)
        brisk = sums[length:] - sums[:-length]
        begin = float(frames.time[int(np.argmax(brisk >= BRISK * brisk.max()))])
        end = begin + seconds
    count = max(int(np.floor((end - begin) * rate + 1e-6)) + 1, 2)
    return resample_streams([recording.imus[name] for name in frames.sensors], begin + np.arange(count) / rate)


def _is_still(frames: ImuFrames, seconds: float) -> bool:
    still = np.deg2rad(3.0)  # turn of sensors on a standing person, by breathing and swaying
    count = max(1, round(seconds / frames.step))
    pose_frames = frames.window(slice(0, count))
    turned = (
        angle_between(pose_frames.R_inertial_sensor[:1], pose_frames.R_inertial_sensor) * pose_frames.orientation_valid
    )
    return bool(pose_frames.orientation_valid[0].all() and turned.max() < still)


def start_choice(sensors: tuple[str, ...], starts: Starts | None) -> StartChoice | None:
    """Convert the result of a search to the part reported in an estimate."""
    if starts is None:
        return None
    return StartChoice(starts.best.hypothesis, starts.rival, starts.margin, tuple(sensors[s] for s in starts.doubtful))


def start_findings(wearer: str, sensors: tuple[str, ...], starts: Starts | None) -> Iterator[Finding]:
    """Report a start that the recording does not determine."""
    if starts is None:
        return
    if starts.doubtful:
        names, declared = _names(sensors, starts.doubtful), starts.best.calibration.R_world_bone is not None
        better = "more and brisker motion" if declared else "a T- or N-pose held at the start and declared"
        times = float(np.exp(starts.margin))
        reason = (
            f"the estimate assumes that {starts.best.hypothesis}; the alternative that {starts.rival} turns sensors by "
            f"more than 60° and is only {times:.1f} times less likely. Record {better}, or give the real mountings"
        )
        subject = f"the mounting and heading of {names}"
        yield Finding("not settled", wearer, subject=subject, numbers={"times": times}, words={"reason": reason})
    if starts.tilted:
        names = _names(sensors, starts.tilted)
        reason = f"with the placed mounting of {names}, either side up, their bones would not be upright on average"
        words = {"declared": "the placement", "reason": reason}
        yield Finding("placement contradicted", wearer, subject=names, words=words)


def _names(sensors: tuple[str, ...], numbers: tuple[int, ...]) -> str:
    return "all sensors" if len(numbers) == len(sensors) else ", ".join(sensors[s] for s in numbers)
