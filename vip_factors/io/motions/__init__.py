"""Motion files of other people, brought onto our skeleton: BVH, ASF/AMC, AMASS."""

from vip_factors.io.motions.amass import read_amass
from vip_factors.io.motions.asf_amc import read_amc
from vip_factors.io.motions.bvh import read_bvh
from vip_factors.io.motions.files import MOTION_SUFFIXES, motion_files, read_motion

__all__ = ["MOTION_SUFFIXES", "motion_files", "read_amass", "read_amc", "read_bvh", "read_motion"]
