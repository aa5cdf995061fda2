"""Help of options: the text at the fields of their dataclasses. tyro would parse a field's module for every class."""

import ast
import inspect
import sys
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import cache, partial
from typing import Any, get_type_hints

import tyro
from tyro.constructors import ConstructorRegistry, StructConstructorSpec, StructFieldSpec, StructTypeInfo

DATACLASSES = ConstructorRegistry()
"""How tyro takes dataclasses apart."""


@DATACLASSES.struct_rule
def dataclass_fields(info: StructTypeInfo) -> StructConstructorSpec | None:
    """Fields of a dataclass, with their help; None for other types."""
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
                texts[options.name, field.target.id] = _docstring(below) or _comment(field, lines)
    return texts


def _docstring(statement: ast.stmt | None) -> str:
    if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
        return " ".join(str(statement.value.value).split())
    return ""


def _comment(field: ast.AnnAssign, lines: list[str]) -> str:
    behind = lines[(field.end_lineno or field.lineno) - 1].encode()[field.end_col_offset :].decode().strip()
    if behind:
        return behind.lstrip("# ")
    above, line = list[str](), field.lineno - 2
    while lines[line].lstrip().startswith("#"):
        above.insert(0, lines[line].strip("# "))
        line -= 1
    return " ".join(above)
