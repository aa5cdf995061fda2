"""Figures on pages: they are those of the file that the studies wrote, and of no other."""

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest

from tests.studies.publish import (
    ALONE,
    BLOCK,
    FIGURES,
    PAGES,
    PARTS,
    SUMMARY,
    Part,
    Publish,
    filled,
    measure,
    summary,
    write_pages,
)
from vip_factors.errors import InputError

FIGURE = re.compile(r"\d ?(?:mm|cm|ms|°)")
# Sections of results that say themselves where their figures come from.
DATED = ("Measured earlier", "Reliability", "Published figures", "History")


def figures_file(path: Path, *parts: Part) -> Path:
    content = {"commit": "0123456789", "machine": "a machine", "parts": [vars(part) for part in parts]}
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


def part(name: str, *tables: str) -> Part:
    return Part(name, f"run {name}", {}, "2026-01-02", 60.0, tables)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_tables_of_pages_are_those_of_the_file(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    names = [match[2] for match in BLOCK.finditer(text)]
    assert names
    assert set(names) <= {"source", "summary", *PARTS}
    assert filled(text) == text


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_no_figure_stands_outside_the_tables(page: Path) -> None:
    text = BLOCK.sub("", page.read_text(encoding="utf-8"))
    for section in re.split(r"^## ", text, flags=re.MULTILINE):
        if not section.startswith(DATED):
            assert not FIGURE.search(section), section


def test_a_changed_figure_is_noticed(tmp_path: Path) -> None:
    page, figures = tmp_path / "page.md", figures_file(tmp_path / "a.json", part("gait", "| a | b |", "| 1.0 | 2.0 |"))
    page.write_text("before\n\n<!-- figures: gait -->\n<!-- end of figures -->\n\nafter\n", encoding="utf-8")
    write_pages(figures, [page])
    text = page.read_text(encoding="utf-8")
    assert text.startswith("before\n")
    assert text.endswith("\nafter\n")
    assert "`run gait`, 2026-01-02:\n\n| a | b |\n| 1.0 | 2.0 |\n" in text
    assert filled(text, figures) == text
    assert filled(text.replace("2.0", "1.9"), figures) == text
    later = figures_file(tmp_path / "c.json", replace(part("gait", "| a | b |"), commit="abcdef"))
    assert "`run gait`, 2026-01-02, commit `abcdef`:" in filled(text, later)
    assert "Not measured" in filled(text, figures_file(tmp_path / "b.json"))


def test_the_summary_takes_numbers_by_row_and_column() -> None:
    parts = {"vip": part("vip", "| variant | walking | mean |", "| --- | --- | --- |", "| IT | 1 / 2 | 3 / 4 |",
                         "| VIP | 5 / 6 | 17.9 / 6.8 |")}  # fmt: skip
    assert "| 17.9 mm, 6.8° | VIP thesis" in summary(parts)
    assert len(summary(parts).splitlines()) == 3
    with pytest.raises(InputError, match="no table with a row 'VIP'"):
        summary({"vip": part("vip", "| variant | mean |", "| --- | --- |", "| IT | 3 / 4 |")})


def test_rows_of_the_summary_are_in_the_file() -> None:
    measured = {one["name"] for one in json.loads(FIGURES.read_text(encoding="utf-8"))["parts"]}
    assert measured <= set(PARTS)
    assert {name for _, name, *_ in SUMMARY} <= set(PARTS)
    assert set(ALONE) <= set(PARTS)


def test_a_part_is_measured_by_its_study() -> None:
    result = measure("speed", ["speed", "--quick"])
    assert result.command.startswith("python -m tests.studies speed --vary")
    assert result.seconds > 0
    assert result.options["quick"] is True
    assert "| frames |" in result.tables[0]


def test_parts_are_checked_before_any_work(tmp_path: Path) -> None:
    study = Publish(data=tmp_path, motions=tmp_path, folder=tmp_path / "made", figures=tmp_path / "a.json")
    with pytest.raises(InputError, match="needs --simulator"):
        replace(study, only=("population",)).wanted()
    with pytest.raises(InputError, match="unknown part 'sup'"):
        replace(study, only=("sup",)).wanted()
    assert "population" not in study.wanted()
    assert study.wanted()[-1] == "speed"
