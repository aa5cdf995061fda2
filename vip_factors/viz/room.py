"""A light room to stand in: tiles that fade into the background, soft shadows, and pictures of everybody in it."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from vip_factors.geometry.rotations import Array
from vip_factors.viz.eye import Eye, Lens, room_model, viewpoints
from vip_factors.viz.figure import Figure, as_bytes, blend, lit_from

_TILES = np.array([[0.79, 0.795, 0.80], [0.905, 0.902, 0.892]], np.float32)  # their joints, and they
_WALL = np.array([[0.955, 0.958, 0.962], [0.83, 0.86, 0.90]], np.float32)  # at the horizon, and high up
TILE_M, JOINT_M = 0.5, 0.012
FADE_M = (3.5, 11.0)  # from the middle of the scene: where tiles begin to fade, and are gone
SHADOW_CELL_M = 0.02
SHADOW_MARGIN_M = 0.6  # around what falls onto the floor: room for the blur
SHADOW_POINTS = 3.0  # of the skin in a cell, for full shadow
TALL_M = 0.6  # what casts from higher up has a softer edge
SOFT_M = {"contact": 0.035, "low": 0.04, "tall": 0.10, "under": 0.25}
DARK = {"contact": 0.55, "low": 0.26, "tall": 0.22, "under": 0.16}
LARGEST_CELLS = 1500


@dataclass(frozen=True)
class Room:
    """The floor's height in metres, the middle ``(2,)`` of what happens on it, and the unit direction to the light."""

    floor: float
    middle: np.ndarray
    light: Array


class Backdrop:
    """The room as one eye sees it, without bodies; kept while the eye stands still."""

    def __init__(self, room: Room, lens: Lens) -> None:
        self.room, self._lens = room, lens
        self._size = (lens.model.width, lens.model.height)
        self._eye: Eye | None = None
        self._image = np.zeros((0, 0, 3), np.float32)
        self._x = self._y = np.zeros((0, 0), np.float32)

    def image(self, eye: Eye, bodies: Sequence[np.ndarray]) -> np.ndarray:
        """``(H, W, 3)`` float32 with the shadows of bodies, points ``(V, 3)`` of whose skin are given."""
        if self._eye is None or not _same(eye, self._eye):
            self._image, self._x, self._y = _empty_room(self.room, eye, self._lens)
            self._eye = eye
        image = self._image.copy()
        shadow, corner = shadow_map(self.room, bodies)
        seen = self._shadowed(eye, shadow.shape, corner)
        if self._x[seen].size:
            image[seen] *= _light(shadow, corner, self._x[seen], self._y[seen])[..., None]
        return image

    def _shadowed(self, eye: Eye, shape: tuple[int, ...], corner: np.ndarray) -> tuple[slice, slice]:
        """The part of the picture in which the shadow map lies."""
        far = corner + SHADOW_CELL_M * np.array(shape[::-1])
        floor = self.room.floor
        edges = np.array([[x, y, floor] for x in (corner[0], far[0]) for y in (corner[1], far[1])])
        pixels, depths = eye.project(edges)
        if (depths < 0.2).any():
            return slice(None), slice(None)
        low, high = np.floor(pixels.min(axis=0)).astype(int), np.ceil(pixels.max(axis=0)).astype(int) + 1
        columns, rows = (slice(*np.clip([a, b], 0, n).tolist()) for a, b, n in zip(low, high, self._size, strict=True))
        return rows, columns


def floor_light(room: Room, eye: Eye, bodies: Sequence[np.ndarray]) -> np.ndarray:
    """How bright the floor is ``(H, W)``, 1 where no shadow falls: for pictures on white paper."""
    _, x, y = _empty_room(room, eye, Lens(eye.model))
    return _light(*shadow_map(room, bodies), x, y)


