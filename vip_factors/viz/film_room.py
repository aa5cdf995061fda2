"""The room of a film: everybody in it, seen from a good place."""

import numpy as np

from vip_factors.geometry.rotations import Array
from vip_factors.viz.eye import Lens
from vip_factors.viz.figure import Figure, as_bytes, blend, lit_from
from vip_factors.viz.room import Backdrop, Room
from vip_factors.viz.viewpoint import room_model, viewpoints

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
