"""An estimate written into an MCAP file chunk by chunk; a whole one is a single chunk.

What is known of the whole at its end alone (who is who, findings, headings over time) is written then, once more on the
topics that had it at the beginning: a reader takes the last of each.
"""

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from math import inf
from pathlib import Path

import numpy as np

from vip_factors.atomic import atomic_open, check_target
from vip_factors.body.kinematics import Motion
from vip_factors.errors import FileFormatError, InputError
from vip_factors.estimate import CameraEstimate, Estimate, WearerEstimate
from vip_factors.estimate_chunks import EstimateChunks
from vip_factors.geometry.rotations import Array
from vip_factors.io import mcap_estimate as on
from vip_factors.io import mcap_messages as codecs
from vip_factors.io.codec import NS_PER_S, time_ns_of
from vip_factors.io.mcap_camera import intrinsics_message, path_messages
from vip_factors.io.mcap_estimate import CAMERA_HEAD, HEAD, SCENE_HEAD
from vip_factors.io.mcap_frames import (
    camera_pose_messages,
    camera_residual_messages,
    point_messages,
    pose_messages,
    residual_messages,
    scene_wanted,
    shown_step,
    skeleton_scene,
    transform_messages,
)
from vip_factors.io.mcap_messages import Topics
from vip_factors.io.mcap_reader import McapContents, read_contents
from vip_factors.io.mcap_recording import wearer_topics
from vip_factors.io.mcap_writer import CHUNK_BYTES, MessageWriter, TimedMessage
from vip_factors.io.schemas.recording_info_pb2 import RecordingInfo

LONG_CHUNK_BYTES = 1 << 20  # of estimates in chunks of their own: the index in memory has an entry for each


def write_estimate(
    estimate: Estimate | EstimateChunks,
    path: str | os.PathLike[str],
    overwrite: bool = False,
    append_to: str | os.PathLike[str] | None = None,
    scene: bool | None = None,
    start_ns: int = 0,
) -> None:
    """Write an estimate; rotations become quaternions, everything else is kept to the bit.

    Args:
        estimate: what to write; its chunks are made here, and what is in memory is one of them.
        path: of the new file, which has a temporary name until all is written.
        overwrite: whether an existing file may be replaced.
        append_to: an MCAP recording: the new file then holds everything in it, and the estimate after it (in place of
            an earlier one). It may be ``path`` itself, with ``overwrite``.
        scene: whether to add the moving skeletons as Foxglove's messages; None: if they are small.
        start_ns: absolute time of t = 0; taken from the recording with ``append_to``.

    Raises:
        InputError: if the file exists and may not be overwritten, cannot be written there, there is no wearer, or
            residuals do not have one column per sensor.
        FileFormatError: if the recording to append to is no MCAP file, or is cut off and would be replaced.
        RecordingError, SolveError: of the chunks.
    """
    if not (estimate.wearers if isinstance(estimate, Estimate) else estimate.head.wearers):
        raise InputError("the estimate has no wearer: expected at least one")
    chunk_bytes, errors = LONG_CHUNK_BYTES, None
    if isinstance(estimate, Estimate):
        errors = None if estimate.camera is None else estimate.camera.residual_px
        for one in estimate.wearers:
            _check_residuals(one)
        estimate, chunk_bytes = EstimateChunks.of(estimate), CHUNK_BYTES
    head = estimate.head
    prefixes = _wearer_prefixes(head)
    with _estimate_file(path, overwrite, append_to, start_ns, chunk_bytes) as (writer, start_ns):
        if not head.is_plain:
            writer.write(on.SCENE_INFO, SCENE_HEAD.encode(head, wearer_topics=prefixes, start_ns=start_ns), start_ns)
        for report in head.reports:
            writer.write(on.SCENE_REPORT, codecs.REPORT.encode(report), start_ns)
        if head.detector is not None:
            writer.write(on.DETECTOR, codecs.DETECTOR.encode(head.detector), start_ns)
        camera = None
        if head.camera is not None:
            frames = estimate.frames[0] if errors is None else len(errors)
            camera = CameraWriter(writer, head.camera, estimate.camera_poses, frames, start_ns)
        wearers = [
            WearerWriter(writer, one, frames, prefix, start_ns, scene)
            for one, frames, prefix in zip(head.wearers, estimate.frames, prefixes, strict=True)
        ]
        writer.flush()
        end_ns = start_ns
        for chunk in estimate.chunks:
            time = chunk.wearers[0].motion.time
            for report in chunk.reports:
                writer.write(on.SCENE_REPORT, codecs.REPORT.encode(report), start_ns + int(NS_PER_S * time[0]))
            streams = [one for own, wearer in zip(wearers, chunk.wearers, strict=True) for one in own.streams(wearer)]
            if camera is not None and chunk.camera is not None:
                streams += camera.streams(chunk.camera, time)
            writer.add_in_order(*streams)
            end_ns = start_ns + int(NS_PER_S * time[-1]) if len(time) else end_ns
        if estimate.closed is not None:
            closed = estimate.closed()
            writer.write(on.SCENE_INFO, SCENE_HEAD.encode(closed, wearer_topics=prefixes, start_ns=start_ns), end_ns)
            for one, prefix in zip(closed.wearers, prefixes, strict=True):
                writer.write(prefix + on.CALIBRATION, codecs.CALIBRATION.encode(one.calibration), end_ns)


