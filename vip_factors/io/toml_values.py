"""The values of a file that people write, checked one by one.

What is wrong is an InputError that says ``where`` in the file it stands, and what was expected.
"""

import json
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np

from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import Array

LARGEST = 1e100  # no quantity of ours is larger, and its square is still a number


def nearest(word: str, choices: Iterable[str]) -> str:
    """``; did you mean 'x'?`` for the known word that is most alike, or all known words if none is."""
    choices = list(choices)
    alike = get_close_matches(word.lower(), choices, n=1, cutoff=0.5) or get_close_matches(
        word, choices, n=1, cutoff=0.5
    )
    return f"; did you mean '{alike[0]}'?" if alike else f": expected one of {', '.join(choices)}"


def known_keys(path: Path, where: str, table: Mapping[str, Any], choices: Iterable[str]) -> None:
    """Refuse a key of a table that is not one of those known, naming the nearest."""
    choices = list(choices)
    for key in table:
        if key not in choices:
            raise InputError(f"{path}: unknown key '{f'{where}.' if where else ''}{key}'{nearest(key, choices)}")


def table_at(path: Path, where: str, value: Any) -> Mapping[str, Any]:
    """The table that a value has to be."""
    if not isinstance(value, Mapping):
        raise InputError(f"{path}: {where} is {value!r}: expected a table")
    return value


def text_at(path: Path, where: str, value: Any) -> str:
    """The text that a value has to be."""
    if not isinstance(value, str):
        raise InputError(f"{path}: {where} is {value!r}: expected text in quotes")
    return value


def number_at(path: Path, where: str, value: Any) -> float:
    """The finite number that a value has to be."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= LARGEST:
        raise InputError(f"{path}: {where} is {value!r}: expected a number")
    return float(value)


def numbers_at(path: Path, where: str, value: Any, count: int | None = None) -> Array:
    """The list ``(count,)`` of finite numbers that a value has to be; of any length if None."""
    if not isinstance(value, list) or count not in (None, len(value)):
        many = "" if count is None else f"{count} "
        raise InputError(f"{path}: {where} is {value!r}: expected a list of {many}numbers")
    return np.array([number_at(path, where, one) for one in value], dtype=float)


def correlation_matrix(path: Path, where: str, rows: Sequence[Array]) -> Array:
    """The symmetric matrix ``(n, n)`` of the ``n`` rows of a table of correlations."""
    matrix = np.array(rows, float).reshape(len(rows), len(rows))
    if not (np.allclose(matrix, matrix.T, atol=1e-4) and np.allclose(np.diag(matrix), 1) and np.abs(matrix).max() <= 1):
        raise InputError(f"{path}: {where}: expected a symmetric table of numbers from -1 to 1, with 1 on its diagonal")
    return np.asarray((matrix + matrix.T) / 2)


def read_toml(path: Path, what: str) -> Mapping[str, Any]:
    """The content of a TOML file; ``what`` it should be is told if it is none.

    Raises:
        FileFormatError: if it cannot be read or parsed.
    """
    text = read_text(path, what, strict=True)
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # the latter: brackets in brackets without end
        raise FileFormatError(f"{path}: {error}: expected {what}") from error


def read_text(path: Path, what: str, strict: bool = False) -> str:
    """The text of a file in UTF-8, of which other bytes are replaced, or refused; ``what`` it should be is told.

    Raises:
        FileFormatError: if it cannot be read.
    """
    try:
        return path.read_text(encoding="utf-8-sig", errors="strict" if strict else "replace")
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read ({error.strerror}): expected {what}") from error
    except ValueError as error:
        raise FileFormatError(f"{path}: {error}: expected {what}") from error


def toml_text(value: Any) -> str:
    """A number, text, or nested list of numbers as TOML."""
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")  # as TOML, but for that character
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | np.integer):
        return str(int(value))
    if isinstance(value, float | np.floating):
        return repr(float(value))
    return "[" + ", ".join(toml_text(one) for one in value) + "]"
