"""Write the page that lists all kinds of findings, made of the table of kinds."""

from pathlib import Path

from vip_factors.findings import KINDS, TEXT, Kind, Severity
from vip_factors.tables import Table, markdown

HEAD = ("what is wrong", "what it affects", "what to do", "kind")
SAYS = {
    Severity.DOUBT: "Do not rely on the results before this is resolved",
    Severity.CARE: "Usable with care",
    Severity.NOTE: "Notes: the results are usable",
}


def page() -> str:
    """The page as Markdown."""
    lines = [
        "# Findings",
        "",
        "Messages of `smooth`, `stream` and `report` about a recording or its estimate. The worst severity is the",
        "[verdict](uncertainty.md#the-verdict). In Python each has `kind`, `severity`, `wearer` and `subject`.",
        "",
    ]
    for severity, title in SAYS.items():
        kinds = {name: kind for name, kind in KINDS.items() if kind.severity is severity and name != TEXT}
        lines += markdown(Table(HEAD, [_row(name, kind) for name, kind in kinds.items()], title, words=len(HEAD)))
    return "\n".join(lines)


def _row(name: str, kind: Kind) -> tuple[str, ...]:
    return kind.headline, kind.affects, kind.advice, name


if __name__ == "__main__":
    Path(__file__).with_name("findings.md").write_text(page(), encoding="utf-8")
