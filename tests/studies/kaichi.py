"""Table 1 and figure 4b of Kaichi et al. 2020 on simulated scenes: their estimator beside the live tracker.

The scenes are like theirs: one standing camera of known pose over a floor at z = 0, 8 to 13 IMUs.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.ndimage import binary_dilation, gaussian_filter1d

from tests.studies.live_run import live_settings, run_live
from tests.studies.scenes import (
    SETTLED_S,
    ClipStudy,
    as_calibration,
    mean_angle,
    middle_of,
    nominal_start,
    posed_scene,
    straps_and_sensors,
    true_calibration,
    true_motion,
    turned,
    without_camera,
)
from tests.studies.study import NAN, Fixed, Tell, bullets, group, mean, table
from vip_factors.body.kinematics import Motion
from vip_factors.cli.options import read_settings
from vip_factors.errors import InputError, RecordingError, SolveError
from vip_factors.evaluate.metrics import GLOBAL_JOINTS, common_frames, global_position_error, indices, orientation_error
from vip_factors.findings import sentences
from vip_factors.geometry.poses import Alignment
from vip_factors.geometry.rotations import rotation_z, transpose, wrap_angle, yaw_of
from vip_factors.pipeline import smooth
from vip_factors.sensors.camera import move_motion
from vip_factors.sensors.recording import Truth
from vip_factors.sensors.scene import Scene
from vip_factors.settings import LiveSettings, Settings
from vip_factors.simulate.settings import SceneSettings, SimulateSettings
from vip_factors.simulate.staging import floor_height

JUMPING = 0.03  # share of frames off the ground from which on a clip is one of those that the paper leaves out
VIDEO_RATE = 60.0  # Hz, TotalCapture's
JUMP_M = 0.12  # soles that high are off the ground: the clips' own floors float by up to 8 cm
LEFT_GROUND_S = 0.1  # before and after, for take-off and landing
SMOOTH_S = 0.05  # of the correction: what is left are 1–2 cm, as of soles and carpets
_ARMS, _THIGHS = ("left_upper_arm", "right_upper_arm"), ("left_thigh", "right_thigh")
# By how many IMUs are left: those of the paper's section 4.4 that are not.
REMOVED: dict[int, tuple[str, ...]] = {13: (), 12: ("head",), 10: ("head", *_ARMS), 8: ("head", *_ARMS, *_THIGHS)}


class Form(StrEnum):
    """The paper's four estimators, by what they use."""

    IMU = "IMU only"
    NO_CONTACT = "no contact"
    UNWEIGHTED = "w_p = 1"
    FULL = "full"


class Way(StrEnum):
    """Whose terms, and how they are solved."""

    THEIRS = "theirs, per frame"
    NEWEST = "ours, zero lag"
    SMOOTHED = "ours, full lag"


THEIR_SETTINGS = Path(__file__).parents[2] / "docs" / "kaichi.toml"
PUBLISHED_CM = {Form.IMU: 70.6, Form.NO_CONTACT: 70.0, Form.UNWEIGHTED: 15.8, Form.FULL: 13.5}  # table 1, mean


@dataclass(frozen=True)
class KaichiTrial:
    """One estimator on one recording; NaN where there is no estimate.

    Attributes:
        clip, seed, imus, form, way: which.
        error_cm: mean over 16 joints, nothing aligned; for the IMUs alone the first frame's root and yaw are.
        error_deg: of the same joints' world orientations.
        off_ground: share of frames with both feet off the ground.
        failure: why there is no estimate.
    """

    clip: str
    seed: int
    imus: int
    form: Form
    way: Way
    error_cm: float = NAN
    error_deg: float = NAN
    off_ground: float = NAN
    findings: tuple[str, ...] = ()
    failure: str = ""


Estimates = tuple[dict[Way, Motion], tuple[str, ...]]


