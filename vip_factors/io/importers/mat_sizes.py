"""Sizes that a MATLAB 5 file declares, checked before SciPy makes room for them.

A damaged file may announce gigabytes in a few bytes, and SciPy makes room for what is announced before it reads.
https://www.mathworks.com/help/pdf_doc/matlab/matfile_format.pdf
"""

import math
import zlib
from pathlib import Path

import numpy as np

from vip_factors.errors import FileFormatError

HEAD = 128  # bytes before the first element
MATRIX, COMPRESSED = 14, 15  # types of elements
SPARSE, LARGEST_NUMERIC = 5, 15  # classes of arrays: a sparse one holds fewer numbers than its dimensions tell
DEEPEST = 20  # arrays within arrays
DAMAGED = "the file is damaged; copy it again, or save it anew with '-v7'"


def check_mat_sizes(path: Path) -> None:
    """Refuse a MATLAB 5 file in which an element or an array is larger than what it lies in.

    Raises:
        FileFormatError: naming the file and the byte; also for other files, but for those of MATLAB 7.3 (HDF5).
        OSError: if it cannot be read.
    """
    data = path.read_bytes()
    order = {b"IM": "<", b"MI": ">"}.get(data[126:HEAD])
    if order is None:
        raise FileFormatError(f"{path}: expected a file that MATLAB saved with '-v7'; its head is another one")
    if np.frombuffer(data[124:126], order + "u2")[0] >> 8 == 1:
        _check_elements(memoryview(data)[HEAD:], HEAD, path, order)


def _check_elements(data: memoryview, start: int, path: Path, order: str, depth: int = 0) -> None:
    """All elements that lie there one after another; ``start`` is the place of the first in the file."""
    if depth > DEEPEST:
        raise FileFormatError(f"{path}: byte {start}: arrays within arrays, more than {DEEPEST} deep")
    at = 0
    while at + 8 <= len(data):
        kind, content, after = _element(data, at, start, path, order)
        if kind == COMPRESSED:
            _check_elements(_inflated(content, path, start + at), start + at, path, order, depth + 1)
            at = after
            continue
        if kind == MATRIX:
            _check_dimensions(content, path, start + at, order)
            _check_elements(content, start + at + 8, path, order, depth + 1)
        at = at + 8 * math.ceil((after - at) / 8)  # those that are not compressed begin at whole eights


def _element(data: memoryview, at: int, start: int, path: Path, order: str) -> tuple[int, memoryview, int]:
    """Type and content of an element, and where it ends."""
    kind, size = (int(one) for one in np.frombuffer(data[at : at + 8], order + "u4"))
    small = kind >> 16  # its size shares the word of its type
    kind, size, begin = (kind & 0xFFFF, small, at + 4) if small else (kind, size, at + 8)
    room = 4 if small else len(data) - begin
    if size > room:
        raise FileFormatError(f"{path}: byte {start + at} tells of {size:,} bytes and {room:,} are there: {DAMAGED}")
    return kind, data[begin : begin + size], max(begin + size, at + 8)


def _inflated(content: memoryview, path: Path, at: int) -> memoryview:
    try:
        return memoryview(zlib.decompress(content))
    except zlib.error as error:
        raise FileFormatError(f"{path}: byte {at}: cannot be unpacked ({error}): {DAMAGED}") from error


def _check_dimensions(content: memoryview, path: Path, at: int, order: str) -> None:
    """Every entry of an array takes at least one byte."""
    if len(content) < 24:  # an empty array in a cell is an empty element
        return
    kind = int(np.frombuffer(content[8:12], order + "u4")[0]) & 0xFF
    _, sizes, _ = _element(content, 16, at + 8, path, order)
    dimensions = np.frombuffer(sizes[: len(sizes) // 4 * 4], order + "i4").tolist()
    if kind == SPARSE or kind > LARGEST_NUMERIC or 0 <= math.prod(dimensions) <= len(content):
        return
    shape = " x ".join(map(str, dimensions))
    raise FileFormatError(f"{path}: byte {at}: an array of {shape} in {len(content):,} bytes: {DAMAGED}")
