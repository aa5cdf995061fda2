"""One page over many recordings: a table of verdicts and findings, the worst first, with links to reports."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from urllib.parse import quote

from vip_factors import __version__
from vip_factors.atomic import atomic_open
from vip_factors.findings import Severity
from vip_factors.report.page import environment, packaged

FAILED = "failed"
WEIGHTS = (FAILED, *reversed(Severity), "")  # of a line, the worst first


@dataclass(frozen=True)
class Line:
    """A recording in the table.

    Attributes:
        name: of its file.
        weight: ``failed``, a severity, or nothing if it is not known.
        told: the verdict, or why it failed.
        findings: sentences.
        frames: of all wearers.
        seconds: of work.
        result: of an evaluation.
        link: to its report, relative to the page; empty without one.
    """

    name: str
    weight: str
    told: str
    findings: tuple[str, ...]
    frames: int
    seconds: float
    result: str = ""
    link: str = ""

    @property
    def rank(self) -> int:
        """By which the table is sorted."""
        return WEIGHTS.index(self.weight)

    @property
    def href(self) -> str:
        """The link as a page has it."""
        return quote(self.link)


def write_overview(title: str, lines: Sequence[Line], path: str | os.PathLike[str]) -> None:
    """Write the page, over one that is there.

    Args:
        title: of the page.
        lines: of the table.
        path: of the page.

    Raises:
        InputError, OSError: if it cannot be written.
    """
    text = environment().get_template("overview.html").render(
        title=title, lines=sorted(lines, key=lambda one: one.rank), version=__version__,
        counts=[(weight, sum(one.weight == weight for one in lines)) for weight in WEIGHTS if weight],
        style=packaged("templates/report.css"),
    )  # fmt: skip
    with atomic_open(path, overwrite=True) as file:
        file.write(text)