@dataclass(frozen=True, kw_only=True)
class Kaichi(ClipStudy):
    """Table 1 and figure 4b of Kaichi et al. 2020 on simulated scenes: their estimator beside ours."""

    imus: tuple[int, ...] = (13, 12, 10, 8)
    """Numbers of IMUs: all, without that on the head, without upper arms, without thighs."""
    forms: tuple[Literal["imu", "no-contact", "unweighted", "full"], ...] = ("imu", "no-contact", "unweighted", "full")
    """What is used: IMUs alone, a camera without ground contact, without adaptive weights, everything."""
    # The orientation error of their IMUs alone, 8.75 deg, lies between those of a walk and of an acting clip.
    pose_error_deg: float = 1.5
    settings: Fixed[LiveSettings] = field(default_factory=LiveSettings)  # of ours
    sensors: Fixed[SimulateSettings] = field(default_factory=straps_and_sensors)

    def rows(self, tell: Tell) -> Iterator[KaichiTrial]:
        work, forms = self.chosen(), [Form[name.upper().replace("-", "_")] for name in self.forms]
        for done, clip in enumerate(work):
            scene = self.scene(clip.motion(), clip.name, clip.seed)
            for count, form in ((count, form) for count in self.imus for form in forms):
                tell(f"{clip.name}, {count} IMUs, {form}", done / len(work))
                worn = with_sensors(scene, count)
                for ways, solve in (
                    ((Way.THEIRS,), partial(_theirs, worn, form)),
                    ((Way.NEWEST, Way.SMOOTHED), partial(_ours, worn, form, self.settings)),
                ):
                    blanks = [KaichiTrial(clip.name, clip.repetition, count, form, way) for way in ways]
                    yield from _estimated(blanks, worn, solve)

    def scene(self, motion: Motion, name: str, seed: int) -> Scene:
        """On a level floor, before a standing camera whose pose is known as a board on the floor tells it."""
        settings = SceneSettings(camera="fixed", known_camera_pose=True, video_rate=VIDEO_RATE, imu=self.sensors)
        return posed_scene(grounded(middle_of(motion, self.seconds, name)), name, settings, self.pose_error_deg, seed)

    def tables(self, rows: Sequence[KaichiTrial]) -> Iterator[str]:
        """Errors per clip with all IMUs, then errors with fewer IMUs."""
        most = max(row.imus for row in rows)
        jumps = {row.clip for row in rows if row.off_ground >= JUMPING}
        clips = list(dict.fromkeys(row.clip for row in rows))
        yield (
            f"Global error in cm over 16 joints, nothing aligned (IMU only: the first frame's root and yaw), of {most} "
            f"IMUs and a standing camera of known pose; {self.seconds:g} s after a T-pose. The mean leaves jumps out; "
            "published: TotalCapture, other motions"
        )
        names = [f"{clip} (jumps)" if clip in jumps else clip for clip in clips]
        estimators = group(sorted(rows, key=lambda one: list(Way).index(one.way)), lambda one: (one.form, one.way))
        lines = list[list[object]]()
        for (form, way), every in estimators.items():
            own = [one for one in every if one.imus == most]
            cells = [mean(one.error_cm for one in own if one.clip == clip) for clip in clips]
            average = mean(one.error_cm for one in own if one.clip not in jumps)
            lines.append([form, way, *cells, average, f"{PUBLISHED_CM[form]:g}" if way is Way.THEIRS else None])
        yield table(["estimator", "", *names, "mean", "published"], lines)
        yield "By the number of IMUs: cm / degrees"
        counts = list(dict.fromkeys(row.imus for row in rows))
        lines = []
        for key, every in estimators.items():
            several = [[one for one in every if one.imus == count and one.clip not in jumps] for count in counts]
            pairs = [(mean(t.error_cm for t in own), mean(t.error_deg for t in own)) for own in several]
            lines.append([*key, *pairs])
        yield table(["estimator", "", *(f"{count} IMUs" for count in counts)], lines)
        failures = (f"{t.clip}, {t.imus} IMUs, {t.form}, {t.way}: {t.failure}" for t in rows if t.failure)
        yield bullets("No estimate, and left out of the means:", failures)


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
    """The scene with their calibration (its eq. 1): mountings off the T-pose, as held, under true headings.

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


def our_settings(form: Form, settings: LiveSettings) -> LiveSettings:
    """Ours in a form of the paper's.

    Contact: feet that stand still do so on the floor, and where their pixels' rays meet it. Adaptive weights: sigmas
    of detections follow the residuals, and the biweight.
    """
    factors, camera = settings.factors, settings.camera
    contact, adaptive = form in (Form.UNWEIGHTED, Form.FULL), form is not Form.UNWEIGHTED
    if form is not Form.IMU:
        foot, floor = replace(factors.foot_contact, use=contact), replace(factors.floor_contact, use=contact)
        factors = replace(factors, foot_contact=foot, floor_contact=floor)
    biweight = replace(camera.reprojection.biweight, use=adaptive and camera.reprojection.biweight.use)
    reprojection = replace(camera.reprojection, adaptive=adaptive, biweight=biweight)
    camera = replace(camera, reprojection=reprojection, ground_contact=replace(camera.ground_contact, use=contact))
    fusion = replace(settings.fusion, use_camera=form is not Form.IMU, contacts_with_standing_camera=contact)
    return replace(settings, factors=factors, fusion=fusion, camera=camera)


def their_settings(form: Form) -> Settings:
    """Theirs in a form of the paper's."""
    settings = read_settings(THEIR_SETTINGS, Settings())
    reprojection, contact = settings.camera.reprojection, settings.camera.ground_contact
    if form is Form.UNWEIGHTED:
        reprojection = replace(reprojection, biweight=replace(reprojection.biweight, use=False))
    if form is Form.NO_CONTACT:
        contact = replace(contact, use=False)
    camera = replace(settings.camera, reprojection=reprojection, ground_contact=contact)
    return replace(settings, camera=camera, fusion=replace(settings.fusion, use_camera=form is not Form.IMU))


