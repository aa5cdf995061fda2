"""Settings from a TOML file over the tree of settings dataclasses; a misspelt key is refused, the nearest one named."""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import is_dataclass, replace
from difflib import get_close_matches
from enum import Enum
from pathlib import Path
from typing import Any, TypeVar, get_args, get_type_hints

from vip_factors.errors import FileFormatError, InputError
from vip_factors.ranges import RangeError

Tree = TypeVar("Tree")


def read_settings(path: Path, defaults: Tree) -> Tree:
    """The settings of a file over ``defaults``: tables are nested dataclasses, keys their fields.

    Args:
        path: of the file.
        defaults: what it changes.

    Raises:
        InputError: for an unknown key (naming the nearest), or a value of another kind than the default's.
        FileFormatError: if the file is not TOML.
        OSError: if it cannot be read.
    """
    if path.is_dir():
        raise InputError(f"{path} is a folder: expected a TOML file with settings")
    try:
        # Editors of Windows put a mark before the text.
        content = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (ValueError, RecursionError) as wrong:  # also numbers of too many digits, and tables in tables without end
        raise FileFormatError(f"{path}: not TOML: {wrong}") from wrong
    try:
        return _overlaid(defaults, content, str(path), ())
    except RangeError as wrong:
        raise InputError(f"{path}: setting {wrong}") from wrong


def _overlaid(defaults: Any, content: Mapping[str, Any], file: str, above: tuple[str, ...]) -> Any:
    hints = get_type_hints(type(defaults))
    changes = {}
    for key, value in content.items():
        where = ".".join((*above, key))
        if key not in hints:
            from vip_factors.settings import CommonSettings, Settings

            if not above and isinstance(defaults, CommonSettings) and key in get_type_hints(Settings):
                raise InputError(
                    f"{file}: setting '{where}' is one of smooth, and a stream cannot honour it: leave it out"
                )
            near = get_close_matches(key, hints, n=1, cutoff=0.4)
            hint = f"did you mean '{'.'.join((*above, near[0]))}'?" if near else f"known are {', '.join(hints)}"
            raise InputError(f"{file}: unknown setting '{where}'; {hint}")
        current = getattr(defaults, key)
        if is_dataclass(current):
            if not isinstance(value, Mapping):
                raise InputError(f"{file}: setting '{where}' is {value!r}: expected a table [{where}]")
            changes[key] = _overlaid(current, value, file, (*above, key))
        else:
            changes[key] = _value(value, hints[key], current, f"{file}: setting '{where}'")
    return replace(defaults, **changes)


def _value(value: Any, hint: Any, current: Any, where: str) -> Any:
    """A TOML value as the field's type; whole numbers do for floats."""
    kinds = get_args(hint) or (hint,)
    for kind in kinds:
        if isinstance(kind, type) and issubclass(kind, Enum):
            if value in [member.value for member in kind]:
                return kind(value)
            names = ", ".join(str(member.value) for member in kind)
            raise InputError(f"{where} is {value!r}: expected one of {names}")
        if isinstance(kind, str):  # one of a Literal
            if value in kinds:
                return value
            raise InputError(f"{where} is {value!r}: expected one of {', '.join(kinds)}")
        if kind is Path and isinstance(value, str):
            return Path(value)
        if kind is float and isinstance(value, int | float) and not isinstance(value, bool):
            try:
                return float(value)
            except OverflowError as wrong:
                raise InputError(f"{where} is a number of {len(str(value))} digits: expected a smaller one") from wrong
        if kind is bool and isinstance(value, bool):
            return value
        if kind is int and isinstance(value, int) and not isinstance(value, bool):
            return value
        if kind is str and isinstance(value, str):
            return value
    raise InputError(f"{where} is {value!r}: expected something like {current!r}")


def given(arguments: Sequence[str], option: str) -> str | None:
    """The value of an option among unparsed arguments; the last one counts."""
    value = None
    for index, word in enumerate(arguments):
        if word == option and index + 1 < len(arguments):
            value = arguments[index + 1]
        elif word.startswith(f"{option}="):
            value = word.partition("=")[2]
    return value
