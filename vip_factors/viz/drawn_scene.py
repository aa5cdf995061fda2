"""A scene and its estimate made ready to draw: one world, one clock, and an index that gives each wearer's colour."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import JOINT_NAMES, joint_index
from vip_factors.errors import InputError
from vip_factors.estimate import Estimate, WearerEstimate, camera_pairs
from vip_factors.evaluate.comparison import Comparison, compare_motion, compare_scene
from vip_factors.geometry.poses import Alignment, align_yaw
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.camera import CameraModel, CameraPath, move_motion, move_path
from vip_factors.sensors.detections import Detections, keypoints_in_image, reprojection_error
from vip_factors.sensors.recording import Recording, Truth
from vip_factors.sensors.scene import Scene, Video

NOBODY = -1
# At rest the body's z (forward) is turned onto the world's x: the yaw of a standing body facing x is that of this.
R_WORLD_STANDING = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
APART_M = 1.4  # between pelvises at least: arms held out may touch, bodies do not
APART = "The wearers are set apart: without a camera, where they stood beside each other is unknown."


@dataclass(frozen=True)
class DrawnWearer:
    """One wearer.

    Attributes:
        name: of the subject.
        index: in the scene, which gives the colour.
        motion: the estimate, turned and shifted with its whole scene onto the truth where that is known.
        truth: at the estimate's frames if there is one, or None.
        error_mm: joint error per frame ``(T,)`` of the two as they are; None without both.
        rest: how the wearer of a bare recording is drawn: standing still.
    """

    name: str
    index: int
    motion: Motion | None
    truth: Motion | None
    recording: Recording | None
    estimate: WearerEstimate | None
    error_mm: Array | None = None
    rest: Motion | None = None

    @property
    def shown(self) -> Motion | None:
        """The body to draw: estimated, else true."""
        return self.motion if self.motion is not None else self.truth


@dataclass(frozen=True)
class DrawnCamera:
    """A camera and what it saw.

    Attributes:
        path: as estimated, else the true one; None if it is not known.
        true_path: beside an estimated one.
        detections: on the recording's clock; None of an estimate without its recording.
        labels: ``(N,)`` wearer of each detection, −1 for nobody.
    """

    name: str
    model: CameraModel
    path: CameraPath | None
    true_path: CameraPath | None = None
    detections: Detections | None = None
    labels: np.ndarray | None = None
    video: Video | None = None

    def reprojected(self, wearer: DrawnWearer) -> Array | None:
        """Keypoints ``(F, K, 2)`` of a wearer in every video frame, or None without path or motion."""
        if wearer.shown is None or self.path is None or self.detections is None:
            return None
        return keypoints_in_image(wearer.shown, self.detections.keypoints, self.path, self.model, self.detections.time)

    def reprojection_px(self, wearer: DrawnWearer) -> Array | None:
        """Root mean square distance ``(F,)`` in pixels, in every video frame, of the detection given to a wearer from
        its body; NaN in frames without. None without path or motion, or where it was given none.
        """
        if wearer.shown is None or self.path is None or self.detections is None or self.labels is None:
            return None
        chosen = np.flatnonzero(self.labels == wearer.index)
        error = reprojection_error(wearer.shown, self.path, self.model, self.detections, chosen)
        is_seen = np.isfinite(error).any(axis=1)
        if not np.any(is_seen):
            return None
        rms = np.full(len(self.detections.time), np.nan)
        rms[self.detections.frame[chosen[is_seen]]] = np.sqrt(np.nanmean(error[is_seen] ** 2, axis=1))
        return rms


@dataclass(frozen=True)
class DrawnScene:
    """Everything in one world, on the recording's clock.

    Attributes:
        estimate: None if there is none, or of one wearer alone.
        apart: whether the wearers were moved apart, because their places beside each other are unknown.
    """

    name: str
    wearers: tuple[DrawnWearer, ...]
    cameras: tuple[DrawnCamera, ...] = ()
    estimate: Estimate | None = None
    apart: bool = False

    @property
    def one_alone(self) -> bool:
        """Whether it is one wearer without a camera: limbs are coloured by side, and single sensors are plotted."""
        return len(self.wearers) == 1 and not self.cameras

    @property
    def names(self) -> list[str]:
        """Of the wearers."""
        return [wearer.name for wearer in self.wearers]

    def films(self) -> list[tuple[DrawnCamera, Detections, np.ndarray]]:
        """Cameras with the detections in their videos and the labels of these.

        Raises:
            InputError: if there are none.
        """
        films = [
            (camera, camera.detections, camera.labels)
            for camera in self.cameras
            if camera.detections is not None and camera.labels is not None
        ]
        if not films:
            raise InputError(f"scene '{self.name}' has no camera: give the filmed recording beside its estimate")
        for camera, detections, _ in films:
            if not len(detections.time):
                raise InputError(
                    f"scene '{self.name}': camera '{camera.name}' has no video frames to draw: was its file cut off?"
                )
        return films


def drawn_wearer(
    recording: Recording | None,
    estimate: WearerEstimate | None,
    truth: Motion | None = None,
) -> DrawnScene:
    """One wearer without a camera as a scene.

    Args:
        recording: its truth is used if ``truth`` is None; without any motion the wearer stands in the T-pose.
        estimate: turned about the vertical once, and drawn on the true root path: only the pose differs.
        truth: of the wearer.

    Raises:
        InputError: if none is given, the estimate has no frames, or estimate and truth have no time in common.
    """
    known_truth = Truth(truth) if truth is not None else recording.truth if recording is not None else None
    comparison = None
    if estimate is not None and known_truth is not None and len(known_truth.motion):
        comparison = compare_motion(estimate.motion, known_truth)
    wearer = _wearer(0, recording, estimate, comparison, known_truth)
    if wearer.motion is not None and wearer.truth is not None:
        wearer = replace(wearer, motion=onto_truth(wearer.motion, wearer.truth))
    elif wearer.shown is None:
        if recording is None:
            raise InputError("nothing to show: expected a recording, an estimate or a motion")
        # The T-pose on the floor, facing x: all that a bare recording says about the body.
        skeleton, R = recording.subject.body(), np.tile(np.eye(3), (1, len(JOINT_NAMES), 1, 1))
        R[0, 0] = R_WORLD_STANDING
        p_world_pelvis = np.array([[0.0, 0.0, 0.02 - float(skeleton.p_pelvis_joint[:, 1].min())]])
        rest = Motion(skeleton, R, p_world_pelvis, 1.0, recording.interval[0], recording.name)
        wearer = replace(wearer, rest=rest)
    shown = wearer.shown or wearer.rest
    assert shown is not None
    if recording is None:
        wearer = replace(wearer, name=shown.name or "wearer")
    name = estimate.name if estimate is not None else recording.name if recording is not None else shown.name
    return DrawnScene(name, (wearer,))


def drawn_scene(scene: Scene | None, estimate: Estimate | None) -> DrawnScene:
    """Bring both into one world.

    The truth's world is used where it is known: an estimate with a camera is turned and shifted as a whole, one
    without (which does not tie its wearers to each other) wearer by wearer.

    Raises:
        InputError: if neither is given, they do not hold the same number of wearers, or an estimate has no frames.
    """
    if scene is None and estimate is None:
        raise InputError("nothing to show: expected a scene, its estimate, or both")
    comparison = compare_scene(estimate, scene) if scene is not None and estimate is not None else None
    recordings = scene.wearers if scene is not None else [None] * len(estimate.wearers if estimate is not None else ())
    estimates = estimate.wearers if estimate is not None else [None] * len(recordings)
    wearers = []
    for index, (recording, wearer_estimate) in enumerate(zip(recordings, estimates, strict=True)):
        compared = comparison.wearers.get(index) if comparison is not None else None
        wearer = _wearer(index, recording, wearer_estimate, compared, recording.truth if recording else None)
        gauge = (comparison.gauge or comparison.gauges.get(index)) if comparison is not None else None
        if gauge is not None and wearer.motion is not None:
            wearer = replace(wearer, motion=move_motion(wearer.motion, gauge))
        wearers.append(wearer)
    motions = [wearer.motion for wearer in wearers if wearer.motion is not None]
    is_placed = any(wearer.motion is not None and wearer.truth is not None for wearer in wearers)
    has_separate_worlds = len(motions) > 1 and not is_placed and (estimate is None or not estimate.cameras)
    if has_separate_worlds:
        wearers = [
            replace(wearer, motion=replace(motion, p_world_pelvis=motion.p_world_pelvis + shift))
            for wearer, motion, shift in zip(wearers, motions, set_apart(motions), strict=True)
        ]
    name = estimate.name if estimate is not None else scene.name if scene is not None else ""
    cameras = _cameras(scene, estimate, comparison.gauge if comparison is not None else None)
    return DrawnScene(name, tuple(wearers), cameras, estimate, has_separate_worlds)


def _cameras(scene: Scene | None, estimate: Estimate | None, gauge: Alignment | None) -> tuple[DrawnCamera, ...]:
    """As estimated, in the true world if there is one, beside the true paths; models and clocks are the estimate's too.

    What was not estimated is drawn where it really is or is said to be.
    """
    if scene is None:
        return tuple(
            DrawnCamera(camera.name, camera.model, camera.path) for camera in (estimate.cameras if estimate else ())
        )
    pairs = () if estimate is None else camera_pairs(scene, estimate)
    drawn = list[DrawnCamera]()
    for camera in scene.cameras:
        camera_estimate = next((estimated for camera_of_scene, estimated in pairs if camera_of_scene is camera), None)
        path = None if camera_estimate is None else camera_estimate.path
        path = path if path is None or gauge is None else move_path(path, gauge)
        true_path = camera.known_path if camera.truth is None else camera.truth.path
        labels = np.full(len(camera.detections), NOBODY)
        if estimate is None and camera.truth is not None:
            labels = camera.truth.wearer
        elif camera_estimate is not None and len(camera_estimate.wearer_of_detection) == len(labels):
            labels = camera_estimate.wearer_of_detection
        if path is None:
            path, true_path = true_path, None
        lens = camera_estimate or camera
        detections = camera.detections.timed(lens.clock)
        drawn.append(DrawnCamera(camera.name, lens.model, path, true_path, detections, labels, camera.video))
    return tuple(drawn)


def _wearer(
    index: int,
    recording: Recording | None,
    estimate: WearerEstimate | None,
    comparison: Comparison | None,
    truth: Truth | None,
) -> DrawnWearer:
    """The estimate and the truth at common frames, or the one that there is."""
    name = recording.subject.name if recording is not None else f"wearer {index + 1}"
    if comparison is not None:
        return DrawnWearer(name, index, *comparison.pair, recording, estimate, comparison.error_mm)
    motion = check_frames(estimate.motion) if estimate is not None else None
    true_motion = truth.motion if truth is not None and len(truth.motion) else None
    return DrawnWearer(name, index, motion, true_motion, recording, estimate)


def check_frames(motion: Motion) -> Motion:
    """The estimated motion.

    Raises:
        InputError: if it has no frames.
    """
    if not len(motion):
        raise InputError(f"the estimate of '{motion.name}' has no frames to draw: was its file cut off?")
    return motion


def onto_truth(estimate: Motion, truth: Motion) -> Motion:
    """The estimate turned about the vertical once, and its pelvis on the true path (both at the same frames)."""
    points = (motion.state.p_world_joint for motion in (estimate, truth))
    gauge = align_yaw(*((p - p[:, :1]).reshape(-1, 3) for p in points))
    return replace(move_motion(estimate, gauge), p_world_pelvis=truth.p_world_pelvis)


def floor_height(motion: Motion) -> float:
    """Height in metres of the floor: where the lower foot usually is, less the ball's height above its sole."""
    feet = motion.state.p_world_joint[:, [joint_index("left_foot"), joint_index("right_foot")], 2]
    # The median of the lower foot: a jump or a single bad frame must not move the floor.
    return float(np.median(feet.min(axis=1))) - 0.012 * 1.72


def set_apart(motions: Sequence[Motion]) -> list[Array]:
    """How far ``(3,)`` metres to move each motion so that at no moment two pelvises are too near each other.

    All start from the first one's place, along the world's y, and stand on its floor.
    """
    shifts: list[Array] = []
    paths: list[tuple[Array, Array]] = []
    step_m = 0.2  # by which a wearer is moved on until nobody is in the way
    for motion in motions:
        shift = motions[0].p_world_pelvis[0] - motion.p_world_pelvis[0]
        shift[1] += APART_M * len(shifts)
        shift[2] = floor_height(motions[0]) - floor_height(motion)
        while any(_nearest(motion.time, motion.p_world_pelvis + shift, *path) < APART_M - 1e-9 for path in paths):
            shift = shift + np.array([0.0, step_m, 0.0])
        shifts.append(shift)
        paths.append((motion.time, motion.p_world_pelvis + shift))
    return shifts


def _nearest(time: Array, path: Array, other_time: Array, other_path: Array) -> float:
    """Least horizontal distance in metres of two paths at the same times."""
    coordinates = [np.interp(time, other_time, other_path[:, axis]) for axis in range(2)]
    return float(np.hypot(path[:, 0] - coordinates[0], path[:, 1] - coordinates[1]).min())
