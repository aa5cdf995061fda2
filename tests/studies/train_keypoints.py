"""Where a 2D pose detector puts its keypoints, learnt from recordings whose wearers' motion is known."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from tests.studies.study import Study, Tell, group, table
from vip_factors.assembly.objective import SceneObjective
from vip_factors.atomic import atomic_open, check_target
from vip_factors.body.keypoints import OFFSET_KEYPOINTS, KeypointOffsets
from vip_factors.cli.options import Output
from vip_factors.errors import InputError, SolveError
from vip_factors.factor_settings import KeypointOffsetSettings
from vip_factors.geometry.rotations import Array
from vip_factors.initialise.calibration import InitialCalibration
from vip_factors.io.mcap_recording import read_scene
from vip_factors.io.typed_files import toml_text
from vip_factors.problem.scene import KeypointView, keypoint_offset_sigmas
from vip_factors.problem.state import WearerState
from vip_factors.problem.variables import DETECTOR
from vip_factors.sensors.camera import VideoClock
from vip_factors.sensors.frames import resample_streams
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Camera, Scene
from vip_factors.sensors.sources import SceneInMemory
from vip_factors.settings import Settings
from vip_factors.stages.association import CameraPlacement, associate_cameras, associate_cameras_again, usable_cameras
from vip_factors.stages.decode import SharedCovariance
from vip_factors.stages.fusion import FusionSolution, fusion_problem
from vip_factors.stages.fusion_start import start_fusion
from vip_factors.stages.inertial import InertialSolution, at_frames
from vip_factors.stages.inertial_model import inertial_model
from vip_factors.stages.solver import Solver
from vip_factors.stages.windows import plan_scene

# m. Thrice the usual: of a camera whose place is not known it holds what all keypoints have in common.
WIDE = KeypointOffsetSettings(sigma=0.03, elbow_wrist_sigma=0.03, hip_sigma=0.06)
ROUNDS = 3  # of camera and offsets, each with the scatter that the last one found
LEAST_FRAMES = 30  # of 15 Hz
# OKS sigmas that detections may scatter about the true body; careless detectors do so by one.
WIDEST_SCATTER = 3.0


# Of the usual sigmas, as a prior over how people scatter: their worth in people, and the share of the variance that is
# the detector's habit, which all people have in common.
PRIOR_PEOPLE, HABIT_SHARE = 4.0, 0.5
LEAST_SIGMA_M = 0.003  # truths are no better: markers on the skin, joints by regression


@dataclass(frozen=True)
class PersonOffsets:
    """Offsets before one filmed person, with their sigmas, of a named keypoint set."""

    keypoints: str
    wearer: str
    offsets: KeypointOffsets


@dataclass(frozen=True)
class PooledOffsets:
    """Offsets to expect before the next person, and the number of people that they were learnt from."""

    keypoints: str
    people: int
    offsets: KeypointOffsets


@dataclass(frozen=True, kw_only=True)
class TrainKeypoints(Study):
    """Learn how far from the joints a 2D pose detector puts hips, knees, shoulders …, from recordings with truth.

    Each recording has a camera's 2D poses and the motion of an optical system that had no part in them. For every
    keypoint set in them the file gets the mean offsets and how far people scatter about them.
    """

    recordings: tyro.conf.Positional[tuple[Path, ...]]
    """Recordings (.mcap) with cameras and truth; two of one person count as two people."""
    out: Annotated[Path, Output(".toml")]
    """File (.toml) to write, for smooth --camera.keypoint-offset.learned; --overwrite replaces it."""

    def rows(self, tell: Tell) -> Iterator[PooledOffsets]:
        check_target(self.out, self.overwrite)
        persons = list[PersonOffsets]()
        for path in self.recordings:
            persons += offsets_in_recording(read_scene(path), Settings(), partial(tell, path.name))
        if not persons:
            raise InputError("no recording named: expected one or more (.mcap) with cameras and truth")
        usual, sets = keypoint_offset_sigmas(KeypointOffsetSettings()), {}
        for name, several in group(persons, lambda person: person.keypoints).items():
            sets[name] = (pooled_offsets([person.offsets for person in several], usual), len(several))
        with atomic_open(self.out, "w", self.overwrite) as file:
            file.write(keypoint_offsets_text(sets, " ".join(path.name for path in self.recordings)))
        yield from (PooledOffsets(name, people, offsets) for name, (offsets, people) in sets.items())

    def tables(self, rows: Sequence[PooledOffsets]) -> Iterator[str]:
        """Offsets in mm, and how far people scatter."""
        for row in rows:
            values = zip(OFFSET_KEYPOINTS, 1e3 * row.offsets.mean, 1e3 * row.offsets.sigma, strict=True)
            lines = [
                [name, *(f"{m:.0f} ± {s:.0f}" for m, s in zip(*gaussian, strict=True))] for name, *gaussian in values
            ]
            yield f"{row.keypoints}: {row.people} {'person' if row.people == 1 else 'people'}"
            yield table(["mm", "left", "up", "forward"], lines)


def keypoint_offsets_text(sets: Mapping[str, tuple[KeypointOffsets, int]], provenance: str) -> str:
    """A file of keypoint offsets (TOML), of offsets and numbers of people by keypoint set; micrometres."""
    lines = [f"provenance = {toml_text(provenance)}"]
    for name, (offsets, people) in sets.items():
        mean, sigma = np.round(offsets.mean, 6) + 0.0, np.round(offsets.sigma, 6)
        lines += ["", f"[{name}]", f"people = {people}", "", f"[{name}.offsets]"]
        lines += [
            f"{keypoint} = {{ mean_m = {toml_text(mean[k])}, sigma_m = {toml_text(sigma[k])} }}"
            for k, keypoint in enumerate(OFFSET_KEYPOINTS)
        ]
    return "\n".join(lines) + "\n"


def pooled_offsets(persons: Sequence[KeypointOffsets], usual: Array) -> KeypointOffsets:
    """Offsets to expect of a detector before the next person; ``usual`` sigmas are ``(K, 3)``, m.

    Every keypoint by itself: the spread of people, alike in all axes for few tell little, is the mean of what is usual
    and of what was estimated, the noise of each taken off; the habit's mean is weighted by that spread, and drawn to
    zero by its share of the usual.
    """
    habit, people = HABIT_SHARE * usual**2, (1 - HABIT_SHARE) * usual**2
    mean, noise = np.stack([one.mean for one in persons]), np.stack([one.sigma**2 for one in persons])
    # Who was seen too vaguely to say how people scatter counts less. About its own mean a sum of squares is smaller.
    sure = (people / (people + noise)) ** 2
    own = sure / np.sum(sure, axis=0)
    squares = np.sum(sure * (mean - np.sum(own * mean, axis=0)) ** 2, axis=0)
    of_noise = np.sum(sure * (1 - own) * noise, axis=0)
    count = np.sum(sure * (1 - own), axis=0)
    seen, count = (one.mean(axis=1, keepdims=True) for one in (squares - of_noise, count))
    spread = (PRIOR_PEOPLE * people + seen) / (PRIOR_PEOPLE + count)
    spread = np.maximum(spread, LEAST_SIGMA_M**2)
    weight = 1 / (spread + noise)
    information = np.sum(weight, axis=0) + 1 / habit
    sigma = np.sqrt(spread + 1 / information)
    return KeypointOffsets(np.sum(weight * mean, axis=0) / information, sigma)


def offsets_in_recording(scene: Scene, settings: Settings, on_progress: Callable[[float], None]) -> list[PersonOffsets]:
    """The offsets of a scene's detector, from each wearer whose motion is known, by itself.

    The body and its motion are the truth's. Cameras whose path the truth has or whose pose is known are believed, and
    have to be in the truth's world; else the first camera's path is found with the offsets.

    Raises:
        InputError: if the scene has no camera, nobody's truth, or nobody of those was seen.
    """
    if scene.camera is None:
        raise InputError(f"scene '{scene.name}' has no camera: expected one with 2D poses (vip-factors convert)")
    true = [one for one in scene.wearers if one.truth is not None]
    if not true:
        raise InputError(
            f"scene '{scene.name}': nobody's true motion is known: expected a recording with the truth of an optical "
            "system, which no camera of the scene had a part in"
        )
    cameras = _believed(scene)
    found = []
    for number, one in enumerate(true):
        alone = Scene(scene.name, (one,), cameras)

        def on_wearer_progress(done: float, number: int = number) -> None:
            on_progress((number + done) / len(true))

        offsets = _offsets_before(alone, _for_training(settings), on_wearer_progress)
        if offsets is not None:
            found.append(PersonOffsets(cameras[0].detections.keypoints.name, one.subject.name, offsets))
    if not found:
        raise InputError(
            f"scene '{scene.name}': nobody was found in the video: expected the 2D poses of a wearer whose true motion "
            "is known"
        )
    return found


def _believed(scene: Scene) -> tuple[Camera, ...]:
    """The cameras, at the truth's poses where it has them."""
    return tuple(
        camera if (truth := camera.truth) is None else replace(camera, known_path=truth.path, clock=truth.clock)
        for camera in scene.cameras
    )


