"""From words on the command line to a dataclass of options: parsed, in range, and never writing over what is read.

``--help``: a screen of what most people use of a command; ``--help-all`` tells everything, as tyro lays it out.
"""

import ast
import inspect
import os
import re
from collections.abc import Iterator, Sequence
from contextlib import redirect_stderr
from dataclasses import MISSING, dataclass, field, fields, is_dataclass, make_dataclass
from importlib import import_module
from io import StringIO
from itertools import combinations, pairwise, takewhile
from pathlib import Path
from textwrap import dedent, wrap
from typing import Annotated, Any, Literal, TypeVar, cast, get_args, get_origin, get_type_hints

import tyro
from tyro.conf import Positional

from vip_factors.errors import InputError
from vip_factors.findings import Severity, Verdict
from vip_factors.ranges import Range, RangeError, check_ranges

HELP, HELP_ALL = ("-h", "--help"), "--help-all"
COLUMNS = 80
COLUMN = 23  # of them for an option's words
LINES = 2  # at most for what it does
WHOLE: Any = {"break_on_hyphens": False, "placeholder": " …"}  # words
# What stands for a value; anything else is text.
VALUES: dict[Any, str] = {Path: "PATH", float: "NUMBER", int: "N"}
RULES = ("─", "---")
MISFITS = (  # what tyro says of a value that does not fit, and what we say
    (r"Error parsing (\S+): no type matching (?:{None}\|)?(\S+) could be .*from \[('.*')\]", r"\1 is \3: expected \2"),
    (r"Error parsing (\S+): invalid literal for int.*: ('.*')", r"\1 is \2: expected INT"),
    (r"Error parsing (\S+): could not convert string to float: ('.*')", r"\1 is \2: expected FLOAT"),
    ("INT$", "a whole number"),
    ("FLOAT$", "a number"),
    (r"invalid choice ('.*') for argument '(\S+)'\. Expected one of \((.*)\)", r"\2 is \1: expected one of \3"),
)
Options = TypeVar("Options")


Flag = tyro.conf.FlagCreatePairsOff[bool]
"""A switch that is off unless named; settings keep both spellings, ``--use`` and ``--no-use``."""

FailOn = Literal["never", "care", "doubt"]
FAILED = 3


def fail_on(limit: FailOn, verdict: Verdict) -> None:
    """End a command whose verdict is as bad as the user does not want it.

    Raises:
        SystemExit: 3, then.
    """
    if limit != "never" and verdict.severity.reaches(Severity(limit)):
        raise SystemExit(FAILED)


def run_command(command: str, prog: str, arguments: Sequence[str]) -> None:
    """Run ``main`` of the module of a command with what :func:`parsed` makes of the words after it."""
    _command_module(command).main(*parsed(command, prog, arguments))


def parsed(command: str, prog: str, arguments: Sequence[str]) -> tuple[Any, ...]:
    """A command's options, and the settings if the options have a ``settings_tree``: what its ``main`` takes."""
    options = _command_module(command).main.__annotations__["options"]
    if hasattr(options, "settings_tree"):
        return parse_with_settings(options, prog, arguments)
    return (parse(options, prog, arguments),)


def _command_module(command: str) -> Any:
    return import_module(f"vip_factors.cli.{command.replace('-', '_')}")


def parse(options: type[Options], prog: str, arguments: Sequence[str], default: Options | None = None) -> Options:
    """Fill a dataclass from arguments; its docstring is the help's first lines, the comments at its fields the rest.

    Args:
        options: the dataclass. Its ``none_is_a_value`` offers the word None where a field may be None (a filter that
            can be switched off, say); if it does not say, a ``settings_tree`` does.
        prog: what the user calls the command.
        arguments: the words after it.
        default: values of the fields that are not given; those of the class if None.

    Raises:
        InputError: for words that do not fit, a number that is out of its range, or an output that is an input or of
            another suffix.
        SystemExit: 0 after ``--help``, a screen of the options that the class names in ``common``, or ``--help-all``.
    """
    none_is_a_value = getattr(options, "none_is_a_value", hasattr(options, "settings_tree"))
    config = [tyro.conf.EnumChoicesFromValues, *([] if none_is_a_value else [tyro.conf.DisallowNone])]
    if hasattr(options, "common"):
        _tell_short_help(arguments, prog, options)
    words = [HELP[1] if word == HELP_ALL else word for word in arguments]
    try:
        with redirect_stderr(StringIO()) as box:
            given = cast(Options, tyro.cli(options, prog=prog, args=words, default=default, config=config))
        check_ranges(given, zero=True)  # settings have checked themselves
        check_outputs(given)
    except RangeError as wrong:
        raise InputError(f"{_option(options, wrong.name)} {wrong.reason}") from wrong
    except SystemExit as end:
        if not end.code:
            raise
        raise InputError(f"{_sentence(box.getvalue())}; all options: {prog} {HELP_ALL}") from None
    return given


