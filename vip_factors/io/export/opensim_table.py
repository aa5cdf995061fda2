"""Tables that OpenSim reads: a header, ``endheader``, column names, and rows separated by tabs."""

from collections.abc import Iterable, Sequence
from pathlib import Path


def write_opensim_table(path: Path, header: Iterable[str], columns: Sequence[str], rows: Iterable[str]) -> None:
    """Write a table; ``rows`` have their cells separated by tabs, time first."""
    with path.open("w", encoding="utf-8", newline="\n") as file:
        for line in (*header, "endheader", "\t".join(("time", *columns)), *rows):
            file.write(f"{line}\n")
