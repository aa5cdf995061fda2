"""Rotations, quaternions, poses and alignment, batched in NumPy."""
