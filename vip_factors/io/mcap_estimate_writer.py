"""An estimate written into an MCAP file chunk by chunk: one in memory is a single chunk, a stream is many small ones.

What is known of the whole at its end alone (who is who, findings, headings over time) is written then, once more on the
topics that had it at the beginning: a reader takes the last of each.
"""

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from math import inf

import numpy as np

from vip_factors.atomic import atomic_open
from vip_factors.errors import InputError
from vip_factors.estimate import CameraEstimate, Estimate, SolveReport, WearerEstimate
from vip_factors.estimate_chunks import EstimateChunks
from vip_factors.geometry.rotations import Array
from vip_factors.io import mcap_estimate as on
from vip_factors.io import mcap_messages as codecs
from vip_factors.io.codec import NS_PER_S
from vip_factors.io.mcap_camera import intrinsics_message, path_messages
from vip_factors.io.mcap_estimate import CAMERA_HEAD, HEAD, SCENE_HEAD
from vip_factors.io.mcap_frames import (
    MODEST_FRAMES,
    REPROJECTION,
    camera_pose_messages,
    pose_messages,
    residual_messages,
    shown_step,
    transform_messages,
)
from vip_factors.io.mcap_recording import wearer_topics
from vip_factors.io.mcap_writer import CHUNK_BYTES, MessageWriter, TimedMessage
from vip_factors.sensors.calibration import Calibration

LONG_CHUNK_BYTES = 1 << 20  # of estimates in chunks of their own: the index in memory has an entry for each


def write_estimate(
    estimate: Estimate | EstimateChunks,
    path: str | os.PathLike[str],
    overwrite: bool = False,
    start_ns: int = 0,
) -> None:
    """Write an estimate; rotations become quaternions, everything else is kept to the bit.

    Args:
        estimate: what to write; its chunks are made here, and what is in memory is one of them.
        path: of the new file, which has a temporary name until all is written.
        overwrite: whether an existing file may be replaced.
        start_ns: absolute time of t = 0.

    Raises:
        InputError: if the file exists and may not be overwritten, cannot be written there, there is no wearer, or
            residuals do not have one column per sensor.
        RecordingError, SolveError: of the chunks.
    """
    if not (estimate.wearers if isinstance(estimate, Estimate) else estimate.head.wearers):
        raise InputError("the estimate has no wearer: expected at least one")
    chunk_bytes, errors = LONG_CHUNK_BYTES, None
    if isinstance(estimate, Estimate):
        errors = None if estimate.camera is None else estimate.camera.residual_px
        for wearer in estimate.wearers:
            _check_residuals(wearer)
        estimate, chunk_bytes = EstimateChunks.of(estimate), CHUNK_BYTES
    head, frames = estimate.head, estimate.frames
    with atomic_open(path, "wb", overwrite) as file, MessageWriter(file, chunk_bytes) as writer:
        out = EstimateWriter(writer, _wearer_prefixes(head), start_ns)
        for index, (wearer, count) in enumerate(zip(head.wearers, frames, strict=True)):
            out.begin_wearer(index, wearer, count)
        if head.camera is not None:
            out.begin_camera(head.camera, estimate.camera_poses, frames[0] if errors is None else len(errors))
        if not head.is_plain:
            out.write_info(head, start_ns)
        out.write_reports(head.reports, 0.0)
        writer.flush()
        end = 0.0
        for chunk in estimate.chunks:
            time = chunk.wearers[0].motion.time
            out.write_reports(chunk.reports, float(time[0]) if len(time) else end)
            out.write_frames(dict(enumerate(chunk.wearers)), chunk.camera)
            end = float(time[-1]) if len(time) else end
        if estimate.closed is not None:
            closed = estimate.closed()
            out.write_info(closed, start_ns + int(NS_PER_S * end))
            for index, wearer in enumerate(closed.wearers):
                out.write_calibration(index, wearer.calibration, start_ns + int(NS_PER_S * end))


def _check_residuals(estimate: WearerEstimate) -> None:
    """Refuse residuals of a shape that cannot be written.

    Raises:
        InputError: naming the kind.
    """
    expected = (len(estimate.motion), len(estimate.sensors))
    for kind, values in estimate.residuals.items():
        if values.shape != expected:
            raise InputError(f"residuals '{kind}' have shape {values.shape}: expected (frames, sensors) = {expected}")


