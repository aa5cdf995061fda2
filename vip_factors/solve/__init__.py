"""Least squares on factor graphs, knowing nothing of bodies."""
