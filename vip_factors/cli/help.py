"""``--help``: a screen of what most people use of a command; ``--help-all`` tells everything, as tyro lays it out."""

import ast
import inspect
import re
from dataclasses import dataclass, fields
from pathlib import Path
from textwrap import dedent, wrap
from typing import Any, Literal, get_args, get_origin, get_type_hints

from tyro.conf import Positional

HELP, HELP_ALL = ("-h", "--help"), "--help-all"
COLUMNS = 80
COLUMN = 23  # of them for an option's words
LINES = 2  # at most for what it does
WHOLE: Any = {"break_on_hyphens": False, "placeholder": " …"}  # words
# What stands for a value; anything else is text.
VALUES: dict[Any, str] = {Path: "PATH", float: "NUMBER", int: "N"}


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