def _sentence(box: str) -> str:
    """Of the box that tyro draws about words that do not fit: what it says above its first rule, in our words."""
    lines = list(filter(None, (line.strip("│ ") for line in box.splitlines()[1:])))
    lines = lines[lines[0].startswith(RULES) :]  # where the terminal has no boxes, the title has a rule, too
    text = " ".join(takewhile(lambda line: not line.startswith((*RULES, "Got errors")), lines)).rstrip(".")
    for theirs, ours in MISFITS:
        text = re.sub(theirs, ours, text)
    meant = next((after for line, after in pairwise(lines) if line == "Perhaps you meant:"), "").partition(" ")[0]
    return f"{text[:1].lower()}{text[1:]}{f'; perhaps {meant} is meant' * bool(meant)}"


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


def parse_with_settings(options: type[Options], prog: str, arguments: Sequence[str]) -> tuple[Options, Any]:
    """As :func:`parse`, of a command that also takes every setting of a tree of settings.

    Those are hundreds: ``--help`` tells a few of them, without importing the rest; ``--help-all`` tells all.

    Args:
        options: the command's own options, whose ``settings_tree`` has a dataclass of the settings to tell by
            ``--help``, which those of the tree inherit, and ``module:class`` of all settings, not imported for the
            short help. A settings file holds where nothing else is given, if the command has --settings.
        prog, arguments: as for :func:`parse`.

    Returns:
        The command's own options, and the settings.
    """
    shown, tree = cast(Any, options).settings_tree
    _tell_short_help(arguments, prog, options, shown)
    module, name = tree.split(":")
    settings = getattr(import_module(module), name)()
    if any(field.name == "settings" for field in fields(cast(Any, options))):
        from vip_factors.cli.settings_file import given, read_settings

        if (path := given(arguments, "--settings")) is not None:
            settings = read_settings(Path(path), settings)
    filled: Any = _with_tree(options, type(settings))
    required = [one.name for one in fields(filled) if one.default is MISSING and one.default_factory is MISSING]
    default = filled(**dict.fromkeys(required, tyro.MISSING), tree=settings)
    found = parse(filled, prog, arguments, default)
    return cast(Options, found), found.tree


def _tell_short_help(arguments: Sequence[str], prog: str, *options: type) -> None:
    """If help is asked for, but not all of it."""
    if HELP_ALL not in arguments and any(word in HELP for word in arguments):
        print(screen(prog, *options))
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


@dataclass(frozen=True)
class Output:
    """Marks an option whose file, or files, the command writes: ``Annotated[Path | None, Output(".mcap")] = None``.

    Attributes:
        suffix: what the name has to end in, so that no other program is misled; any if empty.
        hint: what to do instead of another suffix.
    """

    suffix: str = ""
    hint: str = "choose another one to write"


RERUN_FILE = Output(".rrd", "vip-factors export writes the files of other programs")


@dataclass(frozen=True)
class Input:
    """Marks an option that is text, and may be the name of a file that the command reads; paths need no mark."""


@dataclass(frozen=True, kw_only=True)
class WritingOptions:
    """Options of the commands that write files."""

    overwrite: Flag = False
    """Replace files that exist."""


@dataclass(frozen=True, kw_only=True)
class ManyOptions(WritingOptions):
    """Options of the commands that work on folders, globs and lists (@list.txt) of files too."""

    jobs: Annotated[int, Range(least=1)] = 1
    """Processes at a time, for many files or long ones."""
    cluster: str | None = None
    """Dask scheduler: tcp://host:8786, or its file."""
    summary: Annotated[Path | None, Output()] = None
    """Table (.csv) of many files, and page beside it."""


def check_outputs(options: Any) -> None:
    """Refuse outputs that are an input, that are named twice, or whose suffix tells of another content.

    Args:
        options: a dataclass of options, with dataclasses in it; outputs are marked by :class:`Output`.

    Raises:
        InputError: for the first of them.
    """
    read, written = list[Path](), list[Path]()
    for path, mark in _marked_files(options):
        if "\0" in str(path):
            raise InputError(f"{str(path)!r}: the name of a file cannot hold the character 0")
        if not isinstance(mark, Output):
            read.append(path)
            continue
        written.append(path)
        if mark.suffix and path.suffix.lower() != mark.suffix:
            raise InputError(f"{path}: expected a name that ends in {mark.suffix}; {mark.hint}")
    keep_inputs(read, written)


