"""One summary of many files: a table of verdicts and findings, and the same as a page, the worst first."""

import csv
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from urllib.parse import quote

from vip_factors import __version__
from vip_factors.atomic import atomic_open
from vip_factors.findings import Severity
from vip_factors.names import table_cell

FAILED = "failed"
WEIGHTS = (FAILED, *reversed(Severity), "")  # of a row, the worst first


@dataclass(frozen=True)
class Row:
    """What became of one file.

    Attributes:
        input, output: paths.
        state: done, there already, or failed.
        exit_code: of its command.
        verdict: GOOD, CARE or DOUBT, and what decides; empty if it is not known.
        findings: sentences.
        frames: of all wearers.
        seconds: of work.
        evaluation: of an evaluation, its first line.
        error: why it failed.
        worker: who did it, on a cluster.
    """

    input: str
    output: str
    state: str
    exit_code: int = 0
    verdict: str = ""
    findings: tuple[str, ...] = ()
    frames: int = 0
    seconds: float = 0.0
    evaluation: str = ""
    error: str = ""
    worker: str = ""

    @property
    def weight(self) -> str:
        """The verdict's first word in small letters, empty if it is not known; ``failed`` without an output."""
        return self.verdict.partition(",")[0].lower() if not self.error else FAILED

    @property
    def rank(self) -> int:
        """By which the page is sorted."""
        return WEIGHTS.index(self.weight)

    def link(self, folder: Path) -> str:
        """From a page in a folder to that on the file; empty if there is none."""
        page = Path(self.output).with_suffix(".html")
        return quote(os.path.relpath(page, folder)) if "://" not in self.output and page.exists() else ""


def write_overview(title: str, rows: Sequence[Row], path: Path) -> None:
    """Write the table and the page beside it, over those that are there.

    Args:
        title: of the page.
        rows: of the table.
        path: of the table (.csv).

    Raises:
        InputError, OSError: if they cannot be written.
    """
    from vip_factors.report.page import environment, packaged  # late: who makes rows needs no charts

    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_open(path, overwrite=True) as file:
        table = csv.DictWriter(file, [one.name for one in fields(Row)])
        table.writeheader()
        for row in rows:
            cells = asdict(row) | {"findings": "; ".join(row.findings), "seconds": f"{row.seconds:.1f}"}
            table.writerow({name: table_cell(cell) if isinstance(cell, str) else cell for name, cell in cells.items()})
    text = environment().get_template("overview.html").render(
        title=title, rows=sorted(rows, key=lambda one: one.rank), folder=path.parent, version=__version__,
        counts=[(weight, sum(one.weight == weight for one in rows)) for weight in WEIGHTS if weight],
        style=packaged("templates/report.css"),
    )  # fmt: skip
    with atomic_open(path.with_suffix(".html"), overwrite=True) as file:
        file.write(text)