def _for_training(settings: Settings) -> Settings:
    """Nothing but reprojections, and offsets that may be anywhere."""
    camera = settings.camera
    camera = replace(camera, keypoint_offset=WIDE, ground_contact=replace(camera.ground_contact, use=False))
    calibration = replace(settings.calibration, estimate_keypoints=True, heading_drift_from_s=None)
    return replace(settings, camera=camera, calibration=calibration)


def _offsets_before(scene: Scene, settings: Settings, on_progress: Callable[[float], None]) -> KeypointOffsets | None:
    """Of the only wearer; None if no camera saw them."""
    (recording,) = scene.wearers
    solver = Solver(settings.solve, lambda stage, done: None)
    true = _true(recording, _frames_with_truth(scene, recording, settings), settings)
    motion = true.motion
    associated = usable_cameras(associate_cameras(scene, [true], settings, lambda done: on_progress(0.5 * done)))
    if not associated:
        return None
    initial = start_fusion(associated, [true], settings)
    initial = replace(initial, wearers=(true,), state=replace(initial.state, wearers=(true.state,)))
    paths, solution = [each.camera.known_path for each in associated], None
    placements = [CameraPlacement(path, each.camera.model, VideoClock())
                  for path, each in zip(paths, associated, strict=True) if path is not None]  # fmt: skip
    for done in range(ROUNDS):
        if len(placements) == len(associated):
            associated = associate_cameras_again(associated, placements, [motion], settings, lambda done: None)
        if not any(np.any(one.association.wearer == 0) for one in associated):
            return None
        start = _of_joints(fusion_problem(initial, solution, associated, settings))
        state = solver.solve(SceneObjective(start.model, wearers_move=False), start.state, "keypoint offsets")
        solution = replace(start, state=state)
        placements = list(solution.placements)
        on_progress(0.5 + 0.5 * (done + 1) / ROUNDS)
    assert solution is not None
    scattered = max(one[0] for one in solution.measured_spreads())
    if scattered > WIDEST_SCATTER:
        raise InputError(
            f"scene '{scene.name}': the 2D poses of '{recording.subject.name}' lie {scattered:.1f} OKS sigmas beside "
            "the true body: expected truth and cameras in the same world and on the same clock"
        )
    return _decoded(solution)


