"""AMASS archives: damaged ones, and those that claim more than they hold, are refused in a sentence."""

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest

from vip_factors.errors import FileFormatError
from vip_factors.io.motions.files import read_motion


def part(shape: str, kind: str, data: bytes = b"") -> bytes:
    header = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header.encode() + data


def archive(path: Path, content: bytes) -> Path:
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("poses.npy", content)
    return path


@pytest.mark.parametrize(
    "content",
    [
        part("(1000000000,)", "<f8"),  # room for 8 GB was made
        part("(1,", "<f8"),  # a header that does not end
        part("(1,)", "<U1", b"\xff\xff\xff\x7f"),  # no character has that number
        b"",
    ],
)
def test_parts_that_are_none_are_refused(tmp_path: Path, content: bytes) -> None:
    with pytest.raises(FileFormatError, match=r"a\.npz: not an AMASS npz \(.+\)"):
        read_motion(archive(tmp_path / "a.npz", content))


def test_damaged_archives_are_refused(tmp_path: Path) -> None:
    path, whole = tmp_path / "a.npz", io.BytesIO()
    np.savez_compressed(whole, poses=np.arange(100.0))
    data = whole.getvalue()
    wrong = data[:60] + b"\xff" * 8 + data[68:], data.replace(b"PK\x03\x04", b"PK\x03\x05")
    for damaged in (data[:40], *wrong, b"", b"x"):
        path.write_bytes(damaged)
        with pytest.raises(FileFormatError, match=r"a\.npz: not an AMASS npz \(.+\)"):
            read_motion(path)
