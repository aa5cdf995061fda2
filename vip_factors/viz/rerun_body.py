"""A body in Rerun: one entity per bone whose transform moves, so that shape and sensors are logged once."""

from collections.abc import Mapping

import numpy as np
import rerun as rr

from vip_factors.body.kinematics import Motion
from vip_factors.body.mannequin import SENSOR_COLOUR, Colour, Side
from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.calibration import Calibration, Placement
from vip_factors.viz.rerun_skin import log_shape

TIMELINE = "time"
SENSOR_HALF_SIZE_M = (0.022, 0.016, 0.007)  # a usual body-worn IMU's box: 45 × 32 × 14 mm
SENSOR_AXIS_M = 0.07  # long enough to see how a sensor is turned
AXIS_COLOURS = ((224, 60, 60), (70, 170, 80), (60, 100, 220))
TRAIL_RADIUS_M = 0.006


def time_column(time: Array) -> rr.TimeColumn:
    """Seconds from the recording's start as Rerun's column."""
    return rr.TimeColumn(TIMELINE, duration=time)


def log_body(
    stream: rr.RecordingStream, entity: str, motion: Motion, colours: Mapping[Side, Colour], *, ghost: bool = False
) -> None:
    """Log a moving body below ``entity``: ``entity/<bone>`` carries the bone's world pose and its static shape.

    Args:
        stream: where to.
        entity: path in the world, such as ``world/estimate``.
        motion: in the world to be drawn.
        colours: of the segments by side.
        ghost: draw see-through, for what something else is compared with.
    """
    log_poses(stream, entity, motion)
    log_shape(stream, entity, motion.skeleton, colours, ghost=ghost)


def log_poses(stream: rr.RecordingStream, entity: str, motion: Motion) -> None:
    """Log the world poses of all bones, ``entity/<bone>``."""
    state = motion.state
    quaternions = quaternion_from_matrix(state.R_world_bone, Order.XYZW).astype(np.float32)
    positions = state.p_world_joint.astype(np.float32)
    time = time_column(motion.time)
    for bone, name in enumerate(JOINT_NAMES):
        stream.send_columns(
            f"{entity}/{name}",
            indexes=[time],
            columns=rr.Transform3D.columns(translation=positions[:, bone], quaternion=quaternions[:, bone]),
        )


def log_rest_body(stream: rr.RecordingStream, entity: str, motion: Motion, colours: Mapping[Side, Colour]) -> None:
    """Log the first frame of a motion as a body that stands still for ever."""
    state = motion.state
    for bone, name in enumerate(JOINT_NAMES):
        pose = rr.Transform3D(translation=state.p_world_joint[0, bone], mat3x3=state.R_world_bone[0, bone])
        stream.log(f"{entity}/{name}", pose, static=True)
    log_shape(stream, entity, motion.skeleton, colours)


def log_sensors(
    stream: rr.RecordingStream,
    entity: str,
    placement: Placement,
    calibration: Calibration | None,
    colours: Mapping[str, Colour],
) -> None:
    """Log each sensor as a box with its axes, fixed to its bone: as calibrated, else as placed roughly.

    ``colours`` are those of its curves; a sensor without one is pale yellow.
    """
    for site in placement.sites:
        known = None if calibration is None else calibration.get(site.sensor)
        R_bone_sensor = site.R_bone_sensor if known is None else known.R_bone_sensor
        path = f"{entity}/{site.bone}/{site.sensor}"
        pose = rr.Transform3D(translation=site.p_bone_sensor, mat3x3=R_bone_sensor)
        stream.log(path, pose, static=True)
        box = rr.Boxes3D(
            half_sizes=[SENSOR_HALF_SIZE_M], colors=[colours.get(site.sensor, SENSOR_COLOUR)], fill_mode="solid"
        )
        stream.log(path, box, static=True)
        axes = rr.Arrows3D(vectors=SENSOR_AXIS_M * np.eye(3), colors=AXIS_COLOURS, radii=0.0025)
        stream.log(f"{path}/axes", axes, static=True)


def log_trail(stream: rr.RecordingStream, entity: str, motion: Motion, floor: float, colour: Colour) -> None:
    """Log the way of the pelvis, laid on the floor, as one static line."""
    path = motion.p_world_pelvis.copy()
    path[:, 2] = floor
    stream.log(entity, rr.LineStrips3D([path], colors=[colour], radii=TRAIL_RADIUS_M), static=True)
