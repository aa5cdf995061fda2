"""What people see: progress of work, objects in a few lines, and names without characters that do harm."""

import re
import unicodedata
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import fields
from html import escape
from os import PathLike
from typing import Any, cast

ProgressCallback = Callable[[str, float], None]
"""Called with the name of a stage and the fraction of it that is done."""
FORBIDDEN = re.compile(r'[<>:"/\\|?*\x00-\x1f\x7f]')  # in names of files, on one system or another
CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029]+")


def silent(stage: str, fraction: float) -> None:
    """Progress that nobody looks at; unlike a lambda, it may be sent to another process."""


class Summarised:
    """Base of dataclasses that show themselves in a few lines: a title, then ``label: value`` or ``label  value``."""

    def summary(self) -> list[str]:
        """The lines, without indents: unless a class has its own, its name, and each field that is not empty."""
        values = [(field.name, _in_brief(getattr(self, field.name))) for field in fields(cast(Any, self))]
        return [type(self).__name__, *(f"{name}: {text}" for name, text in values if text)]

    def __repr__(self) -> str:
        return "\n  ".join(self.summary())

    def _repr_html_(self) -> str:
        title, *lines = self.summary()
        rows = (re.match("(.*?)(?:: +|  +|$)(.*)", escape(line)) for line in lines)
        cells = "".join(f"<tr><th>{row[1]}</th><td>{row[2]}</td></tr>" for row in rows if row)
        return f"<table><caption>{escape(title)}</caption>{cells}</table>"


def _in_brief(value: Any) -> str:
    """A part of a line: the shape of an array, the keys of a mapping, the length of a collection, an object's title."""
    few, width = 4, 100  # items, characters
    if shape := getattr(value, "shape", ()):
        return f"array {shape}" if shape > (few,) or len(shape) > 1 else one_line(str(value))
    if value is None or (isinstance(value, Collection) and not len(value)):
        return ""
    text = value.summary()[0] if isinstance(value, Summarised) else one_line(repr(value))
    if isinstance(value, Mapping):
        text = f"{len(value)}, {', '.join(map(str, value))}"
    elif isinstance(value, list | tuple) and len(text) > width:
        text = f"{len(value)} of {type(value[0]).__name__}"
    return text if len(text) <= width else f"{text[: width - 2]} …"


def distinct_file_names(names: Iterable[str]) -> list[str]:
    """Parts of files' names for people's names, no two alike: ``a/b`` and ``a_b`` become ``a_b`` and ``a_b-2``.

    Names that differ in capitals or in how accents are encoded are alike, as on disks of Windows and macOS.
    """
    taken = set[str]()
    parts = []
    for name in names:
        stem = FORBIDDEN.sub("_", name).strip(" .")[:100] or "_"
        part, number = stem, 1
        while _as_disks_compare(part) in taken:
            number += 1
            part = f"{stem}-{number}"
        taken.add(_as_disks_compare(part))
        parts.append(part)
    return parts


def _as_disks_compare(name: str) -> str:
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())


def one_line(text: str) -> str:
    """Text without line breaks, tabs and other control characters, for formats that give them a meaning."""
    return CONTROL.sub(" ", text)


def table_cell(text: str) -> str:
    """Text for a cell of a CSV table: one line, behind a ``'`` where a spreadsheet would take it for a formula."""
    line = one_line(text).lstrip()
    return f"'{line}" if line.startswith(("=", "+", "-", "@")) else line


def described(given: object) -> str:
    """What a user handed over, in a few words."""
    if isinstance(given, str | PathLike):
        return f"{given!s:.80}"
    return f"{type(given).__name__} {getattr(given, 'name', '')}".strip()
