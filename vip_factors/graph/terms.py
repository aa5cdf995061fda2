"""Columns of one wearer's tangent: a frame's own, then what all frames share.

Three for each of 24 joints, three for the root; then one for each heading, three for each mounting, and 69 for the
mean pose.
"""

from vip_factors.body.pose_prior import POSE_SIZE
from vip_factors.body.skeleton import JOINT_COUNT

ROOT = 3 * JOINT_COUNT  # first column of the root translation
FRAME = ROOT + 3  # width of a frame's tangent


def width(sensors: int) -> int:
    """Number of all columns."""
    return FRAME + 4 * sensors + POSE_SIZE


def pose_mean_columns(sensors: int) -> range:
    """Columns of the mean pose."""
    return range(width(sensors) - POSE_SIZE, width(sensors))


def heading_column(sensor: int) -> int:
    """Column of a sensor's heading."""
    return FRAME + sensor


def mounting_columns(sensor: int, sensors: int) -> range:
    """Columns of a sensor's mounting."""
    start = FRAME + sensors + 3 * sensor
    return range(start, start + 3)
