"""Several people, some with sensors, doing what nothing was trained on: who is who, and where they are to one another.

Who is who among bystanders as in the thesis, 4.4.3; places as errors of the vector between two pelves.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter

import numpy as np

from tests.studies.pose_prior_training import held_out_names
from tests.studies.scenes import (
    BLEND_S,
    HOLD_S,
    PLACEMENT,
    POSE,
    begun_late,
    drawn_scene,
    find_clips,
    slowed,
    straps_and_sensors,
)
from tests.studies.study import NAN, Fixed, Study, Tell, bullets, group, mean, table
from vip_factors.associate.associate import associate
from vip_factors.body.kinematics import Motion
from vip_factors.cli.options import Flag
from vip_factors.errors import InputError, RecordingError, SolveError
from vip_factors.evaluate.evaluation import evaluate_scene
from vip_factors.evaluate.scene_metrics import AssociationScore, association_score
from vip_factors.findings import sentences
from vip_factors.io.motions import read_motion
from vip_factors.pipeline import smooth
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.frames import resample_streams
from vip_factors.sensors.scene import Scene
from vip_factors.sensors.sources import SceneInMemory
from vip_factors.settings import Settings
from vip_factors.simulate.scene import Performer, simulate_scene
from vip_factors.simulate.scene_settings import CameraKind, SceneSettings
from vip_factors.simulate.staging import staged, with_initial_pose
from vip_factors.stages.association import gravity_in_camera
from vip_factors.stages.decode import motion_of
from vip_factors.stages.inertial import inertial_tracker
from vip_factors.stages.solver import Solver
from vip_factors.stages.windows import scene_plan

ASSOCIATION_3DPW = (99.3, 92.2)  # thesis, 4.4.3: precision and recall in percent
DRAWS = 10  # of people: clips have single faults that no sensor could measure
SHORTEST_S = 2.0  # of a clip that is to be repeated
PASSING = 0.5  # share of bystanders who come and go
POSE_ERROR_DEG = 4.0  # of the held T-pose, as in the suite of single wearers
FRAMES = 3000  # for which the time is told
METRICS = (
    "mpjpe", "mpjae", "heading_error", "mounting_error", "camera_translation", "camera_rotation",
    "association_precision", "association_recall",
)  # fmt: skip
PAIRS = ("relative_mm", "relative_95th_mm", "distance_mm", "distance_95th_mm")


@dataclass(frozen=True, kw_only=True)
class Crowd(Study):
    """Options of studies of several people."""

    motions: Path
    """Folder of the CMU motions as BVH, searched with all folders below it."""
    seconds: float = 8.0
    """Of each scene, after a T-pose of 2 s."""
    seeds: int = 3
    """Scenes with each camera, each with other motions."""
    wearers: int = 2
    """People with sensors."""
    bystanders: int = 0
    """People without; half of them come and go."""
    settings: Fixed[Settings] = field(default_factory=Settings)
    placement: Fixed[str] = PLACEMENT

    def held_out_motions(self) -> dict[str, Motion]:
        """The clips held out of all training, at 60 Hz or a little more."""
        motions = {name: slowed(read_motion(file)) for name, file in find_clips(self.motions, held_out_names()).items()}
        return {name: motion for name, motion in motions.items() if len(motion) / motion.rate >= SHORTEST_S}

    def scene(self, clips: Mapping[str, Motion], camera: CameraKind, seed: int) -> Scene:
        """Wearers who hold a T-pose and then do what random clips show, among bystanders, some of whom come and go."""
        random = np.random.default_rng([seed, 0xC40D])
        return drawn_scene(lambda: self._draw(clips, camera, seed, random), DRAWS)

    def _draw(self, clips: Mapping[str, Motion], camera: CameraKind, seed: int, random: np.random.Generator) -> Scene:
        people, moving = self.wearers + self.bystanders, []
        for number, name in enumerate(random.choice(sorted(clips), people, replace=len(clips) < people)):
            if number < self.wearers:
                motion, pose_seed = begun_late(clips[name], self.seconds, random), seed + 1009 * number
                moving.append(with_initial_pose(motion, POSE, HOLD_S, BLEND_S, POSE_ERROR_DEG, pose_seed))
            else:
                motion = begun_late(clips[name], self.seconds + HOLD_S, random)
                moving.append(_passing(motion, random) if random.random() < PASSING else motion)
        performers = [
            Performer(f"wearer{number + 1}", motion, preset(self.placement, motion.skeleton), POSE)
            if number < self.wearers
            else Performer(f"bystander{number + 1 - self.wearers}", motion)
            for number, motion in enumerate(staged(moving, seed))
        ]
        settings = SceneSettings(camera=camera, keypoints="openpose18", fov_deg=60.0, imu=straps_and_sensors())
        return simulate_scene(performers, settings, seed, f"crowd{seed}")


def _passing(motion: Motion, random: np.random.Generator) -> Motion:
    """There for a half of the time or more, from the beginning or to the end or neither."""
    first, last = random.uniform(0, 0.4), random.uniform(0.6, 1.0)
    part = motion.frames(slice(int(first * len(motion)), int(last * len(motion))))
    return replace(part, name=motion.name)


@dataclass(frozen=True)
class AssociationTrial:
    """The labels of one scene.

    Attributes:
        seed, camera: which.
        frames, detections: of the video.
        after: ``"inertial tracker"``, or ``"fusion"``: the labels that the whole pipeline ends with.
        visible: share of video frames in which a wearer, on average, is detected.
        score: the labels against the truth.
        tracker_seconds, seconds: of the inertial tracker, and of the association (of all stages after fusion).
    """

    seed: int
    camera: str
    frames: int
    detections: int
    after: str
    visible: float
    score: AssociationScore
    tracker_seconds: float
    seconds: float


@dataclass(frozen=True, kw_only=True)
class WhoIsWho(Crowd):
    """Who is who: two wearers among bystanders, labelled from what their IMUs alone say."""

    seconds: float = 98.0
    """Of each scene, after a T-pose of 2 s: with the default, 3,000 frames at 30 Hz."""
    bystanders: int = 4
    """People without sensors; half of them come and go."""
    camera: CameraKind = "hand-held"
    """What films."""
    whole: Flag = False
    """Also run the pipeline to its end, which labels again with what it knows by then: camera and headings."""

    def rows(self, tell: Tell) -> Iterator[AssociationTrial]:
        clips = self.held_out_motions()
        for seed in range(self.seeds):
            tell("who is who", seed / self.seeds)
            scene = self.scene(clips, self.camera, seed)
            yield first_association(scene, self.settings, seed, self.camera)
            if self.whole:
                begin = perf_counter()
                labels = smooth(scene, self.settings).wearer_of_detection
                yield _labelled(scene, labels, "fusion", seed, self.camera, NAN, perf_counter() - begin)

    def tables(self, rows: Sequence[AssociationTrial]) -> Iterator[str]:
        yield f"{self.wearers} wearers among {self.bystanders} bystanders, {self.camera} camera"
        head = ["after", "seed", "frames", "detections", "wearers visible %", "precision %", "recall %", "swapped",
                "strangers", "missed", "tracker s", "s", f"s for {FRAMES} frames"]  # fmt: skip
        lines: list[list[object]] = []
        for after, own in group(rows, lambda one: one.after).items():
            for one in own:
                score, rates = one.score, (f"{100 * rate:.2f}" for rate in (one.score.precision, one.score.recall))
                lines.append([after, one.seed, one.frames, one.detections, f"{100 * one.visible:.0f}", *rates,
                              score.swapped, score.strangers, score.missed, one.tracker_seconds, one.seconds,
                              one.seconds * FRAMES / one.frames])  # fmt: skip
            lines.append([f"**{after}, all**", *[""] * 4, *(f"**{one:.2f}**" for one in pooled(own)), *[""] * 6])
        yield table(head, [*lines, ["thesis, 3DPW", *[""] * 4, *ASSOCIATION_3DPW, *[""] * 6]])


def first_association(scene: Scene, settings: Settings, seed: int = 0, camera: str = "") -> AssociationTrial:
    """The association as the pipeline begins with it: of what IMUs alone say."""
    if scene.camera is None or scene.truth is None:
        raise InputError(f"scene '{scene.name}' lacks a camera or its truth: expected a simulated one")
    begin = perf_counter()
    solver = Solver(settings.solve, lambda stage, fraction: None)
    time = scene_plan(SceneInMemory(scene), settings, whole=True).all_coarse_time
    motions = []
    for wearer in scene.wearers:
        streams = resample_streams([wearer.imus[name] for name in wearer.placed], time)
        tracked = inertial_tracker(wearer, streams, settings, solver)
        motions.append(motion_of(tracked.model, tracked.state))
    tracked_at = perf_counter()
    detections = scene.camera.timed_detections
    gravity = gravity_in_camera(scene.camera, detections.time)
    found = associate(detections, scene.camera.model, motions, settings.association, gravity_camera=gravity)
    seconds = perf_counter() - tracked_at
    return _labelled(scene, found.wearer, "inertial tracker", seed, camera, tracked_at - begin, seconds)


def _labelled(
    scene: Scene, labels: np.ndarray, after: str, seed: int, camera: str, tracker_seconds: float, seconds: float
) -> AssociationTrial:
    assert scene.camera is not None
    assert scene.truth is not None
    detections, truth = scene.camera.detections, scene.truth.wearer
    frames = len(detections.time)
    if not len(labels):  # nobody was found: everybody is left out
        labels = np.full(len(truth), -1)
    seen = [len(np.unique(detections.frame[truth == w])) / frames for w in range(len(scene.wearers))]
    return AssociationTrial(
        seed, camera, frames, len(truth), after, float(np.mean(seen)), association_score(labels, truth),
        tracker_seconds, seconds,
    )  # fmt: skip


def pooled(trials: Sequence[AssociationTrial]) -> tuple[float, float]:
    """Precision and recall in percent over all labels of all scenes."""
    correct, given, true = (sum(getattr(one.score, name) for one in trials) for name in ("correct", "given", "true"))
    return (100 * correct / given if given else NAN), (100 * correct / true if true else NAN)


@dataclass(frozen=True)
class WearersTrial:
    """One scene: the scene's metrics, and of every pair of wearers the error of the vector between them."""

    camera: str
    seed: int
    metrics: Mapping[str, float]
    pairs: Mapping[str, Mapping[str, float]]
    seconds: float
    findings: tuple[str, ...] = ()
    failure: str = ""

    @property
    def values(self) -> list[float]:
        """Means over pairs, metrics of the scene, time."""
        pairs = [mean(row[name] for row in self.pairs.values()) for name in PAIRS]
        return [*pairs, *(self.metrics.get(name, NAN) for name in METRICS), self.seconds]


