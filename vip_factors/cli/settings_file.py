"""Settings from a TOML file over the tree of settings dataclasses; a misspelt key is refused, the nearest one named."""

from collections.abc import Mapping
from dataclasses import is_dataclass, replace
from pathlib import Path
from typing import Any, TypeVar, cast, get_type_hints

from vip_factors.errors import InputError, nearest
from vip_factors.io.typed_files import convert, read_toml
from vip_factors.ranges import RangeError

Tree = TypeVar("Tree")


def read_settings(path: Path, defaults: Tree) -> Tree:
    """Read settings from a file: tables are nested dataclasses, keys their fields, the rest is as in ``defaults``.

    Raises:
        InputError: for an unknown key, whose nearest is named, or a value of another type or out of range.
        FileFormatError: if the file is not TOML, or cannot be read.
    """
    try:
        return _overlaid(path, defaults, read_toml(path, dict[str, object], "TOML with settings"), "")
    except RangeError as error:
        raise InputError(f"{path}: setting {error}") from error


def _overlaid(path: Path, defaults: Tree, content: Mapping[str, object], where: str) -> Tree:
    types, changes = get_type_hints(type(defaults)), dict[str, Any]()
    for key, value in content.items():
        place = f"{where}.{key}".lstrip(".")
        if key not in types:
            raise InputError(f"{path}: unknown setting '{place}'{nearest(key, types)}")
        default = getattr(defaults, key)
        if is_dataclass(default):
            changes[key] = _overlaid(path, default, convert(path, place, value, dict[str, object]), place)
        else:
            changes[key] = convert(path, place, value, types[key])
    return cast(Tree, replace(cast(Any, defaults), **changes))