def _wearer_prefixes(estimate: Estimate) -> list[str]:
    """What each wearer's topics begin with: the motion's name, or where two have the same, their numbers."""
    names = [wearer.motion.name for wearer in estimate.wearers]
    if len(set(names)) < len(names):
        names = [str(number) for number in range(len(names))]
    return wearer_topics(names, on.SINGLE, on.WEARER)


class EstimateWriter:
    """Writes an estimate into an open file: what is known of the whole, and frames in chunks of any size.

    Args:
        writer: of the file.
        prefixes: what the topics of each wearer begin with.
        start_ns: absolute time of t = 0.
        shown_frames: how many frames of a wearer viewers get as transforms of all joints, if these are few.
    """

    def __init__(
        self,
        writer: MessageWriter,
        prefixes: Sequence[str],
        start_ns: int,
        shown_frames: float = inf,
    ) -> None:
        self._writer, self._prefixes, self._start_ns = writer, prefixes, start_ns
        self._shown_frames = shown_frames
        self._wearers: dict[int, _WearerTopics] = {}
        self._camera: _CameraTopics | None = None

    @property
    def wearer_count(self) -> int:
        """Number of wearers that have begun."""
        return len(self._wearers)

    def begin_wearer(self, index: int, head: WearerEstimate, frames: int = 0) -> None:
        """Write what the frames of a wearer share.

        Args:
            index: of the wearer.
            head: without frames.
            frames: how many there will be; 0 of a stream, where nobody knows yet.
        """
        prefix = self._prefixes[index]
        shown_frames = self._shown_frames if frames / shown_step(head.motion) <= MODEST_FRAMES else 0
        self._wearers[index] = _WearerTopics(self._writer, prefix, self._start_ns, head, frames, shown_frames)
        if frames:  # a stream writes its calibration as it goes
            self.write_calibration(index, head.calibration, self._start_ns)

    def begin_camera(self, head: CameraEstimate, poses: int | None = None, residual_frames: int = 0) -> None:
        """Write what the poses of the camera share.

        Args:
            head: of the camera.
            poses: how many there will be; None if nobody knows yet.
            residual_frames: how many residuals there will be, if any.
        """
        self._camera = _CameraTopics(self._writer, self._start_ns, head, poses, residual_frames)

    def write_info(self, estimate: Estimate, time_ns: int) -> None:
        """Write what is known of the whole, of the wearers who have begun."""
        prefixes = [self._prefixes[index] for index in sorted(self._wearers)]
        message = SCENE_HEAD.encode(estimate, wearer_topics=prefixes, start_ns=self._start_ns)
        self._writer.write(on.SCENE_INFO, message, time_ns)

    def write_reports(self, reports: Iterable[SolveReport], seconds: float) -> None:
        """Write how solves over all wearers went."""
        for report in reports:
            time_ns = self._start_ns + int(NS_PER_S * seconds)
            self._writer.write(on.SCENE_REPORT, codecs.REPORT.encode(report), time_ns)

    def write_calibration(self, index: int, calibration: Calibration, time_ns: int) -> None:
        """Write the headings and mountings of a wearer's sensors."""
        self._writer.write(self._prefixes[index] + on.CALIBRATION, codecs.CALIBRATION.encode(calibration), time_ns)

    def write_frames(self, wearers: Mapping[int, WearerEstimate], camera: CameraEstimate | None = None) -> None:
        """Write the next frames of wearers, by their indices, and of the camera."""
        streams = [stream for index, chunk in wearers.items() for stream in self._wearers[index].streams(chunk)]
        if self._camera is not None and camera is not None:
            times = [chunk.motion.time for chunk in wearers.values()]
            streams += self._camera.streams(camera, times[0] if times else camera.path.time)
        self._writer.add_in_order(*streams)

    def finish(self) -> None:
        """Write how many frames and poses there are, of a stream."""
        for wearer in self._wearers.values():
            wearer.write_info(wearer.next_frame)
        if self._camera is not None:
            self._camera.write_info()


