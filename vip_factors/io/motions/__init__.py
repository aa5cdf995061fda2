"""Motion files of other people, brought onto our skeleton."""

from vip_factors.io.motions.bvh import read_bvh
from vip_factors.io.motions.files import MOTION_SUFFIXES, read_motion

__all__ = ["MOTION_SUFFIXES", "read_bvh", "read_motion"]
