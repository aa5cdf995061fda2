"""Readers of foreign sensor logs, one format per file: each has ``FORMAT``, ``matches(path)`` and ``read(path)``."""
