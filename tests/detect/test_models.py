"""BlazePose's files: from a folder, a wheel, or a wheel that pip fetches."""

import hashlib
import subprocess
import zipfile
from pathlib import Path
from typing import Any

import pytest

from vip_factors.detect import models
from vip_factors.detect.models import DETECTOR, LANDMARKS, MEMBERS, blazepose_files
from vip_factors.errors import FileFormatError, InputError

CONTENT = {DETECTOR: b"detector", LANDMARKS: b"landmarks"}


@pytest.fixture(autouse=True)
def published(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Two small files stand for the models, and a folder of the test's own for the cache."""
    sums = {name: hashlib.sha256(data).hexdigest() for name, data in CONTENT.items()}
    monkeypatch.setattr(models, "SHA256", sums)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def wheel(path: Path, content: dict[str, bytes] = CONTENT) -> Path:
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in content.items():
            archive.writestr(MEMBERS[name], data)
        archive.writestr("mediapipe/__init__.py", "")
    return path


def test_a_wheel_is_unpacked_into_the_cache(tmp_path: Path) -> None:
    files = blazepose_files(wheel(tmp_path / "m.whl"))
    assert files[0] == tmp_path / "cache" / "vip-factors" / "blazepose" / DETECTOR
    assert files[0].read_bytes() == b"detector"
    assert files[1].read_bytes() == b"landmarks"
    assert len(list(files[0].parent.iterdir())) == 2
    assert blazepose_files(None) == files  # from now on without the wheel


def test_a_folder_is_used_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "deep").mkdir()
    for name in MEMBERS:
        (tmp_path / "deep" / name).write_bytes(b"another version")
    assert blazepose_files(tmp_path)[0] == tmp_path / "deep" / DETECTOR
    (tmp_path / "deep" / LANDMARKS).unlink()
    with pytest.raises(InputError, match=f"there is no {LANDMARKS}"):
        blazepose_files(tmp_path)


def test_other_models_than_the_published_ones_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="SHA-256"):
        blazepose_files(wheel(tmp_path / "m.whl", {**CONTENT, LANDMARKS: b"something else"}))
    assert not (tmp_path / "cache").exists()


def test_what_is_no_such_wheel(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        blazepose_files(tmp_path / "none.whl")
    (tmp_path / "text.whl").write_text("no archive")
    with pytest.raises(FileFormatError, match="not a wheel"):
        blazepose_files(tmp_path / "text.whl")
    with pytest.raises(FileFormatError, match="expected a wheel of mediapipe"):
        blazepose_files(wheel(tmp_path / "half.whl", {DETECTOR: b"detector"}))


def test_pip_is_asked_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def pip(command: list[str], **_: Any) -> subprocess.CompletedProcess[str]:
        asked.append(command)
        wheel(Path(command[command.index("--dest") + 1]) / "mediapipe.whl")
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setattr(subprocess, "run", pip)
    told: list[str] = []
    files = blazepose_files(None, told.append)
    assert files[1].read_bytes() == b"landmarks"
    assert blazepose_files(None, told.append) == files
    assert len(asked) == len(told) == 1
    assert "--no-deps" in asked[0]
    assert "mediapipe==0.10.21" in told[0]

    files[0].write_bytes(b"spoilt")  # what does not agree with the checksum is fetched again
    assert blazepose_files(None, told.append)[0].read_bytes() == b"detector"


def test_without_pip_or_network_the_way_out_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def pip(command: list[str], **_: Any) -> subprocess.CompletedProcess[str]:
        return subprocess.CompletedProcess(command, 1, "", "WARNING: slow\nERROR: No matching distribution\n")

    monkeypatch.setattr(subprocess, "run", pip)
    with pytest.raises(InputError, match=r"No matching distribution.*--blazepose WHEEL"):
        blazepose_files(None)


def test_a_wheel_that_is_damaged_inside_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "m.whl"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for member in MEMBERS.values():
            archive.writestr(member, b"a model" * 40)
    whole = path.read_bytes()
    at, listed = whole.index(b".tflite") + len(b".tflite"), whole.index(b"PK\x01\x02")
    utf8 = whole[: listed + 8] + b"\x00\x08" + whole[listed + 10 :]
    for damaged in (
        whole[:at] + b"\xff\xff\xff" + whole[at + 3 :],  # what is compressed
        whole[: listed + 10] + b"\x63" + whole[listed + 11 :],  # its method
        utf8[:40] + b"\xc8\xff" + utf8[42:],  # its name
    ):
        path.write_bytes(damaged)
        with pytest.raises(FileFormatError, match=r"m\.whl: .*expected (one|a wheel) of mediapipe"):
            blazepose_files(path)
