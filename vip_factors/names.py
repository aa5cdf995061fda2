"""Names of people and recordings where they can do harm: in names of files, in lines of text and in spreadsheets."""

import re
import unicodedata
from collections.abc import Iterable

FORBIDDEN = re.compile(r'[<>:"/\\|?*\x00-\x1f\x7f]')  # in names of files, on one system or another
CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029]+")


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


def _as_disks_compare(part: str) -> str:
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", part).casefold())


def one_line(text: str) -> str:
    """Text without line breaks, tabs and other control characters, for formats that give them a meaning."""
    return CONTROL.sub(" ", text)


def table_cell(text: str) -> str:
    """Text for a cell of a CSV table: one line, behind a ``'`` where a spreadsheet would take it for a formula."""
    line = one_line(text).lstrip()
    return f"'{line}" if line.startswith(("=", "+", "-", "@")) else line
