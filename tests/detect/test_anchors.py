"""The detector's answers are counted from a grid of points, in the order of strides."""

import numpy as np

from vip_factors.detect.anchors import anchor_centres


def test_as_many_as_the_model_has_answers() -> None:
    centres = anchor_centres()
    assert centres.shape == (2254, 2)
    assert np.all((centres > 0) & (centres < 1))


def test_layers_of_one_stride_lie_in_one_grid_row_by_row() -> None:
    centres = anchor_centres()
    fine, middle, coarse = np.split(centres, [28 * 28 * 2, 28 * 28 * 2 + 14 * 14 * 2])
    for grid, cells, each in ((fine, 28, 2), (middle, 14, 2), (coarse, 7, 6)):
        assert len(grid) == cells * cells * each
        assert np.allclose(grid[:each], 0.5 / cells)
        assert np.allclose(grid[each], [1.5 / cells, 0.5 / cells])  # the next cell is to the right
        assert np.allclose(grid[-1], 1 - 0.5 / cells)
