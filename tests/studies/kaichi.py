"""Table 1 and figure 4b of Kaichi et al. 2020 on simulated scenes: their estimators beside the live tracker."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import partial
from time import process_time
from typing import Literal

import numpy as np

from tests.studies.kaichi_scenes import VIDEO_RATE, grounded, share_off_ground, told_headings, told_straps, with_sensors
from tests.studies.live_run import live_settings, run_live
from tests.studies.scenes import (
    SETTLED_S,
    ClipStudy,
    middle_of,
    posed_scene,
    straps_and_sensors,
    true_motion,
    without_camera,
)
from tests.studies.study import NAN, Fixed, Tell, bullets, mean, table
from vip_factors.body.kinematics import Motion
from vip_factors.configurations import Configuration, named_settings
from vip_factors.errors import InputError, RecordingError, SolveError
from vip_factors.evaluate.metrics import (
    CM,
    GLOBAL_JOINTS,
    common_frames,
    global_position_error,
    indices,
    mpjpe,
    orientation_error,
    position_error,
)
from vip_factors.findings import sentences
from vip_factors.geometry.poses import Alignment
from vip_factors.geometry.rotations import Array, rotation_z, transpose, yaw_of
from vip_factors.live.settings import LiveSettings
from vip_factors.pipeline import smooth
from vip_factors.sensors.camera_path import move_motion
from vip_factors.sensors.scene import Scene
from vip_factors.simulate.scene_settings import SceneSettings
from vip_factors.simulate.settings import SimulateSettings

JUMPING = 0.03  # share of frames off the ground from which on a clip is one of those that the paper leaves out


class Form(StrEnum):
    """The paper's four estimators, by what they use."""

    IMU = "IMU only"
    NO_CONTACT = "no contact"
    UNWEIGHTED = "w_p = 1"
    FULL = "full"


class Way(StrEnum):
    """Whose terms, and how they are solved."""

    THEIRS = "theirs, per frame"
    THEIRS_LIVE = "theirs, live"  # in the fixed-lag tracker, zero lag
    NEWEST = "ours, zero lag"
    SMOOTHED = "ours, full lag"
    BATCH = "ours, batch"


THEIRS = {
    Form.IMU: Configuration.KAICHI_IMU,
    Form.NO_CONTACT: Configuration.KAICHI_NO_CONTACT,
    Form.UNWEIGHTED: Configuration.KAICHI_UNWEIGHTED,
    Form.FULL: Configuration.KAICHI_FULL,
}
PUBLISHED_CM = {Form.IMU: 70.6, Form.NO_CONTACT: 70.0, Form.UNWEIGHTED: 15.8, Form.FULL: 13.5}  # table 1, mean
PUBLISHED_DEG = {Form.IMU: 8.75, Form.FULL: 8.83}


@dataclass(frozen=True)
class KaichiTrial:
    """One estimator on one recording; NaN where there is no estimate.

    Attributes:
        kind, clip, seed, imus, form, way: which.
        error_cm: mean over 16 joints, nothing aligned; for the IMUs alone the first frame's root and yaw are.
        error_deg: of the same joints' world orientations.
        mpjpe_mm: every frame aligned, for comparison.
        depth_cm, across_cm, up_cm: mean magnitudes of the root's error along the camera's view on the ground, across
            it, and upwards; ``depth_bias_cm`` is the mean itself, positive: too far off.
        joints_cm: by joint.
        off_ground: share of frames with both feet off the ground.
        cpu_s: of this estimator; newest and smoothed come from one run.
        failure: why there is no estimate.
    """

    kind: str
    clip: str
    seed: int
    imus: int
    form: Form
    way: Way
    error_cm: float = NAN
    error_deg: float = NAN
    mpjpe_mm: float = NAN
    depth_cm: float = NAN
    across_cm: float = NAN
    up_cm: float = NAN
    depth_bias_cm: float = NAN
    joints_cm: Mapping[str, float] = field(default_factory=dict)
    off_ground: float = NAN
    cpu_s: float = NAN
    findings: tuple[str, ...] = ()
    failure: str = ""


Estimates = tuple[dict[Way, Motion], tuple[str, ...]]


