"""An estimate in an MCAP file: what its topics and messages are, and how it is read.

Every wearer has the same topics, below a prefix of their own where there are several. What the estimate is as a whole,
the camera's and who is who stand beside them; an estimate of one wearer whom no camera saw needs none of that.
"""

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vip_factors.errors import FileFormatError
from vip_factors.estimate import CameraEstimate, Estimate, Iteration, SolveReport, StartChoice, WearerEstimate
from vip_factors.geometry.quaternions import Order, matrix_from_quaternion
from vip_factors.geometry.rotations import Array
from vip_factors.io.mcap_camera import intrinsics_of
from vip_factors.io.mcap_messages import (
    body_of,
    calibration_of,
    detector_of,
    is_ours,
    motion_of,
    naming,
    of_topic,
    sensor_places_of,
    tell_lost_frames,
    time_ns_of,
    warn,
)
from vip_factors.io.mcap_reader import McapContents, McapMessages, read_contents
from vip_factors.io.schemas.body_estimate_pb2 import BodyEstimate as BodyEstimateMessage
from vip_factors.io.schemas.body_pose_pb2 import BodyPose, MotionInfo
from vip_factors.io.schemas.calibration_estimate_pb2 import CalibrationEstimate
from vip_factors.io.schemas.camera_estimate_pb2 import CameraEstimateInfo, CameraPose, CameraResiduals
from vip_factors.io.schemas.estimate_info_pb2 import EstimateInfo
from vip_factors.io.schemas.place_estimates_pb2 import DetectorEstimate as DetectorEstimateMessage
from vip_factors.io.schemas.place_estimates_pb2 import SensorPlaceEstimates
from vip_factors.io.schemas.residuals_pb2 import Residuals
from vip_factors.io.schemas.scene_estimate_pb2 import SceneEstimateInfo
from vip_factors.io.schemas.solve_report_pb2 import SolveReport as SolveReportMessage
from vip_factors.sensors.camera_path import CameraPath

ESTIMATE = "/estimate/"
SINGLE = "/estimate"  # what the topics of one wearer's estimate begin with, if there is but one
WEARER = "/estimate/wearer/"  # and if there are several; a name follows
# Below each wearer's prefix.
INFO, CALIBRATION, REPORT, MOTION, POSE = "/info", "/calibration", "/report", "/motion", "/pose"
BODY, SENSOR_PLACES, RESIDUALS = "/body", "/sensor_places", "/residuals"
TRANSFORMS, SCENE, POINTS = "/tf", "/skeleton", "/points"
# Of the whole.
SCENE_INFO, SCENE_REPORT, DETECTOR = "/estimate/scene/info", "/estimate/scene/report", "/estimate/detector"
CAMERA_INFO, INTRINSICS = "/estimate/camera/info", "/estimate/camera/intrinsics"
CAMERA_CALIBRATION, CAMERA_RESIDUALS = "/estimate/camera/calibration", "/estimate/camera/residuals"
CAMERA_POSE = "/estimate/camera/pose"
CAMERA_PATH = "/estimate/camera/path"  # the same for viewers; never read back
RECORDING_INFO = "/recording/info"
MOST_RESIDUALS = 20_000_000  # nine hours at 60 Hz, of ten wearers


def read_estimate(path: str | os.PathLike[str]) -> Estimate:
    """Read an estimate, from a file of its own or from one that also holds the recording.

    Of a file that was cut off, every whole frame before the cut is read, and a
    :class:`~vip_factors.io.mcap_reader.McapWarning` says so.

    Raises:
        InputError: if there is no such file.
        FileFormatError: if it is no MCAP file or holds no estimate.
    """
    contents = read_contents(path, lambda channel: channel.topic.startswith(ESTIMATE))
    messages = [one for one in contents.messages.values() if one.channel.topic.startswith(ESTIMATE) and one.data]
    infos = of_topic(contents.path, messages, SCENE_INFO, SceneEstimateInfo)
    with naming(contents.path):
        if not infos:
            return Estimate.of_one(_wearer_of(contents, messages))
        info = infos[-1]
        reports = of_topic(contents.path, messages, SCENE_REPORT, SolveReportMessage)
        detectors = of_topic(contents.path, messages, DETECTOR, DetectorEstimateMessage)
        return Estimate(
            name=info.name,
            method=info.method,
            wearers=tuple(_wearer_of(contents, messages, one) for one in info.wearer_topics),
            camera=_camera(contents, messages),
            wearer_of_detection=np.array(info.wearer_of_detection, dtype=int),
            association=tuple(info.association),
            reports=tuple(report_of(one) for one in reports),
            findings=tuple(info.findings),
            settings=dict(info.settings),
            detector=detector_of(detectors[-1]) if detectors else None,
        )


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


def _wearer_of(contents: McapContents, messages: Sequence[McapMessages], prefix: str = SINGLE) -> WearerEstimate:
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
        raise FileFormatError(
            f"{path}: expected an estimate, with topics {prefix + INFO} and {prefix + MOTION}; "
            f"found topics {topics}{damage}"
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
        residuals=_wearer_residuals(info, of_topic(path, ours, prefix + RESIDUALS, Residuals), len(motion)),
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


def _wearer_residuals(info: EstimateInfo, messages: Sequence[Residuals], frames: int) -> dict[str, Array]:
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
    calibrations = of_topic(path, messages, CAMERA_CALIBRATION, CalibrationEstimate)
    return CameraEstimate(
        name=info.name,
        model=intrinsics_of(intrinsics[-1]),
        path=_path(poses),
        calibration=next(iter(calibration_of(calibrations[-1]).values()), None) if calibrations else None,
        covariance=_covariance(poses),
        residual_px=_camera_residuals(path, info, of_topic(path, messages, CAMERA_RESIDUALS, CameraResiduals)),
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


def _camera_residuals(path: Path, info: CameraEstimateInfo, messages: Sequence[CameraResiduals]) -> Array | None:
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
