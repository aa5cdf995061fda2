"""The estimate of a filmed scene written part by part as it is made: what is in memory is one part.

What is known of the whole at its end alone (who is who, findings, headings over time) is written then, once more on the
topics that had it at the beginning: a reader takes the last of each.
"""

import os
from collections.abc import Iterable

from vip_factors.atomic import atomic_open
from vip_factors.estimate import LongEstimate, LongSceneEstimate, ScenePart
from vip_factors.io.mcap_estimate import CALIBRATION, report_message
from vip_factors.io.mcap_long_estimate import CHUNK_BYTES, WearerWriter
from vip_factors.io.mcap_messages import calibration_message, detector_message
from vip_factors.io.mcap_scene_estimate import (
    DETECTOR,
    INFO,
    REPORT,
    camera_path_messages,
    camera_residual_messages,
    scene_info_message,
    wearer_prefixes,
    write_camera,
)
from vip_factors.io.mcap_writer import NS_PER_S, MessageWriter, TimedMessage


def write_long_scene_estimate(
    estimate: LongSceneEstimate, path: str | os.PathLike[str], overwrite: bool = False, start_ns: int = 0
) -> None:
    """Write the estimate of a scene, under a temporary name until all parts are written.

    Args:
        estimate: its parts are made here.
        path: of the new file.
        overwrite: whether an existing file may be replaced.
        start_ns: absolute time of t = 0.

    Raises:
        InputError: if the file exists and may not be overwritten, or cannot be written there.
        RecordingError, SolveError: of the parts.
    """
    head = estimate.head
    prefixes = wearer_prefixes(head)
    with atomic_open(path, "wb", overwrite) as file, MessageWriter(file, CHUNK_BYTES) as writer:
        writer.write(INFO, scene_info_message(head, prefixes, start_ns), start_ns)
        for report in head.reports:
            writer.write(REPORT, report_message(report), start_ns)
        if head.detector is not None:
            writer.write(DETECTOR, detector_message(head.detector), start_ns)
        if head.camera is not None:
            poses = estimate.frames if estimate.camera_moves else len(head.camera.path)
            write_camera(writer, head.camera, poses, estimate.frames, start_ns)
        wearers = [
            WearerWriter(writer, LongEstimate(one, estimate.frames, iter(())), prefix, start_ns)
            for one, prefix in zip(head.wearers, prefixes, strict=True)
        ]
        end_ns = start_ns
        for part in estimate.parts:
            end_ns = start_ns + int(NS_PER_S * part.wearers[0].motion.time[-1])
            writer.add_in_order(*_streams(writer, wearers, part, estimate.camera_moves, start_ns))
        closed = estimate.closed()
        writer.write(INFO, scene_info_message(closed, prefixes, start_ns), end_ns)
        for one, prefix in zip(closed.wearers, prefixes, strict=True):
            writer.write(prefix + CALIBRATION, calibration_message(one.calibration), end_ns)


def _streams(
    writer: MessageWriter, wearers: list[WearerWriter], part: ScenePart, camera_moves: bool, start_ns: int
) -> list[Iterable[TimedMessage]]:
    """The messages of a part; a camera that stands still has its pose in the first one."""
    time, camera = part.wearers[0].motion.time, part.camera
    for report in part.reports:
        writer.write(REPORT, report_message(report), start_ns + int(NS_PER_S * time[0]))
    streams = [stream for wearer, own in zip(wearers, part.wearers, strict=True) for stream in wearer.streams(own)]
    if camera is None:
        return streams
    if camera_moves or part.first == 0:
        streams += camera_path_messages(writer, camera, start_ns, part.first)
    if camera.residual_px is not None:
        streams.append(camera_residual_messages(writer, camera.residual_px, time, start_ns, part.first))
    return streams