@contextmanager
def _estimate_file(
    path: str | os.PathLike[str],
    overwrite: bool,
    append_to: str | os.PathLike[str] | None,
    start_ns: int,
    chunk_bytes: int,
) -> Iterator[tuple[MessageWriter, int]]:
    """A file to write an estimate into, with the recording in it already; and the absolute time of t = 0.

    Raises:
        InputError, FileFormatError: as :func:`write_estimate`.
    """
    target = check_target(path, overwrite)
    recording = read_contents(append_to) if append_to is not None else None
    if recording is not None:
        start_ns = _start_of(recording)
        if recording.damage and Path(os.path.realpath(recording.path)) == target:
            raise FileFormatError(
                f"{recording.path} is damaged ({recording.damage[0]}): it is not replaced; write to another file"
            )
    with atomic_open(path, "wb", overwrite) as file, MessageWriter(file, chunk_bytes) as writer:
        if recording is not None:
            writer.copy(recording, without=(on.ESTIMATE,))
        yield writer, start_ns


def _start_of(recording: McapContents) -> int:
    topics = [topic for topic in recording.topics if topic.endswith(on.RECORDING_INFO)]  # of a scene, one per wearer
    info = Topics(recording).last(topics[0], RecordingInfo) if topics else None
    return 0 if info is None else time_ns_of(info.start)


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
    names = [one.motion.name for one in estimate.wearers]
    if len(set(names)) < len(names):
        names = [str(number) for number in range(len(names))]
    return wearer_topics(names, on.SINGLE, on.WEARER)


