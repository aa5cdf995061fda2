"""From words on the command line to a dataclass of options."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import MISSING, field, fields, make_dataclass
from pathlib import Path
from typing import Annotated, Any, NoReturn, TypeVar, cast, get_type_hints

import tyro

from vip_factors.cli.outputs import check_outputs
from vip_factors.errors import InputError
from vip_factors.ranges import RangeError, check_ranges

Options = TypeVar("Options")
Tree = TypeVar("Tree")


Flag = tyro.conf.FlagCreatePairsOff[bool]
"""A switch that is off unless named; settings keep both spellings, ``--use`` and ``--no-use``."""

HELP, HELP_ALL = ("-h", "--help"), "--help-all"


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
        InputError: for a number that is out of its range, or an output that is an input or of another suffix.
        SystemExit: after ``--help`` or ``--help-all`` (0) and for options that do not fit (2), which stderr is told.
    """
    config = [tyro.conf.EnumChoicesFromValues, *([] if none_is_a_value else [tyro.conf.DisallowNone])]
    words = [HELP[1] if word == HELP_ALL else word for word in arguments]
    try:
        given = cast(Options, tyro.cli(options, prog=prog, args=words, default=default, config=config))
        check_ranges(given, zero=True)  # settings have checked themselves
        check_outputs(given)
    except RangeError as wrong:
        raise InputError(f"{_option(options, wrong.name)} {wrong.told}") from wrong
    return given


def _option(options: type, name: str) -> str:
    """What ``--help`` calls a field, by its dotted name; fields of some inner dataclasses have no outer name there."""
    words, inner = list[str](), cast(Any, options)
    for field_name in name.split("."):
        hint = get_type_hints(inner, include_extras=True).get(field_name) if isinstance(inner, type) else None
        said = getattr(hint, "__metadata__", ())
        if not any(getattr(one, "prefix_name", None) is False for one in said):
            words.append(field_name.replace("_", "-"))
        inner = getattr(hint, "__origin__", hint) if said else hint
    return "--" + ".".join(words)


def parse_with_settings(
    options: type[Options],
    prog: str,
    arguments: Sequence[str],
    common: type,
    tree: Callable[[], Tree],
    none_is_a_value: bool = True,
) -> tuple[Options, Tree]:
    """As :func:`parse`, of a command that also takes every setting of a tree of settings.

    Those are hundreds: ``--help`` tells the command's own options and a few settings, without importing the rest;
    ``--help-all`` tells all.

    Args:
        options: the command's own options.
        prog, arguments, none_is_a_value: as for :func:`parse`.
        common: a dataclass of the settings to tell by ``--help``, each with the name and default that it has in the
            tree.
        tree: makes the settings that hold where nothing else is given.

    Returns:
        The command's own options, and the settings.
    """
    if asks_for_short_help(arguments):
        tell_short_help(_with_tree(options, common), prog, none_is_a_value)
    settings = tree()
    filled: Any = _with_tree(options, type(settings))
    required = [one.name for one in fields(filled) if one.default is MISSING and one.default_factory is MISSING]
    default = filled(**dict.fromkeys(required, tyro.MISSING), tree=settings)
    found = parse(filled, prog, arguments, default, none_is_a_value)
    return cast(Options, found), found.tree


def asks_for_short_help(arguments: Sequence[str]) -> bool:
    """Whether help is asked for, but not all of it."""
    return HELP_ALL not in arguments and any(word in HELP for word in arguments)


def tell_short_help(options: type, prog: str, none_is_a_value: bool = True) -> NoReturn:
    """Print the help of a part of a command's options, and how to get the rest.

    Raises:
        SystemExit: 0, always.
    """
    with suppress(SystemExit):
        parse(options, prog, HELP[1:], none_is_a_value=none_is_a_value)
    print(f"All options: {prog} {HELP_ALL}")
    raise SystemExit(0)


def _with_tree(options: type, tree: type) -> type:
    """The options, and beside them those of a tree of settings, without a name before them."""
    annotation: Any = Annotated[cast(Any, tree), tyro.conf.arg(name="", prefix_name=False)]
    return make_dataclass(
        options.__name__, [("tree", annotation, field(default_factory=tree))], bases=(options,), frozen=True,
        namespace={"__doc__": options.__doc__, "__module__": __name__},
    )  # fmt: skip


def beside(path: Path, ending: str) -> Path:
    """The usual name of something made from a file, in its folder: ``walk.mcap`` → ``walk.estimate.mcap``.

    Raises:
        InputError: for a folder's path that has no name.
    """
    if not path.name:
        raise InputError(f"{path} is a folder: expected a file")
    return path.with_name(path.name.removesuffix(path.suffix) + ending)
