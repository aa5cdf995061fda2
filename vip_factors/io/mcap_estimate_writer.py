"""An estimate written into an MCAP file chunk by chunk; a whole one is a single chunk.

What is known of the whole at its end alone (who is who, findings, headings over time) is written then, once more on the
topics that had it at the beginning: a reader takes the last of each.
"""

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from vip_factors.atomic import atomic_open, check_target
from vip_factors.errors import FileFormatError, InputError
from vip_factors.estimate import (
    CameraEstimate,
    Estimate,
    EstimateChunks,
    SolveReport,
    WearerEstimate,
)
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import Array
from vip_factors.io.mcap_camera import intrinsics_message, path_messages
from vip_factors.io.mcap_estimate import (
    BODY,
    CALIBRATION,
    CAMERA_CALIBRATION,
    CAMERA_INFO,
    CAMERA_PATH,
    CAMERA_POSE,
    CAMERA_RESIDUALS,
    DETECTOR,
    ESTIMATE,
    INFO,
    INTRINSICS,
    MOTION,
    POINTS,
    POSE,
    RECORDING_INFO,
    REPORT,
    RESIDUALS,
    SCENE,
    SCENE_INFO,
    SCENE_REPORT,
    SENSOR_PLACES,
    SINGLE,
    TRANSFORMS,
    WEARER,
)
from vip_factors.io.mcap_messages import (
    body_message,
    calibration_message,
    detector_message,
    motion_message,
    of_topic,
    pose_messages,
    sensor_places_message,
    set_timestamp,
    time_ns_of,
    vector_message,
)
from vip_factors.io.mcap_reader import McapContents, read_contents
from vip_factors.io.mcap_recording import wearer_topics
from vip_factors.io.mcap_scene import point_messages, scene_wanted, shown_step, skeleton_scene, transform_messages
from vip_factors.io.mcap_writer import CHUNK_BYTES, NS_PER_S, MessageWriter, TimedMessage, nanoseconds
from vip_factors.io.schemas.camera_estimate_pb2 import CameraEstimateInfo, CameraPose, CameraResiduals
from vip_factors.io.schemas.estimate_info_pb2 import EstimateInfo
from vip_factors.io.schemas.estimate_info_pb2 import StartChoice as StartChoiceMessage
from vip_factors.io.schemas.geometry_pb2 import QuaternionWxyz
from vip_factors.io.schemas.recording_info_pb2 import RecordingInfo
from vip_factors.io.schemas.residuals_pb2 import Residuals
from vip_factors.io.schemas.scene_estimate_pb2 import SceneEstimateInfo
from vip_factors.io.schemas.solve_report_pb2 import SolveReport as SolveReportMessage
from vip_factors.sensors.camera_path import CameraPath

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
            writer.write(SCENE_INFO, scene_info_message(head, prefixes, start_ns), start_ns)
        for report in head.reports:
            writer.write(SCENE_REPORT, report_message(report), start_ns)
        if head.detector is not None:
            writer.write(DETECTOR, detector_message(head.detector), start_ns)
        camera = None
        if head.camera is not None:
            frames = estimate.frames[0] if errors is None else len(errors)
            camera = _CameraWriter(writer, head.camera, estimate.camera_poses, frames, start_ns)
        wearers = [
            _WearerWriter(writer, one, frames, prefix, start_ns, scene)
            for one, frames, prefix in zip(head.wearers, estimate.frames, prefixes, strict=True)
        ]
        writer.flush()
        end_ns = start_ns
        for chunk in estimate.chunks:
            time = chunk.wearers[0].motion.time
            for report in chunk.reports:
                writer.write(SCENE_REPORT, report_message(report), start_ns + int(NS_PER_S * time[0]))
            streams = [one for own, wearer in zip(wearers, chunk.wearers, strict=True) for one in own.streams(wearer)]
            if camera is not None and chunk.camera is not None:
                streams += camera.streams(chunk.camera, time)
            writer.add_in_order(*streams)
            end_ns = start_ns + int(NS_PER_S * time[-1]) if len(time) else end_ns
        if estimate.closed is not None:
            closed = estimate.closed()
            writer.write(SCENE_INFO, scene_info_message(closed, prefixes, start_ns), end_ns)
            for one, prefix in zip(closed.wearers, prefixes, strict=True):
                writer.write(prefix + CALIBRATION, calibration_message(one.calibration), end_ns)
            if camera is not None and closed.camera is not None:
                camera.write_info(closed.camera, end_ns)


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
            writer.copy(recording, without=(ESTIMATE,))
        yield writer, start_ns


