"""From our world, Z up, to one with Y up as animation programs have it."""

from vip_factors.body.joint_angles import R_WORLD_ISB

R_YUP_WORLD = R_WORLD_ISB.T
"""x stays, z becomes y, y becomes -z: what Blender and glTF do. At rest a body then faces z, its left along x."""
