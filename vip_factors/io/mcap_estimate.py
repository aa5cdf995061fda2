"""An estimate as an MCAP file of its own, or together with the recording that it was made from."""

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from vip_factors.atomic import atomic_open, check_target
from vip_factors.errors import FileFormatError, InputError
from vip_factors.estimate import Iteration, SolveReport, StartChoice, WearerEstimate
from vip_factors.geometry.rotations import Array
from vip_factors.io.mcap_messages import (
    body_message,
    body_of,
    calibration_message,
    calibration_of,
    is_ours,
    motion_message,
    motion_of,
    naming,
    of_topic,
    pose_messages,
    sensor_places_message,
    sensor_places_of,
    set_timestamp,
    tell_lost_frames,
    time_ns_of,
)
from vip_factors.io.mcap_reader import McapContents, McapMessages, read_contents
from vip_factors.io.mcap_scene import point_messages, scene_wanted, skeleton_scene, transform_messages
from vip_factors.io.mcap_writer import MessageWriter, TimedMessage, nanoseconds
from vip_factors.io.schemas.body_estimate_pb2 import BodyEstimate as BodyEstimateMessage
from vip_factors.io.schemas.body_pose_pb2 import BodyPose, MotionInfo
from vip_factors.io.schemas.calibration_estimate_pb2 import CalibrationEstimate
from vip_factors.io.schemas.estimate_info_pb2 import EstimateInfo
from vip_factors.io.schemas.estimate_info_pb2 import StartChoice as StartChoiceMessage
from vip_factors.io.schemas.place_estimates_pb2 import SensorPlaceEstimates
from vip_factors.io.schemas.recording_info_pb2 import RecordingInfo
from vip_factors.io.schemas.residuals_pb2 import Residuals
from vip_factors.io.schemas.solve_report_pb2 import SolveReport as SolveReportMessage

ESTIMATE = "/estimate/"
SINGLE = "/estimate"  # what the topics of one wearer's estimate begin with, if there is but one
INFO, CALIBRATION, REPORT, MOTION, POSE = "/info", "/calibration", "/report", "/motion", "/pose"
BODY, SENSOR_PLACES, RESIDUALS = "/body", "/sensor_places", "/residuals"
TRANSFORMS, SCENE, POINTS = "/tf", "/skeleton", "/points"
RECORDING_INFO = "/recording/info"


def write_estimate(
    estimate: WearerEstimate,
    path: str | os.PathLike[str],
    overwrite: bool = False,
    append_to: str | os.PathLike[str] | None = None,
    scene: bool | None = None,
    start_ns: int = 0,
) -> None:
    """Write an estimate; rotations become quaternions, everything else is kept to the bit.

    Args:
        estimate: what to write.
        path: of the new file.
        overwrite: whether an existing file may be replaced.
        append_to: an MCAP recording: the new file then holds everything in it, and the estimate after it (in place of
            an earlier one). It may be ``path`` itself, with ``overwrite``.
        scene: whether to add the moving skeleton as Foxglove's messages; None: if it is small.
        start_ns: absolute time of t = 0; taken from the recording with ``append_to``.

    Raises:
        InputError: if the file exists and may not be overwritten, cannot be written there, or the residuals do not
            have one column per sensor.
        FileFormatError: if the recording to append to is no MCAP file, or is cut off and would be replaced.
    """
    check_residuals(estimate)
    with estimate_file(path, overwrite, append_to, start_ns) as (writer, start_ns):
        streams = estimate_messages(writer, estimate, start_ns, scene)
        writer.flush()
        writer.add_in_order(*streams)