@dataclass(frozen=True, kw_only=True)
class Kaichi(ClipStudy):
    """Table 1 and figure 4b of Kaichi et al. 2020 on simulated scenes: their estimators beside ours."""

    imus: tuple[int, ...] = (13, 12, 10, 8)
    """Numbers of IMUs: all, without that on the head, without upper arms, without thighs."""
    forms: tuple[Literal["imu", "no-contact", "unweighted", "full"], ...] = ("imu", "no-contact", "unweighted", "full")
    """What is used: IMUs alone, a camera without ground contact, without adaptive weights, everything."""
    ways: tuple[Literal["theirs", "theirs-live", "newest", "smoothed", "batch"], ...] = (
        "theirs", "theirs-live", "newest", "smoothed", "batch",
    )  # fmt: skip
    """Their estimator frame by frame, and in the live tracker; ours live with zero and full lag, and over whole
    recordings."""
    # The orientation error of their IMUs alone, 8.75 deg, lies between those of a walk and of an acting clip.
    pose_error_deg: float = 1.5
    settings: Fixed[LiveSettings] = field(default_factory=LiveSettings)  # of ours
    sensors: Fixed[SimulateSettings] = field(default_factory=straps_and_sensors)

    def rows(self, tell: Tell) -> Iterator[KaichiTrial]:
        work = self.chosen()
        for done, clip in enumerate(work):
            scene = self.scene(clip.motion(), clip.name, clip.seed)
            for trial in self._trials(scene, clip.kind, clip.repetition):
                tell(f"{clip.name}, {trial.imus} IMUs, {trial.form}", done / len(work))
                yield trial

    def scene(self, motion: Motion, name: str, seed: int) -> Scene:
        """On a level floor, before a standing camera whose pose is known as a board on the floor tells it."""
        settings = SceneSettings(camera="fixed", known_pose=True, video_rate=VIDEO_RATE, imu=self.sensors)
        return posed_scene(grounded(middle_of(motion, self.seconds, name)), name, settings, self.pose_error_deg, seed)

    def _trials(self, scene: Scene, kind: str, seed: int) -> Iterator[KaichiTrial]:
        """Every estimator on one scene; zero and full lag together, as they come from one run."""
        ways = [Way[name.upper().replace("-", "_")] for name in self.ways]
        for count in self.imus:
            worn = with_sensors(scene, count)
            for form in (Form[name.upper().replace("-", "_")] for name in self.forms):
                runs: tuple[tuple[tuple[Way, ...], Callable[[], Estimates]], ...] = (
                    ((Way.THEIRS,), partial(_theirs, worn, form)),
                    ((Way.THEIRS_LIVE,), partial(_theirs_live, worn, form)),
                    ((Way.NEWEST, Way.SMOOTHED), partial(_live, worn, form, self.settings)),
                    ((Way.BATCH,), partial(_batch, worn, form, self.settings)),
                )
                for together, work in runs:
                    blanks = [KaichiTrial(kind, scene.name, seed, count, form, way) for way in together if way in ways]
                    yield from _estimated(blanks, worn, work) if blanks else ()

    def tables(self, rows: Sequence[KaichiTrial]) -> Iterator[str]:
        """Errors per clip with all IMUs, where they lie, then errors with fewer IMUs."""
        most = max(one.imus for one in rows)
        full = {key: own for key, own in _by_estimator(rows, most).items() if own}
        jumps = {one.clip for one in rows if one.off_ground >= JUMPING}
        clips = list(dict.fromkeys(one.clip for one in rows))
        yield (
            f"Global error in cm over 16 joints, nothing aligned (IMU only: the first frame's root and yaw), of {most} "
            f"IMUs and a standing camera of known pose; {self.seconds:g} s after a T-pose. The mean leaves jumps out; "
            "published: TotalCapture, other motions"
        )
        names = [f"{clip} (jumps)" if clip in jumps else clip for clip in clips]
        for value, published in (("error_cm", PUBLISHED_CM), ("error_deg", PUBLISHED_DEG)):
            lines: list[list[object]] = []
            for (form, way), own in full.items():
                cells = [mean(getattr(one, value) for one in own if one.clip == clip) for clip in clips]
                theirs = published.get(form) if way in (Way.THEIRS, Way.THEIRS_LIVE) else None
                average = mean(getattr(one, value) for one in own if one.clip not in jumps)
                lines.append([form, way, *cells, average, None if theirs is None else f"{theirs:g}"])
            yield table(["estimator", "", *names, "mean", "published"], lines)
            yield "Orientation error in degrees of the same joints" if value == "error_cm" else ""
        yield "Errors of the root by direction in cm, and the rest"
        head = ["estimator", "", "depth", "too far", "across", "up", "MPJPE mm", "CPU s"]
        values = ("depth_cm", "depth_bias_cm", "across_cm", "up_cm", "mpjpe_mm", "cpu_s")
        lines = [[*key, *(mean(getattr(one, name) for one in own) for name in values)] for key, own in full.items()]
        yield table(head, lines)
        yield "Errors by joint in cm, both sides"
        joints = list(dict.fromkeys(name.removeprefix("left_").removeprefix("right_") for name in GLOBAL_JOINTS))
        lines = [[*key, *(_of_joint(own, joint) for joint in joints)] for key, own in full.items()]
        yield table(["estimator", "", *joints], lines)
        if len({one.imus for one in rows}) > 1:
            yield "By the number of IMUs: cm / degrees"
            counts = list(dict.fromkeys(one.imus for one in rows))
            lines = []
            for key, every in _by_estimator(rows).items():
                several = [[one for one in every if one.imus == count and one.clip not in jumps] for count in counts]
                pairs = [(mean(t.error_cm for t in own), mean(t.error_deg for t in own)) for own in several]
                lines.append([*key, *pairs])
            yield table(["estimator", "", *(f"{count} IMUs" for count in counts)], lines)
        failures = (f"{t.clip}, {t.imus} IMUs, {t.form}, {t.way}: {t.failure}" for t in rows if t.failure)
        yield bullets("No estimate, and left out of the means:", failures)


