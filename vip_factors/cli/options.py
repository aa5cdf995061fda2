"""From words on the command line to a dataclass of options: parsed, in range, and never writing over what is read."""

import ast
import inspect
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass, replace
from functools import cache, partial
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, TypeVar, cast, get_args, get_type_hints

import tyro
from tyro.constructors import (
    ConstructorRegistry,
    PrimitiveConstructorSpec,
    PrimitiveTypeInfo,
    StructConstructorSpec,
    StructFieldSpec,
    StructTypeInfo,
)

from vip_factors.atomic import check_target
from vip_factors.cli.terminal import STANDARD_OUTPUT
from vip_factors.errors import InputError, naming_file, nearest
from vip_factors.factor_settings import LearnedOffsets
from vip_factors.ranges import Range, RangeError, check_ranges

if TYPE_CHECKING:
    from vip_factors.findings import Verdict


Options = TypeVar("Options")
Tree = TypeVar("Tree")

Flag = tyro.conf.FlagCreatePairsOff[bool]
"""A switch that is off unless named; settings keep both spellings, ``--use`` and ``--no-use``."""
UNPREFIXED = tyro.conf.arg(name="", prefix_name=False)
"""Marks a dataclass among options whose fields are options of their own names: ``Annotated[Settings, UNPREFIXED]``."""

FailOn = Literal["never", "care", "doubt"]
FAILED = 3


def fail_on(limit: FailOn, verdict: "Verdict") -> None:
    """End a command whose verdict is as bad as the user does not want it.

    Raises:
        SystemExit: 3, then.
    """
    from vip_factors.findings import Severity

    if limit != "never" and verdict.severity.reaches(Severity(limit)):
        raise SystemExit(FAILED)


def parse(options: type[Options], prog: str, words: Sequence[str]) -> Options:
    """Fill a dataclass from words.

    Args:
        options: the dataclass, whose docstrings are the help. Its ``none_is_a_value`` offers the word None where a
            field may be None: a filter that can be switched off, say.
        prog: what the user calls the command.
        words: after the command.

    Raises:
        InputError: for a number that is out of its range, an output that is an input or of another suffix, or a
            settings file that cannot be used.
        SystemExit: 0 after ``--help``; 2 after a message about words that do not fit.
    """
    config = [tyro.conf.EnumChoicesFromValues]
    if not getattr(options, "none_is_a_value", False):
        config.append(tyro.conf.DisallowNone)
    named = issubclass(options, SettingsOptions) and any(word.partition("=")[0] == "--settings" for word in words)
    default = _with_settings(options, prog, words) if named else None
    try:
        with naming_file(STANDARD_OUTPUT):  # where help is written
            filled = cast(
                Options,
                tyro.cli(options, prog=prog, args=words, default=default, config=config, registry=DATACLASSES),
            )
        for name, hint in get_type_hints(options, include_extras=True).items():
            if UNPREFIXED in getattr(hint, "__metadata__", ()):  # its fields are named as their options are
                check_ranges(getattr(filled, name), zero=True)
        check_ranges(filled, zero=True)
    except RangeError as error:
        raise InputError(f"--{error.name.replace('_', '-')} {error.reason}") from error
    check_outputs(filled)
    return filled


def _with_settings(options: type[Options], prog: str, words: Sequence[str]) -> Options:
    """Defaults of options, with the settings of the file that ``--settings`` names."""
    named, _ = tyro.cli(SettingsOptions, prog=prog, args=words, add_help=False, return_unknown_args=True)
    declared = {field.name: field for field in fields(cast(Any, options))}
    settings = cast(Any, declared["settings"]).default_factory()
    if named.settings_file is not None:
        settings = read_settings(named.settings_file, settings)
    required = [
        name for name, field in declared.items() if field.default is MISSING and field.default_factory is MISSING
    ]
    return cast(Any, options)(**dict.fromkeys(required, tyro.MISSING), settings=settings)