def _frames_with_truth(scene: Scene, recording: Recording, settings: Settings) -> Array:
    assert recording.truth is not None
    plan, known = plan_scene(SceneInMemory(scene), settings, single_window=True), recording.truth.motion.time
    frames = plan.all_coarse_time
    frames = frames[(frames >= known[0]) & (frames <= known[-1])]
    if len(frames) < LEAST_FRAMES:
        raise InputError(
            f"scene '{scene.name}': the true motion of '{recording.subject.name}' covers {len(frames)} frames: "
            f"expected {LEAST_FRAMES} or more"
        )
    return frames


def _true(recording: Recording, time: Array, settings: Settings) -> InertialSolution:
    """The wearer as they truly are: body and motion; what sensors have to say does not matter."""
    assert recording.truth is not None
    motion = recording.truth.motion
    recording = replace(recording, subject=replace(recording.subject, skeleton=motion.skeleton), initial_pose="none")
    frames = resample_streams([recording.imus[name] for name in recording.placed], time)
    count = len(frames.sensors)
    nothing = InitialCalibration(np.zeros(count), np.ones(count), np.tile(np.eye(3), (count, 1, 1)))
    state = WearerState(
        motion.R_parent_child, motion.p_world_pelvis, nothing.headings, nothing.R_bone_sensor, np.zeros(3 * 23)
    )
    return InertialSolution(inertial_model(recording, frames, nothing, settings), at_frames(state, motion.time, time))


def _of_joints(solution: FusionSolution) -> FusionSolution:
    """The same without the keypoints that have no offset: faces and toes are no surer of their places than the others.

    They would draw a camera whose pose is free to where the table has them.
    """

    def with_offsets_only(view: KeypointView) -> KeypointView:
        return replace(view, seen=view.seen & (view.offsets[0] >= 0))

    model = solution.model
    views = tuple(tuple(map(with_offsets_only, of_camera)) for of_camera in model.views)
    return replace(solution, model=replace(model, views=views))


def _decoded(solution: FusionSolution) -> KeypointOffsets:
    objective = SceneObjective(solution.model, wearers_move=False)
    try:
        shared = objective.linearise(solution.state).static_covariance()
    except SolveError as error:
        raise InputError(f"the offsets are not determined ({error}): expected a longer recording") from error
    covariance = SharedCovariance(objective.layout, shared).of(DETECTOR, "keypoint_offsets")
    assert covariance is not None
    return KeypointOffsets(solution.state.detector.keypoint_offsets, np.sqrt(np.diag(covariance)).reshape(-1, 3))