def _by_estimator(rows: Sequence[KaichiTrial], imus: int | None = None) -> dict[tuple[Form, Way], list[KaichiTrial]]:
    """Trials by form and way, in the order of the paper's table."""
    keys = [(form, way) for way in Way for form in Form]
    found = {key: [one for one in rows if (one.form, one.way) == key and imus in (None, one.imus)] for key in keys}
    return {key: own for key, own in found.items() if own}


def _of_joint(own: Sequence[KaichiTrial], joint: str) -> float:
    return mean(value for one in own for name, value in one.joints_cm.items() if name.endswith(joint))


def our_settings(form: Form, settings: LiveSettings) -> LiveSettings:
    """Ours in a form of the paper's.

    Contact: feet that stand still do so on the floor, and where their pixels' rays meet it. Adaptive weights: sigmas
    of detections follow the residuals, and the biweight.
    """
    factors, camera = settings.factors, settings.camera
    contact, adaptive = form in (Form.UNWEIGHTED, Form.FULL), form is not Form.UNWEIGHTED
    if form is not Form.IMU:
        factors = replace(
            factors,
            foot_contact=replace(factors.foot_contact, use=contact),
            floor_contact=replace(factors.floor_contact, use=contact),
        )
    biweight = replace(camera.reprojection.biweight, use=adaptive and camera.reprojection.biweight.use)
    reprojection = replace(camera.reprojection, adaptive=adaptive, biweight=biweight)
    ground = replace(camera.ground_contact, use=contact)
    fusion = replace(settings.fusion, use_camera=form is not Form.IMU, contacts_with_standing_camera=contact)
    return replace(
        settings,
        factors=factors,
        fusion=fusion,
        camera=replace(camera, reprojection=reprojection, ground_contact=ground),
    )


def _theirs(scene: Scene, form: Form) -> Estimates:
    settings = named_settings(THEIRS[form])
    settings = replace(settings, calibration=replace(settings.calibration, from_truth=True))
    told = told_headings(scene, settings)
    estimate = smooth(without_camera(told) if form is Form.IMU else told, settings)
    return {Way.THEIRS: estimate.wearers[0].motion}, sentences(estimate.findings)


