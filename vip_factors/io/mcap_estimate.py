"""An estimate in an MCAP file: what its topics and messages are, and how it is read.

Every wearer has the same topics, below a prefix of their own where there are several. What the estimate is as a whole,
the camera's and who is who stand beside them; an estimate of one wearer whom no camera saw needs none of that.
"""

import os
from collections.abc import Sequence
from typing import Any

import numpy as np

from vip_factors.errors import FileFormatError
from vip_factors.estimate import CameraEstimate, Estimate, StartChoice, WearerEstimate
from vip_factors.geometry.rotations import Array
from vip_factors.io import mcap_messages as codecs
from vip_factors.io.codec import DataclassCodec, time_ns_of
from vip_factors.io.mcap_camera import intrinsics_of
from vip_factors.io.mcap_frames import (
    camera_covariance_of,
    camera_path_of,
    camera_residuals_of,
    motion_of,
    residuals_of,
)
from vip_factors.io.mcap_messages import is_ours, last_of_topic, naming, objects_of_topic, of_topic, warn
from vip_factors.io.mcap_reader import McapContents, McapMessages, read_contents
from vip_factors.io.mcap_records import McapChannel
from vip_factors.io.schemas.body_pose_pb2 import BodyPose, MotionInfo
from vip_factors.io.schemas.camera_estimate_pb2 import CameraEstimateInfo, CameraPose, CameraResiduals
from vip_factors.io.schemas.estimate_info_pb2 import EstimateInfo
from vip_factors.io.schemas.estimate_info_pb2 import StartChoice as StartChoiceMessage
from vip_factors.io.schemas.residuals_pb2 import Residuals
from vip_factors.io.schemas.scene_estimate_pb2 import SceneEstimateInfo
from vip_factors.sensors.calibration import Calibration

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

START_CHOICE = DataclassCodec(StartChoiceMessage, StartChoice)
HEAD = DataclassCodec(
    EstimateInfo,
    WearerEstimate,
    {"start": "start_ns", "start_choice": "start"},
    more=lambda estimate: {"residual_kinds": list(estimate.residuals)},
)
"""What an estimate of a wearer is; the absolute time of its t = 0 is given."""
SCENE_HEAD = DataclassCodec(SceneEstimateInfo, Estimate, {"start": "start_ns"})
"""What an estimate is as a whole; its start and what its wearers' topics begin with are given."""
CAMERA_HEAD = DataclassCodec(
    CameraEstimateInfo,
    CameraEstimate,
    {"time_offset_s": "time_offset"},
    mend=lambda message, read: read | _clock(message),
)
"""What a camera's estimate is; how many poses and residuals there are is given."""


def _clock(message: CameraEstimateInfo) -> dict[str, Any]:
    sigma = tuple(message.clock_sigma)
    return {"clock_sigma": sigma if len(sigma) == 2 else None}


def is_read(channel: McapChannel) -> bool:
    """Whether a channel is of an estimate, and not for viewers alone."""
    shown = channel.topic.endswith((TRANSFORMS, SCENE, POINTS, CAMERA_PATH))
    return channel.topic.startswith(ESTIMATE) and not shown


def read_estimate(path: str | os.PathLike[str] | McapContents) -> Estimate:
    """Read an estimate, from a file of its own or from one that also holds the recording; or of what was read of it.

    Of a file that was cut off, every whole frame before the cut is read, and a
    :class:`~vip_factors.io.mcap_reader.McapWarning` says so.

    Raises:
        InputError: if there is no such file.
        FileFormatError: if it is no MCAP file or holds no estimate.
    """
    contents = read_contents(path, is_read)
    messages = [one for one in contents.messages.values() if one.channel.topic.startswith(ESTIMATE) and one.data]
    infos = of_topic(contents.path, messages, SCENE_INFO, SceneEstimateInfo)
    with naming(contents.path):
        if not infos:
            return Estimate.of_one(_wearer_of(contents, messages))
        info = infos[-1]
        return Estimate(
            wearers=tuple(_wearer_of(contents, messages, one) for one in info.wearer_topics),
            camera=_camera(contents, messages),
            reports=objects_of_topic(contents.path, messages, SCENE_REPORT, codecs.REPORT),
            detector=last_of_topic(contents.path, messages, DETECTOR, codecs.DETECTOR),
            **SCENE_HEAD.values(info),
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
    motion, covariance = motion_of(path, motions[-1], of_topic(path, ours, prefix + POSE, BodyPose))
    return WearerEstimate(
        motion=motion,
        covariance=covariance,
        calibration=last_of_topic(path, ours, prefix + CALIBRATION, codecs.CALIBRATION) or {},
        residuals=residuals_of(info, of_topic(path, ours, prefix + RESIDUALS, Residuals), len(motion)),
        reports=objects_of_topic(path, ours, prefix + REPORT, codecs.REPORT),
        body=last_of_topic(path, ours, prefix + BODY, codecs.BODY),
        sensor_places=last_of_topic(path, ours, prefix + SENSOR_PLACES, codecs.SENSOR_PLACES) or (),
        **HEAD.values(info),
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
    calibration = last_of_topic(path, messages, CAMERA_CALIBRATION, codecs.CALIBRATION) or {}
    return CameraEstimate(
        model=intrinsics_of(intrinsics[-1]),
        path=camera_path_of(poses),
        calibration=next(iter(calibration.values()), None),
        covariance=camera_covariance_of(poses),
        residual_px=camera_residuals_of(path, info, of_topic(path, messages, CAMERA_RESIDUALS, CameraResiduals)),
        **CAMERA_HEAD.values(info),
    )


CalibrationHistory = tuple[Array, list[Calibration]]
"""Times ``(n,)`` in seconds from the recording's start, and the calibration believed from each of them on."""


def read_calibration_history(path: str | os.PathLike[str]) -> list[CalibrationHistory]:
    """The calibrations of each wearer of an estimate, in the order of time; one entry where it was solved as a whole.

    Raises:
        InputError, FileFormatError: if the file cannot be read.
    """
    wanted = (CALIBRATION, POSE, MOTION, SCENE_INFO)
    contents = read_contents(
        path, lambda channel: channel.topic.startswith(ESTIMATE) and channel.topic.endswith(wanted)
    )
    messages = {one.channel.topic: one for one in contents.messages.values() if one.data}
    infos = of_topic(contents.path, list(messages.values()), SCENE_INFO, SceneEstimateInfo)
    histories: list[CalibrationHistory] = []
    for topic in list(infos[-1].wearer_topics) if infos else [SINGLE]:
        said, poses = messages.get(topic + CALIBRATION), messages.get(topic + POSE)
        motions = of_topic(contents.path, list(messages.values()), topic + MOTION, MotionInfo)
        frames = of_topic(contents.path, [poses], topic + POSE, BodyPose) if poses is not None else []
        if said is None or poses is None or not motions or not frames:
            histories.append((np.zeros(0), []))
            continue
        first_s = motions[-1].start_s + frames[0].frame / motions[-1].rate_hz
        start_ns = poses.log_times[0] - round(first_s * 1e9)
        found = objects_of_topic(contents.path, [said], topic + CALIBRATION, codecs.CALIBRATION)
        times = (np.array(said.log_times, dtype=np.int64) - start_ns) / 1e9
        histories.append((times, list(found)))
    return histories
