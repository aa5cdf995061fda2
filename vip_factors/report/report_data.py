"""What a report is made from: an estimate, and beside it whatever else is known of the recording."""

from dataclasses import dataclass, replace
from functools import cached_property

from vip_factors.errors import InputError
from vip_factors.estimate import Estimate, WearerEstimate
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene
from vip_factors.viz.compare import check_frames
from vip_factors.viz.drawn_scene import DrawnScene, drawn_scene


@dataclass(frozen=True)
class ReportWearer:
    """One of the wearers, with the recording if it is there."""

    index: int
    name: str
    estimate: WearerEstimate
    recording: Recording | None


@dataclass(frozen=True)
class ReportData:
    """The estimate of a scene, and the scene if there is one.

    Attributes:
        estimate: of one wearer or several.
        scene: what was measured, with the truth if it is known; None if there is the estimate alone.
    """

    estimate: Estimate
    scene: Scene | None = None

    @cached_property
    def wearers(self) -> tuple[ReportWearer, ...]:
        """In the scene's order."""
        recordings = self.scene.wearers if self.scene is not None else (None,) * len(self.estimate.wearers)
        return tuple(
            ReportWearer(index, _name(index, estimate, recording), estimate, recording)
            for index, (estimate, recording) in enumerate(zip(self.estimate.wearers, recordings, strict=True))
        )

    @property
    def names(self) -> list[str]:
        """Names of the wearers."""
        return [wearer.name for wearer in self.wearers]

    @cached_property
    def drawn(self) -> DrawnScene:
        """In the truth's world where that is known, on the recording's clock."""
        return drawn_scene(self.scene, self.estimate)

    @property
    def has_truth(self) -> bool:
        """Whether there is something to compare with."""
        return self.scene is not None and any(wearer.truth is not None for wearer in self.scene.wearers)


def _name(index: int, estimate: WearerEstimate, recording: Recording | None) -> str:
    if recording is not None:
        return recording.subject.name
    return estimate.motion.name or f"wearer {index + 1}"


def report_data(estimate: Estimate, scene: Scene | None = None, truth: Scene | None = None) -> ReportData:
    """Put together what there is.

    Args:
        estimate: with one wearer at least.
        scene: what it was made from.
        truth: a scene whose truth counts instead of that scene's.

    Raises:
        InputError: if they do not hold the same number of wearers, or there is no wearer, one without frames, or no
            truth where one is asked for.
    """
    if not estimate.wearers:
        raise InputError(f"estimate '{estimate.name}' has no wearer: expected at least one")
    for wearer in estimate.wearers:
        check_frames(wearer.motion)
    for other in (scene, truth):
        if other is not None and len(other.wearers) != len(estimate.wearers):
            raise InputError(
                f"estimate of {len(estimate.wearers)} wearers beside '{other.name}' of {len(other.wearers)}: expected "
                "the same; is it the estimate of this recording?"
            )
    if truth is None:
        return ReportData(estimate, scene)
    if all(wearer.truth is None for wearer in truth.wearers):
        raise InputError(f"'{truth.name}' holds no truth: expected that of one wearer at least")
    if scene is None:
        return ReportData(estimate, truth)
    wearers = tuple(
        replace(wearer, truth=other.truth) for wearer, other in zip(scene.wearers, truth.wearers, strict=True)
    )
    same = [len(camera.detections) for camera in scene.cameras] == [len(camera.detections) for camera in truth.cameras]
    return ReportData(estimate, replace(scene, wearers=wearers, truth=truth.truth if same else None))