def _theirs_live(scene: Scene, form: Form) -> Estimates:
    settings = live_settings(named_settings(THEIRS[form]))
    told = told_straps(scene, settings)
    run = run_live(without_camera(told) if form is Form.IMU else told, settings)
    return {Way.THEIRS_LIVE: run.newest}, run.findings


def _live(scene: Scene, form: Form, settings: LiveSettings) -> Estimates:
    own = live_settings(our_settings(form, settings))
    run = run_live(without_camera(scene) if form is Form.IMU else scene, own)
    return {Way.NEWEST: run.newest, Way.SMOOTHED: run.smoothed}, run.findings


def _batch(scene: Scene, form: Form, settings: LiveSettings) -> Estimates:
    estimate = smooth(without_camera(scene) if form is Form.IMU else scene, our_settings(form, settings))
    return {Way.BATCH: estimate.wearers[0].motion}, sentences(estimate.findings)


def _estimated(blanks: list[KaichiTrial], scene: Scene, work: Callable[[], Estimates]) -> list[KaichiTrial]:
    begin = process_time()
    try:
        motions, findings = work()
    except (InputError, RecordingError, SolveError) as error:  # their cost diverges at times, and says so
        return [replace(one, failure=f"{type(error).__name__}: {error}") for one in blanks]
    seconds = process_time() - begin
    return [replace(measured(one, motions[one.way], scene), cpu_s=seconds, findings=findings) for one in blanks]


def measured(trial: KaichiTrial, motion: Motion, scene: Scene) -> KaichiTrial:
    """The trial with its errors from the end of the T-pose on."""
    truth = true_motion(scene.wearers[0])
    assert scene.truth is not None
    if not np.all(np.isfinite(motion.p_world_pelvis)):
        raise InputError(f"estimate of '{scene.name}' is not finite: the solve diverged")
    if trial.form is Form.IMU:
        motion = _begun_at(motion, truth)
    late = int(np.count_nonzero(motion.time < SETTLED_S - 1e-6))
    if late >= len(motion):
        raise InputError(f"estimate of '{scene.name}' ends before {SETTLED_S:g} s, from when on it is measured")
    estimate, reference, _ = common_frames(motion.frames(slice(late, None)), truth)
    joints = indices(GLOBAL_JOINTS)
    by_joint = CM * position_error(estimate, reference)[:, joints].mean(axis=0)
    split = _split(estimate, reference, scene.truth.camera.p_world_camera[0])
    size = CM * np.abs(split).mean(axis=0)
    return replace(
        trial,
        error_cm=global_position_error(estimate, reference),
        error_deg=float(np.rad2deg(orientation_error(estimate, reference)[:, joints].mean())),
        mpjpe_mm=mpjpe(estimate, reference),
        depth_cm=float(size[0]),
        across_cm=float(size[1]),
        up_cm=float(size[2]),
        depth_bias_cm=float(CM * split[:, 0].mean()),
        joints_cm=dict(zip(GLOBAL_JOINTS, by_joint.tolist(), strict=True)),
        off_ground=share_off_ground(reference),
    )


def _begun_at(motion: Motion, truth: Motion) -> Motion:
    """The motion moved and turned so that its first frame has the true root and yaw."""
    first, true, _ = common_frames(motion.frames(slice(0, 1)), truth)
    R = rotation_z(yaw_of(true.R_parent_child[0, 0] @ transpose(first.R_parent_child[0, 0])))
    return move_motion(motion, Alignment(R, true.p_world_pelvis[0] - R @ first.p_world_pelvis[0], np.ones(())))


def _split(estimate: Motion, truth: Motion, p_world_camera: Array) -> Array:
    """Errors of the root ``(T, 3)`` in metres: away from the camera on the ground, to the side, and up."""
    error = estimate.p_world_pelvis - truth.p_world_pelvis
    away = (truth.p_world_pelvis - p_world_camera)[:, :2]
    away = away / np.linalg.norm(away, axis=1, keepdims=True)
    side = np.stack([-away[:, 1], away[:, 0]], axis=1)
    return np.stack([np.sum(error[:, :2] * away, axis=1), np.sum(error[:, :2] * side, axis=1), error[:, 2]], axis=1)
