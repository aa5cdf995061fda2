"""TOML and JSON files that people write, read into the types that declare them.

A wrong value is an InputError that names the file, the place in it and the expected value. Files that are too large or
too deep are refused before they are parsed.
"""

import json
import re
from collections.abc import Iterable, Sequence
from enum import EnumType
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin

import msgspec
import numpy as np

from vip_factors.errors import FileFormatError, InputError, nearest
from vip_factors.geometry.rotations import Array

Number = Annotated[float, msgspec.Meta(ge=-1e100, le=1e100)]  # finite, and so is its square
Vector = tuple[Number, Number, Number]
Matrix = tuple[Vector, Vector, Vector]
Declared = TypeVar("Declared")

MOST_BYTES = 1_000_000  # of a file that people write
MOST_MOTION_BYTES = 1_000_000_000  # of a motion as text
PLAIN_WORDS = {
    "float": "number",
    "int": "whole number",
    "str": "text in quotes",
    "bool": "true or false",
    "object": "table",
    "array": "list",
    "Path": "text in quotes",
}
# A parser's work grows with the square of a key's parts, or worse.
LONG_KEY = re.compile(r"""(?<![\w-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')\s*+\.\s*+){16}""")


def read_toml(path: Path, kind: type[Declared], what: str) -> Declared:
    """Read a TOML file into a declared type; ``what`` names the file that is expected."""
    text = read_text(path, what, strict=True)
    if (long := LONG_KEY.search(text)) is not None:
        line = text.count("\n", 0, long.start()) + 1
        raise FileFormatError(f"{path}, line {line}: a key of more than 16 parts: expected {what}")
    return _converted(path, msgspec.toml.decode, text, kind, what)


def read_json(path: Path, kind: type[Declared], what: str, most_bytes: int = MOST_BYTES) -> Declared:
    """Read a JSON file into a declared type, as :func:`read_toml`; NaN is parsed, as Python's programs write it."""
    return _converted(path, json.loads, read_text(path, what, strict=True, most_bytes=most_bytes), kind, what)


def _converted(path: Path, decode: Any, text: str, kind: type[Declared], what: str) -> Declared:
    try:
        content = decode(text)
    except (ValueError, RecursionError) as error:  # the latter: brackets in brackets without end
        raise FileFormatError(f"{path}: {error}: expected {what}") from error
    return convert(path, "", content, kind)


def convert(path: Path, where: str, value: object, kind: type[Declared]) -> Declared:
    """Convert a parsed value, which stands at ``where`` in the file, to a declared type.

    Raises:
        InputError: for a missing or unknown key (the nearest known one is named), or a value of another type.
    """
    try:
        return msgspec.convert(value, kind, dec_hook=_path)
    except msgspec.ValidationError as error:
        message, _, place = str(error).partition(" - at `$")
        place = (where + _named_place(value, kind, place.rstrip("`"))).lstrip(".")
        unknown = re.fullmatch(r"Object contains unknown field `(.*)`", message, re.DOTALL)
        missing = re.fullmatch(r"Object missing required field `(.*)`", message)
        if unknown is not None:
            keys = kind.__struct_fields__ if issubclass(kind, msgspec.Struct) and place == where else ()
            key = f"{place}.{unknown[1]}".lstrip(".")
            raise InputError(f"{path}: unknown key '{key}'{nearest(unknown[1], keys)}") from error
        if missing is not None:
            raise InputError(f"{path}: {f'{place}.{missing[1]}'.lstrip('.')} is missing") from error
        message = re.sub(r"`([A-Za-z |]*)`", _plain, message)
        if message.startswith("Invalid enum value") and (choices := _choices(kind)):
            message += f": expected one of {', '.join(choices)}"
        raise InputError(f"{path}: {place or 'the content'}: {message[0].lower()}{message[1:]}") from error


def _path(kind: type[object], value: object) -> object:
    """The path that text in a file names."""
    if kind is Path and isinstance(value, str):
        return Path(value)
    if isinstance(value, kind):
        return value
    raise TypeError(f"Expected `{kind.__name__}`, got `{type(value).__name__}`")