class _WearerTopics:
    """One wearer's topics; what comes once is written at the start."""

    def __init__(
        self,
        writer: MessageWriter,
        prefix: str,
        start_ns: int,
        head: WearerEstimate,
        frames: int,
        shown_frames: float,
    ) -> None:
        self._writer, self._prefix, self._start_ns = writer, prefix, start_ns
        self._head, self._shown_frames, self.next_frame = head, shown_frames, 0
        # Viewers tell frames apart by name only: two wearers' skeletons need names of their own.
        self._name = head.motion.name if prefix == on.SINGLE else prefix.rpartition("/")[2]
        self.write_info(frames)
        for report in head.reports:
            writer.write(prefix + on.REPORT, codecs.REPORT.encode(report), start_ns)

    def write_info(self, frames: int) -> None:
        """Write what all frames share, and how many there are."""
        motion = codecs.MOTION.encode(self._head.motion, frames=frames)
        info = HEAD.encode(self._head, start_ns=self._start_ns, motion_info=motion)
        self._writer.write(self._prefix + on.INFO, info, self._start_ns)

    def streams(self, chunk: WearerEstimate) -> Iterator[Iterable[TimedMessage]]:
        """The messages of the next frames, which are numbered by the chunk's start."""
        writer, prefix, start_ns, motion = self._writer, self._prefix, self._start_ns, chunk.motion
        start = self._head.motion.start
        first_frame = round((motion.start - start) * motion.rate)
        self.next_frame = first_frame + len(motion)
        self._head = replace(self._head, motion=replace(motion.frames(slice(0, 0)), start=start))
        for report in chunk.reports:
            writer.write(prefix + on.REPORT, codecs.REPORT.encode(report), start_ns + int(NS_PER_S * motion.start))
        yield pose_messages(writer, prefix + on.POSE, motion, start_ns, chunk.covariance, first_frame)
        if chunk.residuals:
            yield residual_messages(writer, prefix + on.RESIDUALS, motion.time, chunk.residuals, start_ns, first_frame)
        if first_frame < self._shown_frames:
            shown = replace(motion.frames(slice(-first_frame % shown_step(motion), None)), name=self._name)
            yield transform_messages(writer, prefix + on.TRANSFORMS, shown, start_ns)


class _CameraTopics:
    """The camera's topics; what comes once is written at the start."""

    def __init__(
        self, writer: MessageWriter, start_ns: int, head: CameraEstimate, poses: int | None, residual_frames: int
    ) -> None:
        self._writer, self._start_ns, self._head = writer, start_ns, head
        self._poses, self._residual_frames = poses, residual_frames
        self._next_pose, self._next_residual = 0, 0
        self.write_info()
        writer.write(on.INTRINSICS, intrinsics_message(head.model, head.name, start_ns), start_ns)
        if head.calibration is not None:
            calibration = codecs.CALIBRATION.encode({head.name: head.calibration})
            writer.write(on.CAMERA_CALIBRATION, calibration, start_ns)

    def write_info(self) -> None:
        """Write what the camera is, how many poses there will be or are, and residuals of how many frames."""
        residual = self._head.residual_px
        info = CAMERA_HEAD.encode(
            self._head,
            poses=self._next_pose if self._poses is None else self._poses,
            has_residuals=residual is not None,
            wearers=None if residual is None else residual.shape[1],
            residual_frames=None if residual is None else self._residual_frames,
        )
        self._writer.write(on.CAMERA_INFO, info, self._start_ns)

    def streams(self, chunk: CameraEstimate, motion_time: Array) -> Iterator[Iterable[TimedMessage]]:
        """The messages of the next frames, at ``motion_time`` ``(T,)``; one pose of a camera that stands still."""
        writer, path, residual = self._writer, chunk.path, chunk.residual_px
        if self._poses is None or self._next_pose < self._poses:
            yield camera_pose_messages(writer, on.CAMERA_POSE, path, self._start_ns, chunk.covariance, self._next_pose)
            yield path_messages(writer, on.CAMERA_PATH, path, self._start_ns)
            self._next_pose += len(path)
        if residual is not None:
            time = next(
                (candidate for candidate in (path.time, motion_time) if len(candidate) == len(residual)),
                motion_time[:1],
            )
            time, kinds = np.resize(time, len(residual)), {REPROJECTION: residual}
            yield residual_messages(writer, on.CAMERA_RESIDUALS, time, kinds, self._start_ns, self._next_residual)
            self._next_residual += len(residual)
