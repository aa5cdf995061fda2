"""An estimate beside the truth, made once for figures and for drawings: one clock, what is known, and the gauge."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.errors import InputError
from vip_factors.estimate import CameraEstimate, Estimate, camera_pairs
from vip_factors.evaluate.calibration import common_instants
from vip_factors.evaluate.metrics import (
    EVERYTHING,
    LEAST_JOINTS,
    MM,
    POSITION_JOINTS,
    Compared,
    align_frames,
    common_frames,
    position_error,
)
from vip_factors.geometry.poses import Alignment
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.camera import CameraModel, MotionPair, PathPair, scene_gauge
from vip_factors.sensors.recording import Truth
from vip_factors.sensors.scene import CameraTruth, Scene


@dataclass(frozen=True)
class Comparison:
    """One wearer's estimate beside the truth, each in its own world and with its own skeleton.

    Attributes:
        motion, truth: at the same frames.
        frames: those of the whole estimate.
        compared: the joints of which the truth knows anything.
    """

    motion: Motion
    truth: Motion
    frames: slice
    compared: Compared = EVERYTHING

    @property
    def pair(self) -> MotionPair:
        """The estimate and the truth."""
        return self.motion, self.truth

    @property
    def error_mm(self) -> Array:
        """Position error ``(T,)`` of the 14 joints by frame, whose mean is MPJPE; NaN if the truth knows too few."""
        joints = self.compared.positions(POSITION_JOINTS)
        if len(joints) < LEAST_JOINTS:
            return np.full(len(self.truth), np.nan)
        alignment = align_frames(self.motion, self.truth, compared=self.compared)
        return MM * position_error(self.motion, self.truth, alignment)[:, joints].mean(axis=1)


def compare_motion(motion: Motion, truth: Truth) -> Comparison:
    """The estimated motion beside the truth.

    Raises:
        InputError: if they share no frame, or one has none.
    """
    return Comparison(*common_frames(motion, truth.motion), Compared(truth.known_bones))


@dataclass(frozen=True)
class CameraComparison:
    """A camera's estimate beside its truth.

    Attributes:
        estimate, truth: of all frames.
        model: true intrinsics, else those of a calibration; None if the lens is unknown.
        pair: the estimated and the true path at common instants.
        instants: indices of these instants in the estimated path.
    """

    estimate: CameraEstimate
    truth: CameraTruth
    model: CameraModel | None
    pair: PathPair
    instants: np.ndarray


@dataclass(frozen=True)
class SceneComparison:
    """A scene's estimate beside its truth.

    Attributes:
        wearers: by index, of those whose truth is known.
        gauges: by index, what takes the estimate into the true world: one yaw and one shift of all before a camera,
            of each wearer without.
        is_tied: whether a camera ties the wearers to each other.
        cameras: those whose truth is known, in the scene's order.
    """

    wearers: Mapping[int, Comparison]
    gauges: Mapping[int, Alignment]
    is_tied: bool
    cameras: tuple[CameraComparison, ...]

    @property
    def gauge(self) -> Alignment | None:
        """That of the whole scene; None if there is none, or nothing to compare."""
        return next(iter(self.gauges.values()), None) if self.is_tied else None


def compare_scene(estimate: Estimate, scene: Scene) -> SceneComparison:
    """The estimate beside the truth of as many wearers as have one.

    Raises:
        InputError: if the two do not hold the same wearers, or share no frame.
    """
    if len(estimate.wearers) != len(scene.wearers):
        raise InputError(
            f"estimate of {len(estimate.wearers)} wearers for a scene of {len(scene.wearers)}: expected the same; "
            "is it the estimate of this scene?"
        )
    wearers = {
        index: compare_motion(wearer.motion, recording.truth)
        for index, (wearer, recording) in enumerate(zip(estimate.wearers, scene.wearers, strict=True))
        if recording.truth is not None and len(recording.truth.motion)
    }
    cameras = list[CameraComparison]()
    for camera, estimated in camera_pairs(scene, estimate):
        if camera.truth is not None:
            *pair, instants = common_instants(estimated.path, camera.truth.path)
            model = camera.truth.model or (None if camera.focal_sigma else camera.model)
            cameras.append(CameraComparison(estimated, camera.truth, model, (pair[0], pair[1]), instants))
    pairs = [comparison.pair for comparison in wearers.values()]
    if not estimate.cameras or not pairs:
        gauges = {index: scene_gauge([comparison.pair]) for index, comparison in wearers.items()}
    else:
        gauges = dict.fromkeys(wearers, scene_gauge(pairs, [camera.pair for camera in cameras]))
    return SceneComparison(wearers, gauges, bool(estimate.cameras), tuple(cameras))


def doubts(estimate: Estimate, scene: Scene, start_ns: int = 0) -> str:
    """What speaks against it, as one sentence; empty if nothing does. ``start_ns``: of the estimate's t = 0, 0 if not
    known.
    """
    sentences, begins = [], scene.wearers[0].start_ns
    if not {scene.name, *(wearer.name for wearer in scene.wearers)} & {
        estimate.name,
        *(wearer.name for wearer in estimate.wearers),
    }:
        sentences.append(f"the estimate is of '{estimate.name}', the truth of '{scene.name}'")
    same_start_s = 60.0  # clocks of computers that record together differ by less
    if start_ns and begins and (start_difference := abs(start_ns - begins) / 1e9) > same_start_s:
        sentences.append(f"they begin {start_difference:.0f} s apart")
    little = 0.9  # of the estimate's time: a truth that begins late or ends early has more
    for estimated, wearer in zip(estimate.wearers, scene.wearers, strict=False):
        who = f" of {wearer.subject.name}" if len(scene.wearers) > 1 else ""
        strange = sorted(set(estimated.sensors) - set(wearer.imus)) if wearer.imus else []
        if strange:
            sentences.append(
                f"{len(strange)} of the {len(estimated.sensors)} sensors{who} are none of the other's: {strange[0]} …"
            )
        if wearer.truth is not None and len(estimated.motion) and len(wearer.truth.motion):
            time, truth = estimated.motion.time, wearer.truth.motion.time
            common, duration = min(time[-1], truth[-1]) - max(time[0], truth[0]), time[-1] - time[0]
            if common < little * duration:
                sentences.append(f"of {duration:.1f} s of the estimate the truth covers {max(common, 0.0):.1f} s")
    return f"is this the truth of the same recording? {'; '.join(sentences)}" if sentences else ""
