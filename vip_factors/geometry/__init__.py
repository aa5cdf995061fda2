"""Rotations, quaternions, poses and alignment: plain NumPy on stacks, knowing nothing of bodies or sensors."""
