"""A scene and its estimate made ready to draw: one world, one clock, and a colour for each wearer."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.errors import InputError
from vip_factors.estimate import Estimate, WearerEstimate
from vip_factors.evaluate.comparison import Comparison, SceneComparison, compare_motion, compare_scene
from vip_factors.geometry.poses import Alignment
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.camera import CameraModel, CameraPath, VideoClock, move_motion, move_path
from vip_factors.sensors.detections import Detections, keypoints_in_image, reprojection_error
from vip_factors.sensors.recording import Recording, Truth
from vip_factors.sensors.scene import Scene, Video
from vip_factors.viz.compare import Compare, check_frames, moved, onto_truth, set_apart

NOBODY = -1


@dataclass(frozen=True)
class DrawnWearer:
    """One wearer.

    Attributes:
        name: of the subject.
        index: in the scene, which gives the colour.
        motion: the estimate, turned and shifted with its whole scene onto the truth where that is known.
        truth: at the estimate's frames if there is one, or None.
        comparison: of the two as they are; None without both.
        rest: how the wearer of a bare recording is drawn: standing still.
    """

    name: str
    index: int
    motion: Motion | None
    truth: Motion | None
    recording: Recording | None
    estimate: WearerEstimate | None
    comparison: Comparison | None = None
    rest: Motion | None = None

    @property
    def shown(self) -> Motion | None:
        """The body to draw: estimated, else true."""
        return self.motion if self.motion is not None else self.truth

    @property
    def error_mm(self) -> Array | None:
        """Joint error per frame ``(T,)``, or None."""
        return self.comparison.error_mm if self.comparison is not None else None


@dataclass(frozen=True)
class DrawnCamera:
    """A camera beside the first one, which stands still; whose its detections were taken for is not known."""

    name: str
    model: CameraModel
    path: CameraPath
    detections: Detections

    def reprojected(self, wearer: DrawnWearer) -> Array | None:
        """Keypoints ``(F, K, 2)`` of a wearer in every video frame, or None without a motion."""
        if wearer.shown is None:
            return None
        return keypoints_in_image(wearer.shown, self.detections.keypoints, self.path, self.model, self.detections.time)


@dataclass(frozen=True)
class DrawnScene:
    """Everything in one world, on the recording's clock.

    Attributes:
        path: of the camera as estimated, else the true one.
        true_path: beside an estimated one.
        labels: ``(N,)`` wearer of each detection, −1 for nobody.
        further: cameras beside the first.
        compare: how an estimate of one wearer was brought beside the truth; None for scenes.
        apart: whether the wearers were moved apart, because their places beside each other are unknown.
    """

    name: str
    wearers: tuple[DrawnWearer, ...]
    model: CameraModel | None = None
    path: CameraPath | None = None
    true_path: CameraPath | None = None
    detections: Detections | None = None
    labels: np.ndarray | None = None
    video: Video | None = None
    estimate: Estimate | None = None
    further: tuple[DrawnCamera, ...] = ()
    apart: bool = False
    compare: Compare | None = None

    @property
    def one_alone(self) -> bool:
        """Whether it is one wearer without a camera: limbs are coloured by side, and single sensors are plotted."""
        return len(self.wearers) == 1 and self.model is None and self.path is None

    def reprojected(self, wearer: DrawnWearer) -> Array | None:
        """Keypoints ``(F, K, 2)`` of a wearer in every video frame, or None without camera or motion."""
        if wearer.shown is None or self.path is None or self.model is None or self.detections is None:
            return None
        return keypoints_in_image(wearer.shown, self.detections.keypoints, self.path, self.model, self.detections.time)

    def reprojection_px(self, wearer: DrawnWearer) -> Array | None:
        """Root mean square distance ``(F,)`` in pixels, in every video frame, of the detection given to a wearer from
        its body; NaN in frames without. None without camera or motion, or where it was given none.
        """
        if wearer.shown is None or self.path is None or self.model is None or self.detections is None:
            return None
        assert self.labels is not None
        chosen = np.flatnonzero(self.labels == wearer.index)
        off = reprojection_error(wearer.shown, self.path, self.model, self.detections, chosen)
        some = np.isfinite(off).any(axis=1)
        if not np.any(some):
            return None
        rms = np.full(len(self.detections.time), np.nan)
        rms[self.detections.frame[chosen[some]]] = np.sqrt(np.nanmean(off[some] ** 2, axis=1))
        return rms


def drawn_wearer(
    recording: Recording | None, estimate: WearerEstimate | None, truth: Motion | None = None,
    compare: Compare = Compare.ROOT,
) -> DrawnScene:  # fmt: skip
    """One wearer without a camera as a scene.

    Args:
        recording: its truth is used if ``truth`` is None; without any motion the wearer stands in the T-pose.
        estimate: brought beside the truth.
        truth: of the wearer.
        compare: where the estimate is drawn beside the truth.

    Raises:
        InputError: if none is given, the estimate has no frames, or estimate and truth have no time in common.
    """
    known = Truth(truth) if truth is not None else recording.truth if recording is not None else None
    comparison = None
    if estimate is not None and known is not None and len(known.motion):
        comparison = compare_motion(estimate.motion, known)
    wearer = _wearer(0, recording, estimate, comparison, known)
    if wearer.motion is not None and wearer.truth is not None:
        wearer = replace(wearer, motion=onto_truth(wearer.motion, wearer.truth, compare))
    elif wearer.shown is None:
        if recording is None:
            raise InputError("nothing to show: expected a recording, an estimate or a motion")
        wearer = replace(wearer, rest=_resting(recording))
    shown = wearer.shown or wearer.rest
    assert shown is not None
    wearer = replace(wearer, name=(recording.subject.name if recording is not None else shown.name) or "wearer")
    name = estimate.name if estimate is not None else recording.name if recording is not None else shown.name
    return DrawnScene(name, (wearer,), compare=compare)


def _resting(recording: Recording) -> Motion:
    """The wearer standing in the T-pose on the floor, facing x: all that a bare recording says about the body."""
    skeleton = recording.subject.body()
    R = np.tile(np.eye(3), (1, len(JOINT_NAMES), 1, 1))
    R[0, 0] = [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]  # body y up, z forward
    height = -float(skeleton.p_pelvis_joint[:, 1].min()) + 0.02
    return Motion(skeleton, R, np.array([[0.0, 0.0, height]]), 1.0, recording.interval[0], recording.name)


def drawn_scene(scene: Scene | None, estimate: Estimate | None) -> DrawnScene:
    """Bring both into one world.

    The truth's world is used where it is known: an estimate with a camera is turned and shifted as a whole, one
    without (which does not tie its wearers to each other) wearer by wearer.

    Raises:
        InputError: if neither is given, they do not hold the same number of wearers, or an estimate has no frames.
    """
    if scene is None and estimate is None:
        raise InputError("nothing to show: expected a scene, its estimate, or both")
    comparison = compare_scene(estimate, _drawable(scene)) if scene is not None and estimate is not None else None
    wearers = _wearers_of(scene, estimate, comparison)
    true_path = scene.truth.camera if scene is not None and scene.truth is not None else None
    if true_path is None and scene is not None and scene.camera is not None:
        true_path = scene.camera.known_path
    camera_estimate = estimate.camera if estimate is not None else None
    path = camera_estimate.path if camera_estimate is not None else None
    gauge = comparison.gauge if comparison is not None else None
    if gauge is not None and path is not None:
        wearers = [_moved(wearer, gauge) for wearer in wearers]
        path = move_path(path, gauge)
    elif comparison is not None:
        wearers = [_moved(wearer, comparison.gauges.get(wearer.index)) for wearer in wearers]
    apart = camera_estimate is None and _unknown_places(wearers)
    if apart:
        wearers = _apart(wearers)
    camera = scene.camera if scene is not None else None
    name = estimate.name if estimate is not None else scene.name if scene is not None else ""
    clock = (
        camera_estimate.clock if camera_estimate is not None else camera.clock if camera is not None else VideoClock()
    )
    return DrawnScene(
        name,
        tuple(wearers),
        camera_estimate.model if camera_estimate is not None else camera.model if camera is not None else None,
        path if path is not None else true_path,
        true_path if path is not None else None,
        camera.detections.timed(clock) if camera is not None else None,
        _labels(scene, estimate),
        camera.video if camera is not None else None,
        estimate,
        _further(scene),
        apart,
    )


def _further(scene: Scene | None) -> tuple[DrawnCamera, ...]:
    """Where they really are if that is known, for then the estimate is brought there; else where they are said to."""
    if scene is None:
        return ()
    known = [camera.known_path for camera in scene.further_cameras]
    paths = known if scene.truth is None else [truth.camera for truth in scene.truth.further]
    return tuple(
        DrawnCamera(one.name, one.model, path, one.timed_detections)
        for one, path in zip(scene.further_cameras, paths, strict=True)
        if path is not None
    )


def _drawable(scene: Scene) -> Scene:
    """The scene without truths that have no frames, as those of a file that was cut off."""
    wearers = [
        replace(wearer, truth=None) if wearer.truth is not None and not len(wearer.truth.motion) else wearer
        for wearer in scene.wearers
    ]
    return replace(scene, wearers=tuple(wearers))


def _wearers_of(
    scene: Scene | None, estimate: Estimate | None, comparison: SceneComparison | None
) -> list[DrawnWearer]:
    recordings = scene.wearers if scene is not None else [None] * len(estimate.wearers if estimate is not None else ())
    estimates = estimate.wearers if estimate is not None else [None] * len(recordings)
    return [
        _wearer(
            index,
            recording,
            wearer,
            comparison.wearers.get(index) if comparison is not None else None,
            recording.truth if recording is not None else None,
        )
        for index, (recording, wearer) in enumerate(zip(recordings, estimates, strict=True))
    ]


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
        return DrawnWearer(name, index, *comparison.pair, recording, estimate, comparison=comparison)
    motion = check_frames(estimate.motion) if estimate is not None else None
    true_motion = truth.motion if truth is not None and len(truth.motion) else None
    return DrawnWearer(name, index, motion, true_motion, recording, estimate)


def _moved(wearer: DrawnWearer, gauge: Alignment | None) -> DrawnWearer:
    if gauge is None or wearer.motion is None:
        return wearer
    return replace(wearer, motion=move_motion(wearer.motion, gauge))


def _unknown_places(wearers: Sequence[DrawnWearer]) -> bool:
    """Whether several are estimated without a truth; without a camera too, nothing ties them to each other."""
    estimated = [one for one in wearers if one.motion is not None]
    return len(estimated) > 1 and all(one.truth is None for one in estimated)


def _apart(wearers: Sequence[DrawnWearer]) -> list[DrawnWearer]:
    motions = [one.motion for one in wearers if one.motion is not None]
    shifts = iter(set_apart(motions))
    return [one if one.motion is None else replace(one, motion=moved(one.motion, next(shifts))) for one in wearers]


def _labels(scene: Scene | None, estimate: Estimate | None) -> np.ndarray | None:
    """The estimate's labels; without an estimate the true ones."""
    if scene is None or scene.camera is None:
        return None
    count = len(scene.camera.detections)
    if estimate is not None and len(estimate.wearer_of_detection) == count:
        return estimate.wearer_of_detection
    if estimate is None and scene.truth is not None:
        return scene.truth.wearer
    return np.full(count, NOBODY)