def _start_of(recording: McapContents) -> int:
    messages = list(recording.messages.values())
    topics = [topic for topic in recording.topics if topic.endswith(RECORDING_INFO)]  # of a scene, one per wearer
    infos = [info for topic in topics[:1] for info in of_topic(recording.path, messages, topic, RecordingInfo)]
    return time_ns_of(infos[-1].start) if infos else 0


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
    return wearer_topics(names, SINGLE, WEARER)


def scene_info_message(estimate: Estimate, prefixes: Sequence[str], start_ns: int) -> SceneEstimateInfo:
    """What the estimate of a scene is; ``prefixes`` are what its wearers' topics begin with."""
    info = SceneEstimateInfo(
        name=estimate.name,
        method=estimate.method,
        wearer_topics=prefixes,
        wearer_of_detection=np.asarray(estimate.wearer_of_detection, int).tolist(),
        findings=estimate.findings,
        settings=dict(estimate.settings),
        association=estimate.association,
    )
    set_timestamp(info.start, start_ns)
    return info


def info_message(estimate: WearerEstimate, start_ns: int) -> EstimateInfo:
    """What an estimate is."""
    message = EstimateInfo(
        name=estimate.name,
        method=estimate.method,
        sensors=estimate.sensors,
        settings=dict(estimate.settings),
        residual_kinds=list(estimate.residuals),
        findings=estimate.findings,
    )
    if estimate.start is not None:
        one = estimate.start
        message.start_choice.CopyFrom(
            StartChoiceMessage(supposition=one.supposition, rival=one.rival, margin=one.margin, doubtful=one.doubtful)
        )
    set_timestamp(message.start, start_ns)
    return message


def report_message(report: SolveReport) -> SolveReportMessage:
    """How one solve went."""
    message = SolveReportMessage(
        stage=report.stage,
        initial_cost=dict(report.initial_cost),
        final_cost=dict(report.final_cost),
        converged=report.converged,
        seconds=report.seconds,
    )
    for one in report.iterations:
        message.iterations.add(cost=one.cost, damping=one.damping, accepted=one.accepted, seconds=dict(one.seconds))
    return message


class _WearerWriter:
    """One wearer's topics; what comes once is written at the start."""

    def __init__(
        self, writer: MessageWriter, head: WearerEstimate, frames: int, prefix: str, start_ns: int, scene: bool | None
    ) -> None:
        self._writer, self._prefix, self._start_ns, self._written = writer, prefix, start_ns, 0
        motion = motion_message(head.motion)
        motion.frames = frames
        writer.write(prefix + INFO, info_message(head, start_ns), start_ns)
        writer.write(prefix + MOTION, motion, start_ns)
        writer.write(prefix + CALIBRATION, calibration_message(head.calibration), start_ns)
        if head.body is not None:
            writer.write(prefix + BODY, body_message(head.body), start_ns)
        if head.sensor_places:
            writer.write(prefix + SENSOR_PLACES, sensor_places_message(head.sensor_places), start_ns)
        for report in head.reports:
            writer.write(prefix + REPORT, report_message(report), start_ns)
        # Viewers tell frames apart by name only: two wearers' skeletons need names of their own.
        self._name = head.motion.name if prefix == SINGLE else prefix.rpartition("/")[2]
        self._shown = scene_wanted(scene, head.motion, frames)
        if self._shown:
            writer.write(prefix + SCENE, skeleton_scene(replace(head.motion, name=self._name)), start_ns)

    def streams(self, chunk: WearerEstimate) -> Iterator[Iterable[TimedMessage]]:
        """The messages of the next frames."""
        writer, prefix, start_ns, motion, first = (
            self._writer,
            self._prefix,
            self._start_ns,
            chunk.motion,
            self._written,
        )
        self._written += len(motion)
        for report in chunk.reports:
            writer.write(prefix + REPORT, report_message(report), start_ns + int(NS_PER_S * motion.start))
        yield pose_messages(writer, prefix + POSE, motion, start_ns, chunk.covariance, first)
        if chunk.residuals:
            yield residual_messages(writer, prefix + RESIDUALS, motion.time, chunk.residuals, start_ns, first)
        if self._shown:
            shown = replace(motion.frames(slice(-first % shown_step(motion), None)), name=self._name)
            yield transform_messages(writer, prefix + TRANSFORMS, shown, start_ns)
            yield point_messages(writer, prefix + POINTS, shown, start_ns)


