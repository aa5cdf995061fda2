"""An estimate of any length in chunks of consecutive frames."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest

import numpy as np

from vip_factors.estimate import CameraEstimate, Estimate, PoseCovariance, WearerEstimate
from vip_factors.findings import Finding
from vip_factors.sensors.camera import CameraPath


@dataclass(frozen=True)
class EstimateChunks:
    """An estimate of any length, which need not be in memory at once.

    Attributes:
        head: all but the frames: its wearers' motions have none, and its cameras' paths are the first pose.
        frames: how many each wearer will have.
        camera_poses: how many each camera will have: one if it stands still.
        chunks: estimates of consecutive frames in the order of time, made as they are asked for, once. Their reports
            are of the solves that made them; their detections follow those of the chunk before.
        closed: makes the head with what is known of the whole once all chunks were made (findings, headings over time,
            who is who); None if the head has that already.
    """

    head: Estimate
    frames: tuple[int, ...]
    chunks: Iterator[Estimate]
    camera_poses: tuple[int, ...] = ()
    closed: Callable[[], Estimate] | None = None

    @classmethod
    def of(cls, estimate: Estimate) -> "EstimateChunks":
        """A whole estimate as one chunk."""
        wearers, none = estimate.wearers, slice(0, 0)
        without = tuple(replace(wearer, reports=()) for wearer in wearers)
        return cls(
            replace(
                estimate,
                cameras=tuple(camera.start for camera in estimate.cameras),
                wearers=tuple(wearer.frames(none) for wearer in wearers),
            ),
            tuple(len(wearer.motion) for wearer in wearers),
            iter([replace(estimate, wearers=without, reports=())]),
            tuple(len(camera.path) for camera in estimate.cameras),
        )

    @classmethod
    def apart(cls, name: str, estimates: "Sequence[EstimateChunks]") -> "EstimateChunks":
        """Combine the estimates of wearers without a common world into one named ``name``; frames run side by side."""
        wearers = tuple(estimate.head.wearer() for estimate in estimates)
        findings = tuple(finding for wearer in wearers for finding in wearer.findings)
        if len(wearers) > 1:
            findings = (*findings, Finding("apart"))
        head = replace(estimates[0].head, name=name, wearers=wearers, findings=findings)
        ended = [Estimate.of_one(replace(wearer, reports=())) for wearer in wearers]

        def chunks() -> Iterator[Estimate]:
            for several in zip_longest(*(estimate.chunks for estimate in estimates)):
                chunk = [(chunk_or_end or end).wearer() for chunk_or_end, end in zip(several, ended, strict=True)]
                yield replace(head, wearers=tuple(chunk))

        return cls(head, tuple(estimate.frames[0] for estimate in estimates), chunks())

    def changed(self, change: Callable[[Estimate], Estimate]) -> "EstimateChunks":
        """Return the chunks with a function applied to the head and to every chunk."""
        closed = self.closed
        return replace(
            self,
            head=change(self.head),
            chunks=map(change, self.chunks),
            closed=None if closed is None else lambda: change(closed()),
        )

    def whole(self) -> Estimate:
        """All chunks together, in memory."""
        chunks = list(self.chunks)
        head = self.closed() if self.closed is not None else self.head
        wearers = map(_joined_wearer, head.wearers, *(chunk.wearers for chunk in chunks))
        cameras = map(_joined_camera, head.cameras, *(chunk.cameras for chunk in chunks))
        reports = (*head.reports, *(report for chunk in chunks for report in chunk.reports))
        return replace(head, cameras=tuple(cameras), wearers=tuple(wearers), reports=reports)


def _joined_wearer(head: WearerEstimate, *chunks: WearerEstimate) -> WearerEstimate:
    R, p = (
        np.concatenate([getattr(chunk.motion, name) for chunk in chunks])
        for name in ("R_parent_child", "p_world_pelvis")
    )
    covariances = [chunk.covariance for chunk in chunks if chunk.covariance is not None]
    has_covariance = len(covariances) == len(chunks)
    joints, root = ([getattr(covariance, name) for covariance in covariances] for name in ("joints", "root"))
    return replace(
        head,
        motion=replace(head.motion, R_parent_child=R, p_world_pelvis=p),
        covariance=PoseCovariance(np.concatenate(joints), np.concatenate(root)) if has_covariance else None,
        residuals={kind: np.concatenate([chunk.residuals[kind] for chunk in chunks]) for kind in head.residuals},
        reports=(*head.reports, *(report for chunk in chunks for report in chunk.reports)),
    )


def _joined_camera(head: CameraEstimate, *chunks: CameraEstimate) -> CameraEstimate:
    paths = [chunk.path for chunk in chunks]
    covariances = [chunk.covariance for chunk in chunks if chunk.covariance is not None]
    residuals = [chunk.residual_px for chunk in chunks if chunk.residual_px is not None]
    moves = any(len(path) > 1 for path in paths)
    together = [np.concatenate([getattr(path, name) for path in paths]) for name in vars(head.path)]
    return replace(
        head,
        path=CameraPath(*together) if moves else paths[0],
        covariance=np.concatenate(covariances) if moves and len(covariances) == len(chunks) else chunks[0].covariance,
        residual_px=np.concatenate(residuals) if len(residuals) == len(chunks) else None,
    )
