"""Parts of a film: what the camera saw with bodies over it, and headings as they settle in a live estimate."""

from collections.abc import Sequence

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from vip_factors.body.body_mesh import body_mesh
from vip_factors.body.mannequin import Colour, Side
from vip_factors.body.skeleton import PARENTS
from vip_factors.geometry.rotations import Array, wrap_angle
from vip_factors.sensors.calibration import Calibration
from vip_factors.sensors.camera_path import CameraPath
from vip_factors.viz.charts import GRID, SOFT_INK, page, panel, pixels, seconds_axis, write
from vip_factors.viz.colours import UNCLAIMED, hexadecimal, mixed, wearer_colour
from vip_factors.viz.drawn_scene import DrawnScene, DrawnWearer
from vip_factors.viz.eye import Eye, Lens, scaled
from vip_factors.viz.figure import Figure, as_bytes, blend, lit_from
from vip_factors.viz.images import draw_pose, limb_pairs, video_stream
from vip_factors.viz.room import Backdrop, Room, floor_of

CLOTHES = dict.fromkeys(Side, (206, 208, 212))
PLANE: Colour = (34, 38, 45)  # of a frame whose picture is not there
BONES = np.array([[parent, joint] for joint, parent in enumerate(PARENTS) if parent >= 0])
NEAREST_M = 0.1  # joints behind the camera are in no picture
DOT_SHARE = 1 / 260  # of the picture's height: a keypoint's radius
HIGHEST_DEG = 60.0  # of the chart: headings that are further off are at its edge