class _CameraWriter:
    """The camera's topics; what comes once is written at the start."""

    def __init__(self, writer: MessageWriter, head: CameraEstimate, poses: int, frames: int, start_ns: int) -> None:
        self._writer, self._poses, self._frames, self._start_ns = writer, poses, frames, start_ns
        self._written, self._residuals = 0, 0
        self.write_info(head, start_ns)
        writer.write(INTRINSICS, intrinsics_message(head.model, head.name, start_ns), start_ns)
        if head.calibration is not None:
            writer.write(CAMERA_CALIBRATION, calibration_message({head.name: head.calibration}), start_ns)

    def write_info(self, camera: CameraEstimate, time_ns: int) -> None:
        """What the camera is, how many poses there will be, and residuals of how many frames."""
        residual = camera.residual_px
        info = CameraEstimateInfo(
            name=camera.name,
            time_offset_s=camera.time_offset,
            time_drift=camera.time_drift,
            clock_sigma=camera.clock_sigma,
            poses=self._poses,
            has_residuals=residual is not None,
            wearers=residual.shape[1] if residual is not None else 0,
            residual_frames=self._frames if residual is not None else 0,
        )
        self._writer.write(CAMERA_INFO, info, time_ns)

    def streams(self, chunk: CameraEstimate, motion_time: Array) -> Iterator[Iterable[TimedMessage]]:
        """The messages of the next frames, at ``motion_time`` ``(T,)``; one pose of a camera that stands still."""
        writer, path, residual = self._writer, chunk.path, chunk.residual_px
        if self._written < self._poses:
            yield camera_pose_messages(writer, CAMERA_POSE, path, self._start_ns, chunk.covariance, self._written)
            yield path_messages(writer, CAMERA_PATH, path, self._start_ns)
            self._written += len(path)
        if residual is not None:
            time = next((one for one in (path.time, motion_time) if len(one) == len(residual)), motion_time[:1])
            time = np.resize(time, len(residual))
            yield _camera_residual_messages(writer, residual, time, self._start_ns, self._residuals)
            self._residuals += len(residual)


def residual_messages(
    writer: MessageWriter, topic: str, time: Array, residuals: Mapping[str, Array], start_ns: int, first: int = 0
) -> Iterator[TimedMessage]:
    """The residuals of frames at ``time`` ``(T,)``, serialised; the first of them has the number ``first``."""
    channel = writer.channel(topic, Residuals)
    for row, time_ns in enumerate(nanoseconds(time, start_ns)):
        message = Residuals(frame=first + row)
        set_timestamp(message.timestamp, time_ns)
        for kind, values in residuals.items():
            message.kinds.add(name=kind, values=values[row])
        yield time_ns, channel, message.SerializeToString()


def camera_pose_messages(
    writer: MessageWriter,
    topic: str,
    path: CameraPath,
    start_ns: int,
    covariance: Array | None = None,
    first: int = 0,
) -> Iterator[TimedMessage]:
    """The poses of a camera, serialised, in the order of time; the first of them has the number ``first``."""
    channel = writer.channel(topic, CameraPose)
    turns = quaternion_from_matrix(path.R_world_camera, Order.WXYZ).tolist()
    for row, (time_ns, seconds) in enumerate(zip(nanoseconds(path.time, start_ns), path.time.tolist(), strict=True)):
        w, x, y, z = turns[row]
        message = CameraPose(
            frame=first + row,
            seconds=seconds,
            rotation_wxyz=QuaternionWxyz(w=w, x=x, y=y, z=z),
            p_world_camera=vector_message(path.p_world_camera[row]),
            covariance=covariance[row].ravel() if covariance is not None else (),
        )
        set_timestamp(message.timestamp, time_ns)
        yield time_ns, channel, message.SerializeToString()


def _camera_residual_messages(
    writer: MessageWriter, residual: Array, time: Array, start_ns: int, first: int = 0
) -> Iterator[TimedMessage]:
    """Reprojection errors ``(T, wearers)`` of frames at ``time`` ``(T,)``, numbered from ``first`` on."""
    channel = writer.channel(CAMERA_RESIDUALS, CameraResiduals)
    for row, time_ns in enumerate(nanoseconds(time, start_ns)):
        message = CameraResiduals(frame=first + row, pixels=residual[row])
        set_timestamp(message.timestamp, time_ns)
        yield time_ns, channel, message.SerializeToString()