class WearerWriter:
    """One wearer's topics; what comes once is written at the start.

    Args:
        writer: of the file.
        head: of the wearer, without frames.
        frames: how many there will be; 0 of a stream, where nobody knows yet.
        prefix: what the topics begin with.
        start_ns: absolute time of t = 0.
        scene: as of :func:`write_estimate`.
        shown_frames: how many of them viewers get to see.
    """

    def __init__(
        self,
        writer: MessageWriter,
        head: WearerEstimate,
        frames: int,
        prefix: str,
        start_ns: int,
        scene: bool | None,
        shown_frames: float = inf,
    ) -> None:
        self._writer, self._prefix, self._start_ns, self._start_s = writer, prefix, start_ns, head.motion.start
        writer.write(prefix + on.INFO, HEAD.encode(head, start_ns=start_ns), start_ns)
        self.write_motion(head.motion, frames)
        if frames:  # a stream writes its calibration as it goes
            writer.write(prefix + on.CALIBRATION, codecs.CALIBRATION.encode(head.calibration), start_ns)
        if head.body is not None:
            writer.write(prefix + on.BODY, codecs.BODY.encode(head.body), start_ns)
        if head.sensor_places:
            writer.write(prefix + on.SENSOR_PLACES, codecs.SENSOR_PLACES.encode(head.sensor_places), start_ns)
        for report in head.reports:
            writer.write(prefix + on.REPORT, codecs.REPORT.encode(report), start_ns)
        # Viewers tell frames apart by name only: two wearers' skeletons need names of their own.
        self._name = head.motion.name if prefix == on.SINGLE else prefix.rpartition("/")[2]
        self._shown_frames = shown_frames if scene_wanted(scene, head.motion, frames) else 0
        if self._shown_frames:
            writer.write(prefix + on.SCENE, skeleton_scene(replace(head.motion, name=self._name)), start_ns)

    def write_motion(self, motion: Motion, frames: int) -> None:
        """What all frames share; of what comes several times the last one counts."""
        self._writer.write(self._prefix + on.MOTION, codecs.MOTION.encode(motion, frames=frames), self._start_ns)

    def streams(self, chunk: WearerEstimate) -> Iterator[Iterable[TimedMessage]]:
        """The messages of the next frames, which are numbered by the chunk's start."""
        writer, prefix, start_ns, motion = self._writer, self._prefix, self._start_ns, chunk.motion
        first = round((motion.start - self._start_s) * motion.rate)
        for report in chunk.reports:
            writer.write(prefix + on.REPORT, codecs.REPORT.encode(report), start_ns + int(NS_PER_S * motion.start))
        yield pose_messages(writer, prefix + on.POSE, motion, start_ns, chunk.covariance, first)
        if chunk.residuals:
            yield residual_messages(writer, prefix + on.RESIDUALS, motion.time, chunk.residuals, start_ns, first)
        if first < self._shown_frames:
            shown = replace(motion.frames(slice(-first % shown_step(motion), None)), name=self._name)
            yield transform_messages(writer, prefix + on.TRANSFORMS, shown, start_ns)
            yield point_messages(writer, prefix + on.POINTS, shown, start_ns)


class CameraWriter:
    """The camera's topics; what comes once is written at the start.

    Args:
        writer: of the file.
        head: of the camera.
        poses: how many there will be; None if nobody knows yet.
        frames: how many residuals there will be, if any.
        start_ns: absolute time of t = 0.
    """

    def __init__(
        self, writer: MessageWriter, head: CameraEstimate, poses: int | None, frames: int, start_ns: int
    ) -> None:
        self._writer, self._poses, self._frames, self._start_ns = writer, poses, frames, start_ns
        self._written, self._residuals = 0, 0
        self.write_info(head, start_ns)
        writer.write(on.INTRINSICS, intrinsics_message(head.model, head.name, start_ns), start_ns)
        if head.calibration is not None:
            calibration = {head.name: head.calibration}
            writer.write(on.CAMERA_CALIBRATION, codecs.CALIBRATION.encode(calibration), start_ns)

    def write_info(self, camera: CameraEstimate, time_ns: int) -> None:
        """What the camera is, how many poses there will be or are, and residuals of how many frames."""
        residual = camera.residual_px
        info = CAMERA_HEAD.encode(
            camera,
            poses=self._written if self._poses is None else self._poses,
            has_residuals=residual is not None,
            wearers=None if residual is None else residual.shape[1],
            residual_frames=None if residual is None else self._frames,
        )
        self._writer.write(on.CAMERA_INFO, info, time_ns)

    def streams(self, chunk: CameraEstimate, motion_time: Array) -> Iterator[Iterable[TimedMessage]]:
        """The messages of the next frames, at ``motion_time`` ``(T,)``; one pose of a camera that stands still."""
        writer, path, residual = self._writer, chunk.path, chunk.residual_px
        if self._poses is None or self._written < self._poses:
            yield camera_pose_messages(writer, on.CAMERA_POSE, path, self._start_ns, chunk.covariance, self._written)
            yield path_messages(writer, on.CAMERA_PATH, path, self._start_ns)
            self._written += len(path)
        if residual is not None:
            time = next((one for one in (path.time, motion_time) if len(one) == len(residual)), motion_time[:1])
            time = np.resize(time, len(residual))
            yield camera_residual_messages(writer, on.CAMERA_RESIDUALS, time, residual, self._start_ns, self._residuals)
            self._residuals += len(residual)
