"""Short streams for tests of the tracker: gestures in front of a camera, tracked at half the usual rate."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from filmed_gestures import filmed_gestures

from vip_factors.body.kinematics import Motion
from vip_factors.evaluate.metrics import common_frames, mpjpe
from vip_factors.findings import sentences
from vip_factors.live.tracker import FixedLagTracker
from vip_factors.live_estimate import LiveEstimate, LivePose, motion_of
from vip_factors.sensors.live import LiveSample, live_samples, stream_head
from vip_factors.sensors.scene import Scene
from vip_factors.settings import CalibrationSettings, LiveSettings, RecalibrationSettings, StartSettings

RATE = 30.0  # half the usual: half the time
# Streams are too short for a calibration that is found anew, and tests of that have settings of their own.
SETTINGS = LiveSettings(frame_rate=RATE, recalibration=RecalibrationSettings(use=False))
# Starts from straps and the low-passed motion alone, for disturbances that come later.
QUICK = replace(SETTINGS, calibration=CalibrationSettings(start=StartSettings(search=False)))
LAG = round(SETTINGS.lag_s * RATE)


@dataclass(frozen=True)
class Tracked:
    """A scene and what was answered to it."""

    scene: Scene
    answers: tuple[LiveEstimate, ...]

    @property
    def findings(self) -> str:
        return "\n".join(sentence for answer in self.answers for sentence in sentences(answer.findings))

    def motion(self, kind: str, wearer: int = 0) -> Motion:
        """The ``"newest"`` or ``"smoothed"`` poses."""
        return self._motion_of(poses(self.answers, kind, wearer), wearer)

    def _motion_of(self, chosen: Sequence[LivePose], wearer: int) -> Motion:
        return motion_of(chosen, self.scene.wearers[wearer].subject.body(), RATE, "live")

    def error_mm(self, kind: str, after: float = 2.0, wearer: int = 0, before: float = np.inf) -> float:
        """MPJPE of the answers from a time on."""
        chosen = [pose for pose in poses(self.answers, kind, wearer) if after <= pose.time < before]
        truth = self.scene.wearers[wearer].truth
        assert truth is not None
        ours, true, _ = common_frames(self._motion_of(chosen, wearer), truth.motion)
        return mpjpe(ours, true)


def poses(answers: Iterable[LiveEstimate], kind: str, wearer: int = 0) -> list[LivePose]:
    found = [getattr(answer.wearers[wearer], kind) for answer in answers]
    return [one for one in found if one is not None]


def track(scene: Scene, samples: Iterable[LiveSample] | None = None, settings: LiveSettings = SETTINGS) -> Tracked:
    """All answers to a scene's samples, or to others of the same set-up."""
    tracker = FixedLagTracker(stream_head(scene), settings)
    answers: list[LiveEstimate] = []
    for sample in live_samples(scene) if samples is None else samples:
        answers += tracker.push(sample)
    return Tracked(scene, (*answers, *tracker.finish()))


@cache
def filmed() -> Scene:
    """One wearer of ten sensors, four seconds, a camera on a tripod whose pose nobody knows."""
    return filmed_gestures("fixed", 4.0)


@cache
def tracked() -> Tracked:
    """That, undisturbed."""
    return track(filmed())


@cache
def placed_camera() -> Scene:
    """The same with the camera's pose known."""
    scene = filmed()
    assert scene.camera is not None
    assert scene.camera.truth is not None
    return replace(scene, cameras=(replace(scene.camera, known_path=scene.camera.truth.path, moving=False),))


@cache
def tracked_by_placed_camera() -> Tracked:
    """That, undisturbed."""
    return track(placed_camera())


def unfilmed(scene: Scene) -> Scene:
    return Scene(scene.name, scene.wearers)
