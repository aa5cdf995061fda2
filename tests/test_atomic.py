"""A file appears whole or not at all."""

import errno
import os
from pathlib import Path

import pytest

from vip_factors.atomic import atomic_open, atomic_path
from vip_factors.errors import InputError


def test_the_file_appears_only_at_the_end_and_alone(tmp_path: Path) -> None:
    target = tmp_path / "walk.bvh"
    with atomic_path(target) as temporary:
        assert temporary.parent == tmp_path
        assert temporary.suffix == ".bvh"
        temporary.write_text("whole")
        assert not target.exists()
    assert target.read_text() == "whole"
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, SystemExit, GeneratorExit])
@pytest.mark.parametrize("existing", [False, True])
def test_whatever_goes_wrong_leaves_things_as_they_were(tmp_path: Path, error: type, existing: bool) -> None:
    target = tmp_path / "walk.bvh"
    if existing:
        target.write_text("old")
    with pytest.raises(error), atomic_open(target, "w", overwrite=existing) as file:  # noqa: PT012
        file.write("half")
        raise error
    assert [path.read_text() for path in tmp_path.iterdir()] == (["old"] if existing else [])


def test_an_existing_file_is_refused_before_any_work(tmp_path: Path) -> None:
    target = tmp_path / "walk.bvh"
    target.write_text("old")
    with pytest.raises(InputError, match=r"walk\.bvh exists already.*--overwrite"), atomic_path(target):
        pytest.fail("reached")
    with atomic_open(target, "wb", overwrite=True) as file:
        file.write(b"new")
    assert target.read_text() == "new"


def test_a_file_that_appears_meanwhile_is_not_replaced(tmp_path: Path) -> None:
    target = tmp_path / "walk.bvh"
    with pytest.raises(InputError, match="exists already"), atomic_open(target) as file:  # noqa: PT012
        file.write("ours")
        target.write_text("theirs")
    assert [path.read_text() for path in tmp_path.iterdir()] == ["theirs"]


def test_a_missing_folder_a_folder_and_a_file_as_folder_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"there is no folder .*nowhere"), atomic_path(tmp_path / "nowhere" / "a.bvh"):
        pytest.fail("reached")
    with pytest.raises(InputError, match="is a folder"), atomic_path(tmp_path, overwrite=True):
        pytest.fail("reached")
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="there is no folder"), atomic_path(tmp_path / "file" / "a.bvh"):
        pytest.fail("reached")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_read_only_folder_is_refused(tmp_path: Path) -> None:
    tmp_path.chmod(0o555)
    with pytest.raises(InputError, match="no permission"), atomic_path(tmp_path / "a.bvh"):
        pytest.fail("reached")


def test_a_link_is_written_through(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "a.txt").write_text("old")
    (tmp_path / "link.txt").symlink_to(tmp_path / "there" / "a.txt")
    with atomic_open(tmp_path / "link.txt", overwrite=True) as file:
        file.write("new")
    assert (tmp_path / "link.txt").is_symlink()
    assert (tmp_path / "there" / "a.txt").read_text() == "new"


def test_the_new_file_has_the_usual_permissions_and_names_may_be_long(tmp_path: Path) -> None:
    (tmp_path / "plain").touch()
    target = tmp_path / ("ä" * 100 + ".txt")
    with atomic_open(target) as file:
        file.write("é\n")
    assert target.stat().st_mode == (tmp_path / "plain").stat().st_mode
    assert target.read_bytes() == "é\n".encode()


def test_a_full_disk_names_the_file_that_was_wanted(tmp_path: Path) -> None:
    with (
        pytest.raises(OSError, match=r"No space left on device: .*wanted.txt") as caught,
        atomic_open(tmp_path / "wanted.txt"),
    ):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert caught.value.filename == str(tmp_path / "wanted.txt")
    assert list(tmp_path.iterdir()) == []


def test_content_is_on_the_disk_before_the_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced, fsync = list[int](), os.fsync
    monkeypatch.setattr(os, "fsync", lambda number: synced.append(os.fstat(number).st_ino) or fsync(number))
    target = tmp_path / "walk.bvh"
    with atomic_open(target, "w") as file:
        file.write("whole")
    assert target.stat().st_ino in synced
