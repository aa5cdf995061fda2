"""Video Inertial Poser: body-worn IMUs (and cameras) to 3D human motion, as a GTSAM factor graph."""

__version__ = "0.1.0"
