"""How a live estimate's calibrations changed while the stream ran: its file keeps them twice a second or more often."""

import os

import numpy as np

from vip_factors.geometry.rotations import Array
from vip_factors.io import mcap_messages as codecs
from vip_factors.io.mcap_estimate import CALIBRATION, ESTIMATE, MOTION, POSE, SCENE_INFO, SINGLE
from vip_factors.io.mcap_messages import objects_of_topic, of_topic
from vip_factors.io.mcap_reader import read_contents
from vip_factors.io.schemas.body_pose_pb2 import BodyPose, MotionInfo
from vip_factors.io.schemas.scene_estimate_pb2 import SceneEstimateInfo
from vip_factors.sensors.calibration import Calibration

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
        told = of_topic(contents.path, [poses], topic + POSE, BodyPose) if poses is not None else []
        if said is None or poses is None or not motions or not told:
            histories.append((np.zeros(0), []))
            continue
        first_s = motions[-1].start_s + told[0].frame / motions[-1].rate_hz
        start_ns = poses.log_times[0] - round(first_s * 1e9)
        found = objects_of_topic(contents.path, [said], topic + CALIBRATION, codecs.CALIBRATION)
        times = (np.array(said.log_times, dtype=np.int64) - start_ns) / 1e9
        histories.append((times, list(found)))
    return histories
