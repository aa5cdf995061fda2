"""Estimates written part by part as they are made: what is in memory is one part of each wearer's."""

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import zip_longest

from vip_factors.atomic import atomic_open
from vip_factors.estimate import Estimate, EstimatePart, LongEstimate
from vip_factors.io.mcap_estimate import (
    BODY,
    CALIBRATION,
    INFO,
    MOTION,
    POINTS,
    POSE,
    REPORT,
    RESIDUALS,
    SCENE,
    SENSOR_PLACES,
    SINGLE,
    TRANSFORMS,
    info_message,
    report_message,
    residual_messages,
)
from vip_factors.io.mcap_messages import (
    body_message,
    calibration_message,
    motion_message,
    pose_messages,
    sensor_places_message,
)
from vip_factors.io.mcap_recording import wearer_topics
from vip_factors.io.mcap_scene import point_messages, scene_wanted, shown_step, skeleton_scene, transform_messages
from vip_factors.io.mcap_scene_estimate import INFO as SCENE_INFO
from vip_factors.io.mcap_scene_estimate import WEARER, scene_info_message
from vip_factors.io.mcap_writer import MessageWriter, TimedMessage

CHUNK_BYTES = 1 << 20  # the index in memory has an entry for each chunk


def write_long_estimate(
    scene: Estimate,
    estimates: Sequence[LongEstimate],
    path: str | os.PathLike[str],
    overwrite: bool = False,
    start_ns: int = 0,
) -> None:
    """Write the estimates of wearers whom no camera saw, under a temporary name until all parts are written.

    Args:
        scene: that all wearers are in; of one wearer the file is a plain estimate.
        estimates: of the wearers; their parts are made here.
        path: of the new file.
        overwrite: whether an existing file may be replaced.
        start_ns: absolute time of t = 0.

    Raises:
        InputError: if the file exists and may not be overwritten, or cannot be written there.
        RecordingError, SolveError: of the parts.
    """
    names = [one.head.motion.name for one in estimates]
    prefixes = wearer_topics(
        names if len(set(names)) == len(names) else [str(n) for n in range(len(names))], SINGLE, WEARER
    )
    with atomic_open(path, "wb", overwrite) as file, MessageWriter(file, CHUNK_BYTES) as writer:
        if len(estimates) > 1:
            writer.write(SCENE_INFO, scene_info_message(scene, prefixes, start_ns), start_ns)
        wearers = [WearerWriter(writer, one, prefix, start_ns) for one, prefix in zip(estimates, prefixes, strict=True)]
        for parts in zip_longest(*(one.parts for one in estimates)):
            streams = [
                stream
                for wearer, part in zip(wearers, parts, strict=True)
                if part is not None
                for stream in wearer.streams(part)
            ]
            writer.add_in_order(*streams)


class WearerWriter:
    """One wearer's topics; what comes once is written at the start."""

    def __init__(self, writer: MessageWriter, estimate: LongEstimate, prefix: str, start_ns: int) -> None:
        self._writer, self._prefix, self._start_ns = writer, prefix, start_ns
        head = estimate.head
        motion = motion_message(head.motion)
        motion.frames = estimate.frames
        writer.write(prefix + INFO, info_message(head, start_ns), start_ns)
        writer.write(prefix + MOTION, motion, start_ns)
        writer.write(prefix + CALIBRATION, calibration_message(head.calibration), start_ns)
        if head.body is not None:
            writer.write(prefix + BODY, body_message(head.body), start_ns)
        if head.sensor_places:
            writer.write(prefix + SENSOR_PLACES, sensor_places_message(head.sensor_places), start_ns)
        for report in head.reports:
            writer.write(prefix + REPORT, report_message(report), start_ns)
        self._shown = scene_wanted(None, head.motion, estimate.frames)
        self._name = head.motion.name if prefix == SINGLE else prefix.rpartition("/")[2]
        if self._shown:
            writer.write(prefix + SCENE, skeleton_scene(replace(head.motion, name=self._name)), start_ns)
        writer.flush()

    def streams(self, part: EstimatePart) -> Iterator[Iterable[TimedMessage]]:
        """The messages of a part."""
        writer, prefix, start_ns, motion = self._writer, self._prefix, self._start_ns, part.motion
        yield pose_messages(writer, prefix + POSE, motion, start_ns, part.covariance, part.first)
        if part.residuals:
            yield residual_messages(writer, prefix + RESIDUALS, motion.time, part.residuals, start_ns, part.first)
        if self._shown:
            shown = replace(motion.frames(slice(-part.first % shown_step(motion), None)), name=self._name)
            yield transform_messages(writer, prefix + TRANSFORMS, shown, start_ns)
            yield point_messages(writer, prefix + POINTS, shown, start_ns)
        at = start_ns + int(1e9 * motion.start)
        for report in part.reports:
            writer.write(prefix + REPORT, report_message(report), at)
