"""Files that appear complete or not at all."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from vip_factors.errors import InputError, naming_file


@contextmanager
def new_file(path: Path, overwrite: bool) -> Iterator[Path]:
    """A name beside ``path`` to write to; it takes the place of ``path`` when the block ends without an exception.

    The temporary name keeps the suffix, by which writers tell the format.

    Raises:
        InputError: if the file exists and must not be overwritten, or its folder is missing.
        OSError: if it cannot be written, on a full disk say; it names ``path``.
    """
    path = Path(path)
    if path.exists() and not overwrite:
        raise InputError(
            f"{path} exists already: choose another, or allow to replace it (--overwrite; overwrite=True in Python)"
        )
    if not path.parent.is_dir():
        raise InputError(f"{path}: there is no folder {path.parent}; make it first")
    partial = path.with_name(f".{path.stem}.{os.getpid()}.partial{path.suffix}")
    try:
        with naming_file(path, partial):
            yield partial
            os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)
