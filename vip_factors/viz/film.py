"""What the camera saw with the skeletons that were found over it: pictures, and a film in H.264 that browsers play."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np

from vip_factors.atomic import atomic_path
from vip_factors.body.mannequin import Colour
from vip_factors.body.skeleton import PARENTS
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array
from vip_factors.viz.colours import UNCLAIMED, mixed, wearer_colour
from vip_factors.viz.drawn_scene import DrawnScene
from vip_factors.viz.images import draw_pose, frames_left, limb_pairs, video_stream

# No loss to be seen on a screen, and drawing takes longer than this; g: whole pictures are near for who jumps in time.
H264 = {"crf": "20", "preset": "veryfast", "g": "30"}
FASTEST_HZ = 30.0  # of a faster video every second or third frame is shown
INSTALL = "pip install 'vip-factors[film]'"


def film(
    drawn: DrawnScene,
    path: Path,
    height: int,
    seconds: tuple[float, float] | None = None,
    *,
    overwrite: bool = False,
    on_progress: Callable[[str, float], None] = lambda stage, fraction: None,
) -> tuple[Array, float]:
    """Draw and write a film.

    Args:
        drawn: an estimate and the scene that it was made from.
        path: ends in .mp4.
        height: of the pictures in pixels; the width follows.
        seconds: first and last second of the recording to show; all of it if None.
        overwrite: replace an existing file.
        on_progress: called with how much is done.

    Returns:
        Instants ``(T,)`` of its pictures in seconds of the recording, and pictures per second.

    Raises:
        InputError: if no camera or motion is known, nothing is left of the time, or PyAV is not installed.
    """
    check_film(path)
    if drawn.model is None or drawn.path is None or drawn.detections is None or not len(drawn.detections.time):
        raise InputError(f"{path}: no camera is known that filmed: expected a filmed recording, and its estimate")
    frames, rate = film_frames(drawn, seconds)
    size = 2 * round(height * drawn.model.width / drawn.model.height / 2), height // 2 * 2  # H.264 takes even ones
    with film_file(path, rate, overwrite) as file:
        for index, picture in enumerate(overlaid_frames(drawn, frames, size)):
            file.add(picture)
            on_progress("drawing the film", (index + 1) / len(frames))
    return drawn.detections.time[frames], rate


def film_frames(drawn: DrawnScene, seconds: tuple[float, float] | None = None) -> tuple[np.ndarray, float]:
    """Indices ``(T,)`` of the video frames that a film shows, and pictures per second.

    Where images of some frames alone are left of the video, those are the frames.

    Raises:
        InputError: if there is no motion, or nothing is left of the time.
    """
    motions = [wearer.shown for wearer in drawn.wearers if wearer.shown is not None]
    if not motions or drawn.detections is None:
        raise InputError("no motion for a film: give an estimate, or a recording with its truth")
    first, last = min(float(m.time[0]) for m in motions), max(float(m.time[-1]) for m in motions)
    if seconds is not None:
        first, last = max(first, seconds[0]), min(last, seconds[1])
    video = drawn.detections.time
    frames = frames_left(drawn.video, len(video))
    span = float(video[frames[-1]] - video[frames[0]])
    rate = (len(frames) - 1) / span if span > 0 else FASTEST_HZ
    step = max(1, int(np.ceil(rate / FASTEST_HZ - 0.01)))
    frames = frames[(video[frames] >= first - 1e-6) & (video[frames] <= last + 1e-6)][::step]
    if not len(frames):
        raise InputError(f"nothing to film between {first:.2f} and {last:.2f} s: expected seconds of the recording")
    return frames, rate / step


def check_film(path: Path) -> None:
    """Fail before the work, not after it.

    Raises:
        InputError: for another suffix than .mp4, or if PyAV is not installed.
    """
    if Path(path).suffix.lower() != ".mp4":
        raise InputError(f"{path}: expected a film's name to end in .mp4")
    try:
        import av  # noqa: F401
    except ImportError as error:
        raise InputError(f"films need PyAV, which is not installed: {INSTALL}") from error


@contextmanager
def film_file(path: Path, rate: float, overwrite: bool) -> "Iterator[FilmFile]":
    """A film to add pictures to; it appears when the block ends without an exception.

    Args:
        path: ends in .mp4.
        rate: pictures per second.
        overwrite: replace an existing file.

    Raises:
        InputError: as :func:`check_film`, or if the file may not be written.
    """
    check_film(path)
    with atomic_path(path, overwrite) as partial:
        film = FilmFile(partial, rate)
        try:
            yield film
            film.flush()
        finally:
            film.close()


class FilmFile:
    """Pictures encoded as H.264 into an MP4 file."""

    def __init__(self, path: Path, rate: float) -> None:
        import av

        self._av = av
        # The index in front, so that a browser plays it while it loads.
        self._container = av.open(str(path), "w", options={"movflags": "faststart"})
        self._stream = self._container.add_stream("libx264", rate=Fraction(rate).limit_denominator(1001), options=H264)
        self._stream.pix_fmt = "yuv420p"  # phones decode no other
        self._begun = False

    def add(self, picture: np.ndarray) -> None:
        """Encode a further picture ``(H, W, 3)`` uint8, red green blue; all have one size."""
        if not self._begun:
            self._stream.height, self._stream.width = picture.shape[:2]
            self._begun = True
        frame = self._av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24")
        self._container.mux(self._stream.encode(frame))

    def flush(self) -> None:
        """Write what the encoder still holds."""
        if self._begun:
            self._container.mux(self._stream.encode(None))

    def close(self) -> None:
        """Close the file."""
        self._container.close()


GROUND: Colour = (34, 38, 45)  # where the video's picture is not there
BONES = np.array([[parent, joint] for joint, parent in enumerate(PARENTS) if parent >= 0])
NEAREST_M = 0.1  # joints behind the camera are in no picture


def overlaid_frames(
    drawn: DrawnScene, frames: np.ndarray, size: tuple[int, int], *, names: bool = True
) -> Iterator[np.ndarray]:
    """Frames of the video, or a plain ground, with skeletons (broad) and detections (thin, pale) over them.

    Args:
        drawn: a scene with the camera's model and detections.
        frames: ``(N,)`` increasing indices of video frames.
        size: width and height of the pictures in pixels.
        names: write the wearers' names above their heads, if there are several.

    Yields:
        ``(height, width, 3)`` uint8, red green blue.
    """
    if drawn.model is None or drawn.detections is None:
        raise InputError(f"scene '{drawn.name}' has no camera: expected one to draw what it saw")
    scale = np.array([size[0] / drawn.model.width, size[1] / drawn.model.height])
    for frame, image in zip(frames.tolist(), video_stream(drawn.video, frames.tolist()), strict=True):
        if image is None:
            picture = np.full((size[1], size[0], 3), GROUND, np.uint8)
        else:
            picture = np.ascontiguousarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA)[..., ::-1])
        draw_detections(picture, drawn, frame, scale)
        draw_skeletons(picture, drawn, float(drawn.detections.time[frame]), scale, names)
        yield picture


def draw_skeletons(picture: np.ndarray, drawn: DrawnScene, time: float, scale: Array, names: bool) -> None:
    """Draw every wearer's skeleton at a time (s); ``scale`` ``(2,)``: the picture's pixels in one of the camera."""
    if drawn.path is None or drawn.model is None:
        return
    camera = drawn.path.at(np.array([time]))
    for wearer in drawn.wearers:
        motion = wearer.shown
        if motion is None or not motion.time[0] - 0.1 <= time <= motion.time[-1] + 0.1:
            continue
        frame = int(np.clip(round((time - motion.start) * motion.rate), 0, len(motion) - 1))
        p_camera = (motion.state.p_world_joint[frame] - camera.p_world_camera[0]) @ camera.R_world_camera[0]
        pixels, before = scale * drawn.model.project(p_camera), p_camera[:, 2] > NEAREST_M
        label = wearer.name if names and len(drawn.wearers) > 1 else ""
        draw_pose(picture, BONES, pixels, before.astype(float), wearer.index, label, 2.0)


def draw_detections(picture: np.ndarray, drawn: DrawnScene, frame: int, scale: Array) -> None:
    """Draw the keypoints that were detected in a video frame, in a pale shade of the wearer's colour."""
    if drawn.detections is None or drawn.labels is None:
        return
    limbs, radius = limb_pairs(drawn.detections.keypoints), max(1, round(picture.shape[0] / 260))
    people = drawn.detections.of_frame(frame)
    detections = (drawn.labels[people].tolist(), drawn.detections.seen[people], drawn.detections.pixels[people])
    for label, seen, pixels in zip(*detections, strict=True):
        colour = UNCLAIMED if label < 0 else mixed(wearer_colour(label), (255, 255, 255), 0.6)
        points = np.round(16 * np.where(seen[:, None], pixels * scale, 0)).astype(int)
        for a, b in limbs:
            if seen[a] and seen[b]:
                cv2.line(picture, points[a].tolist(), points[b].tolist(), colour, 1, cv2.LINE_AA, 4)
        for point in points[seen]:
            cv2.circle(picture, point.tolist(), 16 * radius, colour, -1, cv2.LINE_AA, 4)
