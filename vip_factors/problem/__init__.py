"""Least-squares problem of a scene: wearers, cameras, keypoint views, layout of the variables and their values."""
