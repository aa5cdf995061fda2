"""Shaded triangles into a picture with a depth buffer: by OpenCV 5, or in NumPy where OpenCV is older."""

import cv2
import numpy as np

FAR_M = 1e3  # of pixels that nothing covers, about: OpenCV turns depths over and back
COVERED_M = 0.9 * FAR_M  # anything nearer is covered
NEAREST_M = 0.15  # triangles with a corner nearer than this are left out
LARGEST_PX = 400  # in NumPy, so are larger ones: their pixels would take too much memory


def empty_depth(height: int, width: int) -> np.ndarray:
    """A depth buffer of nothing."""
    return np.full((height, width), FAR_M, dtype=np.float32)


def paint(
    image: np.ndarray, depth: np.ndarray, pixels: np.ndarray, depths: np.ndarray, faces: np.ndarray, colours: np.ndarray
) -> None:
    """Draw triangles that face the eye into ``image`` where they are nearer than what is there.

    Colours and depths are linear over the image, not over the surface: for triangles of a few pixels that is the same.

    Args:
        image: ``(H, W, 3)`` float32, changed in place.
        depth: ``(H, W)`` float32 metres, changed in place.
        pixels: ``(V, 2)`` of the vertices, x right and y down; pixel centres are whole numbers.
        depths: ``(V,)`` metres before the eye.
        faces: ``(F, 3)`` int32, anticlockwise seen from outside.
        colours: ``(V, 3)`` float32, 0 to 1.
    """
    near = depths <= NEAREST_M
    if near.any():
        faces = faces[~near[faces].any(axis=1)]
    if not len(faces):
        return
    if hasattr(cv2, "triangleRasterize"):
        _by_opencv(image, depth, pixels, depths, faces, colours)
    else:
        _by_numpy(image, depth, pixels, depths, faces, colours)


def _by_opencv(
    image: np.ndarray, depth: np.ndarray, pixels: np.ndarray, depths: np.ndarray, faces: np.ndarray, colours: np.ndarray
) -> None:
    """Undo OpenCV's own projection (90° high, y up, looking along −z), so that any camera's pixels can be given."""
    half = np.float32(image.shape[0] / 2)
    points = np.empty((len(pixels), 3), np.float32)
    points[:, 0] = (pixels[:, 0] + 0.5 - image.shape[1] / 2) / half * depths
    points[:, 1] = (half - 0.5 - pixels[:, 1]) / half * depths
    points[:, 2] = -depths
    cv2.triangleRasterize(
        points, faces, colours, image, depth, np.eye(4, dtype=np.float32), np.pi / 2, NEAREST_M / 2, FAR_M
    )


def _by_numpy(
    image: np.ndarray, depth: np.ndarray, pixels: np.ndarray, depths: np.ndarray, faces: np.ndarray, colours: np.ndarray
) -> None:
    """All candidate pixels of all triangles at once; the nearest of each pixel wins."""
    height, width = depth.shape
    a, b, c = (pixels[faces[:, corner]].astype(np.float32) for corner in range(3))
    ab, ac = b - a, c - a
    area = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
    low = np.maximum(np.ceil(np.minimum(np.minimum(a, b), c)), 0)
    high = np.minimum(np.floor(np.maximum(np.maximum(a, b), c)), np.array([width, height], np.float32) - 1)
    extent = high - low + 1
    # y goes down in the image: what is anticlockwise from outside has a negative area here.
    good = np.flatnonzero((area < 0) & (extent > 0).all(axis=1) & (extent < LARGEST_PX).all(axis=1))
    a, ab, ac, area, low, extent = (one[good] for one in (a, ab, ac, area, low, extent.astype(np.int32)))
    count = extent[:, 0] * extent[:, 1]
    one = np.repeat(np.arange(len(good)), count)
    row, column = np.divmod(np.arange(len(one)) - np.repeat(np.cumsum(count) - count, count), extent[one, 0])
    x, y = low[one, 0] + column - a[one, 0], low[one, 1] + row - a[one, 1]
    share_b = (x * ac[one, 1] - y * ac[one, 0]) / area[one]
    share_c = (y * ab[one, 0] - x * ab[one, 1]) / area[one]
    inside = np.flatnonzero((share_b >= 0) & (share_c >= 0) & (share_b + share_c <= 1))
    one, share_b, share_c = one[inside], share_b[inside], share_c[inside]
    share = np.stack([1 - share_b - share_c, share_b, share_c], axis=1)
    at = (low[one, 1].astype(int) + row[inside]) * width + low[one, 0].astype(int) + column[inside]
    corners = faces[good[one]]
    there = 1 / np.einsum("nc,nc->n", share, 1 / depths[corners])
    order = np.lexsort((there, at))
    order = order[np.flatnonzero(np.diff(at[order], prepend=-1))]
    order = order[there[order] < depth.ravel()[at[order]]]
    depth.ravel()[at[order]] = there[order]
    image.reshape(-1, 3)[at[order]] = np.einsum("nc,nci->ni", share[order], colours[corners[order]])
