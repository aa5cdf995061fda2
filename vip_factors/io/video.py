"""Videos: frames of a file or embedded images, the colours of people's torsos in them, and a phone's focal length."""

import os
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

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
    """OpenCV's reader of a video file, closed afterwards; errors as of :func:`video_facts`."""
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
        images = _of_file(video.path, range(start, 2**62 if stop is None else stop, every))
    elif video.images:
        images = _embedded(video, range(start, max(video.images) + 1 if stop is None else stop, every))
    else:
        raise InputError("the recording has no video: neither a file nor embedded images")
    import cv2

    for index, stamp, image in images:
        if width is not None and image.shape[1] > width:
            height = max(1, round(image.shape[0] * width / image.shape[1]))
            image = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
        seconds = stamp if time is None else float(frame_times(time, np.array(index)))
        yield VideoFrame(index, seconds, cv2.cvtColor(image, cv2.COLOR_BGR2RGB))


def _of_file(path: Path, wanted: range) -> Iterator[VideoFrame]:
    """Frames of a file, blue first."""
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
            yield VideoFrame(index, capture.get(cv2.CAP_PROP_POS_MSEC) / 1000 or index / rate, image)


def _embedded(video: Video, wanted: range) -> Iterator[VideoFrame]:
    """Embedded images, blue first."""
    import cv2

    for index in (index for index in sorted(video.images) if index in wanted):
        image = cv2.imdecode(np.frombuffer(video.images[index], np.uint8), cv2.IMREAD_COLOR)
        if image is None:
            raise FileFormatError(f"the embedded image of video frame {index} cannot be decoded: expected JPEG or PNG")
        yield VideoFrame(index, float(index), image)


def embed_video(scene: Scene) -> Scene:
    """The scene with frames of its cameras' videos as JPEG, so that its file can be viewed anywhere.

    Raises:
        InputError: if the scene has no video.
        FileFormatError: if a file is no video.
    """
    import cv2

    every, width = 3, 640  # ten images a second of a video at 30, about 50 kB each: enough to see who is who
    quality = 80  # of 100: lines stay sharp to the eye, at an eighth of the best quality's size
    cameras = list(scene.cameras)
    for number, camera in enumerate(cameras):
        if camera.video is None or camera.video.path is None:
            continue
        source, images = camera.video.path, dict[int, bytes]()
        for index, _, image in iterate_frames(source, every=every, stop=len(camera.detections.time), width=width):
            good, data = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
            if not good:
                raise InputError(f"{source}: frame {index} cannot be encoded as JPEG")
            images[index] = data.tobytes()
        cameras[number] = replace(camera, video=Video(source, images))
    if not any(camera.video is not None and camera.video.path is not None for camera in cameras):
        raise InputError(f"scene '{scene.name}' names no video file: give one to embed")
    return replace(scene, cameras=tuple(cameras))


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


FOCAL_KEY = b"com.apple.quicktime.camera.focal_length.35mm_equivalent"
FULL_FRAME_WIDTH_MM = 34.6  # of a 4:3 image with the diagonal of 35 mm film: the widths of photo and video are the same
STABILISATION = 1.1  # filming crops the width of photos by about a tenth
LONGEST = 256  # bytes of a key or a value: more is damage
METADATA_FOCAL_SIGMA = 0.1  # of the logarithm: the crop differs between phones


def focal_from_metadata(path: Path, width: int, height: int) -> float | None:
    """Focal length in pixels of a video of ``width`` by ``height``, as phones write it into QuickTime and MP4 files.

    None if the file does not state it.
    """
    with path.open("rb") as file:
        try:
            equivalent = next(_values(file, path.stat().st_size), None)
        except (struct.error, ValueError, RecursionError):  # a damaged file
            return None
    if equivalent is None or not 5 < equivalent < 500:
        return None
    return STABILISATION * equivalent / FULL_FRAME_WIDTH_MM * max(width, height)


def _atoms(file: BinaryIO, end: int) -> Iterator[tuple[bytes, int]]:
    """Types and ends of the atoms from the file's position to ``end``; the position is then behind each header."""
    position = file.tell()
    while position + 8 <= end:
        file.seek(position)
        size, kind = struct.unpack(">I4s", file.read(8))
        if size == 1:  # of 64 bits
            size = struct.unpack(">Q", file.read(8))[0]
        stop = end if size == 0 else position + size
        if not position + 8 <= stop <= end:
            return
        yield kind, stop
        position = stop


def _values(file: BinaryIO, end: int, index: int = 0) -> Iterator[float]:
    """The values of the key in the movie's and its tracks' metadata; ``index`` is its place among the keys there."""
    for kind, stop in _atoms(file, end):
        if kind == b"meta" and file.read(4) != bytes(4):  # a version in MP4, none in QuickTime
            file.seek(-4, 1)
        if kind in (b"moov", b"trak", b"udta", b"meta") or (index and kind in (b"ilst", index.to_bytes(4, "big"))):
            yield from _values(file, stop, index)
        elif kind == b"keys":
            file.read(8)  # version, flags and count
            names = [file.read(min(end_of_key - file.tell(), LONGEST)) for _, end_of_key in _atoms(file, stop)]
            index = names.index(FOCAL_KEY) + 1 if FOCAL_KEY in names else 0
        elif kind == b"data" and index:  # text, a float or an integer
            form, _ = struct.unpack(">II", file.read(8))
            content = file.read(min(stop - file.tell(), LONGEST))
            if form == 1:
                yield float(content)
            elif form in (23, 24):
                yield float(struct.unpack(">f" if form == 23 else ">d", content)[0])
            elif form in (21, 22, 65, 66, 67, *range(74, 79)):
                yield float(int.from_bytes(content, "big"))
