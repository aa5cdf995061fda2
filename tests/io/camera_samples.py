"""Camera files: ours, OpenCV's, ROS's, plain JSON, and Pose2Sim's of two cameras."""

from pathlib import Path

import cv2
import numpy as np

GOOD = "width = 640\nheight = 480\nfx = 500\nfy = 500.5\ncx = 320\ncy = 240\n"
K, BENT = np.array([[500.0, 0, 320], [0, 510, 240], [0, 0, 1]]), np.array([[0.1, -0.2, 0.001, 0.002, 0.05]])
ROS = (
    "image_width: 640\nimage_height: 480\ncamera_name: head\ncamera_matrix:\n  rows: 3\n  cols: 3\n"
    "  data: [500, 0, 320, 0, 510, 240, 0, 0, 1]\ndistortion_model: plumb_bob\ndistortion_coefficients:\n"
    "  rows: 1\n  cols: 5\n  data: [0.1, -0.2, 0.001, 0.002, 0.05]\n"
)
PLAIN = f'{{"camera_matrix": {K.tolist()}, "dist_coeffs": {BENT.tolist()}, "image_size": [640, 480]}}'
POSE2SIM = """[left]
name = "left"
size = [1088.0, 1920.0]
matrix = [[1681.2, 0.0, 532.9], [0.0, 1681.0, 948.1], [0.0, 0.0, 1.0]]
distortions = [-0.05, 0.1, 0.0, 0.0]
rotation = [1.5707963267948966, 0.0, 0.0]
translation = [0.5, 1.5, 4.0]
fisheye = false

[right]
size = [640, 480]
matrix = [[500, 0, 320], [0, 500, 240], [0, 0, 1]]
distortions = []
rotation = [0, 0, 0]
translation = [0, 0, 0]

[metadata]
adjusted = false
"""


def write_opencv(path: Path) -> None:
    """As OpenCV writes it, in the form that the suffix tells: .yaml, .xml or .json."""
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 640)
    storage.write("image_height", 480)
    storage.write("camera_matrix", K)
    storage.write("dist_coeffs", BENT)
    storage.release()
