"""Motion files of other people, brought onto our skeleton."""

from vip_factors.io.motions.bvh import read_bvh

__all__ = ["read_bvh"]
