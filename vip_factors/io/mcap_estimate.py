"""Estimates in MCAP files: topics and messages, read at once and written chunk by chunk.

Every wearer has the same topics, each below a separate prefix if there are several. The scene and the cameras have
further topics; an estimate of one unfilmed wearer has none of these.

An estimate in memory is written as a single chunk, a stream is many small ones. What is known of the whole at its end
alone (who is who, findings, headings over time) is written then, once more on the topics that had it at the beginning:
a reader takes the last of each.
"""

import os
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import starmap, zip_longest
from typing import Any

import numpy as np

from vip_factors.atomic import atomic_open
from vip_factors.errors import FileFormatError, InputError
from vip_factors.estimate import CameraEstimate, Estimate, WearerEstimate
from vip_factors.estimate_chunks import EstimateChunks
from vip_factors.findings import TEXT, bare, sentences
from vip_factors.geometry.rotations import Array
from vip_factors.io import codec
from vip_factors.io.codec import Codec, time_ns_of
from vip_factors.io.mcap_camera import clock_fields, intrinsics_message, intrinsics_of, path_messages, with_clock
from vip_factors.io.mcap_frames import (
    MODEST_FRAMES,
    REPROJECTION,
    camera_path_of,
    camera_pose_messages,
    camera_residuals_of,
    motion_of,
    pose_messages,
    residual_messages,
    residuals_of,
    shown_step,
    transform_messages,
)
from vip_factors.io.mcap_messages import CHUNK_BYTES, MessageWriter, TimedMessage, Topics, is_ours, naming, warn
from vip_factors.io.mcap_reader import McapChannel, McapContents, read_contents, read_few
from vip_factors.io.mcap_recording import wearer_topics
from vip_factors.io.schemas.body_pose_pb2 import BodyPose
from vip_factors.io.schemas.camera_estimate_pb2 import CameraEstimateInfo, CameraPose
from vip_factors.io.schemas.estimate_info_pb2 import EstimateInfo, Residuals
from vip_factors.sensors.calibration import Calibration
from vip_factors.solve.levenberg_marquardt import SolveReport

ESTIMATE = "/estimate/"
SINGLE = "/estimate"  # prefix of the topics of a single wearer's estimate
WEARER = "/estimate/wearer/"  # and if there are several; a name follows
# Below each wearer's prefix.
INFO, CALIBRATION, REPORT, POSE, RESIDUALS = "/info", "/calibration", "/report", "/pose", "/residuals"
TRANSFORMS = "/tf"  # for viewers; never read back
# Of the whole.
SCENE_INFO, SCENE_REPORT = "/estimate/scene/info", "/estimate/scene/report"
CAMERA = "/estimate/camera"  # prefix of the topics of the scene's first camera
FURTHER_CAMERA = "/estimate/cameras/"  # and those of the others; a name follows
# Below each camera's prefix.
INTRINSICS, CAMERA_POSE = "/intrinsics", "/pose"
CAMERA_PATH = "/path"  # the same for viewers; never read back
RECORDING_INFO = "/recording/info"


def _findings(estimate: WearerEstimate | Estimate) -> dict[str, Any]:
    """Sentences for every reader, and beside each its kind."""
    return {"findings": sentences(estimate.findings), "finding_kinds": [finding.kind for finding in estimate.findings]}


def _with_findings(message: EstimateInfo, read: dict[str, Any]) -> dict[str, Any]:
    kinds = message.finding_kinds[: len(message.findings)]
    return read | {"findings": tuple(starmap(bare, zip_longest(message.findings, kinds, fillvalue=TEXT)))}


def _with_clock(message: CameraEstimateInfo, read: dict[str, Any]) -> dict[str, Any]:
    sigma = tuple(message.clock_sigma)
    return with_clock(message, read) | {"clock_sigma": sigma if len(sigma) == 2 else None}


HEAD = Codec(
    EstimateInfo,
    WearerEstimate,
    {"start": "start_ns", "start_choice": "start", "motion": "motion_info"},
    encode_hook=lambda estimate: {"residual_kinds": list(estimate.residuals)} | _findings(estimate),
    decode_hook=_with_findings,
)
"""An estimate of a wearer without its frames; the absolute time of its t = 0 and the motion's message are given."""
SCENE_HEAD = Codec(EstimateInfo, Estimate, {"start": "start_ns"}, encode_hook=_findings, decode_hook=_with_findings)
"""The scene's part of an estimate; its start and the prefixes of its wearers' topics are given."""
CAMERA_HEAD = Codec(CameraEstimateInfo, CameraEstimate, encode_hook=clock_fields, decode_hook=_with_clock)
"""What a camera's estimate is; how many poses and residuals there are is given."""


