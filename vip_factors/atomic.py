"""A file appears whole or not at all: written under a temporary name beside its target, then renamed.

Whatever goes wrong in between, an interrupt from the keyboard included, leaves neither a half file nor a trace. The
file of a stream, which grows for long, is called NAME.partial.SUFFIX until it is complete, and is kept in any case.
"""

import errno
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, Literal

from vip_factors.errors import InputError, naming_file

LONGEST_STEM = 100  # characters of the target's name in the temporary one: file systems end names at 255 bytes


@contextmanager
def atomic_path(path: str | os.PathLike[str], overwrite: bool = False) -> Iterator[Path]:
    """A temporary path to write to, in the folder of ``path`` and with its suffix; renamed to it on success.

    Args:
        path: the file wanted.
        overwrite: whether an existing file may be replaced; until the rename it stays as it was.

    Raises:
        InputError: if ``path`` exists and may not be replaced, is a folder, or its folder is missing or read-only.
        OSError: if it cannot be written, on a full disk say; it names ``path``.
    """
    target = check_target(path, overwrite)
    temporary = target.with_name(f".{target.stem[:LONGEST_STEM]}.{secrets.token_hex(4)}.part{target.suffix}")
    try:
        with naming_file(path, temporary):
            yield temporary
            with open(temporary, "rb+") as file:  # otherwise a power cut can leave the new name with no content
                os.fsync(file.fileno())
            if not overwrite:
                check_target(path, overwrite)  # another program may have written it meanwhile
            os.replace(temporary, target)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


@contextmanager
def atomic_open(
    path: str | os.PathLike[str], mode: Literal["w", "wb"] = "w", overwrite: bool = False
) -> Iterator[IO[Any]]:
    """An open file as of ``open(path, mode)``, which appears under its name only once it is whole.

    Text is UTF-8 with plain newlines on every system. Other arguments and errors as :func:`atomic_path`.
    """
    text = {} if "b" in mode else {"encoding": "utf-8", "newline": "\n"}
    with atomic_path(path, overwrite) as temporary, open(temporary, mode, **text) as file:  # type: ignore[call-overload]
        yield file


def check_complete(written: int, wanted: int, unit: str) -> None:
    """Check the output of a library that reports no errors: a full disk ends its file early.

    Args:
        written: number of bytes or frames that can be read back.
        wanted: least number.
        unit: of the numbers.

    Raises:
        OSError: if there are fewer.
    """
    if written < wanted:
        raise OSError(errno.EIO, f"only {written} of {wanted} {unit} could be written: is the disk full?")


def check_target(path: str | os.PathLike[str], overwrite: bool = False) -> Path:
    """The real path that would be written (links followed), if it may be: to fail before the work, not after it.

    Raises:
        InputError: as :func:`atomic_path`.
    """
    target = Path(os.path.realpath(path))
    if target.is_dir():
        raise InputError(f"{path} is a folder: give the name of a file to write")
    if not target.parent.is_dir():
        raise InputError(f"cannot write {path}: there is no folder {target.parent}; create it first")
    if not os.access(target.parent, os.W_OK):
        raise InputError(f"cannot write {path}: no permission to write in folder {target.parent}")
    if target.exists() and not target.is_file():
        raise InputError(f"{path} is a device or a pipe: give the name of a file to write")
    if target.exists() and not overwrite:
        raise InputError(
            f"{path} exists already: choose another, or allow to replace it (--overwrite; overwrite=True in Python)"
        )
    return target


def partial_path(path: Path) -> Path:
    """Path of a stream's file until it is complete: ``walk.rrd`` → ``walk.partial.rrd``."""
    return path.with_name(f"{path.stem}.partial{path.suffix}")


def check_partial(path: Path, overwrite: bool) -> Path:
    """The partial file's path, if both it and the complete file may be written: to fail before the work.

    Raises:
        InputError: as :func:`check_target`, and if a partial file exists and may not be overwritten.
    """
    check_target(path, overwrite)
    partial = partial_path(path)
    if partial.exists() and not overwrite:
        raise InputError(
            f"{partial} exists already, left by a stream that was killed or still runs: look at it and rename it, or "
            "allow to replace it (--overwrite; overwrite=True in Python)"
        )
    return partial


@contextmanager
def partial_file(path: Path, overwrite: bool) -> Iterator[Path]:
    """The path to write to, which is renamed to ``path`` when the block ends, but not after an exception."""
    partial = check_partial(path, overwrite)
    yield partial
    os.replace(partial, path)