class CameraPane:
    """Pictures of the camera at some of its frames, red green blue.

    Without a video the room is drawn in its place: through the true camera, with everybody as they really moved, in
    grey, as far as that is known; a dark plane, and what was detected, where nothing is known of where the camera was,
    and where skeletons are drawn instead of bodies.

    Args:
        drawn: a scene with a camera.
        figures: its wearers.
        times: ``(T,)`` seconds of the frames.
        frames: ``(T,)`` their numbers in the video.
        size: of the pictures, width and height.
        opacity: of the bodies that are laid over; None for skeletons instead.
    """

    def __init__(
        self,
        drawn: DrawnScene,
        figures: list[Figure],
        times: Array,
        frames: np.ndarray,
        size: tuple[int, int],
        opacity: float | None,
    ) -> None:
        assert drawn.model is not None
        self._drawn, self._times, self._frames, self._opacity = drawn, times, frames, opacity
        self._size, self._model, self._figures = size, scaled(drawn.model, *size), figures
        self._video = video_stream(drawn.video, frames.tolist())
        self._eyes = self._seen_from(drawn.path) if drawn.path is not None and figures else []
        if not self._eyes or opacity is None:
            return
        self._true_eyes = self._seen_from(drawn.true_path) if drawn.true_path is not None else self._eyes
        self._people = [
            Figure(body_mesh(wearer.truth.skeleton), wearer.truth, CLOTHES)
            for wearer in drawn.wearers
            if wearer.motion is not None and wearer.truth is not None
        ]
        at = np.mean([figure.motion.p_world_pelvis[:, :2].mean(axis=0) for figure in figures], axis=0)
        self._room = Room(floor_of(self._people or figures, times), at, lit_from(self._true_eyes[0]))
        self._backdrop = Backdrop(self._room, Lens(self._model))

    def _seen_from(self, path: CameraPath) -> Sequence[Eye]:
        at = path.at(self._times)
        return [Eye(self._model, R, p) for R, p in zip(at.R_world_camera, at.p_world_camera, strict=True)]

    def draw(self, index: int) -> np.ndarray:
        """``(H, W, 3)`` uint8, red green blue, at ``times[index]``; to be called for one after the other."""
        time, picture = float(self._times[index]), next(self._video)
        plain = self._opacity is None or not self._eyes
        image = self._of_video(picture) if picture is not None else self._plane() if plain else self._room_seen(index)
        if self._eyes and self._opacity is not None:
            bodies = [figure.posed(time) for figure in self._figures if figure.shown_at(time)]
            alone = picture is None and not self._people
            blend(image, self._eyes[index], bodies, self._room.light, 1.0 if alone else self._opacity)
        shown = as_bytes(image)
        self._keypoints(shown, int(self._frames[index]))
        if self._eyes and self._opacity is None:
            self._skeletons(shown, self._eyes[index], time)
        return shown

    def _skeletons(self, shown: np.ndarray, eye: Eye, time: float) -> None:
        for wearer in self._drawn.wearers:
            motion = wearer.shown
            if motion is None or not motion.time[0] - 0.1 <= time <= motion.time[-1] + 0.1:
                continue
            frame = int(np.clip(round((time - motion.start) * motion.rate), 0, len(motion) - 1))
            pixels, depth = eye.project(motion.state.p_world_joint[frame])
            label = wearer.name if len(self._drawn.wearers) > 1 else ""
            draw_pose(shown, BONES, pixels, (depth > NEAREST_M).astype(float), wearer.index, label, 2.0)

    def _of_video(self, picture: np.ndarray) -> Array:
        fitted = cv2.resize(picture, self._size, interpolation=cv2.INTER_AREA)
        return np.ascontiguousarray(fitted[..., ::-1]).astype(np.float32) / 255

    def _plane(self) -> Array:
        return np.broadcast_to(np.array(PLANE, np.float32) / 255, (self._size[1], self._size[0], 3)).copy()

    def _room_seen(self, index: int) -> Array:
        time, eye = float(self._times[index]), self._true_eyes[index]
        people = [figure.posed(time) for figure in self._people or self._figures if figure.shown_at(time)]
        image = self._backdrop.image(eye, [body.p for body in people])
        if self._people:
            blend(image, eye, people, self._room.light)
        return image

    def _keypoints(self, shown: np.ndarray, frame: int) -> None:
        """What the detector found, as thin limbs; broader ones where no body is drawn."""
        drawn = self._drawn
        assert drawn.detections is not None
        assert drawn.labels is not None
        assert drawn.model is not None
        by = np.array([self._size[0] / drawn.model.width, self._size[1] / drawn.model.height])
        pairs, radius = limb_pairs(drawn.detections.keypoints), max(1, round(DOT_SHARE * self._size[1]))
        line = 1 if self._eyes else 2
        people = drawn.detections.of_frame(frame)
        detections = (drawn.labels[people].tolist(), drawn.detections.seen[people], drawn.detections.pixels[people])
        for label, seen, found in zip(*detections, strict=True):
            colour = UNCLAIMED if label < 0 else mixed(wearer_colour(label), (255, 255, 255), 0.6)
            at = np.round(16 * np.where(seen[:, None], found * by, 0)).astype(int)
            for a, b in pairs:
                if seen[a] and seen[b]:
                    cv2.line(shown, at[a].tolist(), at[b].tolist(), colour, line, cv2.LINE_AA, 4)
            for point in at[seen]:
                cv2.circle(shown, point.tolist(), 16 * radius * line, colour, -1, cv2.LINE_AA, 4)


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
        highest = max(float(np.abs(errors).max()) for _, _, errors in self._errors)
        self._highest = float(np.clip(10 * np.ceil(highest / 10), 10, HIGHEST_DEG))
        (self._faint, _), (self._full, self._axes) = (self._chart(share) for share in (0.82, 0.25))
        self._medians: dict[int, np.ndarray] = {}

    def draw(self, index: int) -> np.ndarray:
        """``(H, W, 3)`` uint8, red green blue, at ``times[index]``."""
        time = float(self._times[index])
        now = [
            (float(np.interp(time, times, values)), wearer_colour(wearer.index))
            for wearer, times, errors in self._errors
            for values in errors.T
        ]
        at = self._axes.transData.transform([(time, np.clip(value, -self._highest, self._highest)) for value, _ in now])
        at[:, 1] = self._size[1] - at[:, 1]
        x = int(np.clip(round(float(at[0, 0])), 0, self._size[0] - 1))
        shown = self._faint.copy()
        shown[:, :x] = self._full[:, :x]
        box = self._axes.bbox
        top, bottom = round(self._size[1] - box.y1), round(self._size[1] - box.y0)
        cv2.line(shown, (x, top), (x, bottom), (150, 156, 166), 1)
        for point, (_, colour) in zip(np.round(16 * at).astype(int).tolist(), now, strict=True):
            cv2.circle(shown, point, round(16 * self._text / 5), colour, -1, cv2.LINE_AA, 4)
        strip = self._median(round(float(np.median(np.abs([value for value, _ in now])))))
        shown[: strip.shape[0], max(0, self._size[0] - strip.shape[1]) :] = strip[:, -self._size[0] :]
        return shown

    def _median(self, degrees: int) -> np.ndarray:
        """The number for the upper right corner."""
        if degrees not in self._medians:
            size = self._text
            figure = page(round(7.5 * size), round(2.0 * size))
            write(figure, (6.7 * size, 1.5 * size), f"median {degrees}°", size, weight="bold", ha="right")
            self._medians[degrees] = pixels(figure)
        return self._medians[degrees]

    def _chart(self, pale: float) -> tuple[np.ndarray, Axes]:
        """The whole chart with lines that are paler by a share of white."""
        size, first, last = self._text, float(self._times[0]), float(self._times[-1])
        figure = page(*self._size)
        count = sum(errors.shape[1] for _, _, errors in self._errors)
        write(figure, (0.6 * size, 1.5 * size), "Heading errors", size, weight="bold")
        write(figure, (9.8 * size, 1.5 * size), f"of {count} sensors", size, SOFT_INK)
        axes = panel(figure, (2.9 * size, 2.9 * size, self._size[0] - 0.8 * size, self._size[1] - 1.9 * size))
        axes.tick_params(labelsize=0.8 * size, pad=4)
        axes.set_ylim(-self._highest, self._highest)
        axes.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 3, 5, 10]))
        axes.yaxis.set_major_formatter("{x:.0f}°")
        axes.grid(axis="y", color=GRID, linewidth=1)
        seconds_axis(axes, first, last, 6)
        for wearer, times, errors in self._errors:
            colour = hexadecimal(mixed(wearer_colour(wearer.index), (255, 255, 255), pale))
            times, errors = np.append(times, max(last, times[-1])), np.concatenate([errors, errors[-1:]])
            axes.plot(times, errors, color=colour, linewidth=1.0 + size / 30)
        return pixels(figure), axes
