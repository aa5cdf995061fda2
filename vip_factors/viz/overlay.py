"""The camera's pictures with the skeletons that were found and the keypoints that were detected drawn over them."""

from collections.abc import Iterator

import cv2
import numpy as np

from vip_factors.body.mannequin import Colour
from vip_factors.body.skeleton import PARENTS
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array
from vip_factors.viz.colours import UNCLAIMED, mixed, wearer_colour
from vip_factors.viz.drawn_scene import DrawnScene
from vip_factors.viz.images import draw_pose, limb_pairs, video_stream

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
