"""Parts of a film: what the camera saw with bodies over it, and headings as they settle in a live estimate."""

from collections.abc import Sequence

import cv2
import numpy as np

from vip_factors.body.body_mesh import body_mesh
from vip_factors.body.mannequin import Colour, Side
from vip_factors.geometry.rotations import Array, wrap_angle
from vip_factors.sensors.calibration import Calibration
from vip_factors.sensors.camera_path import CameraPath
from vip_factors.viz.canvas import OVERSAMPLING, Canvas, mixed
from vip_factors.viz.drawn_scene import DrawnScene, DrawnWearer
from vip_factors.viz.eye import Eye, Lens, scaled
from vip_factors.viz.figure import Figure, as_bytes, blend, lit_from
from vip_factors.viz.images import limb_pairs, video_stream
from vip_factors.viz.room import Backdrop, Room, floor_of
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


INK, SOFT_INK, GRID, WHITE = (40, 46, 58), (120, 128, 140), (228, 231, 236), (255, 255, 255)
HIGHEST_DEG = 60.0
STEPS_DEG = (10.0, 20.0, 30.0)  # between grid lines


def heading_errors(
    drawn: DrawnScene, histories: Sequence[tuple[Array, list[Calibration]]]
) -> list[tuple[DrawnWearer, Array, Array]]:
    """How far headings were off while they were found.

    Against the truth, or where that is not known against what they ended at. What all sensors share in one instant is
    taken off: the whole scene may be turned. The first instant is 0 s, with the headings as they came.

    Returns:
        Wearers with times ``(n,)`` in seconds and errors ``(n, S)`` in degrees.
    """
    found = []
    for wearer, (times, calibrations) in zip(drawn.wearers, histories, strict=False):
        if not len(times):
            continue
        truth = wearer.recording.truth.calibration if wearer.recording is not None and wearer.recording.truth else {}
        sensors = [name for name in calibrations[-1] if not truth or name in truth]
        wanted = np.array([(truth or calibrations[-1])[name].heading for name in sensors])
        headings = np.array([[one[name].heading for name in sensors] for one in calibrations])
        headings = np.concatenate([np.zeros((1, len(sensors))), headings])
        times = np.concatenate([[0.0], np.maximum(times, 1e-6)])
        found.append((wearer, times, headings - wanted))
    if not found:
        return []
    return [(wearer, times, np.rad2deg(_less_mean(errors))) for wearer, times, errors in found]


def _less_mean(errors: Array) -> Array:
    mean = np.angle(np.exp(1j * errors).mean(axis=1, keepdims=True))
    return wrap_angle(errors - mean)


class HeadingsPane:
    """Pictures of a chart whose lines grow with time.

    Args:
        drawn: the scene.
        histories: by wearer, times and calibrations.
        times: ``(T,)`` seconds of the film.
        size: of the pictures, width and height.
    """

    def __init__(
        self,
        drawn: DrawnScene,
        histories: Sequence[tuple[Array, list[Calibration]]],
        times: Array,
        size: tuple[int, int],
    ) -> None:
        self._times, self._size = times, size
        self._errors = heading_errors(drawn, histories)
        self._text = float(np.clip(size[1] / 15, 11, 22))
        self._box = (2.6 * self._text, 2.9 * self._text, size[0] - 0.8 * self._text, size[1] - 1.9 * self._text)
        highest = max(float(np.abs(errors).max()) for _, _, errors in self._errors)
        self._highest = float(np.clip(10 * np.ceil(highest / 10), 10, HIGHEST_DEG))
        self._empty = self._axes()
        self._faint, self._full = (self._with_lines(share) for share in (0.82, 0.25))

    def draw(self, index: int) -> np.ndarray:
        """``(H, W, 3)`` uint8, red green blue, at ``times[index]``."""
        time = float(self._times[index])
        x = int(np.clip(round(self._x(time)), 0, self._size[0] - 1))
        shown = self._faint.copy()
        shown[:, :x] = self._full[:, :x]
        top, bottom = round(self._box[1]), round(self._box[3])
        cv2.line(shown, (x, top), (x, bottom), (150, 156, 166), 1)
        now = [
            (float(np.interp(time, times, values)), wearer_colour(wearer.index))
            for wearer, times, errors in self._errors
            for values in errors.T
        ]
        for value, colour in now:
            at = (round(16 * self._x(time)), round(16 * self._y(value)))
            cv2.circle(shown, at, round(16 * self._text / 5), colour, -1, cv2.LINE_AA, 4)
        self._median(shown, float(np.median(np.abs([value for value, _ in now]))))
        return shown

    def _median(self, shown: np.ndarray, degrees: float) -> None:
        """Into the upper right corner."""
        text = self._text
        strip = Canvas(round(7.5 * text), round(2.0 * text))
        label = f"median {degrees:.0f}°"
        strip.text((strip.width - strip.text_width(label, text, 600) - 0.8 * text, 1.5 * text), label, INK, text, 600)
        left = max(0, self._size[0] - strip.width)
        part = shown[: strip.height, left:]
        part[:] = strip.pixels()[: part.shape[0], -part.shape[1] :, ::-1]

    def _x(self, time: float) -> float:
        first, last = float(self._times[0]), float(self._times[-1])
        return self._box[0] + (self._box[2] - self._box[0]) * (time - first) / max(last - first, 1e-6)

    def _y(self, degrees: float) -> float:
        share = np.clip(degrees / self._highest, -1, 1)
        return float(self._box[1] + (self._box[3] - self._box[1]) * (1 - share) / 2)

    def _axes(self) -> Canvas:
        canvas, text = Canvas(*self._size), self._text
        x = canvas.text((0.6 * text, 1.5 * text), "Heading errors", INK, 1.05 * text, 600)
        count = sum(errors.shape[1] for _, _, errors in self._errors)
        canvas.text((x + 0.7 * text, 1.5 * text), f"of {count} sensors", SOFT_INK, text)
        step = next((one for one in STEPS_DEG if self._highest / one <= 2), STEPS_DEG[-1])
        for value in np.arange(-(self._highest // step), self._highest // step + 1) * step:
            y = self._y(float(value))
            canvas.curve([[self._box[0], y], [self._box[2], y]], mixed(GRID, INK, 0.35 if value == 0 else 0.0), 1.0)
            label = f"{value:.0f}°"
            canvas.text(
                (self._box[0] - canvas.text_width(label, 0.8 * text) - 6, y + 0.3 * text), label, SOFT_INK, 0.8 * text
            )
        last = float(self._times[-1])
        for second in np.arange(np.ceil(self._times[0]), last + 1e-6, max(1.0, round(last / 8))):
            label = f"{second:.0f} s"
            at = self._x(float(second)) - canvas.text_width(label, 0.8 * text) / 2
            canvas.text((at, self._box[3] + 1.2 * text), label, SOFT_INK, 0.8 * text)
        return canvas

    def _with_lines(self, pale: float) -> np.ndarray:
        canvas = self._axes()
        for wearer, times, errors in self._errors:
            colour: Colour = mixed(wearer_colour(wearer.index), WHITE, pale)
            inside = np.unique(np.concatenate([times[(times > self._times[0]) & (times < self._times[-1])],
                                               self._times[[0, -1]]]))  # fmt: skip
            for values in errors.T:
                along = np.interp(inside, times, values)
                points = [[self._x(float(t)), self._y(float(v))] for t, v in zip(inside, along, strict=True)]
                canvas.curve(points, colour, 3.2 / OVERSAMPLING + self._text / 30)
        return np.ascontiguousarray(canvas.pixels()[..., ::-1])
