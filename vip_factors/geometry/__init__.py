"""Rotations, quaternions and alignment: plain NumPy on stacks, knowing nothing of bodies or sensors."""