def read_settings(path: Path, defaults: Tree) -> Tree:
    """Read settings from a file: tables are nested dataclasses, keys their fields, the rest is as in ``defaults``.

    Raises:
        InputError: for an unknown key, whose nearest is named, or a value of another type or out of range.
        FileFormatError: if the file is not TOML, or cannot be read.
    """
    from vip_factors.io.typed_files import read_toml

    try:
        return _overlaid(path, defaults, read_toml(path, dict[str, object], "TOML with settings"), "")
    except RangeError as error:
        raise InputError(f"{path}: setting {error}") from error


def _overlaid(path: Path, defaults: Tree, content: Mapping[str, object], where: str) -> Tree:
    from vip_factors.io.typed_files import convert

    types, changes = get_type_hints(type(defaults)), dict[str, Any]()
    for key, value in content.items():
        place = f"{where}.{key}".lstrip(".")
        if key not in types:
            raise InputError(f"{path}: unknown setting '{place}'{nearest(key, types)}")
        default = getattr(defaults, key)
        if is_dataclass(default):
            changes[key] = _overlaid(path, default, convert(path, place, value, dict[str, object]), place)
        elif types[key] == LearnedOffsets | None:
            changes[key] = _read_offsets([convert(path, place, value, str)])
        else:
            changes[key] = convert(path, place, value, types[key])
    return cast(Tree, replace(cast(Any, defaults), **changes))


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
        may_exist: whether it is replaced without asking, or the command itself looks whether it may be.
    """

    suffix: str = ""
    hint: str = "choose another one to write"
    may_exist: bool = False


RERUN_FILE = Output(".rrd", "vip-factors export writes the files of other programs")


@dataclass(frozen=True)
class Input:
    """Marks an option that is text, and may be the name of a file that the command reads; paths need no mark."""


@dataclass(frozen=True, kw_only=True)
class WritingOptions:
    """Options of the commands that write files."""

    overwrite: Flag = False
    """Replace files that exist."""

    def target(self, target: Path | None, source: Path, ending: str) -> Path:
        """The file to write: the given one, or else the usual one beside the source.

        Raises:
            InputError: if it exists and may not be replaced, or cannot be written.
        """
        path = target or beside(source, ending)
        check_target(path, self.overwrite)
        return path


@dataclass(frozen=True, kw_only=True)
class ManyOptions(WritingOptions):
    """Options of the commands that work on folders and globs of recordings too."""

    jobs: Annotated[int, Range(least=1)] = 1
    """Number of parallel processes, for many or long recordings."""
    cluster: str | None = None
    """Dask scheduler: tcp://host:8786, or its scheduler file."""
    summary: Annotated[Path | None, Output(may_exist=True)] = None
    """Summary table (.csv), one row per recording."""


@dataclass(frozen=True, kw_only=True)
class SettingsOptions:
    """Options of the commands that have a field ``settings``, each of which is an option, too."""

    none_is_a_value: ClassVar = True
    settings_file: Annotated[Path | None, tyro.conf.arg(name="settings")] = None
    """TOML file with settings, one table per group, such as [solve]. Options override it."""


