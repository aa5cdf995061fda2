"""Overlays: frames of a video, skeletons drawn over them, and a film in H.264 that browsers play."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np

from vip_factors.atomic import atomic_path
from vip_factors.body.keypoints import LIMBS, KeypointSet
from vip_factors.body.mannequin import Colour
from vip_factors.body.skeleton import PARENTS
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.scene import Video
from vip_factors.viz.colours import UNCLAIMED, mixed, wearer_colour
from vip_factors.viz.drawn_scene import DrawnCamera, DrawnScene

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
    camera: int = 0,
    overwrite: bool = False,
    on_progress: Callable[[str, float], None] = lambda stage, fraction: None,
) -> tuple[Array, float]:
    """Draw and write a film.

    Args:
        drawn: an estimate and the scene that it was made from.
        path: ends in .mp4.
        height: of the pictures in pixels; the width follows.
        seconds: first and last second of the recording to show; all of it if None.
        camera: index in :meth:`~vip_factors.viz.drawn_scene.DrawnScene.films`.
        overwrite: replace an existing file.
        on_progress: called with how much is done.

    Returns:
        Instants ``(T,)`` of its pictures in seconds of the recording, and pictures per second.

    Raises:
        InputError: if no camera or motion is known, nothing is left of the time, or PyAV is not installed.
    """
    check_film(path)
    drawn_camera, detections, _ = drawn.films()[camera]
    motions = [wearer.shown for wearer in drawn.wearers if wearer.shown is not None]
    if not motions:
        raise InputError("no motion for a film: give an estimate, or a recording with its truth")
    start, end = min(float(m.time[0]) for m in motions), max(float(m.time[-1]) for m in motions)
    if seconds is not None:
        if not seconds[0] < seconds[1]:
            raise InputError(f"film from second {seconds[0]} to {seconds[1]}: expected a later end")
        start, end = max(start, seconds[0]), min(end, seconds[1])
    time, model, video = detections.time, drawn_camera.model, drawn_camera.video
    frames = np.arange(len(time))
    # All of a file, and of one of which no image is left either.
    if video is not None and len(video.images) >= 2 and not (video.path is not None and video.path.is_file()):
        frames = np.array([index for index in sorted(video.images) if index < len(time)], dtype=int)
    span = float(time[frames[-1]] - time[frames[0]])
    rate = (len(frames) - 1) / span if span > 0 else FASTEST_HZ
    step = max(1, int(np.ceil(rate / FASTEST_HZ - 0.01)))
    frames, rate = frames[(time[frames] >= start - 1e-6) & (time[frames] <= end + 1e-6)][::step], rate / step
    if not len(frames):
        raise InputError(f"nothing to film between {start:.2f} and {end:.2f} s: expected seconds of the recording")
    size = 2 * round(height * model.width / model.height / 2), height // 2 * 2  # H.264 takes even ones
    with film_file(path, rate, overwrite) as add:
        for index, picture in enumerate(overlaid_frames(drawn, frames, size, camera=camera)):
            add(picture)
            on_progress("drawing the film", (index + 1) / len(frames))
    return time[frames], rate


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
def film_file(path: Path, rate: float, overwrite: bool) -> Iterator[Callable[[np.ndarray], None]]:
    """A film to add pictures to, ``(H, W, 3)`` uint8, red green blue, all of one size; it appears when the block ends
    without an exception.

    Args:
        path: ends in .mp4.
        rate: pictures per second.
        overwrite: replace an existing file.

    Raises:
        InputError: as :func:`check_film`, or if the file may not be written.
    """
    check_film(path)
    import av

    # The index in front, so that a browser plays it while it loads.
    with atomic_path(path, overwrite) as partial, av.open(str(partial), "w", options={"movflags": "faststart"}) as file:
        stream = file.add_stream("libx264", rate=Fraction(rate).limit_denominator(1001), options=H264)
        stream.pix_fmt = "yuv420p"  # phones decode no other
        has_pictures = False

        def add(picture: np.ndarray) -> None:
            nonlocal has_pictures
            if not has_pictures:
                stream.height, stream.width = picture.shape[:2]
                has_pictures = True
            file.mux(stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24")))

        yield add
        if has_pictures:
            file.mux(stream.encode(None))


GROUND: Colour = (34, 38, 45)  # where the video's picture is not there
BONES = np.array([[parent, joint] for joint, parent in enumerate(PARENTS) if parent >= 0])
NEAREST_M = 0.1  # joints behind the camera are in no picture


def overlaid_frames(
    drawn: DrawnScene, frames: np.ndarray, size: tuple[int, int], *, camera: int = 0, names: bool = True
) -> Iterator[np.ndarray]:
    """Frames of the video, or a plain ground, with skeletons (broad) and detections (thin, pale) over them.

    Args:
        drawn: a scene with the camera's model and detections.
        frames: ``(N,)`` increasing indices of video frames.
        size: width and height of the pictures in pixels.
        camera: index in :meth:`~vip_factors.viz.drawn_scene.DrawnScene.films`.
        names: write the wearers' names above their heads, if there are several.

    Yields:
        ``(height, width, 3)`` uint8, red green blue.
    """
    drawn_camera, detections, labels = drawn.films()[camera]
    scale = np.array([size[0] / drawn_camera.model.width, size[1] / drawn_camera.model.height])
    for frame, image in zip(frames.tolist(), video_stream(drawn_camera.video, frames.tolist()), strict=True):
        if image is None:
            picture = np.full((size[1], size[0], 3), GROUND, np.uint8)
        else:
            picture = np.ascontiguousarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA)[..., ::-1])
        _draw_detections(picture, detections, labels, frame, scale)
        _draw_skeletons(picture, drawn, drawn_camera, float(detections.time[frame]), scale, names)
        yield picture


def _draw_skeletons(
    picture: np.ndarray, drawn: DrawnScene, camera: DrawnCamera, time: float, scale: Array, names: bool
) -> None:
    """Draw every wearer's skeleton at a time (s); ``scale`` ``(2,)``: the picture's pixels in one of the camera."""
    if camera.path is None:
        return
    pose = camera.path.at(np.array([time]))
    for wearer in drawn.wearers:
        motion = wearer.shown
        if motion is None or not motion.time[0] - 0.1 <= time <= motion.time[-1] + 0.1:
            continue
        frame = int(np.clip(round((time - motion.start) * motion.rate), 0, len(motion) - 1))
        p_camera = (motion.state.p_world_joint[frame] - pose.p_world_camera[0]) @ pose.R_world_camera[0]
        pixels, is_before = scale * camera.model.project(p_camera), p_camera[:, 2] > NEAREST_M
        label = wearer.name if names and len(drawn.wearers) > 1 else ""
        draw_pose(picture, BONES, pixels, is_before.astype(float), wearer.index, label, 2.0)


def _draw_detections(picture: np.ndarray, detections: Detections, labels: np.ndarray, frame: int, scale: Array) -> None:
    """Draw the keypoints that were detected in a video frame, in a pale shade of the wearer's colour."""
    limbs, radius = limb_pairs(detections.keypoints), max(1, round(picture.shape[0] / 260))
    people = detections.of_frame(frame)
    for label, is_seen, pixels in zip(
        labels[people].tolist(), detections.seen[people], detections.pixels[people], strict=True
    ):
        colour = UNCLAIMED if label < 0 else mixed(wearer_colour(label), (255, 255, 255), 0.6)
        points = np.round(16 * np.where(is_seen[:, None], pixels * scale, 0)).astype(int)
        for a, b in limbs:
            if is_seen[a] and is_seen[b]:
                cv2.line(picture, points[a].tolist(), points[b].tolist(), colour, 1, cv2.LINE_AA, 4)
        for point in points[is_seen]:
            cv2.circle(picture, point.tolist(), 16 * radius, colour, -1, cv2.LINE_AA, 4)