@dataclass(frozen=True, kw_only=True)
class Wearers(Crowd):
    """Several wearers in one scene: the error of their places relative to one another."""

    cameras: tuple[CameraKind, ...] = ("fixed", "hand-held")
    """What films."""

    def rows(self, tell: Tell) -> Iterator[WearersTrial]:
        clips = self.held_out_motions()
        work = [(camera, seed) for seed in range(self.seeds) for camera in self.cameras]
        for done, (camera, seed) in enumerate(work):
            tell("wearers", done / len(work))
            yield wearers_trial(self.scene(clips, camera, seed), self.settings, camera, seed)

    def tables(self, rows: Sequence[WearersTrial]) -> Iterator[str]:
        yield (
            f"{self.wearers} wearers, {self.bystanders} bystanders, {self.seconds:g} s; relative: of the vector "
            "between two pelves, after the scene's common yaw; distance: of its length, which no gauge touches"
        )
        lines: list[list[object]] = []
        for camera, own in group(rows, lambda one: one.camera).items():
            lines += [[f"{camera}, seed {one.seed}", *_two(one.values)] for one in own]
            if solved := [one.values for one in own if one.pairs]:
                lines.append([f"**{camera}, mean**", *_two(np.mean(solved, axis=0))])
        yield table(["camera", *PAIRS, *METRICS, "seconds"], lines)
        where = [(f"{one.camera}, seed {one.seed}", one) for one in rows]
        yield bullets("", (f"{name}: not solved: {one.failure}" for name, one in where if one.failure))
        yield bullets("", (f"{name}: {finding}" for name, one in where for finding in one.findings))


def wearers_trial(scene: Scene, settings: Settings, camera: str = "", seed: int = 0) -> WearersTrial:
    """One scene, reconstructed and measured."""
    begin = perf_counter()
    try:
        estimate = smooth(scene, settings)
    except (SolveError, RecordingError) as error:
        return WearersTrial(camera, seed, {}, {}, perf_counter() - begin, failure=str(error))
    seconds, evaluation = perf_counter() - begin, evaluate_scene(estimate, scene)
    metrics = {name: evaluation.metrics[name].value for name in METRICS if name in evaluation.metrics}
    pairs = {name: dict(row) for name, row in evaluation.pairs.items()}
    return WearersTrial(camera, seed, metrics, pairs, seconds, sentences(estimate.findings))


def _two(values: Sequence[float] | np.ndarray) -> list[str]:
    return [f"{value:.2f}" if np.isfinite(value) else "n/a" for value in values]
