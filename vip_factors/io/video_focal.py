"""The focal length that a phone writes into its videos: metadata of QuickTime and MP4 files."""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

KEY = b"com.apple.quicktime.camera.focal_length.35mm_equivalent"
FULL_FRAME_WIDTH_MM = 34.6  # of a 4:3 image with the diagonal of 35 mm film: the widths of photo and video are the same
STABILISATION = 1.1  # filming crops the width of photos by about a tenth
LONGEST = 256  # bytes of a key or a value: more is damage
METADATA_FOCAL_SIGMA = 0.1  # of the logarithm: the crop differs between phones


def focal_from_metadata(path: Path, width: int, height: int) -> float | None:
    """Focal length in pixels of a video of ``width`` by ``height``; None if the file does not state it."""
    with path.open("rb") as file:
        try:
            equivalent = next(_values(file, path.stat().st_size), None)
        except (struct.error, ValueError, RecursionError):  # a damaged file
            return None
    if equivalent is None or not 5 < equivalent < 500:
        return None
    return STABILISATION * equivalent / FULL_FRAME_WIDTH_MM * max(width, height)


def _atoms(file: BinaryIO, end: int) -> Iterator[tuple[bytes, int]]:
    """Types and ends of the atoms from the file's position to ``end``; the position is then behind each header."""
    position = file.tell()
    while position + 8 <= end:
        file.seek(position)
        size, kind = struct.unpack(">I4s", file.read(8))
        if size == 1:  # of 64 bits
            size = struct.unpack(">Q", file.read(8))[0]
        stop = end if size == 0 else position + size
        if not position + 8 <= stop <= end:
            return
        yield kind, stop
        position = stop


def _values(file: BinaryIO, end: int) -> Iterator[float]:
    """The values of the key in the movie's and its tracks' metadata."""
    index = 0
    for kind, stop in _atoms(file, end):
        if kind == b"meta" and file.read(4) != bytes(4):  # a version in MP4, none in QuickTime
            file.seek(-4, 1)
        if kind in (b"moov", b"trak", b"udta", b"meta"):
            yield from _values(file, stop)
        elif kind == b"keys":
            file.read(8)  # version, flags and count
            names = [file.read(min(end_of_key - file.tell(), LONGEST)) for _, end_of_key in _atoms(file, stop)]
            index = names.index(KEY) + 1 if KEY in names else 0
        elif kind == b"ilst" and index:
            for number, item in _atoms(file, stop):
                if int.from_bytes(number, "big") == index:
                    yield from _data(file, item)


def _data(file: BinaryIO, end: int) -> Iterator[float]:
    """The number of a ``data`` atom: text, a float or an integer."""
    for kind, stop in _atoms(file, end):
        if kind == b"data":
            form, _ = struct.unpack(">II", file.read(8))
            content = file.read(min(stop - file.tell(), LONGEST))
            match form:
                case 1:
                    yield float(content)
                case 23 | 24:
                    yield float(struct.unpack(">f" if form == 23 else ">d", content)[0])
                case 21 | 22 | 65 | 66 | 67 | 74 | 75 | 76 | 77 | 78:
                    yield float(int.from_bytes(content, "big"))
