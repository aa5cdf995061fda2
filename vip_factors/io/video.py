"""Frames of a video, from a file or from images embedded in a recording, and the colours of people's torsos in them."""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import Array
from vip_factors.io.mcap_camera import frame_times
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.scene import Camera, Scene, Video

if TYPE_CHECKING:
    import cv2

CODED_BLOCK = 16  # pixels: codecs fill images up to whole blocks, and some calibrations count those (1088 for 1080)


class VideoFrame(NamedTuple):
    """Its index in the video, seconds on its clock, and the image ``(height, width, 3)``, red first, bytes."""

    number: int
    time: float
    image: np.ndarray


@dataclass(frozen=True)
class VideoFacts:
    """Facts about a video file.

    Attributes:
        path: of the file.
        width, height: of its frames as shown (turned if the file demands it).
        rate: frames per second, the median where it varies.
        time: ``(F,)`` seconds of each frame after the first, from the file: phones vary their rate.
    """

    path: Path
    width: int
    height: int
    rate: float
    time: Array

    def __len__(self) -> int:
        return len(self.time)


def video_facts(path: str | os.PathLike[str]) -> VideoFacts:
    """Size, frames and times of a video file; all frames are gone through, as counts in the header are estimates.

    Raises:
        InputError: if there is no such file.
        FileFormatError: if it is no video, or has no frame.
    """
    path = Path(path)
    with opened_video(path) as capture:
        import cv2

        stamps = []
        while capture.grab():
            stamps.append(capture.get(cv2.CAP_PROP_POS_MSEC) / 1000)
        nominal = capture.get(cv2.CAP_PROP_FPS)
        width, height = (int(capture.get(side)) for side in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
    if not stamps:
        raise FileFormatError(f"{path}: not a single frame of the video can be read: it may be cut off; copy it again")
    time = np.array(stamps) - stamps[0]
    if len(time) > 1 and np.any(np.diff(time) <= 0):  # a container without times of its own
        if not nominal > 0:
            raise FileFormatError(f"{path}: the video states neither its rate nor frame times")
        time = np.arange(len(time)) / nominal
    rate = float(1 / np.median(np.diff(time))) if len(time) > 1 else float(nominal)
    return VideoFacts(path, width, height, rate, time)


@contextmanager
def opened_video(path: Path) -> "Iterator[cv2.VideoCapture]":
    """OpenCV's reader of a video file, closed afterwards.

    Raises:
        InputError: if there is no such file.
        FileFormatError: if it is no video.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such video file")
    import cv2

    capture = cv2.VideoCapture(str(path))
    try:
        if not capture.isOpened():
            raise FileFormatError(f"{path}: not a video that OpenCV can open: expected .mp4, .mov, .avi or the like")
        yield capture
    finally:
        capture.release()


def iterate_frames(
    video: Video | str | Path,
    time: Array | None = None,
    every: int = 1,
    start: int = 0,
    stop: int | None = None,
    width: int | None = None,
) -> Iterator[VideoFrame]:
    """Frames one after the other, in the order of time; of the file if it is there, else the embedded ones.

    Args:
        video: to look at.
        time: ``(F,)`` seconds of each video frame, such as those of the detections; from the file if None.
        every: take each n-th frame only.
        start, stop: first frame, and the one after the last.
        width: of the images, in pixels; smaller ones stay as they are.

    Raises:
        InputError: if there is neither a file nor an embedded image.
        FileFormatError: if the file is no video, or an image cannot be decoded.
    """
    if not isinstance(video, Video):
        video = Video(Path(video))
    if video.path is not None and (video.path.is_file() or not video.images):
        yield from _of_file(video.path, time, range(start, 2**62 if stop is None else stop, every), width)
    elif video.images:
        wanted = range(start, max(video.images) + 1 if stop is None else stop, every)
        yield from _of_images(video, time, wanted, width)
    else:
        raise InputError("the recording has no video: neither a file nor embedded images")


def _of_file(path: Path, time: Array | None, wanted: range, width: int | None) -> Iterator[VideoFrame]:
    with opened_video(path) as capture:
        import cv2

        rate = capture.get(cv2.CAP_PROP_FPS) or 1.0
        for index in range(wanted.stop):
            if not capture.grab():
                return
            if index not in wanted:
                continue
            good, image = capture.retrieve()
            if not good:
                raise FileFormatError(f"{path}: frame {index} of the video cannot be decoded")
            stamp = capture.get(cv2.CAP_PROP_POS_MSEC) / 1000 or index / rate
            yield VideoFrame(index, _time(time, index, stamp), _shown(image, width))


def _of_images(video: Video, time: Array | None, wanted: range, width: int | None) -> Iterator[VideoFrame]:
    import cv2

    for index in sorted(video.images):
        if index not in wanted:
            continue
        image = cv2.imdecode(np.frombuffer(video.images[index], np.uint8), cv2.IMREAD_COLOR)
        if image is None:
            raise FileFormatError(f"the embedded image of video frame {index} cannot be decoded: expected JPEG or PNG")
        yield VideoFrame(index, _time(time, index, float(index)), _shown(image, width))


def _time(time: Array | None, index: int, otherwise: float) -> float:
    return otherwise if time is None else float(frame_times(time, np.array(index)))


def _shown(image: np.ndarray, width: int | None) -> np.ndarray:
    """Red first, and not wider than asked."""
    import cv2

    if width is not None and image.shape[1] > width:
        height = max(1, round(image.shape[0] * width / image.shape[1]))
        image = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)


def embed_video(scene: Scene) -> Scene:
    """The scene with frames of its cameras' videos as JPEG, so that its file can be viewed anywhere.

    Raises:
        InputError: if the scene has no video.
        FileFormatError: if a file is no video.
    """
    if all(camera.video is None or camera.video.path is None for camera in scene.cameras):
        raise InputError(f"scene '{scene.name}' names no video file: give one to embed")
    return replace(scene, cameras=tuple(map(_embedded, scene.cameras)))


def _embedded(camera: Camera) -> Camera:
    """The camera with frames of its video file, if it has one."""
    source = camera.video.path if camera.video is not None else None
    if source is None:
        return camera
    import cv2

    every, width = 3, 640  # ten images a second of a video at 30, about 50 kB each: enough to see who is who
    quality = 80  # of 100: lines stay sharp to the eye, at an eighth of the best quality's size
    images: dict[int, bytes] = {}
    for index, _, image in iterate_frames(source, every=every, stop=len(camera.detections.time), width=width):
        good, data = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
        if not good:
            raise InputError(f"{source}: frame {index} cannot be encoded as JPEG")
        images[index] = data.tobytes()
    return replace(camera, video=Video(source, images))


def with_videos(scene: Scene | None, paths: Sequence[str | os.PathLike[str]]) -> Scene:
    """The scene with the video files that its detections were made from, one for each camera in their order.

    Raises:
        InputError: if there is no such file, another number of cameras, or a video does not belong to the detections.
        FileFormatError: if a file is no video.
    """
    facts = [video_facts(path) for path in paths]
    if scene is None or not scene.cameras:
        raise InputError(f"{facts[0].path}: no camera is known that took it: expected a filmed recording beside it")
    if len(facts) != len(scene.cameras):
        names = ", ".join(camera.name for camera in scene.cameras)
        raise InputError(f"{len(facts)} video files for {len(scene.cameras)} cameras ({names}): expected one for each")
    for video, camera in zip(facts, scene.cameras, strict=True):
        check_video(video, camera)
    cameras = (replace(camera, video=Video(video.path)) for video, camera in zip(facts, scene.cameras, strict=True))
    return replace(scene, cameras=tuple(cameras))


def check_video(facts: VideoFacts, camera: Camera) -> None:
    """Refuse a video that the detections or the calibration cannot belong to.

    Raises:
        InputError: if it is shorter than its detections, or of another size than the calibrated one.
    """
    frames = len(camera.detections.time)
    if len(facts) < frames:
        raise InputError(
            f"{facts.path} has {len(facts)} frames, but the detections have {frames}: the video is shorter than its "
            "detections; give the video that they were made from"
        )
    model = camera.model
    if max(abs(facts.width - model.width), abs(facts.height - model.height)) >= CODED_BLOCK:
        turned = (facts.height, facts.width) == (model.width, model.height)
        advice = "calibrate with the camera held as in the video" if turned else "calibrate at the video's resolution"
        raise InputError(
            f"{facts.path} has frames of {facts.width} by {facts.height} pixels, but the camera was calibrated at "
            f"{model.width} by {model.height}: {advice}"
        )


CORNERS = ("left_shoulder", "right_shoulder", "right_hip", "left_hip")
LEAST_CONFIDENCE = 0.3  # of the corners: a guessed one includes the background or another person
LOOK_EVERY_S = 0.2  # clothes stay as they are; frames between are passed over
INNER = 0.8  # of the way from the middle to the corners: arms and background lie at the edges
NARROWEST = 0.15  # of the torso's length: from the side its corners lie on a line
SHORTEST_PX = 6.0  # of a torso, to have a colour
HUES, SATURATIONS, VALUES = 6, 2, 3
COLOURS = HUES * SATURATIONS * VALUES
GREY = 64  # saturation, of 255, below which a hue is noise
BINS = (np.array([180, 256, 256]) / (HUES, SATURATIONS, VALUES)).astype(float)  # OpenCV's hues go up to 180


def with_torso_colours(detections: Detections, video: Video) -> Detections:
    """The detections of a video with the colours of torsos, in about five frames a second; NaN in the others.

    Raises:
        InputError, FileFormatError: if the video cannot be read.
    """
    corners = [detections.keypoints.keypoints.index(name) for name in CORNERS if name in detections.keypoints.keypoints]
    if len(corners) < len(CORNERS) or not len(detections):
        return detections
    every = max(1, round(LOOK_EVERY_S * detections.rate))
    is_sure = np.all(detections.seen[:, corners] & (detections.confidence[:, corners] >= LEAST_CONFIDENCE), axis=1)
    colours = np.full((len(detections), COLOURS), np.nan)
    for number, _, image in iterate_frames(video, every=every, stop=len(detections.time)):
        rows = detections.of_frame(number)
        for row in np.flatnonzero(is_sure[rows]) + rows.start:
            colour = torso_colour(image, detections.pixels[row, corners])
            if colour is not None:
                colours[row] = colour
    return replace(detections, torso_colour=colours)


def torso_colour(image: np.ndarray, corners: Array) -> Array | None:
    """Shares ``(COLOURS,)`` of the colours within four corners ``(4, 2)`` around the torso, pixels of an image
    ``(height, width, 3)``, red first; None if hardly any lies in it.
    """
    corners = corners.mean(axis=0) + INNER * (corners - corners.mean(axis=0))
    length = float(np.linalg.norm(corners[:2].mean(axis=0) - corners[2:].mean(axis=0)))
    size = np.array([image.shape[1], image.shape[0]])
    low = np.clip(np.floor(corners.min(axis=0) - NARROWEST * length), 0, size).astype(int)
    high = np.clip(np.ceil(corners.max(axis=0) + NARROWEST * length) + 1, 0, size).astype(int)
    if length < SHORTEST_PX or np.any(high <= low):
        return None
    import cv2

    torso = np.ascontiguousarray(image[low[1] : high[1], low[0] : high[0]])
    mask = np.zeros(torso.shape[:2], np.uint8)
    hull = cv2.convexHull(np.round(corners - low).astype(np.int32))
    cv2.fillConvexPoly(mask, hull, 1)
    cv2.polylines(mask, [hull], True, 1, max(1, round(NARROWEST * length)))
    hsv = cv2.cvtColor(torso, cv2.COLOR_RGB2HSV)[mask > 0].astype(float)
    if len(hsv) < SHORTEST_PX:
        return None
    hsv[hsv[:, 1] < GREY, :2] = 0.0
    hsv[hsv[:, 1] >= GREY, 1] = 255.0
    hue, saturation, value = (hsv / BINS).astype(int).T
    counts = np.bincount((hue * SATURATIONS + saturation) * VALUES + value, minlength=COLOURS)
    return np.asarray(counts / counts.sum())
