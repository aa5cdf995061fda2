"""Ranges of numeric settings, declared at the field and checked before any work."""

import math
import sys
from dataclasses import dataclass, fields, is_dataclass
from functools import cache, partial
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from vip_factors.errors import InputError


@dataclass(frozen=True)
class Range:
    """Which numbers are allowed; stated as ``Annotated[float, Range(...)]`` where the usual rule does not hold.

    Attributes:
        least: the smallest.
        above: all must be larger than this.
        most: the largest.
    """

    least: float = -math.inf
    above: float = -math.inf
    most: float = math.inf

    def __contains__(self, value: float) -> bool:
        is_finite = abs(value) <= sys.float_info.max  # isfinite fails at integers beyond the largest float
        return is_finite and self.above < value and self.least <= value <= self.most

    def __str__(self) -> str:
        words = []
        if self.above > -math.inf:
            words.append(f"more than {self.above:g}")
        if self.least > -math.inf:
            words.append(f"{self.least:g} or more")
        if self.most < math.inf:
            words.append(f"{self.most:g} at most")
        return "a finite number" + (f", {' and '.join(words)}" if words else "")


NotNegative = Annotated[float, Range(least=0)]
"""A setting that 0 switches off."""
NotNegativeInt = Annotated[int, Range(least=0)]
"""A count that may be none."""
Rate = Annotated[float, Range(above=0, most=10_000)]
"""Hz, of frames or samples: beyond it no sensor measures, and no memory holds a recording."""
MaybeRate = Annotated[float | None, Range(above=0, most=10_000)]
"""As :data:`Rate`; None: as something else has it."""
Port = Annotated[int, Range(least=1, most=65_534)]
"""Of a server, which may take the next one too."""
Share = Annotated[float, Range(least=0, most=1)]
"""A part of a whole."""


class RangeError(InputError):
    """A number among settings that is out of its range.

    Attributes:
        name: of the setting, dotted.
        reason: its value and what was expected.
    """

    def __init__(self, name: str, reason: str) -> None:
        super().__init__(f"{name} {reason}")
        self.name, self.reason = name, reason


_HINTS = cache(partial(get_type_hints, include_extras=True))


def check_ranges(settings: Any, prefix: str = "", zero: bool = False) -> None:
    """Refuse a number among settings that is out of its range.

    The range is the one that is stated at the field. Where none is, every number has to be finite, and to be positive
    if its default is: a standard deviation, a rate, a length, a count.

    Args:
        settings: a dataclass, with dataclasses in it.
        prefix: what stands before the names of its fields, in the sentence about a wrong one.
        zero: whether 0 is allowed where the usual rule would have a positive number: of errors that 0 switches off.

    Raises:
        RangeError: for the first number that is out of its range; it is named with its value and the range.
    """
    hints = _HINTS(settings.__class__)
    for field in fields(settings):
        value, name = getattr(settings, field.name), f"{prefix}{field.name}"
        if is_dataclass(value):
            check_ranges(value, f"{name}.", zero)
        elif isinstance(value, int | float) and not isinstance(value, bool):
            default = field.default if isinstance(field.default, int | float) else 0
            is_positive = default > 0 and not isinstance(default, bool)
            usual = Range() if not is_positive else Range(least=0) if zero else Range(above=0)
            allowed = _stated(hints[field.name]) or usual
            if value not in allowed:
                raise RangeError(name, f"is {value}: expected {allowed}")
        elif isinstance(value, tuple) and not all(math.isfinite(n) for n in value if isinstance(n, float)):
            raise RangeError(name, f"is {value}: expected finite numbers")


def _stated(hint: Any) -> Range | None:
    """The range that a field's type carries, at its top or in one of its alternatives (a number, or None)."""
    if get_origin(hint) is Annotated:
        return next((one for one in hint.__metadata__ if isinstance(one, Range)), None)
    return next((found for one in get_args(hint) if (found := _stated(one)) is not None), None)