def check_outputs(options: Any) -> None:
    """Refuse outputs that are an input, that are named twice, or whose suffix tells of another content.

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


def check_existing(options: Any) -> None:
    """Raise an :class:`InputError` for an output that exists and may not be replaced, or cannot be written."""
    for path, mark in _marked_files(options):
        if isinstance(mark, Output) and not mark.may_exist:
            check_target(path, options.overwrite)


def keep_inputs(read: Sequence[Path], written: Sequence[Path]) -> None:
    """Refuse to write over what is read, ``--overwrite`` or not: no command touches its inputs.

    Raises:
        InputError: if a file is among both, by whatever name, or twice among those to be written.
    """
    for path in written:
        if any(_same(path, source) for source in read):
            raise InputError(f"{path} is an input and would be overwritten: choose another output name")
    for path, second in combinations(written, 2):
        if _same(path, second):
            raise InputError(f"{path} is named twice as an output: give each output another name")


def _same(path: Path, second: Path) -> bool:
    try:
        return os.path.samefile(path, second)
    except (OSError, ValueError):  # one of them is not there, or cannot be
        return os.path.realpath(path) == os.path.realpath(second)


def _marked_files(options: Any) -> Iterator[tuple[Path, Input | Output | None]]:
    """Every path among options with its mark, and text that is marked."""
    hints = get_type_hints(type(options), include_extras=True)
    for field in fields(options):
        value = getattr(options, field.name)
        if is_dataclass(value):
            yield from _marked_files(value)
            continue
        mark = _mark(hints[field.name])
        for name in value if isinstance(value, tuple) else (value,):
            if isinstance(name, Path) or (isinstance(name, str) and mark is not None):
                yield Path(name), mark


def _mark(hint: Any) -> Input | Output | None:
    for mark in getattr(hint, "__metadata__", ()):
        if isinstance(mark, Input | Output):
            return mark
    marks = map(_mark, get_args(hint))
    return next((mark for mark in marks if mark is not None), None)


DATACLASSES = ConstructorRegistry()
"""How tyro takes dataclasses apart."""


@DATACLASSES.primitive_rule
def learned_offsets(info: PrimitiveTypeInfo) -> "PrimitiveConstructorSpec[LearnedOffsets] | None":
    """Rule for an option that names a file of keypoint offsets; None for other types."""
    if info.type is not LearnedOffsets:
        return None
    return PrimitiveConstructorSpec(
        1, "PATH", _read_offsets, lambda value: isinstance(value, LearnedOffsets), lambda offsets: [str(offsets)]
    )


def _read_offsets(words: list[str]) -> LearnedOffsets:
    from vip_factors.io.detections import read_keypoint_offsets

    return read_keypoint_offsets(Path(words[0]))


@DATACLASSES.struct_rule
def dataclass_fields(info: StructTypeInfo) -> StructConstructorSpec | None:
    """Fields of a dataclass, with their help; None for other types. tyro itself parses a module for every class."""
    if not is_dataclass(info.type):
        return None
    hints = get_type_hints(info.type, include_extras=True)
    specs = list[StructFieldSpec]()
    for field in fields(info.type):
        text = partial(_help, info.type, field.name)
        specs.append(StructFieldSpec(field.name, hints[field.name], _default(field, info.default), text))
    return StructConstructorSpec(info.type, tuple(specs))


def _default(field: Field[Any], owner: Any) -> Any:
    if owner is tyro.MISSING:
        return owner
    if owner is not None and owner is not tyro.MISSING_NONPROP:
        return getattr(owner, field.name)
    if field.default_factory is not MISSING:
        return field.default_factory()
    return tyro.MISSING_NONPROP if field.default is MISSING else field.default


def _help(options: type[Any], name: str) -> str | None:
    texts = (_texts(base.__module__).get((base.__name__, name)) for base in options.__mro__ if base is not object)
    return next(filter(None, texts), None)


@cache
def _texts(module: str) -> dict[tuple[str, str], str]:
    """By class and field of a module: the docstring below the field, or else the comment behind it or above it."""
    source = inspect.getsource(sys.modules[module])
    lines, texts = source.splitlines(), dict[tuple[str, str], str]()
    for options in ast.parse(source).body:
        if not isinstance(options, ast.ClassDef):
            continue
        for field, below in zip(options.body, [*options.body[1:], None], strict=True):
            if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
                texts[options.name, field.target.id] = _description(field, below, lines)
    return texts


def _description(field: ast.AnnAssign, below: ast.stmt | None, lines: list[str]) -> str:
    if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant):
        return " ".join(str(below.value.value).split())
    behind = lines[(field.end_lineno or field.lineno) - 1].encode()[field.end_col_offset :].decode().strip()
    if behind:
        return behind.lstrip("# ")
    above, line = list[str](), field.lineno - 2
    while lines[line].lstrip().startswith("#"):
        above.insert(0, lines[line].strip("# "))
        line -= 1
    return " ".join(above)
