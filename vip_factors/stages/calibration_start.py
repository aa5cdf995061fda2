"""Which start of headings and mountings a recording asks for: the search of ``initialise`` over a brisk stretch."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from vip_factors.body.pose_prior import load_joint_limits, load_pose_prior
from vip_factors.body.skeleton import PARENTS, Skeleton, held_pose, joint_index
from vip_factors.estimate import StartChoice
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array, angle_between
from vip_factors.initialise.calibration import InitialCalibration, initial_calibration, orientation_at_start
from vip_factors.initialise.sensor_tree import sensor_tree
from vip_factors.initialise.start_candidates import BONE_SIGMA, START_RATE
from vip_factors.initialise.start_search import SensorPrior, Starts, StartSearch
from vip_factors.sensors.frames import ImuFrames, resample_streams
from vip_factors.sensors.recording import Recording
from vip_factors.settings import CommonSettings
from vip_factors.stages.inertial_model import gauge_sensor

UPRIGHT = tuple(
    joint_index(name)
    for name in (
        "pelvis", "spine1", "spine2", "spine3", "neck", "head", "left_hip", "right_hip", "left_knee", "right_knee"
    )
)  # fmt: skip
BRISK = 0.5  # of the briskest stretch: the first one like that is near the start, and headings have not drifted


def search_start(
    recording: Recording, frames: ImuFrames, usual: InitialCalibration, settings: CommonSettings,
    stretch: ImuFrames | None = None,
) -> Starts | None:  # fmt: skip
    """The likeliest start; None where there is nothing to choose from, one sensor say.

    Where no pose is declared but nobody moves at first, that the wearer stands upright there with hanging arms is
    tried too. The ``stretch`` that is looked at is :func:`brisk_stretch`, unless it is given.
    """
    if len(frames.sensors) < 2:
        return None
    stretch = brisk_stretch(recording, frames, settings) if stretch is None else stretch
    search = start_search(recording, stretch, settings, not settings.calibration.estimate_mountings)
    declared = settings.factors.initial_pose
    R_inertial_sensor = orientation_at_start(frames, declared.seconds)
    if recording.initial_pose != "none" or search.known_mountings or not _still(frames, declared.seconds):
        return search.best(usual, R_inertial_sensor)
    bones = [recording.placement.site(name).bone_index for name in frames.sensors]
    standing = initial_calibration(
        frames, recording.placement, recording.subject.body(), held_pose("n-pose", declared.nominal), declared.seconds,
        gauge_sensor(bones),
    )  # fmt: skip
    as_standing = search.best(standing, R_inertial_sensor).best.calibration
    return search.best(usual, R_inertial_sensor, (as_standing,))


def start_search(
    recording: Recording, stretch: ImuFrames, settings: CommonSettings, known_mountings: bool
) -> StartSearch:  # fmt: skip
    """The search over the frames of a stretch, evenly spaced, of a recording's placed sensors."""
    sites = [recording.placement.site(name) for name in stretch.sensors]
    bones, body = [site.bone_index for site in sites], recording.subject.body()
    links = sensor_tree(
        bones, np.stack([site.p_bone_sensor for site in sites]), body, load_pose_prior(), load_joint_limits(),
        BONE_SIGMA,
    )  # fmt: skip
    prior = SensorPrior(
        links,
        np.stack([site.R_bone_sensor for site in sites]),
        np.array([site.mounting_sigma for site in sites]),
        np.stack([_along(body, bone) for bone in bones]),
        np.isin(bones, UPRIGHT),
    )
    search, stated = StartSearch(stretch, prior, known_mountings), settings.factors.agreeing_headings.sigma_deg
    return search if stated is None else replace(search, agree_deg=stated)


def _along(body: Skeleton, bone: int) -> Array:
    """Unit vector along a bone, in its axes: trunk and head stand upright, feet and hands follow their last joint."""
    limb = body.limb(bone)
    if limb is None and bone not in UPRIGHT and bone in PARENTS:
        limb = body.p_parent_joint[PARENTS.index(bone)]
    if limb is None or not np.any(limb):
        return np.array([0.0, 1.0, 0.0])
    return np.asarray(limb / np.linalg.norm(limb))


def brisk_stretch(recording: Recording, frames: ImuFrames, settings: CommonSettings) -> ImuFrames:
    """Frames of the first stretch that is half as brisk as the briskest, or of everything that is shorter."""
    seconds, rate = 30.0, START_RATE
    begin, end = float(frames.time[0]), float(frames.time[-1])
    if end - begin > seconds:
        both = frames.orientation_valid[1:] & frames.orientation_valid[:-1]
        turned = angle_between(frames.R_inertial_sensor[:-1], frames.R_inertial_sensor[1:]) * both
        sums = np.concatenate([[0.0], np.cumsum(turned.sum(axis=1))])
        length = round(seconds / frames.step)
        brisk = sums[length:] - sums[:-length]
        begin = float(frames.time[int(np.argmax(brisk >= BRISK * brisk.max()))])
        end = begin + seconds
    count = max(int(np.floor((end - begin) * rate + 1e-6)) + 1, 2)
    return resample_streams([recording.imus[name] for name in frames.sensors], begin + np.arange(count) / rate)


def _still(frames: ImuFrames, seconds: float) -> bool:
    still = np.deg2rad(3.0)  # how far sensors turn while somebody stands: breathing and swaying
    count = max(1, round(seconds / frames.step))
    first = frames.window(slice(0, count))
    turned = angle_between(first.R_inertial_sensor[:1], first.R_inertial_sensor) * first.orientation_valid
    return bool(first.orientation_valid[0].all() and turned.max() < still)


def start_choice(sensors: tuple[str, ...], starts: Starts | None) -> StartChoice | None:
    """What an estimate tells of its start."""
    if starts is None:
        return None
    return StartChoice(starts.best.hypothesis, starts.rival, starts.margin, tuple(sensors[s] for s in starts.doubtful))


def start_findings(wearer: str, sensors: tuple[str, ...], starts: Starts | None) -> Iterator[Finding]:
    """Of a start that the recording does not settle."""
    if starts is None:
        return
    if starts.doubtful:
        names, declared = _names(sensors, starts.doubtful), starts.best.calibration.R_world_bone is not None
        better = "more and brisker motion" if declared else "a T- or N-pose held at the start and declared"
        times = float(np.exp(starts.margin))
        reason = (
            f"the start supposes that {starts.best.hypothesis}, and another, turned by more than 60° (it supposes that "
            f"{starts.rival}), is only {times:.1f} times less likely: {better}, or the straps as they "
            "really sat, would tell"
        )
        subject = f"how {names} sat and which way the inertial frames point"
        yield Finding("not settled", wearer, subject=subject, numbers={"times": times}, words={"reason": reason})
    if starts.tilted:
        names = _names(sensors, starts.tilted)
        reason = f"{names} cannot, whichever side up, for their bones would not be upright on the whole"
        words = {"declared": "the placement", "reason": reason}
        yield Finding("placement contradicted", wearer, subject=names, words=words)


def _names(sensors: tuple[str, ...], numbers: tuple[int, ...]) -> str:
    return "all sensors" if len(numbers) == len(sensors) else ", ".join(sensors[s] for s in numbers)