def keep_inputs(read: Sequence[Path], written: Sequence[Path]) -> None:
    """Refuse to write over what is read, ``--overwrite`` or not: no command touches its inputs.

    Raises:
        InputError: if a file is among both, by whatever name, or twice among those to be written.
    """
    for path in written:
        if any(_same(path, source) for source in read):
            raise InputError(f"{path} is read, and would be written over: choose another name for what is written")
    for path, other in combinations(written, 2):
        if _same(path, other):
            raise InputError(f"{path} is named twice for what is written: give each file a name of its own")


def _same(path: Path, other: Path) -> bool:
    try:
        return os.path.samefile(path, other)
    except (OSError, ValueError):  # one of them is not there, or cannot be
        return os.path.realpath(path) == os.path.realpath(other)


def _marked_files(options: Any) -> Iterator[tuple[Path, Input | Output | None]]:
    """Every path among options with its mark, and text that is marked."""
    hints = get_type_hints(type(options), include_extras=True)
    for one in fields(options):
        value = getattr(options, one.name)
        if is_dataclass(value):
            yield from _marked_files(value)
            continue
        mark = _mark(hints[one.name])
        for single in value if isinstance(value, tuple) else (value,):
            if isinstance(single, Path) or (isinstance(single, str) and mark is not None):
                yield Path(single), mark


def _mark(hint: Any) -> Input | Output | None:
    for one in getattr(hint, "__metadata__", ()):
        if isinstance(one, Input | Output):
            return one
    return next((found for inner in get_args(hint) if (found := _mark(inner)) is not None), None)


def screen(prog: str, options: Any, *shown: type) -> str:
    """Usage, a sentence, the arguments, and the options that most people use: of each the first sentence.

    Args:
        prog: what the user calls the command.
        options: its dataclass, whose ``common`` names the fields that are told beside its arguments.
        shown: further dataclasses, whose fields are all told.
    """
    found = {one.name: one for one in _entries(options)}
    arguments = [one for one in found.values() if one.positional]
    told = [*arguments, *(found[name] for name in options.common)]
    lines = [" ".join([f"usage: {prog}", "[OPTIONS]", *(one.words for one in arguments)]), ""]
    lines += [*wrap(_first_sentence(inspect.getdoc(options) or ""), COLUMNS, **WHOLE), ""]
    told += [entry for cls in shown for entry in _entries(cls)]
    for entry in told:
        words, text = entry.words, wrap(_first_sentence(entry.text), COLUMNS - COLUMN - 4, max_lines=LINES, **WHOLE)
        if len(words) > COLUMN:
            lines.append(f"  {words}")
            words = ""
        lines += [f"  {'' if n else words:{COLUMN}}  {line}" for n, line in enumerate(text)]
    return "\n".join([*lines, "", f"All options: {prog} {HELP_ALL}"])


@dataclass(frozen=True)
class _Entry:
    """A field, as the command line has it.

    Attributes:
        words: what one types.
        text: what it does.
    """

    name: str
    positional: bool
    words: str
    text: str


def _entries(options: type) -> list[_Entry]:
    """Of all fields of a dataclass."""
    hints, texts = get_type_hints(options, include_extras=True), _texts(options)
    found = []
    for one in fields(options):
        hint = hints[one.name]
        marks = getattr(hint, "__metadata__", ())
        positional = Positional in marks
        value = next((mark.metavar for mark in marks if getattr(mark, "metavar", None)), None) or _value(hint)
        short = [word for mark in marks for word in getattr(mark, "aliases", None) or ()]
        option = ", ".join([*short, f"--{one.name.replace('_', '-')}"])
        words = value if positional else f"{option} {value}".strip()
        found.append(_Entry(one.name, positional, words, texts.get(one.name, "")))
    return found


def _value(hint: Any) -> str:
    """What is typed behind an option of a type; of a switch nothing."""
    while get_origin(hint) is not Literal and get_args(hint):  # Annotated, Optional, tuples: by what is in them
        hint = get_args(hint)[0]
    if get_origin(hint) is Literal:
        return "|".join(map(str, get_args(hint)))
    return "" if hint is bool else VALUES.get(hint, "TEXT")


def _texts(options: type) -> dict[str, str]:
    """The text behind each field, of the class and of those that it inherits: Python does not keep them."""
    found = dict[str, str]()
    for cls in reversed([one for one in options.__mro__ if one is not object]):
        (body,) = (node for node in ast.parse(dedent(inspect.getsource(cls))).body if isinstance(node, ast.ClassDef))
        for before, node in zip(body.body, body.body[1:], strict=False):
            if isinstance(before, ast.AnnAssign) and isinstance(before.target, ast.Name) and isinstance(node, ast.Expr):
                found[before.target.id] = str(ast.literal_eval(node.value))
    return found


def _first_sentence(text: str) -> str:
    return re.split(r"(?<=\.)\s+(?=[A-Z0-9])", " ".join(text.partition("\n\n")[0].split()))[0]
