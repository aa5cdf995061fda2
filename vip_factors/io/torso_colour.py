"""What colours people's torsos have in a video: a histogram of what lies between shoulders and hips."""

from dataclasses import replace

import numpy as np

from vip_factors.geometry.rotations import Array
from vip_factors.io.video import iterate_frames
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.scene import Video

CORNERS = ("left_shoulder", "right_shoulder", "right_hip", "left_hip")
LEAST_CONFIDENCE = 0.3  # of the corners: a guessed one takes in the background, or somebody else
LOOK_EVERY_S = 0.2  # clothes stay as they are; frames between are passed over
INNER = 0.8  # of the way from the middle to the corners: arms and background lie at the edges
NARROWEST = 0.15  # of the torso's length: from the side its corners lie on a line
SHORTEST_PX = 6.0  # of a torso, to have a colour
HUES, SATURATIONS, VALUES = 6, 2, 3
COLOURS = HUES * SATURATIONS * VALUES
GREY = 64  # saturation, of 255, below which a hue is noise
BINS = (np.array([180, 256, 256]) / (HUES, SATURATIONS, VALUES)).astype(float)  # OpenCV's hues go up to 180


def with_torso_colours(detections: Detections, video: Video) -> Detections:
    """The detections with the colours of torsos, in about five frames a second; NaN in the others.

    Args:
        detections: of the video's frames, pixels as in the video.
        video: a file.

    Raises:
        InputError, FileFormatError: if the video cannot be read.
    """
    corners = [detections.keypoints.keypoints.index(name) for name in CORNERS if name in detections.keypoints.keypoints]
    if len(corners) < len(CORNERS) or not len(detections):
        return detections
    every = max(1, round(LOOK_EVERY_S * detections.rate))
    known = np.all(detections.seen[:, corners] & (detections.confidence[:, corners] >= LEAST_CONFIDENCE), axis=1)
    colours = np.full((len(detections), COLOURS), np.nan)
    for number, _, image in iterate_frames(video, every=every, stop=len(detections.time)):
        here = detections.of_frame(number)
        for one in np.flatnonzero(known[here]) + here.start:
            found = torso_colour(image, detections.pixels[one, corners])
            if found is not None:
                colours[one] = found
    return replace(detections, torso_colour=colours)


def torso_colour(image: np.ndarray, corners: Array) -> Array | None:
    """Shares ``(COLOURS,)`` of the colours within four corners ``(4, 2)``; None if hardly any lies in the image.

    Args:
        image: ``(height, width, 3)``, red first, bytes.
        corners: pixels, in order around the torso.
    """
    corners = corners.mean(axis=0) + INNER * (corners - corners.mean(axis=0))
    length = float(np.linalg.norm(corners[:2].mean(axis=0) - corners[2:].mean(axis=0)))
    size = np.array([image.shape[1], image.shape[0]])
    low = np.clip(np.floor(corners.min(axis=0) - NARROWEST * length), 0, size).astype(int)
    high = np.clip(np.ceil(corners.max(axis=0) + NARROWEST * length) + 1, 0, size).astype(int)
    if length < SHORTEST_PX or np.any(high <= low):
        return None
    import cv2

    part = np.ascontiguousarray(image[low[1] : high[1], low[0] : high[0]])
    mask = np.zeros(part.shape[:2], np.uint8)
    hull = cv2.convexHull(np.round(corners - low).astype(np.int32))
    cv2.fillConvexPoly(mask, hull, 1)
    cv2.polylines(mask, [hull], True, 1, max(1, round(NARROWEST * length)))
    hsv = cv2.cvtColor(part, cv2.COLOR_RGB2HSV)[mask > 0].astype(float)
    if len(hsv) < SHORTEST_PX:
        return None
    hsv[hsv[:, 1] < GREY, :2] = 0.0
    hsv[hsv[:, 1] >= GREY, 1] = 255.0
    hue, saturation, value = (hsv / BINS).astype(int).T
    counts = np.bincount((hue * SATURATIONS + saturation) * VALUES + value, minlength=COLOURS)
    return np.asarray(counts / counts.sum())