def _cameras(contents: McapContents) -> list[str]:
    """Prefixes of the cameras' topics: the first camera's, then the others' in the order of their names."""
    infos = (topic for topic in contents.topics if topic.startswith(FURTHER_CAMERA) and topic.endswith(INFO))
    return [CAMERA, *sorted(topic.removesuffix(INFO) for topic in infos)]


def is_read(channel: McapChannel) -> bool:
    """Whether a channel belongs to an estimate, and not to viewers alone."""
    shown = channel.topic.endswith((TRANSFORMS, CAMERA_PATH))
    return channel.topic.startswith(ESTIMATE) and not shown


def read_estimate(path: str | os.PathLike[str] | McapContents) -> Estimate:
    """Read an estimate from a file, which may also hold the recording, or from its contents.

    Of a file that was cut off, every whole frame before the cut is read, and a
    :class:`~vip_factors.io.mcap_reader.McapWarning` says so.

    Raises:
        FileFormatError: if it is no MCAP file or holds no estimate.
    """
    contents = read_contents(path, is_read)
    topics = Topics(contents)
    info = topics.last(SCENE_INFO, EstimateInfo)
    with naming(contents.path):
        if info is None:
            return Estimate.of_one(_wearer_of(contents))
        cameras = [camera for prefix in _cameras(contents) if (camera := _camera(contents, prefix)) is not None]
        labels = np.array(info.wearer_of_detection, int)  # of the first camera: earlier versions wrote them here
        if cameras and np.any(labels >= 0):  # if all are −1, they may belong to a camera that was left out
            cameras[0] = replace(cameras[0], wearer_of_detection=labels)
        return Estimate(
            wearers=tuple(_wearer_of(contents, prefix) for prefix in info.wearer_topics),
            cameras=tuple(cameras),
            reports=topics.objects(SCENE_REPORT, codec.REPORT),
            **SCENE_HEAD.values(info),
        )


def read_head(path: str | os.PathLike[str]) -> tuple[Estimate, int]:
    """An estimate without its frames, and the number of frames of all wearers."""

    def is_of_head(channel: McapChannel) -> bool:  # the number of a camera's poses is of its frames
        topic = channel.topic
        is_of_camera = topic.startswith(CAMERA) and topic.endswith(INFO)
        return is_read(channel) and not is_of_camera and not topic.endswith((POSE, RESIDUALS))

    contents = read_few(path, is_of_head)
    with warnings.catch_warnings():  # that frames are missing
        warnings.simplefilter("ignore")
        head = read_estimate(contents)
    topics = Topics(contents)
    infos = [topics.last(topic, EstimateInfo) for topic in contents.topics if topic.endswith(INFO)]
    return head, sum(info.motion.frames for info in infos if info is not None)


def read_start(path: str | os.PathLike[str]) -> tuple[int, float]:
    """Absolute time of an estimate's t = 0 in nanoseconds, 0 if unknown, and that of the log's own clock in seconds."""
    contents = read_few(path, lambda channel: channel.topic.startswith(ESTIMATE) and is_ours(channel, EstimateInfo))
    topics = Topics(contents)
    infos = [info for topic in contents.topics if topic.endswith(INFO) for info in topics.all(topic, EstimateInfo)]
    return (time_ns_of(infos[0].start), infos[0].clock_s) if infos else (0, 0.0)


def _wearer_of(contents: McapContents, prefix: str = SINGLE) -> WearerEstimate:
    """One wearer's estimate, from the messages below the topic ``prefix``."""
    path, topics = contents.path, Topics(contents, prefix)
    info = topics.last(INFO, EstimateInfo)
    if info is None or not info.HasField("motion"):
        if any(topic.endswith(RECORDING_INFO) for topic in contents.topics):
            raise FileFormatError(
                f"{path} is a recording: expected an estimate, which vip-factors smooth makes of a recording"
            )
        topic_names = ", ".join(contents.topics) or "none"
        damage = f" ({contents.damage[0]})" if contents.damage else ""
        raise FileFormatError(
            f"{path}: expected an estimate, with a motion on topic {prefix + INFO}; found topics {topic_names}{damage}"
        )
    motion, covariance = motion_of(path, info.motion, topics.all(POSE, BodyPose))
    return WearerEstimate(
        motion=motion,
        covariance=covariance,
        calibration=topics.object(CALIBRATION, codec.CALIBRATION) or {},
        residuals=residuals_of(info.residual_kinds, len(info.sensors), topics.all(RESIDUALS, Residuals), len(motion)),
        reports=topics.objects(REPORT, codec.REPORT),
        **HEAD.values(info),
    )


