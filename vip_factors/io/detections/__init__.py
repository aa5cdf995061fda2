"""Readers of 2D poses, one format per file: each has ``FORMAT``, ``matches(path)`` and ``read(path)``."""
