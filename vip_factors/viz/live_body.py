"""One wearer of a stream in Rerun: the newest body, the smoothed one, and the sensors on them."""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from vip_factors.body.kinematics import Motion
from vip_factors.body.mannequin import Colour, Side
from vip_factors.geometry.rotations import Array
from vip_factors.live_estimate import LivePose, LiveWearerEstimate
from vip_factors.sensors.live import LiveWearer
from vip_factors.viz.colours import GHOST_COLOUR, body_colours
from vip_factors.viz.compare import moved
from vip_factors.viz.rerun_body import log_joints, log_joints_style, log_poses, log_sensors, log_shape


class LiveBody:
    """One wearer: the newest pose solid in the wearer's colour, the smoothed one, a lag earlier, a dark ghost.

    Attributes:
        shift: ``(3,)`` metres by which the wearer is drawn elsewhere.
    """

    def __init__(
        self, stream: rr.RecordingStream, index: int, wearer: LiveWearer, rate: float, sensors: dict[str, Colour]
    ) -> None:
        self.shift: Array = np.zeros(3)
        self._sensors = sensors
        self._stream, self._wearer, self._rate = stream, wearer, rate
        self._skeleton, self._colours = wearer.subject.body(), body_colours(index)
        below = f"world/{rr.escape_entity_path_part(wearer.name)}"
        self.newest, self._smoothed = f"{below}/newest", f"{below}/smoothed"
        self._log_shape()
        log_joints_style(stream, f"{self.newest}/joints", index)

    def _log_shape(self) -> None:
        ghost = dict.fromkeys(Side, GHOST_COLOUR)
        log_shape(self._stream, self.newest, self._skeleton, self._colours)
        log_shape(self._stream, self._smoothed, self._skeleton, ghost, ghost=True)

    def motion(self, poses: Sequence[LivePose]) -> Motion:
        """Poses one frame apart."""
        R = np.array([one.R_parent_child for one in poses])
        p = np.array([one.p_world_pelvis for one in poses])
        return Motion(self._skeleton, R, p, self._rate, poses[0].time, self._wearer.name)

    def log(self, answers: list[LiveWearerEstimate]) -> Motion:
        """Log the poses; returns the newest ones."""
        body = answers[-1].skeleton
        if body is not None and not np.array_equal(body.p_parent_joint, self._skeleton.p_parent_joint):
            self._skeleton = body
            self._log_shape()
        newest = self.motion([one.newest for one in answers])
        log_poses(self._stream, self.newest, moved(newest, self.shift))
        log_joints(self._stream, f"{self.newest}/joints", moved(newest, self.shift))
        smoothed = [one.smoothed for one in answers if one.smoothed is not None]
        if smoothed:
            log_poses(self._stream, self._smoothed, moved(self.motion(smoothed), self.shift))
        return newest

    def log_sensors(self, answer: LiveWearerEstimate) -> None:
        """The sensors on the bones, as their mountings are believed to be now."""
        log_sensors(self._stream, self.newest, self._wearer.placement, answer.calibration, self._sensors)