# Where a set has a neck, the head hangs on it; otherwise it would float above the shoulders.
_MORE = (("neck", "nose"), ("neck", "head_top"))


def limb_pairs(keypoints: KeypointSet) -> np.ndarray:
    """Indices ``(L, 2)`` of the keypoints to join by lines."""
    names = keypoints.keypoints
    pairs = [[names.index(a), names.index(b)] for a, b in (*LIMBS, *_MORE) if a in names and b in names]
    return np.array(pairs, dtype=int).reshape(-1, 2)


def draw_pose(
    image: np.ndarray, limbs: np.ndarray, pixels: Array, confidence: Array, index: int, label: str, broad: float = 1.0
) -> None:
    """Draw one person into an image.

    Args:
        image: ``(height, width, 3)``, red first, bytes; it is changed.
        limbs: ``(L, 2)`` which points to join (:func:`limb_pairs`).
        pixels: ``(K, 2)`` in the image.
        confidence: ``(K,)`` in [0, 1].
        index: of the colour: that of the wearer with this index.
        label: written above the person.
        broad: how broad lines are, as a multiple of the usual.
    """
    least_confidence = 0.1  # below it the reconstruction uses no keypoint (reprojection.least_confidence)
    shown = confidence >= least_confidence
    if not np.any(shown):
        return
    colour = wearer_colour(index)
    width = max(1, round(broad * min(image.shape[:2]) / 360))
    sub, shift = 8, 3  # OpenCV draws at eighths of pixels, given as integers
    points = np.round(np.nan_to_num(pixels) * sub).astype(int)
    faint = 0.5  # keypoints of less confidence are drawn hollow, limbs thin
    for a, b in limbs:
        if shown[a] and shown[b]:
            thick = width if min(confidence[a], confidence[b]) >= faint else max(1, width // 2)
            cv2.line(image, points[a].tolist(), points[b].tolist(), colour, thick, cv2.LINE_AA, shift)
    for keypoint in np.flatnonzero(shown):
        filled = -1 if confidence[keypoint] >= faint else 1
        cv2.circle(image, points[keypoint].tolist(), (width + 1) * sub, (255, 255, 255), filled, cv2.LINE_AA, shift)
        cv2.circle(image, points[keypoint].tolist(), width * sub, colour, filled, cv2.LINE_AA, shift)
    _label(image, pixels[shown], label, colour)


def _label(image: np.ndarray, points: Array, label: str, colour: tuple[int, int, int]) -> None:
    size = image.shape[0] / 1000
    x = int(points[:, 0].mean() - 8 * size * len(label))
    y = int(max(points[:, 1].min() - 30 * size, 28 * size))
    thick, off = max(1, round(2 * size)), max(1, round(1.5 * size))
    for right, down in ((-off, -off), (off, -off), (-off, off), (off, off), (0, 0)):  # broader letters would be wider
        ink = colour if not right else (20, 20, 20)
        cv2.putText(image, label, (x + right, y + down), cv2.FONT_HERSHEY_SIMPLEX, size, ink, thick, cv2.LINE_AA)


def video_stream(video: Video | None, wanted: Sequence[int]) -> Iterator[np.ndarray | None]:
    """One by one, increasing, images ``(height, width, 3)``, blue green red; None for one that cannot be decoded.

    Embedded ones if all are there, which is quick, else those of the file: not now one, now the other. Files are read
    on from frame to frame, as seeking is not exact in every container.
    """
    reader, frame_number = None, 0
    is_embedded = video is not None and all(index in video.images for index in wanted)
    if video is not None and video.path is not None and video.path.is_file() and not is_embedded:
        reader = cv2.VideoCapture(str(video.path))
    try:
        for index in wanted:
            image = None
            if reader is not None:
                while frame_number < index and reader.grab():
                    frame_number += 1
                good, image = reader.read() if frame_number == index else (False, None)
                frame_number += int(good)
            elif video is not None and index in video.images:
                image = cv2.imdecode(np.frombuffer(video.images[index], np.uint8), cv2.IMREAD_COLOR)
            yield image
    finally:
        if reader is not None:
            reader.release()


def png_bytes(image: np.ndarray) -> bytes:
    """An image ``(height, width, 3)``, blue green red, as PNG: for drawings."""
    return bytes(cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 6])[1].tobytes())


def jpeg_bytes(image: np.ndarray, quality: int = 82) -> bytes:
    """An image as JPEG."""
    return bytes(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes())
