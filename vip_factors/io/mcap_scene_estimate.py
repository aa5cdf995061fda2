"""The estimate of a scene as an MCAP file: every wearer's as an estimate of its own, the camera's, who is who.

One wearer's topics are those of a plain estimate, so that each can be read as the other.
"""

import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from vip_factors.errors import FileFormatError, InputError
from vip_factors.estimate import CameraEstimate, Estimate
from vip_factors.geometry.quaternions import Order, matrix_from_quaternion, quaternion_from_matrix
from vip_factors.geometry.rotations import Array
from vip_factors.io.mcap_camera import intrinsics_message, intrinsics_of, path_messages
from vip_factors.io.mcap_estimate import (
    ESTIMATE,
    SINGLE,
    check_residuals,
    estimate_file,
    estimate_messages,
    estimate_of,
    report_message,
    report_of,
)
from vip_factors.io.mcap_messages import (
    calibration_message,
    calibration_of,
    detector_message,
    detector_of,
    naming,
    of_topic,
    set_timestamp,
    vector_message,
    warn,
)
from vip_factors.io.mcap_reader import McapContents, McapMessages, read_contents
from vip_factors.io.mcap_recording import wearer_topics
from vip_factors.io.mcap_writer import MessageWriter, TimedMessage, nanoseconds
from vip_factors.io.schemas.calibration_estimate_pb2 import CalibrationEstimate
from vip_factors.io.schemas.camera_estimate_pb2 import CameraEstimateInfo, CameraPose, CameraResiduals
from vip_factors.io.schemas.geometry_pb2 import QuaternionWxyz
from vip_factors.io.schemas.place_estimates_pb2 import DetectorEstimate as DetectorEstimateMessage
from vip_factors.io.schemas.scene_estimate_pb2 import SceneEstimateInfo
from vip_factors.io.schemas.solve_report_pb2 import SolveReport as SolveReportMessage
from vip_factors.sensors.camera_path import CameraPath

INFO, REPORT, WEARER = "/estimate/scene/info", "/estimate/scene/report", "/estimate/wearer/"
DETECTOR = "/estimate/detector"
CAMERA_INFO, INTRINSICS = "/estimate/camera/info", "/estimate/camera/intrinsics"
CALIBRATION, CAMERA_RESIDUALS = "/estimate/camera/calibration", "/estimate/camera/residuals"
CAMERA_POSE = "/estimate/camera/pose"
CAMERA_PATH = "/estimate/camera/path"  # the same for viewers; never read back


def write_scene_estimate(
    estimate: Estimate,
    path: str | os.PathLike[str],
    overwrite: bool = False,
    append_to: str | os.PathLike[str] | None = None,
    scene: bool | None = None,
    start_ns: int = 0,
) -> None:
    """Write the estimate of a scene; rotations become quaternions, everything else is kept to the bit.

    Args:
        estimate: what to write.
        path: of the new file.
        overwrite: whether an existing file may be replaced.
        append_to: an MCAP scene or recording: the new file then holds everything in it, and the estimate after it.
        scene: whether to add the moving skeletons as Foxglove's messages; None: if they are small.
        start_ns: absolute time of t = 0; taken from the recording with ``append_to``.

    Raises:
        InputError: as :func:`~vip_factors.io.mcap_estimate.write_estimate`.
        FileFormatError: likewise.
    """
    for one in estimate.wearers:
        check_residuals(one)
    if not estimate.wearers:
        raise InputError(f"estimate '{estimate.name}' has no wearer: expected at least one")
    prefixes = wearer_prefixes(estimate)
    with estimate_file(path, overwrite, append_to, start_ns) as (writer, start_ns):
        writer.write(INFO, scene_info_message(estimate, prefixes, start_ns), start_ns)
        for report in estimate.reports:
            writer.write(REPORT, report_message(report), start_ns)
        if estimate.detector is not None:
            writer.write(DETECTOR, detector_message(estimate.detector), start_ns)
        streams: list[Iterable[TimedMessage]] = []
        if estimate.camera is not None:
            streams += _camera_messages(writer, estimate.camera, estimate.wearers[0].motion.time, start_ns)
        for prefix, one in zip(prefixes, estimate.wearers, strict=True):
            streams += estimate_messages(writer, one, start_ns, scene, prefix)
        writer.flush()
        writer.add_in_order(*streams)


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


