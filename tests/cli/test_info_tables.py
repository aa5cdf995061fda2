"""Tables of facts on a terminal: plain text, whatever the names in them are."""

import math

import pytest

from vip_factors.cli.terminal import terminal_text
from vip_factors.tables import UNKNOWN, Quantity, Table, facts

SENSORS = Table(
    ("sensor", "on", "heading"), [("head", "head", Quantity(-0.04, 1.26, "°", 1)), ("shank", "left", UNKNOWN)], words=2
)


def test_columns_are_aligned_below_their_title() -> None:
    text = terminal_text([facts("wearer 'Ada'", ("body", "1.75 m"), ("start", "as placed")), facts(""), SENSORS])
    assert text == (
        "wearer 'Ada'\n  body:   1.75 m\n  start:  as placed\n\n"
        f"  sensor  on       heading\n  head    head  0.0 ± 1.3°\n  shank   left           {UNKNOWN}"
    )


def test_a_narrow_terminal_breaks_lines_and_loses_nothing() -> None:
    words = " ".join(f"word{number}" for number in range(40))
    text = terminal_text([facts("", ("note", words))], width=40)
    assert max(map(len, text.splitlines())) <= 40
    assert text.split()[1:] == words.split()
    assert terminal_text([facts("", ("note", words))]).count("\n") == 0


@pytest.mark.parametrize("width", [40, 80])
def test_columns_are_folded_and_names_stay_whole(width: int) -> None:
    rows = [(f"left_upper_arm_{row}", *(f"{row}.{column} ± {'7' * 6}°" for column in range(6))) for row in range(3)]
    text = terminal_text([Table(("sensor", *"abcdef"), rows)], width)
    assert max(map(len, text.splitlines())) <= width
    assert all((row[0] in text) == (width == 80) for row in rows)
    assert text.count("7") == 3 * 6 * 6


@pytest.mark.parametrize("name", ["\x1b[2J\x07", "[bold]", ":smile:", "a\nb", "\u202egnp"])
def test_names_steer_no_terminal(name: str) -> None:
    text = terminal_text([facts(name, (name, name)), Table((name, ""), [(name, name)])])
    assert text.isprintable() or set(text) - {"\n"} == {one for one in text if one.isprintable()}
    assert text.count(name if name.isprintable() else name.encode("unicode_escape").decode()) == 6


@pytest.mark.parametrize(
    ("quantity", "text"),
    [
        (Quantity(1.754, unit="m", decimals=2), "1.75 m"),
        (Quantity(432.4, 12.6), "432 ± 13"),
        (Quantity(91.26, 0.31), "91.3 ± 0.3"),
        (Quantity(91.26, 0.0), "91"),
        (Quantity(-0.001, math.inf, "°", 1), "0.0°"),
        (Quantity(math.nan, 1.0, "mm"), UNKNOWN),
    ],
)
def test_a_number_stands_with_what_is_known_of_it(quantity: Quantity, text: str) -> None:
    assert str(quantity) == text
