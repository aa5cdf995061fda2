"""An estimate of any length, made and handed on in chunks of consecutive frames, and put together again."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.estimate import CameraEstimate, Estimate, PoseCovariance, WearerEstimate
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
        without = tuple(replace(one, reports=()) for one in wearers)
        return cls(
            replace(
                estimate,
                cameras=tuple(camera.start for camera in estimate.cameras),
                wearers=tuple(one.frames(none) for one in wearers),
            ),
            tuple(len(one.motion) for one in wearers),
            iter([replace(estimate, wearers=without, reports=())]),
            tuple(len(camera.path) for camera in estimate.cameras),
        )

    def changed(self, change: Callable[[Estimate], Estimate]) -> "EstimateChunks":
        """The same with a change of the head and of every chunk."""
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
        wearers = map(_joined_wearer, head.wearers, *(one.wearers for one in chunks))
        cameras = map(_joined_camera, head.cameras, *(one.cameras for one in chunks))
        reports = (*head.reports, *(report for one in chunks for report in one.reports))
        return replace(head, cameras=tuple(cameras), wearers=tuple(wearers), reports=reports)


def _joined_wearer(head: WearerEstimate, *chunks: WearerEstimate) -> WearerEstimate:
    R, p = (
        np.concatenate([getattr(one.motion, name) for one in chunks]) for name in ("R_parent_child", "p_world_pelvis")
    )
    covariances = [one.covariance for one in chunks if one.covariance is not None]
    known = len(covariances) == len(chunks)
    joints, root = ([getattr(one, name) for one in covariances] for name in ("joints", "root"))
    return replace(
        head,
        motion=replace(head.motion, R_parent_child=R, p_world_pelvis=p),
        covariance=PoseCovariance(np.concatenate(joints), np.concatenate(root)) if known else None,
        residuals={kind: np.concatenate([one.residuals[kind] for one in chunks]) for kind in head.residuals},
        reports=(*head.reports, *(report for one in chunks for report in one.reports)),
    )


def _joined_camera(head: CameraEstimate, *chunks: CameraEstimate) -> CameraEstimate:
    paths = [one.path for one in chunks]
    covariances = [one.covariance for one in chunks if one.covariance is not None]
    residuals = [one.residual_px for one in chunks if one.residual_px is not None]
    moves = any(len(one) > 1 for one in paths)
    together = [np.concatenate([getattr(one, name) for one in paths]) for name in vars(head.path)]
    return replace(
        head,
        path=CameraPath(*together) if moves else paths[0],
        covariance=np.concatenate(covariances) if moves and len(covariances) == len(chunks) else chunks[0].covariance,
        residual_px=np.concatenate(residuals) if len(residuals) == len(chunks) else None,
    )
