"""What a study is: options, rows that it makes one by one, tables of them; and the writer of tables and JSON."""

import json
import re
import subprocess
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, is_dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
import tyro

from vip_factors.atomic import atomic_open, check_target
from vip_factors.cli.options import Flag, Output
from vip_factors.errors import InputError

NUMBER = re.compile(r"[-+*\d]|n/a|$")
NAN = float("nan")
MB = 1e6
Tell = Callable[[str, float], None]
"""Called with what is being done and the fraction of it that is done."""
Row = TypeVar("Row")
T = TypeVar("T")
Fixed = Annotated[T, tyro.conf.Fixed, tyro.conf.Suppress]
"""A field that callers in Python may set, and the command line may not."""


def no_news(stage: str, fraction: float) -> None:
    """A :data:`Tell` that nobody hears."""


@dataclass(frozen=True, kw_only=True)
class Study:
    """Options of a study are its fields; the class's docstring is its help."""

    json: Annotated[Path | None, Output()] = None
    """Also write everything to this file, as JSON, after each row."""
    overwrite: Flag = False
    """Replace the JSON file if it exists."""

    def rows(self, tell: Tell) -> Iterator[Any]:
        """Measurements (dataclasses), each as soon as it is made."""
        raise NotImplementedError

    def tables(self, rows: Sequence[Any]) -> Iterable[str]:
        """Blocks of Markdown; ``rows`` has one at least."""
        raise NotImplementedError


def run(study: Study, tell: Tell = no_news, found: list[Any] | None = None) -> list[Any]:
    """All rows of a study, in ``found`` and in its file as they are made: one that is interrupted leaves them there."""
    found = [] if found is None else found
    if study.json is not None:
        check_target(study.json, study.overwrite)
    for row in study.rows(tell):
        found.append(row)
        if study.json is not None:  # once written, it is this run's own to replace
            with atomic_open(study.json, "w", study.overwrite or len(found) > 1) as file:
                file.write(json_text(study, found))
    return found


def markdown(study: Study, rows: Sequence[Any]) -> str:
    """All tables of a study."""
    return "\n\n".join(block for block in study.tables(rows) if block) + "\n" if rows else ""


def json_text(study: Study, rows: Sequence[Any]) -> str:
    """Rows, and what they were made with."""
    return json.dumps({"study": type(study).__name__, "options": plain(study), "rows": plain(rows)}, indent=2) + "\n"


def plain(value: Any) -> Any:
    """What JSON can hold; numbers that are not defined are null."""
    if is_dataclass(value) and not isinstance(value, type):
        value = asdict(value)
    if isinstance(value, Mapping):
        return {str(key): plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple | set | np.ndarray):
        return [plain(inner) for inner in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)


def table(head: Sequence[str], lines: Iterable[Sequence[object]]) -> str:
    """Markdown; columns of numbers are aligned on the right."""
    written = [list(map(cell, line)) for line in lines]
    rules = ["---:" if all(NUMBER.match(one) for one in column) else "---" for column in zip(*written, strict=True)]
    return "\n".join(f"| {' | '.join(line)} |" for line in (head, rules or ["---"] * len(head), *written))


def columns(rows: Iterable[Row], values: Mapping[str, Callable[[Row], object]]) -> str:
    """A table with one line for each row, by what a column is called and what is in it."""
    return table(list(values), [[of(row) for of in values.values()] for row in rows])


def cell(value: object) -> str:
    """One decimal; several numbers with slashes between them; nothing for None."""
    if value is None:
        return ""
    if isinstance(value, tuple):
        return " / ".join(map(cell, value)) if np.isfinite(value[0]) else "n/a"
    if isinstance(value, float | np.floating):
        return f"{value:.1f}" if np.isfinite(value) else "n/a"
    return str(value)


def mean(values: Iterable[float]) -> float:
    """Of those that are defined; NaN without any."""
    known = [value for value in values if np.isfinite(value)]
    return float(np.mean(known)) if known else NAN


def group(rows: Iterable[Row], key: Callable[[Row], T]) -> dict[T, list[Row]]:
    """Rows by what they have in common, in the order of the first of each."""
    found: dict[T, list[Row]] = {}
    for row in rows:
        found.setdefault(key(row), []).append(row)
    return found


def bullets(title: str, lines: Iterable[str]) -> str:
    """A list below a title; nothing if it is empty."""
    written = [f"- {line}" for line in lines]
    return "\n".join([title, *written] if title else written) if written else ""


def commit_of_sources() -> str:
    """The commit that is checked out.

    Raises:
        InputError: if a source file was edited since, so that no commit names the code that runs.
    """
    edited = _git("status", "--porcelain", "--", "vip_factors", "tests", "kernels")
    if edited:
        raise InputError(f"sources were edited since the last commit: commit them first\n{edited}")
    return _git("rev-parse", "--short=10", "HEAD")


def _git(*words: str) -> str:
    root = Path(__file__).resolve().parents[2]
    return subprocess.run(["git", *words], cwd=root, check=True, capture_output=True, text=True).stdout.strip()
