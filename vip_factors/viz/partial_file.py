"""Files of streams, which grow for long: under a name that says so until they are complete, and kept in any case."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from vip_factors.errors import InputError


def partial_path(path: Path) -> Path:
    """Where a file is written until it is complete: ``walk.rrd`` → ``walk.partial.rrd``."""
    return path.with_name(f"{path.stem}.partial{path.suffix}")


def check_partial(path: Path, overwrite: bool) -> Path:
    """The partial file's path, if it may be written: to fail before the work.

    Raises:
        InputError: if it or the complete file exists and may not be overwritten.
    """
    partial = partial_path(path)
    if path.exists() and not overwrite:
        raise InputError(
            f"{path} exists already: choose another, or allow to replace it (--overwrite; overwrite=True in Python)"
        )
    if partial.exists() and not overwrite:
        raise InputError(
            f"{partial} exists already, left by a stream that was killed or still runs: look at it and rename it, or "
            "allow to replace it (--overwrite; overwrite=True in Python)"
        )
    return partial


@contextmanager
def partial_file(path: Path, overwrite: bool) -> Iterator[Path]:
    """The path to write to; it becomes ``path`` when the block ends, and stays what it is after an exception.

    Raises:
        InputError: as :func:`check_partial`.
    """
    partial = check_partial(path, overwrite)
    yield partial
    os.replace(partial, path)
