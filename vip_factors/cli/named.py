"""The settings that a command line names before the rest of it is parsed: a configuration, a settings file."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from vip_factors.configurations import Configuration, configured

if TYPE_CHECKING:
    from vip_factors.settings import Settings

Tree = TypeVar("Tree", bound="Settings")


def named_tree(arguments: Sequence[str], own: Tree) -> Tree:
    """What ``--configuration`` and ``--settings`` make of a command's own settings.

    A configuration on the command line wins over that of the file, whose other settings stay.
    """
    name, path = given(arguments, "--configuration"), given(arguments, "--settings")
    if (path is None and name is None) or (name is not None and name not in list(Configuration)):
        return own  # of an unknown name the parser tells
    tree = configured(own, name or Configuration.OWN)
    if path is None:
        return tree
    from vip_factors.cli.settings_file import read_settings

    return read_settings(Path(path), tree, lambda other: configured(own, other) if name is None else tree)


def given(arguments: Sequence[str], option: str) -> str | None:
    """The value of an option among unparsed arguments; the last one counts."""
    value = None
    for index, word in enumerate(arguments):
        if word == option and index + 1 < len(arguments):
            value = arguments[index + 1]
        elif word.startswith(f"{option}="):
            value = word.partition("=")[2]
    return value
