"""The video again, with the poses that were found drawn over it."""

from collections.abc import Callable
from pathlib import Path

from vip_factors.atomic import atomic_path
from vip_factors.detect.video import VideoPoses
from vip_factors.errors import InputError
from vip_factors.io.video import iterate_frames
from vip_factors.viz.images import draw_pose

LARGEST = 1280  # pixels of the longer side: sharp enough to judge poses by, and quick to write


def write_overlay(
    path: Path, poses: VideoPoses, overwrite: bool = False, tell: Callable[[float], None] = lambda fraction: None
) -> None:
    """Write the frames that were looked at as a video (``.mp4``), each person in a colour and with the track's number.

    Raises:
        InputError: if the file exists, or this OpenCV cannot write such a video.
    """
    import cv2

    facts, looked = poses.facts, poses.looked
    scale = min(1.0, LARGEST / max(facts.width, facts.height))
    size = tuple(2 * round(scale * length / 2) for length in (facts.width, facts.height))  # codecs want even numbers
    with atomic_path(path, overwrite) as temporary:
        code = cv2.VideoWriter.fourcc(*"mp4v")
        writer = cv2.VideoWriter(str(temporary), code, facts.rate / looked.step, size)
        if not writer.isOpened():
            raise InputError(f"{path}: OpenCV cannot write such a video: give a name that ends in .mp4")
        try:
            for index, _, image in iterate_frames(facts.path, facts.time, looked.step, looked.start, looked.stop):
                small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
                for one in poses.frames[index]:
                    pixels = one.pixels * [size[0] / facts.width, size[1] / facts.height]
                    draw_pose(small, poses.keypoints, pixels, one.confidence, one.track - 1, str(one.track))
                writer.write(cv2.cvtColor(small, cv2.COLOR_RGB2BGR))
                tell((index + 1 - looked.start) / (looked.stop - looked.start))
        finally:
            writer.release()