def _camera(contents: McapContents, prefix: str) -> CameraEstimate | None:
    """A camera's estimate, from the messages below the topic ``prefix``."""
    from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration

    topics = Topics(contents, prefix)
    path, info = topics.path, topics.last(INFO, CameraEstimateInfo)
    if info is None:
        return None
    intrinsics, poses = topics.last(INTRINSICS, CameraCalibration), topics.all(CAMERA_POSE, CameraPose)
    if intrinsics is None or not poses:
        lacking = prefix + (INTRINSICS if intrinsics is None else CAMERA_POSE)
        warn(path, f"camera '{info.name}' is left out: nothing on {lacking}")
        return None
    if len(poses) < info.poses:
        warn(path, f"camera '{info.name}': {len(poses)} of {info.poses} poses are left")
    calibration = topics.object(CALIBRATION, codec.CALIBRATION) or {}
    covariances = [pose.covariance for pose in poses if len(pose.covariance) == 36]
    return CameraEstimate(
        model=intrinsics_of(intrinsics),
        path=camera_path_of(poses),
        calibration=next(iter(calibration.values()), None),
        covariance=np.array(covariances).reshape(-1, 6, 6) if len(covariances) == len(poses) else None,
        residual_px=camera_residuals_of(path, info, topics.all(RESIDUALS, Residuals)),
        **CAMERA_HEAD.values(info),
    )


LONG_CHUNK_BYTES = 1 << 20  # of estimates in chunks of their own: the index in memory has an entry for each


def write_estimate(
    estimate: Estimate | EstimateChunks,
    path: str | os.PathLike[str],
    overwrite: bool = False,
    start_ns: int = 0,
    clock_s: float = 0.0,
) -> None:
    """Write an estimate; rotations become quaternions, everything else is kept to the bit.

    Args:
        estimate: in memory, a single chunk, or in chunks, which are made here.
        path: of the new file, which has a temporary name until all is written.
        overwrite: whether an existing file may be replaced.
        start_ns: absolute time of t = 0.
        clock_s: time of t = 0 on the log's own clock, seconds.
    """
    if not (estimate.wearers if isinstance(estimate, Estimate) else estimate.head.wearers):
        raise InputError("the estimate has no wearer: expected at least one")
    chunk_bytes, rows = LONG_CHUNK_BYTES, list[int]()
    if isinstance(estimate, Estimate):
        rows = [0 if camera.residual_px is None else len(camera.residual_px) for camera in estimate.cameras]
        for wearer in estimate.wearers:
            _check_residuals(wearer)
        estimate, chunk_bytes = EstimateChunks.of(estimate), CHUNK_BYTES
    head, frames = estimate.head, estimate.frames
    names = [wearer.motion.name for wearer in head.wearers]
    if len(set(names)) < len(names):
        names = [str(number) for number in range(len(names))]
    with (
        atomic_open(path, "wb", overwrite) as file,
        MessageWriter(file, start_ns, chunk_bytes) as writer,
    ):
        out = EstimateWriter(writer, wearer_topics(names, SINGLE, WEARER), clock_s)
        for index, (wearer, count) in enumerate(zip(head.wearers, frames, strict=True)):
            out.begin_wearer(index, wearer, count)
        for camera, poses, residual_frames in zip(
            head.cameras, estimate.camera_poses, rows or [frames[0]] * len(head.cameras), strict=True
        ):
            out.begin_camera(camera, poses, residual_frames, is_first=camera is head.camera)
        if not head.is_plain:
            out.write_info(head)
        out.write_reports(head.reports, 0.0)
        writer.flush()
        end = 0.0
        for chunk in estimate.chunks:
            time = chunk.wearers[0].motion.time
            out.write_reports(chunk.reports, float(time[0]) if len(time) else end)
            out.write_frames(dict(enumerate(chunk.wearers)), chunk.cameras)
            end = float(time[-1]) if len(time) else end
        if estimate.closed is not None:
            out.write_closed(estimate.closed(), end)


