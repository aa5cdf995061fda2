"""Gait: foot strikes and toe-offs, strides, their figures, and joint angles over the cycle."""
