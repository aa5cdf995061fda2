"""A setting that is out of its range is refused before any work, and named."""

from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Annotated, Any

import pytest

from vip_factors.cli.options import UNPREFIXED, parse
from vip_factors.errors import InputError
from vip_factors.ranges import NotNegative, Share, check_ranges
from vip_factors.settings import LiveSettings, Settings


@dataclass(frozen=True)
class Inner:
    part: Share = 0.5
    off: NotNegative = 1.0
    choice: float | None = None


@dataclass(frozen=True)
class Outer:
    sigma: float = 2.0
    shift: float = 0.0
    count: int = 3
    switch: bool = True
    offsets: tuple[float, ...] = (1.0,)
    inner: Inner = field(default_factory=Inner)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (Outer(sigma=0.0), "sigma is 0.0: expected a finite number, more than 0"),
        (Outer(sigma=float("inf")), "sigma is inf"),
        (Outer(shift=float("nan")), "shift is nan: expected a finite number"),
        (Outer(count=-1), "count is -1"),
        (Outer(offsets=(1.0, float("inf"))), "offsets"),
        (Outer(inner=Inner(1.5)), "inner.part is 1.5: expected a finite number, 0 or more and 1 at most"),
        (Outer(inner=Inner(off=-1.0)), "inner.off is -1.0: expected a finite number, 0 or more"),
        (Outer(inner=Inner(choice=float("inf"))), "inner.choice is inf"),
    ],
)
def test_what_is_not_is_named_with_what_was_expected(settings: Outer, words: str) -> None:
    with pytest.raises(InputError) as told:
        check_ranges(settings)
    assert words in str(told.value)


def numbers(settings: Any, path: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    found = []
    for one in fields(settings):
        value = getattr(settings, one.name)
        if is_dataclass(value):
            found += numbers(value, (*path, one.name))
        elif isinstance(value, int | float) and not isinstance(value, bool):
            found.append((*path, one.name))
    return found


def changed(settings: Any, path: tuple[str, ...], value: float) -> Any:
    first, *rest = path
    inner = changed(getattr(settings, first), tuple(rest), value) if rest else value
    return replace(settings, **{first: inner})


@pytest.mark.parametrize("whole", [Settings(), LiveSettings()], ids=["smooth", "stream"])
def test_no_setting_may_be_infinite(whole: Settings) -> None:
    for path in numbers(whole):
        for value in (float("inf"), float("nan")):
            with pytest.raises(InputError):
                changed(whole, path, value)


@dataclass(frozen=True)
class Command:
    """Options of a command."""

    own: Inner = field(default_factory=Inner)
    sigma_deg: float = 2.0
    outer: Annotated[Outer, UNPREFIXED] = field(default_factory=Outer)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--sigma-deg", "inf"], "--sigma-deg is inf: expected a finite number, 0 or more"),
        (["--own.part", "2"], "--own.part is 2.0: "),
        (["--count", "-1"], "--count is -1: "),
    ],
)
def test_on_the_command_line_it_is_named_as_help_names_it(words: list[str], said: str) -> None:
    with pytest.raises(InputError) as told:
        parse(Command, "command", words)
    assert str(told.value).startswith(said)