def _check_residuals(estimate: WearerEstimate) -> None:
    """Refuse residuals of a shape that cannot be written."""
    expected = (len(estimate.motion), len(estimate.sensors))
    for kind, values in estimate.residuals.items():
        if values.shape != expected:
            raise InputError(f"residuals '{kind}' have shape {values.shape}: expected (frames, sensors) = {expected}")


class EstimateWriter:
    """Writes an estimate into an open file: what is known of the whole, and frames in chunks of any size.

    Args:
        writer: of the file.
        prefixes: what the topics of each wearer begin with.
        clock_s: time of t = 0 on the log's own clock, seconds.
    """

    def __init__(self, writer: MessageWriter, prefixes: Sequence[str], clock_s: float) -> None:
        self._writer, self._prefixes, self._clock_s = writer, prefixes, clock_s
        self._wearers: dict[int, _WearerTopics] = {}
        self._cameras = list[_CameraTopics]()

    @property
    def wearer_count(self) -> int:
        """Number of wearers that have begun."""
        return len(self._wearers)

    def begin_wearer(self, index: int, head: WearerEstimate, frames: int = 0) -> None:
        """Write what the frames of a wearer share; there will be so many of these, 0 where nobody knows yet."""
        most_frames = MODEST_FRAMES * shown_step(head.motion)
        shown_frames = most_frames if frames <= most_frames else 0
        topics = _WearerTopics(self._writer, self._prefixes[index], self._clock_s, head, shown_frames)
        self._wearers[index] = topics
        topics.write_info(frames)
        topics.write_reports(head.reports, 0.0)
        if frames:  # a stream writes its calibration as it goes
            self.write_calibration(index, head.calibration)

    def begin_camera(
        self, head: CameraEstimate, poses: int | None = None, residual_frames: int = 0, is_first: bool = True
    ) -> None:
        """Write what the poses of a camera share; how many there will be is None where nobody knows yet."""
        prefix = CAMERA if is_first else FURTHER_CAMERA + head.name.replace("/", "_")
        topics = _CameraTopics(self._writer, prefix, head, poses, residual_frames)
        self._cameras.append(topics)
        topics.write_info()
        topics.write_lens()
        if head.calibration is not None:
            self._writer.write(prefix + CALIBRATION, codec.CALIBRATION.encode({head.name: head.calibration}))

    def write_info(self, estimate: Estimate, seconds: float = 0.0) -> None:
        """Write what is known of the whole at a time, of the wearers who have begun."""
        prefixes = [self._prefixes[index] for index in sorted(self._wearers)]
        message = SCENE_HEAD.encode(estimate, wearer_topics=prefixes, start_ns=self._writer.start_ns)
        self._writer.write(SCENE_INFO, message, seconds)

    def write_closed(self, head: Estimate, seconds: float) -> None:
        """Write again, at the end, what is known of the whole, of the cameras and of the calibrations."""
        self.write_info(head, seconds)
        for topics, camera in zip(self._cameras, head.cameras, strict=True):
            topics.head = camera
            topics.write_info(seconds)
        for index, wearer in enumerate(head.wearers):
            self.write_calibration(index, wearer.calibration, seconds)

    def write_reports(self, reports: Iterable[SolveReport], seconds: float) -> None:
        """Write how solves over all wearers went."""
        for report in reports:
            self._writer.write(SCENE_REPORT, codec.REPORT.encode(report), seconds)

    def write_calibration(self, index: int, calibration: Calibration, seconds: float = 0.0) -> None:
        """Write the headings and mountings of a wearer's sensors."""
        self._writer.write(self._prefixes[index] + CALIBRATION, codec.CALIBRATION.encode(calibration), seconds)

    def write_frames(self, wearers: Mapping[int, WearerEstimate], cameras: Sequence[CameraEstimate] = ()) -> None:
        """Write the next frames of wearers, by their indices, and of the cameras that have begun."""
        streams = [stream for index, chunk in wearers.items() for stream in self._wearers[index].streams(chunk)]
        chunks = {camera.name: camera for camera in cameras}
        for topics in self._cameras:
            if (camera := chunks.get(topics.head.name)) is not None:
                times = [chunk.motion.time for chunk in wearers.values()]
                streams += topics.streams(camera, times[0] if times else camera.path.time)
        self._writer.add_in_order(*streams)

    def finish(self) -> None:
        """Write how many frames and poses there are, of a stream."""
        for wearer in self._wearers.values():
            wearer.write_info(wearer.next_frame)
        for camera in self._cameras:
            camera.write_info()


