"""Where the 3D view is looked from: near enough that people fill it, and following the point between them."""

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from vip_factors.body.kinematics import Motion
from vip_factors.geometry.rotations import Array, rotation_z
from vip_factors.viz.rerun_body import time_column

# Rerun's viewer shows as many metres of height as its eye is away, nearly.
HEIGHT_PER_METRE = 1.03
ROOM_M = 0.55  # beside the outermost pelvis: an arm held out
NEAREST_M, WIDEST_M = 2.5, 14.0  # a whole person fits; farther off nobody is seen
EYE_TURN = 0.68  # radians to the left of straight ahead: from there a body has depth
TURNS_DEG = (0.0, -20.0, 20.0, -40.0, 40.0, -60.0, 60.0)  # that are tried, the least first
UP = 0.29  # of the direction to the eye: a little from above, so that the floor shows where people stand


def forward_of(motion: Motion) -> Array:
    """The horizontal direction ``(3,)`` that a body faces in its first frame."""
    forward: Array = motion.state.R_world_bone[0, 0, :, 2] * [1, 1, 0]
    norm = float(np.linalg.norm(forward))
    return forward / norm if norm > 1e-6 else np.array([1.0, 0.0, 0.0])


def centre_path(motions: Sequence[Motion]) -> tuple[Array, Array]:
    """The point between the wearers over time: seconds ``(T,)`` of the first, metres ``(T, 3)``.

    Its height is the pelvises' mean, always: an eye that bobs with the steps is no pleasure.
    """
    time = motions[0].time
    paths = np.array([[np.interp(time, one.time, one.p_world_pelvis[:, axis]) for axis in range(3)] for one in motions])
    centre: Array = paths.mean(axis=0).T
    centre[:, 2] = centre[:, 2].mean()
    return time, centre


def spread_of(motions: Sequence[Motion]) -> float:
    """Metres from the point between the wearers to the outermost one, most of the time."""
    time, centre = centre_path(motions)
    off = [
        np.hypot(*(np.interp(time, one.time, one.p_world_pelvis[:, axis]) - centre[:, axis] for axis in range(2)))
        for one in motions
    ]
    return float(np.percentile(np.max(off, axis=0), 95))


def abreast(motions: Sequence[Motion], ahead: Array) -> Array:
    """The horizontal direction ``(3,)`` within 60° of ``ahead`` for which people at the start hide each other least."""
    places = np.array([one.p_world_pelvis[0] for one in motions])
    turned = [rotation_z(np.deg2rad(degrees)) @ ahead for degrees in TURNS_DEG]
    across = [float(np.ptp(places @ (rotation_z(EYE_TURN) @ [-one[1], one[0], 0.0]))) for one in turned]
    return turned[int(np.argmax(np.round(across, 2)))]


def eye(target: Array, ahead: Array, spread: float, aspect: float, follow: str | None) -> rrb.EyeControls3D:
    """An eye before people and to their left.

    Args:
        target: ``(3,)`` metres, between them at the start.
        ahead: ``(3,)`` horizontal direction in which the eye lies, from which the eye is turned to see depth.
        spread: metres from there to the outermost of them.
        aspect: width of the view by its height.
        follow: entity that the eye follows, or None.
    """
    distance = (spread + ROOM_M) / (0.5 * HEIGHT_PER_METRE * aspect) + spread
    distance = float(np.clip(distance, NEAREST_M, WIDEST_M))
    direction = rotation_z(EYE_TURN) @ ahead + np.array([0.0, 0.0, UP])
    return rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=target + distance * direction / np.linalg.norm(direction),
        look_target=target,
        eye_up=(0.0, 0.0, 1.0),
        tracking_entity=follow,
    )


CENTRE = "world/centre"
RADIUS_M = 0.001  # something must be drawn for Rerun to follow it


def log_centre(stream: rr.RecordingStream, time: Array, p_world_centre: Array) -> None:
    """Log where it is: seconds ``(T,)``, metres ``(T, 3)``."""
    stream.log(CENTRE, rr.Points3D([[0.0, 0.0, 0.0]], radii=RADIUS_M), static=True)
    columns = rr.Transform3D.columns(translation=p_world_centre.astype(np.float32))
    stream.send_columns(CENTRE, indexes=[time_column(time)], columns=columns)
