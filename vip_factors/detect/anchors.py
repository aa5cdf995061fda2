"""Where the person detector's answers are counted from: one point of the image for each of them.

The layout is MediaPipe's published one for BlazePose: an image of 224 pixels, layers of stride 8, 16 and three times
32, two anchors a cell and layer, all of size one.
"""

import numpy as np

from vip_factors.geometry.rotations import Array

INPUT = 224  # pixels, both ways
STRIDES = (8, 16, 32, 32, 32)
PER_CELL = 2  # of each layer


def anchor_centres() -> Array:
    """Centres ``(2254, 2)`` as fractions of the image, x and y, in the order of the model's answers.

    Layers of the same stride follow one another within a cell.
    """
    centres = []
    for stride in dict.fromkeys(STRIDES):
        cells = -(-INPUT // stride)
        row, column = np.divmod(np.arange(cells * cells), cells)
        cell = np.column_stack([column + 0.5, row + 0.5]) / cells
        centres.append(np.repeat(cell, PER_CELL * STRIDES.count(stride), axis=0))
    return np.concatenate(centres)
