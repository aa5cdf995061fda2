"""An estimate in an MCAP file: what its topics and messages are, and how it is read.

Every wearer has the same topics, below a prefix of their own where there are several. What the estimate is as a whole,
the camera's and who is who stand beside them; an estimate of one wearer whom no camera saw needs none of that.
"""

import os
import warnings
from itertools import starmap, zip_longest
from typing import Any

from vip_factors.errors import FileFormatError
from vip_factors.estimate import CameraEstimate, Estimate, WearerEstimate
from vip_factors.findings import TEXT, bare, sentences
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
from vip_factors.io.mcap_messages import Topics, is_ours, naming, warn
from vip_factors.io.mcap_reader import McapChannel, McapContents, read_contents, read_few
from vip_factors.io.schemas.body_pose_pb2 import BodyPose
from vip_factors.io.schemas.camera_estimate_pb2 import CameraEstimateInfo, CameraPose
from vip_factors.io.schemas.estimate_info_pb2 import EstimateInfo, Residuals

ESTIMATE = "/estimate/"
SINGLE = "/estimate"  # what the topics of one wearer's estimate begin with, if there is but one
WEARER = "/estimate/wearer/"  # and if there are several; a name follows
# Below each wearer's prefix.
INFO, CALIBRATION, REPORT, POSE, RESIDUALS = "/info", "/calibration", "/report", "/pose", "/residuals"
TRANSFORMS = "/tf"  # for viewers; never read back
# Of the whole.
SCENE_INFO, SCENE_REPORT = "/estimate/scene/info", "/estimate/scene/report"
CAMERA_INFO, INTRINSICS = "/estimate/camera/info", "/estimate/camera/intrinsics"
CAMERA_CALIBRATION, CAMERA_RESIDUALS = "/estimate/camera/calibration", "/estimate/camera/residuals"
CAMERA_POSE = "/estimate/camera/pose"
CAMERA_PATH = "/estimate/camera/path"  # the same for viewers; never read back
RECORDING_INFO = "/recording/info"

HEAD = DataclassCodec(
    EstimateInfo,
    WearerEstimate,
    {"start": "start_ns", "start_choice": "start", "motion": "motion_info"},
    more=lambda estimate: {"residual_kinds": list(estimate.residuals)} | _findings(estimate),
    mend=lambda message, read: read | _findings_of(message),
)
"""An estimate of a wearer without its frames; the absolute time of its t = 0 and the motion's message are given."""
SCENE_HEAD = DataclassCodec(
    EstimateInfo,
    Estimate,
    {"start": "start_ns"},
    more=lambda estimate: _findings(estimate),
    mend=lambda message, read: read | _findings_of(message),
)
"""What an estimate is as a whole; its start and what its wearers' topics begin with are given."""
CAMERA_HEAD = DataclassCodec(
    CameraEstimateInfo,
    CameraEstimate,
    {"time_offset_s": "time_offset"},
    mend=lambda message, read: read | _clock(message),
)
"""What a camera's estimate is; how many poses and residuals there are is given."""


def _findings(estimate: WearerEstimate | Estimate) -> dict[str, Any]:
    """Sentences for every reader, and beside each its kind."""
    return {"findings": sentences(estimate.findings), "finding_kinds": [finding.kind for finding in estimate.findings]}


def _findings_of(message: EstimateInfo) -> dict[str, Any]:
    kinds = message.finding_kinds[: len(message.findings)]
    return {"findings": tuple(starmap(bare, zip_longest(message.findings, kinds, fillvalue=TEXT)))}


def _clock(message: CameraEstimateInfo) -> dict[str, Any]:
    sigma = tuple(message.clock_sigma)
    return {"clock_sigma": sigma if len(sigma) == 2 else None}


def is_read(channel: McapChannel) -> bool:
    """Whether a channel is of an estimate, and not for viewers alone."""
    shown = channel.topic.endswith((TRANSFORMS, CAMERA_PATH))
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
    topics = Topics(contents)
    info = topics.last(SCENE_INFO, EstimateInfo)
    with naming(contents.path):
        if info is None:
            return Estimate.of_one(_wearer_of(contents))
        return Estimate(
            wearers=tuple(_wearer_of(contents, prefix) for prefix in info.wearer_topics),
            camera=_camera(topics),
            reports=topics.objects(SCENE_REPORT, codecs.REPORT),
            **SCENE_HEAD.values(info),
        )


def read_head(path: str | os.PathLike[str]) -> tuple[Estimate, int]:
    """What an estimate says of the whole, without its frames, and how many these are, of all wearers.

    Raises:
        InputError, FileFormatError: as :func:`read_estimate`.
    """
    left_out = (POSE, RESIDUALS, CAMERA_POSE, CAMERA_INFO)
    contents = read_few(path, lambda channel: is_read(channel) and not channel.topic.endswith(left_out))
    with warnings.catch_warnings():  # that frames are missing
        warnings.simplefilter("ignore")
        head = read_estimate(contents)
    topics = Topics(contents)
    infos = [topics.last(topic, EstimateInfo) for topic in contents.topics if topic.endswith(INFO)]
    return head, sum(info.motion.frames for info in infos if info is not None)


def read_start(path: str | os.PathLike[str]) -> int:
    """Absolute time in nanoseconds of an estimate's t = 0; 0 if it is not known."""
    contents = read_few(path, lambda channel: channel.topic.startswith(ESTIMATE) and is_ours(channel, EstimateInfo))
    topics = Topics(contents)
    infos = [info for topic in contents.topics if topic.endswith(INFO) for info in topics.all(topic, EstimateInfo)]
    return time_ns_of(infos[0].start) if infos else 0


def _wearer_of(contents: McapContents, prefix: str = SINGLE) -> WearerEstimate:
    """One wearer's estimate, of the messages below the topic ``prefix``.

    Raises:
        FileFormatError: if it is not there.
    """
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
        calibration=topics.object(CALIBRATION, codecs.CALIBRATION) or {},
        residuals=residuals_of(info.residual_kinds, len(info.sensors), topics.all(RESIDUALS, Residuals), len(motion)),
        reports=topics.objects(REPORT, codecs.REPORT),
        **HEAD.values(info),
    )


def _camera(topics: Topics) -> CameraEstimate | None:
    from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration

    path, info = topics.path, topics.last(CAMERA_INFO, CameraEstimateInfo)
    if info is None:
        return None
    intrinsics, poses = topics.last(INTRINSICS, CameraCalibration), topics.all(CAMERA_POSE, CameraPose)
    if intrinsics is None or not poses:
        lacking = INTRINSICS if intrinsics is None else CAMERA_POSE
        warn(path, f"camera '{info.name}' is left out: nothing on {lacking}")
        return None
    if len(poses) < info.poses:
        warn(path, f"camera '{info.name}': {len(poses)} of {info.poses} poses are left")
    calibration = topics.object(CAMERA_CALIBRATION, codecs.CALIBRATION) or {}
    return CameraEstimate(
        model=intrinsics_of(intrinsics),
        path=camera_path_of(poses),
        calibration=next(iter(calibration.values()), None),
        covariance=camera_covariance_of(poses),
        residual_px=camera_residuals_of(path, info, topics.all(CAMERA_RESIDUALS, Residuals)),
        **CAMERA_HEAD.values(info),
    )
