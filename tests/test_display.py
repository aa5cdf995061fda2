"""Names that people give, where they could do harm."""

import csv
from pathlib import Path

import pytest

from vip_factors.cli.multi_file import Row, write_summary
from vip_factors.display import one_line, table_cell


@pytest.mark.parametrize("name", ["=1+1", "+49", "-2", "@sum", "\t=1", "\r=1", "=a,b\nc", '="x"'])
def test_no_cell_of_a_table_is_a_formula(name: str) -> None:
    cell = table_cell(name)
    assert cell.lstrip()[0] not in "=+-@"
    assert not set("\t\r\n") & set(cell)
    assert next(csv.reader([f'"{cell.replace(chr(34), chr(34) * 2)}",1'])) == [cell, "1"]


def test_usual_names_stay_as_they_are() -> None:
    for name in ("Ada", "subject 1", "Zoë", "a_b/c", "李"):
        assert table_cell(name) == one_line(name) == name


def test_lines_end_only_where_they_should() -> None:
    assert one_line("a\nb\r\nc\td\x1b[2J\u2028e") == "a b c d [2J e"


def test_the_table_of_many_files_holds_no_formula(tmp_path: Path) -> None:
    write_summary([Row("=cmd()", "@out", "done", findings=("+1", "b\nc"), error="-1\tx")], tmp_path / "a.csv")
    (row,) = csv.DictReader((tmp_path / "a.csv").read_text().splitlines())
    assert [row[name] for name in ("input", "output", "findings", "error")] == ["'=cmd()", "'@out", "'+1; b c", "'-1 x"]