def _theirs(scene: Scene, form: Form) -> Estimates:
    settings = their_settings(form)
    settings = replace(settings, calibration=replace(settings.calibration, from_truth=True))
    told = told_headings(scene, settings)
    estimate = smooth(without_camera(told) if form is Form.IMU else told, settings)
    return {Way.THEIRS: estimate.wearers[0].motion}, sentences(estimate.findings)


def _ours(scene: Scene, form: Form, settings: LiveSettings) -> Estimates:
    own = live_settings(our_settings(form, settings))
    run = run_live(without_camera(scene) if form is Form.IMU else scene, own)
    return {Way.NEWEST: run.newest, Way.SMOOTHED: run.smoothed}, run.findings


def _estimated(blanks: list[KaichiTrial], scene: Scene, solve: Callable[[], Estimates]) -> list[KaichiTrial]:
    try:
        motions, findings = solve()
        return [replace(measured(blank, motions[blank.way], scene), findings=findings) for blank in blanks]
    except (InputError, RecordingError, SolveError) as error:  # their cost diverges at times, and says so
        return [replace(blank, failure=f"{type(error).__name__}: {error}") for blank in blanks]


def measured(trial: KaichiTrial, motion: Motion, scene: Scene) -> KaichiTrial:
    """The trial with its errors from the end of the T-pose on."""
    truth = true_motion(scene.wearers[0])
    if not np.all(np.isfinite(motion.p_world_pelvis)):
        raise InputError(f"estimate of '{scene.name}' is not finite: the solve diverged")
    if trial.form is Form.IMU:  # moved and turned so that the first frame has the true root and yaw
        first, true, _ = common_frames(motion.frames(slice(0, 1)), truth)
        R = rotation_z(yaw_of(true.R_parent_child[0, 0] @ transpose(first.R_parent_child[0, 0])))
        shift = true.p_world_pelvis[0] - R @ first.p_world_pelvis[0]
        motion = move_motion(motion, Alignment(R, shift, np.ones(())))
    late = int(np.count_nonzero(motion.time < SETTLED_S - 1e-6))
    if late >= len(motion):
        raise InputError(f"estimate of '{scene.name}' ends before {SETTLED_S:g} s, from when on it is measured")
    estimate, reference, _ = common_frames(motion.frames(slice(late, None)), truth)
    turn = orientation_error(estimate, reference)[:, indices(GLOBAL_JOINTS)].mean()
    return replace(
        trial, error_cm=global_position_error(estimate, reference), error_deg=float(np.rad2deg(turn)),
        off_ground=share_off_ground(reference),
    )  # fmt: skip
