"""Repetitions of exercises: squats, lunges, jumps and curls, each with its times, depth, ranges and symmetry."""