def wearer_prefixes(estimate: Estimate) -> list[str]:
    """What each wearer's topics begin with: the motion's name, or where two have the same, their numbers."""
    names = [one.motion.name for one in estimate.wearers]
    if len(set(names)) < len(names):
        names = [str(number) for number in range(len(names))]
    return wearer_topics(names, SINGLE, WEARER)


def _camera_messages(
    writer: MessageWriter, camera: CameraEstimate, motion_time: Array, start_ns: int
) -> list[Iterable[TimedMessage]]:
    residual = camera.residual_px
    write_camera(writer, camera, len(camera.path), 0 if residual is None else len(residual), start_ns)
    streams = camera_path_messages(writer, camera, start_ns)
    if residual is not None:
        time = next((one for one in (camera.path.time, motion_time) if len(one) == len(residual)), motion_time[:1])
        streams.append(camera_residual_messages(writer, residual, np.resize(time, len(residual)), start_ns))
    return streams


def write_camera(writer: MessageWriter, camera: CameraEstimate, poses: int, frames: int, start_ns: int) -> None:
    """What comes once of a camera of which so many poses, and residuals of so many frames, will come in time."""
    residual = camera.residual_px
    info = CameraEstimateInfo(
        name=camera.name,
        time_offset_s=camera.time_offset,
        time_drift=camera.time_drift,
        clock_sigma=camera.clock_sigma,
        poses=poses,
        has_residuals=residual is not None,
        wearers=residual.shape[1] if residual is not None else 0,
        residual_frames=frames if residual is not None else 0,
    )
    writer.write(CAMERA_INFO, info, start_ns)
    writer.write(INTRINSICS, intrinsics_message(camera.model, camera.name, start_ns), start_ns)
    if camera.calibration is not None:
        writer.write(CALIBRATION, calibration_message({camera.name: camera.calibration}), start_ns)


def camera_path_messages(
    writer: MessageWriter, camera: CameraEstimate, start_ns: int, first: int = 0
) -> list[Iterable[TimedMessage]]:
    """A camera's poses, the first of which has the number ``first``; and the same for viewers."""
    return [
        camera_pose_messages(writer, CAMERA_POSE, camera.path, start_ns, camera.covariance, first),
        path_messages(writer, CAMERA_PATH, camera.path, start_ns),
    ]


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


def camera_residual_messages(
    writer: MessageWriter, residual: Array, time: Array, start_ns: int, first: int = 0
) -> Iterator[TimedMessage]:
    """Reprojection errors ``(T, wearers)`` of frames at ``time`` ``(T,)``, numbered from ``first`` on."""
    channel = writer.channel(CAMERA_RESIDUALS, CameraResiduals)
    for row, time_ns in enumerate(nanoseconds(time, start_ns)):
        message = CameraResiduals(frame=first + row, pixels=residual[row])
        set_timestamp(message.timestamp, time_ns)
        yield time_ns, channel, message.SerializeToString()


