"""From words on the command line to a dataclass of options."""

from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar, cast

import tyro

from vip_factors.ranges import check_ranges

Options = TypeVar("Options")


Flag = tyro.conf.FlagCreatePairsOff[bool]
"""A switch that is off unless named; settings keep both spellings, ``--use`` and ``--no-use``."""


def parse(
    options: type[Options],
    prog: str,
    arguments: Sequence[str],
    default: Options | None = None,
    none_is_a_value: bool = False,
) -> Options:
    """Fill a dataclass from arguments; its docstring is the help's first lines, the comments at its fields the rest.

    Args:
        options: the dataclass.
        prog: what the user calls the command.
        arguments: the words after it.
        default: values of the fields that are not given; those of the class if None.
        none_is_a_value: offer the word None where a field may be None (a filter that can be switched off, say).

    Raises:
        InputError: for a number that is out of its range.
        SystemExit: after ``--help`` (0) and for options that do not fit (2), which are told on stderr.
    """
    config = [tyro.conf.EnumChoicesFromValues, *([] if none_is_a_value else [tyro.conf.DisallowNone])]
    given = cast(Options, tyro.cli(options, prog=prog, args=list(arguments), default=default, config=config))
    check_ranges(given)
    return given


def beside(path: Path, ending: str) -> Path:
    """The usual name of something made from a file, in its folder: ``walk.mcap`` → ``walk.estimate.mcap``."""
    return path.with_name(path.name.removesuffix(path.suffix) + ending)