def _choices(kind: object) -> list[str]:
    """Values of an enumeration, or of the literals in a union."""
    if isinstance(kind, EnumType):
        return [str(member.value) for member in kind]  # type: ignore[var-annotated]
    if get_origin(kind) is Literal:
        return list(map(str, get_args(kind)))
    return [choice for member in get_args(kind) for choice in _choices(member)]


def _named_place(value: object, kind: object, location: str) -> str:
    """Place of an error with the keys of free tables, which msgspec writes as ``[...]``.

    The entries of such a table are tried one at a time; the table is left with the wrong one alone.
    """
    named, table = "", value
    for field, index in re.findall(r"\.([^.\[]+)|\[(\d+|\.\.\.)\]", location):
        name = field or index
        if index == "..." and isinstance(table, dict):
            for name, entry in dict(table).items():
                table.clear()
                table[name] = entry
                if not _converts(value, kind):
                    break
        named += f"[{name}]" if isinstance(table, list) else f".{name}"
        table = table[int(name)] if isinstance(table, list) else table[name] if isinstance(table, dict) else None
    return named


def _converts(value: object, kind: object) -> bool:
    try:
        msgspec.convert(value, kind, dec_hook=_path)
    except msgspec.ValidationError:
        return False
    return True


def _plain(kinds: re.Match[str]) -> str:
    """The types that msgspec names, in plain words."""
    return " or ".join(PLAIN_WORDS.get(word, word) for word in kinds[1].split(" | ") if word != "null")


def read_text(path: Path, what: str, strict: bool = False, most_bytes: int = MOST_BYTES) -> str:
    """Read a file in UTF-8; other bytes are replaced, or refused if ``strict``. ``what`` names the expected file."""
    try:
        with path.open(encoding="utf-8-sig", errors="strict" if strict else "replace") as file:
            # In pieces: whatever the file's size, room is made for as many bytes as are asked for.
            pieces = iter(partial(file.read, MOST_BYTES), "")
            text = "".join(islice(pieces, most_bytes // MOST_BYTES + 1))
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read ({error.strerror}): expected {what}") from error
    except ValueError as error:
        raise FileFormatError(f"{path}: {error}: expected {what}") from error
    if len(text) > most_bytes:
        raise FileFormatError(f"{path}: more than {most_bytes / 1e6:g} MB: expected {what}")
    return text


def check_keys(path: Path, where: str, table: Iterable[str], expected: Iterable[str]) -> None:
    """Refuse a table that lacks one of the expected keys, or has another."""
    expected, keys = list(expected), set(table)
    for key in sorted(keys ^ set(expected)):
        state = "unknown" if key in keys else "missing"
        raise InputError(f"{path}: {where}.{key} is {state}: expected all of {', '.join(expected)}")


def correlation_matrix(path: Path, where: str, rows: Sequence[Sequence[float]]) -> Array:
    """Symmetric matrix ``(n, n)`` of the ``n`` rows of a table of correlations, which is refused if it is none."""
    if any(len(row) != len(rows) for row in rows):
        raise InputError(f"{path}: {where}: expected {len(rows)} rows of {len(rows)} numbers")
    matrix = np.array(rows, float).reshape(len(rows), len(rows))
    if not (
        np.allclose(matrix, matrix.T, atol=1e-4)
        and np.allclose(np.diag(matrix), 1)
        and np.abs(matrix).max(initial=0) <= 1
    ):
        raise InputError(f"{path}: {where}: expected a symmetric table of numbers from -1 to 1, with 1 on its diagonal")
    return np.asarray((matrix + matrix.T) / 2)


def toml_text(value: str | float | np.number | Iterable[Any]) -> str:
    """Text, a number, or a nested list of numbers as TOML."""
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")  # as TOML, but for that character
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | np.integer):
        return str(int(value))
    if isinstance(value, float | np.floating):
        return repr(float(value))
    return "[" + ", ".join(toml_text(element) for element in value) + "]"  # type: ignore[union-attr]