@contextmanager
def estimate_file(
    path: str | os.PathLike[str], overwrite: bool, append_to: str | os.PathLike[str] | None, start_ns: int
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
    with atomic_open(path, "wb", overwrite) as file, MessageWriter(file) as writer:
        if recording is not None:
            writer.copy(recording, without=(ESTIMATE,))
        yield writer, start_ns


def estimate_messages(
    writer: MessageWriter, estimate: WearerEstimate, start_ns: int, scene: bool | None = None, prefix: str = SINGLE
) -> list[Iterable[TimedMessage]]:
    """Write what comes once; what comes with every frame is returned as streams, to be interleaved with others.

    Args:
        writer: of the file.
        estimate: of one wearer.
        start_ns: absolute time of t = 0.
        scene: as of :func:`write_estimate`.
        prefix: what the topics begin with.
    """
    motion = estimate.motion
    writer.write(prefix + INFO, info_message(estimate, start_ns), start_ns)
    writer.write(prefix + MOTION, motion_message(motion), start_ns)
    writer.write(prefix + CALIBRATION, calibration_message(estimate.calibration), start_ns)
    if estimate.body is not None:
        writer.write(prefix + BODY, body_message(estimate.body), start_ns)
    if estimate.sensor_places:
        writer.write(prefix + SENSOR_PLACES, sensor_places_message(estimate.sensor_places), start_ns)
    for report in estimate.reports:
        writer.write(prefix + REPORT, report_message(report), start_ns)
    streams: list[Iterable[TimedMessage]] = [
        pose_messages(writer, prefix + POSE, motion, start_ns, estimate.covariance)
    ]
    if estimate.residuals:
        streams.append(residual_messages(writer, prefix + RESIDUALS, motion.time, estimate.residuals, start_ns))
    if scene_wanted(scene, motion):
        # Viewers tell frames apart by name only: two wearers' skeletons need names of their own.
        shown = motion if prefix == SINGLE else replace(motion, name=prefix.rpartition("/")[2])
        writer.write(prefix + SCENE, skeleton_scene(shown), start_ns)
        streams.append(transform_messages(writer, prefix + TRANSFORMS, shown, start_ns))
        streams.append(point_messages(writer, prefix + POINTS, shown, start_ns))
    return streams


def check_residuals(estimate: WearerEstimate) -> None:
    """Refuse residuals of a shape that cannot be written.

    Raises:
        InputError: naming the kind.
    """
    expected = (len(estimate.motion), len(estimate.sensors))
    for kind, values in estimate.residuals.items():
        if values.shape != expected:
            raise InputError(f"residuals '{kind}' have shape {values.shape}: expected (frames, sensors) = {expected}")


def _start_of(recording: McapContents) -> int:
    messages = list(recording.messages.values())
    topics = [topic for topic in recording.topics if topic.endswith(RECORDING_INFO)]  # of a scene, one per wearer
    infos = [info for topic in topics[:1] for info in of_topic(recording.path, messages, topic, RecordingInfo)]
    return time_ns_of(infos[-1].start) if infos else 0


def read_start(path: str | os.PathLike[str]) -> int:
    """Absolute time in nanoseconds of an estimate's t = 0; 0 if it is not known."""
    contents = read_contents(
        path, lambda channel: channel.topic.startswith(ESTIMATE) and is_ours(channel, EstimateInfo)
    )
    topics = [topic for topic in contents.topics if topic.endswith(INFO)]
    infos = [
        one
        for topic in topics
        for one in of_topic(contents.path, list(contents.messages.values()), topic, EstimateInfo)
    ]
    return time_ns_of(infos[0].start) if infos else 0


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


def read_estimate(path: str | os.PathLike[str]) -> WearerEstimate:
    """Read an estimate, from a file of its own or from one that also holds the recording.

    Of the estimate of a scene with one wearer, it is that wearer's.

    Of a file that was cut off, every whole frame before the cut is read, and a
    :class:`~vip_factors.io.mcap_reader.McapWarning` says so.

    Raises:
        InputError: if there is no such file.
        FileFormatError: if it is no MCAP file, holds no estimate, or several wearers'.
    """
    contents = read_contents(path, lambda channel: channel.topic.startswith(ESTIMATE) and is_ours(channel))
    with naming(contents.path):
        return estimate_of(contents, contents.messages.values())


def estimate_of(contents: McapContents, messages: Iterable[McapMessages], prefix: str = SINGLE) -> WearerEstimate:
    """One wearer's estimate, of the messages below the topic ``prefix``.

    Raises:
        FileFormatError: if it is not there.
    """
    path = contents.path
    ours = [one for one in messages if one.channel.topic.startswith(f"{prefix}/") and one.data]
    infos = of_topic(path, ours, prefix + INFO, EstimateInfo)
    motions = of_topic(path, ours, prefix + MOTION, MotionInfo)
    if not infos or not motions:
        if any(topic.endswith(RECORDING_INFO) for topic in contents.topics):
            raise FileFormatError(
                f"{path} is a recording: expected an estimate, which vip-factors smooth makes of a recording"
            )
        topics = ", ".join(contents.topics) or "none"
        damage = f" ({contents.damage[0]})" if contents.damage else ""
        several = any(topic.startswith(f"{SINGLE}/wearer/") for topic in contents.topics) and prefix == SINGLE
        advice = "; it holds several wearers: read it as a scene's (read_scene_estimate)" if several else ""
        raise FileFormatError(
            f"{path}: expected an estimate, with topics {prefix + INFO} and {prefix + MOTION}; "
            f"found topics {topics}{damage}{advice}"
        )
    info = infos[-1]
    motion, covariance = motion_of(motions[-1], of_topic(path, ours, prefix + POSE, BodyPose))
    tell_lost_frames(path, motions[-1], motion)
    calibrations = of_topic(path, ours, prefix + CALIBRATION, CalibrationEstimate)
    bodies = of_topic(path, ours, prefix + BODY, BodyEstimateMessage)
    places = of_topic(path, ours, prefix + SENSOR_PLACES, SensorPlaceEstimates)
    return WearerEstimate(
        name=info.name,
        method=info.method,
        motion=motion,
        calibration=calibration_of(calibrations[-1]) if calibrations else {},
        covariance=covariance,
        residuals=_residuals(info, of_topic(path, ours, prefix + RESIDUALS, Residuals), len(motion)),
        sensors=tuple(info.sensors),
        reports=tuple(report_of(one) for one in of_topic(path, ours, prefix + REPORT, SolveReportMessage)),
        settings=dict(info.settings),
        findings=tuple(info.findings),
        start=_start_choice(info),
        body=body_of(bodies[-1]) if bodies else None,
        sensor_places=sensor_places_of(places[-1]) if places else (),
    )


def _start_choice(info: EstimateInfo) -> StartChoice | None:
    if not info.HasField("start_choice"):
        return None
    one = info.start_choice
    return StartChoice(one.supposition, one.rival, one.margin, tuple(one.doubtful))


def _residuals(info: EstimateInfo, messages: Sequence[Residuals], frames: int) -> dict[str, Array]:
    """By kind ``(frames, sensors)``; NaN where a frame's message is lost."""
    residuals = {kind: np.full((frames, len(info.sensors)), np.nan) for kind in info.residual_kinds}
    for message in messages:
        for kind in message.kinds:
            if kind.name not in residuals or len(kind.values) != len(info.sensors):
                raise FileFormatError(
                    f"frame {message.frame} has {len(kind.values)} residuals '{kind.name}': expected "
                    f"{len(info.sensors)}, of {', '.join(residuals) or 'no kind'}"
                )
            if message.frame < frames:
                residuals[kind.name][message.frame] = kind.values
    return residuals


def report_of(message: SolveReportMessage) -> SolveReport:
    """The report of a message."""
    iterations = tuple(Iteration(one.cost, one.damping, one.accepted, dict(one.seconds)) for one in message.iterations)
    return SolveReport(
        message.stage,
        iterations,
        dict(message.initial_cost),
        dict(message.final_cost),
        message.converged,
        message.seconds,
    )
