"""Files that a command writes: named for what they hold, each once, and never one that the command reads."""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass
from itertools import combinations
from pathlib import Path
from typing import Any, get_args, get_type_hints

from vip_factors.errors import InputError


@dataclass(frozen=True)
class Output:
    """Marks an option whose file, or files, the command writes: ``Annotated[Path | None, Output(".mcap")] = None``.

    Attributes:
        suffix: what the name has to end in, so that no other program is misled; any if empty.
    """

    suffix: str = ""


@dataclass(frozen=True)
class Input:
    """Marks an option that is text, and may be the name of a file that the command reads; paths need no mark."""


def check_outputs(options: Any) -> None:
    """Refuse outputs that are an input, that are named twice, or whose suffix tells of another content.

    Args:
        options: a dataclass of options, with dataclasses in it; outputs are marked by :class:`Output`.

    Raises:
        InputError: for the first of them.
    """
    read, written = list[Path](), list[Path]()
    for path, mark in _files(options):
        if "\0" in str(path):
            raise InputError(f"{str(path)!r}: the name of a file cannot hold the character 0")
        if not isinstance(mark, Output):
            read.append(path)
            continue
        written.append(path)
        if mark.suffix and path.suffix.lower() != mark.suffix:
            raise InputError(f"{path}: expected a name that ends in {mark.suffix}; choose another one to write")
    keep_inputs(read, written)


def keep_inputs(read: Sequence[Path], written: Sequence[Path]) -> None:
    """Refuse to write over what is read, ``--overwrite`` or not: no command touches its inputs.

    Raises:
        InputError: if a file is among both, by whatever name, or twice among those to be written.
    """
    for path in written:
        if any(_same(path, source) for source in read):
            raise InputError(f"{path} is read, and would be written over: choose another name for what is written")
    for path, other in combinations(written, 2):
        if _same(path, other):
            raise InputError(f"{path} is named twice for what is written: give each file a name of its own")


def _same(path: Path, other: Path) -> bool:
    try:
        return os.path.samefile(path, other)
    except (OSError, ValueError):  # one of them is not there, or cannot be
        return os.path.realpath(path) == os.path.realpath(other)


def _files(options: Any) -> Iterator[tuple[Path, Input | Output | None]]:
    """Every path among options with its mark, and text that is marked."""
    hints = get_type_hints(type(options), include_extras=True)
    for one in fields(options):
        value = getattr(options, one.name)
        if is_dataclass(value):
            yield from _files(value)
            continue
        mark = _mark(hints[one.name])
        for single in value if isinstance(value, tuple) else (value,):
            if isinstance(single, Path) or (isinstance(single, str) and mark is not None):
                yield Path(single), mark


def _mark(hint: Any) -> Input | Output | None:
    for one in getattr(hint, "__metadata__", ()):
        if isinstance(one, Input | Output):
            return one
    return next((found for inner in get_args(hint) if (found := _mark(inner)) is not None), None)
