"""Table 1 and figure 4b of Kaichi et al. 2020 on simulated scenes: their estimators beside the live tracker."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import partial
from pathlib import Path
from time import process_time

import numpy as np

from tests.studies.kaichi_suite import (
    REMOVED,
    SETTLED_S,
    KaichiScenes,
    kaichi_scene,
    share_off_ground,
    told_headings,
    told_straps,
    with_sensors,
    without_camera,
)
from tests.studies.live_run import live_settings, run_live
from tests.studies.sip import find_clips
from tests.studies.vip_suite import seed_of
from vip_factors.body.held_out_clips import HELD_OUT_CLIPS, held_out_names
from vip_factors.body.motion import Motion
from vip_factors.configurations import Configuration, named_settings
from vip_factors.errors import InputError, RecordingError, SolveError
from vip_factors.evaluate.frames import common_frames
from vip_factors.evaluate.joints import GLOBAL_JOINTS, indices
from vip_factors.evaluate.metrics import CM, global_position_error, mpjpe, orientation_error, position_error
from vip_factors.geometry.alignment import Alignment
from vip_factors.geometry.rotations import Array, rotation_z, transpose, yaw_of
from vip_factors.io.motions.files import read_motion
from vip_factors.live.settings import LiveSettings
from vip_factors.pipeline import smooth_scene
from vip_factors.sensors.gauge import move_motion
from vip_factors.sensors.scene import Scene

Tell = Callable[[str, float], None]
NAN = float("nan")


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
class KaichiTrials:
    """What is recorded, and who estimates it."""

    scenes: KaichiScenes = field(default_factory=KaichiScenes)
    imus: tuple[int, ...] = tuple(REMOVED)
    forms: tuple[Form, ...] = tuple(Form)
    ways: tuple[Way, ...] = tuple(Way)
    settings: LiveSettings = field(default_factory=LiveSettings)  # of ours

    def __post_init__(self) -> None:
        unknown = [count for count in self.imus if count not in REMOVED]
        if unknown:
            raise InputError(f"{unknown[0]} IMUs: expected some of {', '.join(map(str, REMOVED))}")


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


def run_kaichi(
    motions: Path, trials: KaichiTrials | None = None, tell: Tell | None = None,
    clips: Mapping[str, Sequence[str]] | None = None, keep: Callable[[tuple[KaichiTrial, ...]], None] | None = None,
) -> tuple[KaichiTrial, ...]:  # fmt: skip
    """Run all estimators on clips.

    Args:
        motions: folder with the motion files of the clips, searched with all folders below it.
        trials: what is recorded, and who estimates it.
        tell: called with what is done and the fraction of it.
        clips: names by kind; those held out of the pose prior's training if absent.
        keep: called with all trials so far after each estimator: runs are long.

    Raises:
        InputError: if a clip has no file in the folder or is too short.
    """
    trials, clips = trials or KaichiTrials(), clips or HELD_OUT_CLIPS
    files = find_clips(motions, [name for names in clips.values() for name in names])
    known = held_out_names()
    listed = [(kind, name) for kind, names in clips.items() for name in names]
    work = [(seed, n, kind, name) for seed in range(trials.scenes.seeds) for n, (kind, name) in enumerate(listed)]
    found: list[KaichiTrial] = []
    for done, (seed, n, kind, name) in enumerate(work):
        number = known.index(name) if name in known else n
        scene = kaichi_scene(read_motion(files[name]), name, trials.scenes, seed_of(number, seed))
        for several in trials_of(scene, kind, seed, trials):
            found += several
            if tell is not None:
                tell(f"{name}, {several[-1].imus} IMUs, {several[-1].form}", done / len(work))
            if keep is not None:
                keep(tuple(found))
    return tuple(found)


def trials_of(scene: Scene, kind: str, seed: int, trials: KaichiTrials) -> Iterator[list[KaichiTrial]]:
    """Every estimator on one scene; zero and full lag together, as they come from one run."""
    for count in trials.imus:
        worn = with_sensors(scene, count)
        for form in trials.forms:
            blank = KaichiTrial(kind, scene.name, seed, count, form, Way.THEIRS)
            if Way.THEIRS in trials.ways:
                yield _estimated([blank], worn, partial(_theirs, worn, form))
            if Way.THEIRS_LIVE in trials.ways:
                one = replace(blank, way=Way.THEIRS_LIVE)
                yield _estimated([one], worn, partial(_theirs_live, worn, form))
            live = [replace(blank, way=way) for way in (Way.NEWEST, Way.SMOOTHED) if way in trials.ways]
            if live:
                yield _estimated(live, worn, partial(_live, worn, form, trials.settings))
            if Way.BATCH in trials.ways:
                one = replace(blank, way=Way.BATCH)
                yield _estimated([one], worn, partial(_batch, worn, form, trials.settings))


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


Estimates = tuple[dict[Way, Motion], tuple[str, ...]]


def _theirs(scene: Scene, form: Form) -> Estimates:
    settings = named_settings(THEIRS[form])
    settings = replace(settings, calibration=replace(settings.calibration, from_truth=True))
    told = told_headings(scene, settings)
    estimate = smooth_scene(without_camera(told) if form is Form.IMU else told, settings)
    return {Way.THEIRS: estimate.wearers[0].motion}, estimate.findings


def _theirs_live(scene: Scene, form: Form) -> Estimates:
    settings = live_settings(named_settings(THEIRS[form]))
    told = told_straps(scene, settings)
    run = run_live(without_camera(told) if form is Form.IMU else told, settings)
    return {Way.THEIRS_LIVE: run.newest}, tuple(f"{time:.1f} s: {finding}" for time, finding in run.findings)


def _live(scene: Scene, form: Form, settings: LiveSettings) -> Estimates:
    own = live_settings(our_settings(form, settings))
    run = run_live(without_camera(scene) if form is Form.IMU else scene, own)
    findings = tuple(f"{time:.1f} s: {finding}" for time, finding in run.findings)
    return {Way.NEWEST: run.newest, Way.SMOOTHED: run.smoothed}, findings


def _batch(scene: Scene, form: Form, settings: LiveSettings) -> Estimates:
    estimate = smooth_scene(without_camera(scene) if form is Form.IMU else scene, our_settings(form, settings))
    return {Way.BATCH: estimate.wearers[0].motion}, estimate.findings


def _estimated(blanks: list[KaichiTrial], scene: Scene, work: Callable[[], Estimates]) -> list[KaichiTrial]:
    begin = process_time()
    try:
        motions, findings = work()
    except (InputError, RecordingError, SolveError) as error:  # their cost diverges at times, and says so
        return [replace(one, failure=f"{type(error).__name__}: {error}") for one in blanks]
    seconds = process_time() - begin
    return [replace(measured(one, motions[one.way], scene), cpu_s=seconds, findings=findings) for one in blanks]


def measured(trial: KaichiTrial, motion: Motion, scene: Scene) -> KaichiTrial:
    """The trial with its errors from the end of the T-pose on.

    Raises:
        InputError: for a scene without the truth, or an estimate that is not finite or too short.
    """
    truth = scene.wearers[0].truth
    if truth is None or scene.truth is None:
        raise InputError(f"scene '{scene.name}' has no truth to measure by: expected a simulated one")
    if not np.all(np.isfinite(motion.p_world_pelvis)):
        raise InputError(f"estimate of '{scene.name}' is not finite: the solve diverged")
    if trial.form is Form.IMU:
        motion = _begun_at(motion, truth.motion)
    late = int(np.count_nonzero(motion.time < SETTLED_S - 1e-6))
    if late >= len(motion):
        raise InputError(f"estimate of '{scene.name}' ends before {SETTLED_S:g} s, from when on it is measured")
    estimate, reference, _ = common_frames(motion.frames(slice(late, None)), truth.motion)
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
