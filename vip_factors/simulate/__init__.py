"""Recordings with truth, made from any motion."""