def _light(shadow: np.ndarray, corner: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """What a shadow map leaves of the light at points of the floor."""
    to_x, to_y = (
        (one - np.float32(low)) * np.float32(1 / SHADOW_CELL_M) for one, low in zip((x, y), corner, strict=True)
    )
    return cv2.remap(1 - shadow, to_x, to_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=1.0)


def _same(one: Eye, other: Eye) -> bool:
    return np.array_equal(one.p_world_camera, other.p_world_camera) and np.array_equal(
        one.R_world_camera, other.R_world_camera
    )


def _empty_room(room: Room, eye: Eye, lens: Lens) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The picture, and where on the floor each pixel's ray ends (nowhere: far away)."""
    R, f = eye.R_world_camera.astype(np.float32), np.float32(eye.model.focal[0])
    u, v = lens.rays
    down = R[2, 0] * u + R[2, 1] * v + R[2, 2]
    up = np.clip(2 * down / np.sqrt(u * u + v * v + 1), 0, 1)[..., None]
    image = _WALL[0] + (_WALL[1] - _WALL[0]) * up
    x, y = np.full((2, *down.shape), 1e6, np.float32)
    height = np.float32(eye.p_world_camera[2] - room.floor)
    hit = down < -1e-4
    if height <= 0 or not hit.any():
        return image, x, y
    u, v, down = u[hit], v[hit], down[hit]
    t = -height / down
    joints, places = np.ones_like(t), []
    for i in range(2):
        ray = R[i, 0] * u + R[i, 1] * v + R[i, 2]
        place = np.float32(eye.p_world_camera[i]) + t * ray
        # How far a pixel reaches on the floor: over that the joints are averaged, so that far ones do not flicker.
        reach = sum(np.abs(R[i, j] - ray * (R[2, j] / down)) for j in range(2)) * (t / f)
        joints *= 1 - _lines(place, reach)
        places.append(place)
    away = np.hypot(places[0] - np.float32(room.middle[0]), places[1] - np.float32(room.middle[1]))
    fade = np.clip((away - FADE_M[0]) / (FADE_M[1] - FADE_M[0]), 0, 1)
    fade = (fade * fade * (3 - 2 * fade))[:, None]
    floor = _TILES[0] + (_TILES[1] - _TILES[0]) * joints[:, None]
    image[hit] = floor + (_WALL[0] - floor) * fade
    x[hit], y[hit] = places
    return image, x, y


def _lines(along: np.ndarray, reach: np.ndarray) -> np.ndarray:
    """Share of joints between tiles in a stretch of floor: the mean of the pattern over ``reach`` metres."""
    share = np.float32(JOINT_M / TILE_M)

    def total(at: np.ndarray) -> np.ndarray:
        whole = np.floor(at)
        return whole * share + np.minimum(at - whole, share)

    half = np.clip(reach / TILE_M, 1e-4, 1e4) / 2
    middle = along / TILE_M + share / 2
    return np.clip((total(middle + half) - total(middle - half)) / (2 * half), 0, 1)


def shadow_map(room: Room, bodies: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """How dark the floor is, ``(N, M)`` by y and x in cells, and the world's x and y of its first cell."""
    sun, nothing = room.light, (np.zeros((1, 1), np.float32), np.zeros(2))
    if not bodies:
        return nothing
    p = np.concatenate(bodies)
    height = np.maximum(p[:, 2] - np.float32(room.floor), 0)
    cast = p[:, :2] - height[:, None] * (sun[:2] / sun[2]).astype(np.float32)
    low = np.minimum(cast, p[:, :2]).min(axis=0) - SHADOW_MARGIN_M
    high = np.maximum(cast, p[:, :2]).max(axis=0) + SHADOW_MARGIN_M
    size = np.ceil((high - low) / SHADOW_CELL_M).astype(int) + 1
    if size.max() > LARGEST_CELLS:
        return nothing
    dark = np.ones((size[1], size[0]), np.float32)
    for kind, points, weights in (
        ("contact", p[:, :2], np.exp(-height / 0.05)),
        ("low", cast, (height < TALL_M).astype(np.float32)),
        ("tall", cast, (height >= TALL_M).astype(np.float32)),
        ("under", p[:, :2], np.exp(-height / 0.5)),
    ):
        cell = np.floor((points - low) / SHADOW_CELL_M).astype(int)
        count = np.bincount(cell[:, 1] * size[0] + cell[:, 0], weights, minlength=size[0] * size[1])
        full = np.clip(count.reshape(size[1], size[0]) / SHADOW_POINTS, 0, 1).astype(np.float32)
        dark *= 1 - DARK[kind] * np.clip(cv2.GaussianBlur(full, (0, 0), SOFT_M[kind] / SHADOW_CELL_M), 0, 1)
    return 1 - dark, low + SHADOW_CELL_M / 2


FLOOR_SAMPLES = 40


def floor_of(figures: list[Figure], times: Array) -> float:
    """Height in metres on which the lowest skin usually is; a jump or a bad frame does not move it."""
    some = times[np.unique(np.linspace(0, len(times) - 1, min(FLOOR_SAMPLES, len(times))).astype(int))]
    lowest = [min(float(figure.posed(time).p[:, 2].min()) for figure in figures) for time in some]
    return float(np.median(lowest))


class RoomPane:
    """Pictures of the room at some times.

    Args:
        figures: everybody.
        times: ``(T,)`` seconds.
        size: of the pictures, width and height.
    """

    def __init__(self, figures: list[Figure], times: Array, size: tuple[int, int]) -> None:
        self._times = times
        self._figures = figures
        floor = floor_of(self._figures, times)
        model = room_model(*size)
        self._eyes = viewpoints([figure.motion for figure in self._figures], floor, times, model)
        middle = np.mean([figure.motion.p_world_pelvis[:, :2].mean(axis=0) for figure in self._figures], axis=0)
        self.room = Room(floor, middle, lit_from(self._eyes[0]))
        self._backdrop = Backdrop(self.room, Lens(model))

    def draw(self, index: int) -> np.ndarray:
        """``(H, W, 3)`` uint8, red green blue, at ``times[index]``."""
        eye, time = self._eyes[index], float(self._times[index])
        bodies = [figure.posed(time) for figure in self._figures if figure.shown_at(time)]
        image = self._backdrop.image(eye, [body.p for body in bodies])
        blend(image, eye, bodies, self.room.light)
        return as_bytes(image)
