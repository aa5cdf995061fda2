"""What is told follows what is believed without jumping: each new measurement changes a little what is believed."""

from dataclasses import dataclass

import numpy as np

from vip_factors.geometry.rotations import Array, exp, log, transpose
from vip_factors.live.state import FrameState


@dataclass
class AnswerFilter:
    """Told frames: each is the one told before, moved as the estimate moves between the two, and drawn towards it.

    A smoother believes something slightly else of the frame before once a frame is added. Told as it is, that reads as
    trembling of some millimetres; it is made up for over ``share`` of what is left with each frame instead.

    Attributes:
        share: of the difference to what is believed that each frame makes up for, in (0, 1]; 1 tells what is believed.
    """

    share: float
    _told: FrameState | None = None

    def filtered(self, before: FrameState | None, now: FrameState) -> FrameState:
        """The next frame to tell.

        Args:
            before: what is believed by now of the frame told last; None to begin anew.
            now: what is believed of the next one.
        """
        told = self._told
        if told is None or before is None or self.share >= 1:
            self._told = now
            return now
        believed, last, old = _rotations(now), _rotations(before), _rotations(told)
        R = believed @ exp((1 - self.share) * log(transpose(last) @ old))
        p = [
            new_p + (1 - self.share) * (old_p - last_p)
            for old_p, last_p, new_p in zip(_positions(told), _positions(before), _positions(now), strict=True)
        ]
        joints = R[:-1].reshape(now.R_parent_child.shape)
        self._told = FrameState(joints, p[0], R[-1], p[1])
        return self._told


def _rotations(state: FrameState) -> Array:
    return np.concatenate([state.R_parent_child.reshape(-1, 3, 3), state.R_world_camera[None]])


def _positions(state: FrameState) -> tuple[Array, Array]:
    return state.p_world_pelvis, state.p_world_camera
