"""What the camera saw, with the bodies laid over it through the reconstructed camera."""

from collections.abc import Sequence

import cv2
import numpy as np

from vip_factors.body.body_mesh import body_mesh
from vip_factors.body.mannequin import Side
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.camera_path import CameraPath
from vip_factors.viz.canvas import mixed
from vip_factors.viz.eye import Eye, Lens, scaled
from vip_factors.viz.figure import Figure, as_bytes, blend, lit_from
from vip_factors.viz.film_room import floor_of
from vip_factors.viz.image_limbs import limb_pairs
from vip_factors.viz.room import Backdrop, Room
from vip_factors.viz.scene_world import DrawnScene
from vip_factors.viz.video_frames import video_stream
from vip_factors.viz.wearer_colours import UNCLAIMED, wearer_colour

CLOTHES = {Side.LEFT: (206, 208, 212), Side.RIGHT: (206, 208, 212), Side.MIDDLE: (206, 208, 212)}
DOT_SHARE = 1 / 260  # of the picture's height: a keypoint's radius


class CameraPane:
    """Pictures of the camera at some of its frames.

    Without a video the room is drawn in its place: through the true camera, with everybody as they really moved, in
    grey, as far as that is known.

    Args:
        drawn: a scene with a camera.
        figures: its wearers.
        times: ``(T,)`` seconds of the frames.
        frames: ``(T,)`` their numbers in the video.
        size: of the pictures, width and height.
        opacity: of the bodies that are laid over.
        coarse: draw a room at half the resolution, for speed.
    """

    def __init__(
        self,
        drawn: DrawnScene,
        figures: list[Figure],
        times: Array,
        frames: np.ndarray,
        size: tuple[int, int],
        opacity: float,
        coarse: bool = True,
    ) -> None:
        assert drawn.model is not None
        assert drawn.path is not None
        self._drawn, self._times, self._frames, self._opacity = drawn, times, frames, opacity
        self._size, self._model = size, scaled(drawn.model, *size)
        self._figures = figures
        self._eyes = self._seen_from(drawn.path)
        self._true_eyes = self._seen_from(drawn.true_path) if drawn.true_path is not None else self._eyes
        self._people = [
            Figure(body_mesh(wearer.truth.skeleton), wearer.truth, CLOTHES)
            for wearer in drawn.wearers
            if wearer.motion is not None and wearer.truth is not None
        ]
        self._video = video_stream(drawn.video, frames.tolist())
        at = np.mean([figure.motion.p_world_pelvis[:, :2].mean(axis=0) for figure in self._figures], axis=0)
        self._room = Room(floor_of(self._people or self._figures, times), at, lit_from(self._true_eyes[0]))
        self._backdrop = Backdrop(self._room, Lens(self._model), coarse)

    def _seen_from(self, path: CameraPath) -> Sequence[Eye]:
        at = path.at(self._times)
        return [Eye(self._model, R, p) for R, p in zip(at.R_world_camera, at.p_world_camera, strict=True)]

    def draw(self, index: int) -> np.ndarray:
        """``(H, W, 3)`` uint8, red green blue, at ``times[index]``; to be called for one after the other."""
        time, picture = float(self._times[index]), next(self._video)
        image = self._without_video(index) if picture is None else self._of_video(picture)
        bodies = [figure.posed(time) for figure in self._figures if figure.shown_at(time)]
        alone = picture is None and not self._people
        blend(image, self._eyes[index], bodies, self._room.light, 1.0 if alone else self._opacity)
        shown = as_bytes(image)
        self._keypoints(shown, int(self._frames[index]))
        return shown

    def _of_video(self, picture: np.ndarray) -> Array:
        fitted = cv2.resize(picture, self._size, interpolation=cv2.INTER_AREA)
        return np.ascontiguousarray(fitted[..., ::-1]).astype(np.float32) / 255

    def _without_video(self, index: int) -> Array:
        time, eye = float(self._times[index]), self._true_eyes[index]
        people = [figure.posed(time) for figure in self._people or self._figures if figure.shown_at(time)]
        image = self._backdrop.image(eye, [body.p for body in people])
        if self._people:
            blend(image, eye, people, self._room.light)
        return image

    def _keypoints(self, shown: np.ndarray, frame: int) -> None:
        """What the detector found, as thin limbs."""
        drawn = self._drawn
        assert drawn.detections is not None
        assert drawn.labels is not None
        assert drawn.model is not None
        by = np.array([self._size[0] / drawn.model.width, self._size[1] / drawn.model.height])
        pairs, radius = limb_pairs(drawn.detections.keypoints), max(1, round(DOT_SHARE * self._size[1]))
        people = drawn.detections.of_frame(frame)
        detections = (drawn.labels[people].tolist(), drawn.detections.seen[people], drawn.detections.pixels[people])
        for label, seen, pixels in zip(*detections, strict=True):
            colour = UNCLAIMED if label < 0 else mixed(wearer_colour(label), (255, 255, 255), 0.6)
            at = np.round(16 * np.where(seen[:, None], pixels * by, 0)).astype(int)
            for a, b in pairs:
                if seen[a] and seen[b]:
                    cv2.line(shown, at[a].tolist(), at[b].tolist(), colour, 1, cv2.LINE_AA, 4)
            for point in at[seen]:
                cv2.circle(shown, point.tolist(), 16 * radius, colour, -1, cv2.LINE_AA, 4)