def read_scene_estimate(path: str | os.PathLike[str]) -> Estimate:
    """Read the estimate of a scene, or a plain estimate as that of a scene with one wearer without a camera.

    Of a file that was cut off, every whole frame before the cut is read, and a
    :class:`~vip_factors.io.mcap_reader.McapWarning` says so.

    Raises:
        InputError: if there is no such file.
        FileFormatError: if it is no MCAP file or holds no estimate.
    """
    contents = read_contents(path, lambda channel: channel.topic.startswith(ESTIMATE))
    messages = [one for one in contents.messages.values() if one.channel.topic.startswith(ESTIMATE) and one.data]
    infos = of_topic(contents.path, messages, INFO, SceneEstimateInfo)
    with naming(contents.path):
        if not infos:
            single = estimate_of(contents, messages)
            return Estimate(single.name, single.method, (single,), settings=single.settings)
        info = infos[-1]
        reports = of_topic(contents.path, messages, REPORT, SolveReportMessage)
        detectors = of_topic(contents.path, messages, DETECTOR, DetectorEstimateMessage)
        return Estimate(
            name=info.name,
            method=info.method,
            wearers=tuple(estimate_of(contents, messages, one) for one in info.wearer_topics),
            camera=_camera(contents, messages),
            wearer_of_detection=np.array(info.wearer_of_detection, dtype=int),
            association=tuple(info.association),
            reports=tuple(report_of(one) for one in reports),
            findings=tuple(info.findings),
            settings=dict(info.settings),
            detector=detector_of(detectors[-1]) if detectors else None,
        )


def _camera(contents: McapContents, messages: Sequence[McapMessages]) -> CameraEstimate | None:
    from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration

    path = contents.path
    infos = of_topic(path, messages, CAMERA_INFO, CameraEstimateInfo)
    if not infos:
        return None
    info = infos[-1]
    intrinsics = of_topic(path, messages, INTRINSICS, CameraCalibration)
    poses = of_topic(path, messages, CAMERA_POSE, CameraPose)
    if not intrinsics or not poses:
        warn(path, f"camera '{info.name}' is left out: nothing on {CAMERA_POSE if intrinsics else INTRINSICS}")
        return None
    if len(poses) < info.poses:
        warn(path, f"camera '{info.name}': {len(poses)} of {info.poses} poses are left")
    calibrations = of_topic(path, messages, CALIBRATION, CalibrationEstimate)
    return CameraEstimate(
        name=info.name,
        model=intrinsics_of(intrinsics[-1]),
        path=_path(poses),
        calibration=next(iter(calibration_of(calibrations[-1]).values()), None) if calibrations else None,
        covariance=_covariance(poses),
        residual_px=_residuals(path, info, of_topic(path, messages, CAMERA_RESIDUALS, CameraResiduals)),
        time_offset=info.time_offset_s,
        time_drift=info.time_drift,
        clock_sigma=(info.clock_sigma[0], info.clock_sigma[1]) if len(info.clock_sigma) == 2 else None,
    )


def _path(poses: Sequence[CameraPose]) -> CameraPath:
    turns = [one.rotation_wxyz for one in poses]
    places = [one.p_world_camera for one in poses]
    return CameraPath(
        np.array([one.seconds for one in poses]),
        matrix_from_quaternion([(q.w, q.x, q.y, q.z) for q in turns], Order.WXYZ),
        np.array([(p.x, p.y, p.z) for p in places]),
    )


def _covariance(poses: Sequence[CameraPose]) -> Array | None:
    """``(T, 6, 6)`` if all poses have one."""
    if not all(len(one.covariance) == 36 for one in poses):
        return None
    return np.array([one.covariance for one in poses]).reshape(-1, 6, 6)


MOST_RESIDUALS = 20_000_000  # nine hours at 60 Hz, of ten wearers


def _residuals(path: Path, info: CameraEstimateInfo, messages: Sequence[CameraResiduals]) -> Array | None:
    """``(T, wearers)``; NaN where a frame's message is lost."""
    if not info.has_residuals:
        return None
    if info.residual_frames * info.wearers > MOST_RESIDUALS:
        raise FileFormatError(
            f"{path}: tells of reprojection errors in {info.residual_frames} frames of {info.wearers} wearers: "
            f"expected {MOST_RESIDUALS:,} at most; the file is damaged, copy it again"
        )
    residual = np.full((info.residual_frames, info.wearers), np.nan)
    for message in messages:
        if len(message.pixels) != info.wearers or message.frame >= len(residual):
            raise FileFormatError(
                f"{path}: frame {message.frame} has {len(message.pixels)} reprojection errors: expected "
                f"{info.wearers}, in frames 0 to {len(residual) - 1}"
            )
        residual[message.frame] = message.pixels
    return residual