@dataclass
class _WearerTopics:
    """One wearer's topics; viewers get the first ``shown_frames`` as transforms of all joints."""

    writer: MessageWriter
    prefix: str
    clock_s: float
    head: WearerEstimate
    shown_frames: int
    next_frame: int = 0

    def write_info(self, frames: int) -> None:
        """Write what all frames share, and how many there are."""
        motion = codec.MOTION.encode(self.head.motion, frames=frames)
        info = HEAD.encode(self.head, start_ns=self.writer.start_ns, clock_s=self.clock_s, motion_info=motion)
        self.writer.write(self.prefix + INFO, info)

    def write_reports(self, reports: Iterable[SolveReport], seconds: float) -> None:
        """Write how solves of this wearer went."""
        for report in reports:
            self.writer.write(self.prefix + REPORT, codec.REPORT.encode(report), seconds)

    def streams(self, chunk: WearerEstimate) -> Iterator[Iterable[TimedMessage]]:
        """The messages of the next frames, which are numbered by the chunk's start."""
        writer, prefix, motion = self.writer, self.prefix, chunk.motion
        start = self.head.motion.start
        first_frame = round((motion.start - start) * motion.rate)
        self.next_frame = first_frame + len(motion)
        self.head = replace(self.head, motion=replace(motion.frames(slice(0, 0)), start=start))
        self.write_reports(chunk.reports, motion.start)
        yield pose_messages(writer, prefix + POSE, motion, chunk.covariance, first_frame)
        if chunk.residuals:
            yield residual_messages(writer, prefix + RESIDUALS, motion.time, chunk.residuals, first_frame)
        if first_frame < self.shown_frames:
            # Viewers tell frames apart by name only: two wearers' skeletons need names of their own.
            name = motion.name if prefix == SINGLE else prefix.rpartition("/")[2]
            shown = replace(motion.frames(slice(-first_frame % shown_step(motion), None)), name=name)
            yield transform_messages(writer, prefix + TRANSFORMS, shown)


@dataclass
class _CameraTopics:
    """A camera's topics; ``poses`` is how many there will be, None where nobody knows yet."""

    writer: MessageWriter
    prefix: str
    head: CameraEstimate
    poses: int | None
    residual_frames: int
    next_pose: int = 0
    next_residual: int = 0

    def write_info(self, seconds: float = 0.0) -> None:
        """Write what the camera is, how many poses there will be or are, and residuals of how many frames."""
        residual = self.head.residual_px
        info = CAMERA_HEAD.encode(
            self.head,
            poses=self.next_pose if self.poses is None else self.poses,
            has_residuals=residual is not None,
            wearers=None if residual is None else residual.shape[1],
            residual_frames=None if residual is None else self.residual_frames,
        )
        self.writer.write(self.prefix + INFO, info, seconds)

    def write_lens(self, seconds: float = 0.0) -> None:
        """Write the intrinsics."""
        message = intrinsics_message(self.head.model, self.head.name, self.writer.time_ns(seconds))
        self.writer.write(self.prefix + INTRINSICS, message, seconds)

    def streams(self, chunk: CameraEstimate, motion_time: Array) -> Iterator[Iterable[TimedMessage]]:
        """The messages of the next frames, at ``motion_time`` ``(T,)``; one pose of a camera that stands still."""
        writer, prefix, path, residual = self.writer, self.prefix, chunk.path, chunk.residual_px
        if chunk.model != self.head.model:  # a stream refines its lens
            self.head = replace(self.head, model=chunk.model)
            self.write_lens(float(path.time[0]))
        if self.poses is None or self.next_pose < self.poses:
            yield camera_pose_messages(writer, prefix + CAMERA_POSE, path, chunk.covariance, self.next_pose)
            yield path_messages(writer, prefix + CAMERA_PATH, path)
            self.next_pose += len(path)
        if residual is not None:
            times = (time for time in (path.time, motion_time) if len(time) == len(residual))
            time, kinds = np.resize(next(times, motion_time[:1]), len(residual)), {REPROJECTION: residual}
            yield residual_messages(writer, prefix + RESIDUALS, time, kinds, self.next_residual)
            self.next_residual += len(residual)
