"""Archives of arrays: damaged ones, and those that claim more than they hold, are refused in a sentence."""

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest

from vip_factors.body.npz_file import read_npz
from vip_factors.errors import FileFormatError


def part(shape: str, kind: str, data: bytes = b"") -> bytes:
    header = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header.encode() + data


def archive(path: Path, content: bytes) -> Path:
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("a.npy", content)
    return path


def test_arrays_come_back_by_name(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", a=np.arange(3.0), b=np.array("text"), c=np.zeros(0))
    assert sorted(read_npz(tmp_path / "a.npz", "none")) == ["a", "b", "c"]
    assert list(read_npz(tmp_path / "a.npz", "none", ("b", "d"))) == ["b"]
    assert str(read_npz(tmp_path / "a.npz", "none")["b"]) == "text"


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
    with pytest.raises(FileFormatError, match=r"a\.npz: not a motion \(.+\)"):
        read_npz(archive(tmp_path / "a.npz", content), "not a motion")


def test_damaged_archives_are_refused(tmp_path: Path) -> None:
    path, whole = tmp_path / "a.npz", io.BytesIO()
    np.savez_compressed(whole, a=np.arange(100.0))
    data = whole.getvalue()
    wrong = data[:60] + b"\xff" * 8 + data[68:], data.replace(b"PK\x03\x04", b"PK\x03\x05")
    for damaged in (data[:40], *wrong, b"", b"x"):
        path.write_bytes(damaged)
        with pytest.raises(FileFormatError, match=r"a\.npz: not a motion \(.+\)"):
            read_npz(path, "not a motion")
