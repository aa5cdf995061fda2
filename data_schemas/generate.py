"""Regenerate what is made from declarations; needs grpcio-tools (extra ``dev``).

``vip_factors/io/schemas`` comes from the .proto files beside this script, ``live_answer.schema.json`` from the classes
in ``vip_factors/io/live_json.py``.

Generated modules run with the protobuf they were made for and later ones, so the oldest grpcio-tools that
pyproject.toml allows is the one to commit from: ``pip install grpcio-tools==1.66.2`` in an environment of its own.
"""

import json
import re
import sys
import types
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, NotRequired, Required, Union, get_args, get_origin, get_type_hints, is_typeddict

from grpc_tools import protoc

from vip_factors.io.live_json import Answer

SCHEMAS = Path(__file__).parent
TARGET = SCHEMAS.parent / "vip_factors" / "io" / "schemas"
# protoc derives Python imports from the schemas' folder; the modules live elsewhere in the package.
IMPORT = re.compile(r"^from vip_factors import (\w+_pb2)", re.MULTILINE)


def run_protoc(*arguments: str) -> None:
    """Run protoc on all schemas of this folder."""
    protos = sorted(str(path.relative_to(SCHEMAS)) for path in SCHEMAS.glob("vip_factors/*.proto"))
    well_known = str(files("grpc_tools") / "_proto")
    status = protoc.main(["protoc", f"-I{SCHEMAS}", f"-I{well_known}", *arguments, *protos])
    if status != 0:
        sys.exit(f"protoc failed with status {status}")


def generate(target: Path) -> None:
    """Write the modules and their type stubs into ``target``."""
    build = target / "build"
    build.mkdir(parents=True)
    run_protoc(f"--python_out={build}", f"--pyi_out={build}")
    for module in sorted((build / "vip_factors").iterdir()):
        text = module.read_text(encoding="utf-8")
        (target / module.name).write_text(IMPORT.sub(r"from vip_factors.io.schemas import \1", text), encoding="utf-8")
        module.unlink()
    (build / "vip_factors").rmdir()
    build.rmdir()


ANSWER_SCHEMA = SCHEMAS / "live_answer.schema.json"
JSON_TYPES = {float: "number", int: "integer", str: "string", bool: "boolean", type(None): "null"}


def answer_schema() -> str:
    """The JSON Schema of an answer of ``vip-factors stream``, as text."""
    classes: dict[str, Any] = {}
    schema = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "vip-factors stream: the answer to a frame",
    }
    schema |= schema_of(Answer, classes)
    return json.dumps(schema | {"$defs": classes}, indent=1, ensure_ascii=False) + "\n"


def schema_of(hint: Any, classes: dict[str, Any]) -> dict[str, Any]:
    """The schema of a type; those of the classes in it go into ``classes``, by name."""
    if get_origin(hint) is Annotated:
        inner, *notes = get_args(hint)
        schema = schema_of(inner, classes)
        for note in notes:
            schema |= noted(note, schema)
        return schema
    if get_origin(hint) in (NotRequired, Required):
        return schema_of(get_args(hint)[0], classes)
    if get_origin(hint) in (Union, types.UnionType):
        options = [schema_of(one, classes) for one in get_args(hint)]
        plain = all(set(one) == {"type"} for one in options)
        return {"type": [one["type"] for one in options]} if plain else {"anyOf": options}
    if get_origin(hint) is list:
        return {"type": "array", "items": schema_of(get_args(hint)[0], classes)}
    if get_origin(hint) is dict:
        return {"type": "object", "additionalProperties": schema_of(get_args(hint)[1], classes)}
    if is_typeddict(hint):
        if hint.__name__ not in classes:
            keys = get_type_hints(hint, include_extras=True)
            classes[hint.__name__] = {
                "type": "object",
                "description": hint.__doc__,
                "required": [name for name in keys if name in hint.__required_keys__],
                "properties": {name: schema_of(one, classes) for name, one in keys.items()},
            }
        return {"$ref": f"#/$defs/{hint.__name__}"}
    return {"type": JSON_TYPES[hint]}


def noted(note: Any, schema: dict[str, Any]) -> dict[str, Any]:
    """What a note in an annotation adds: words, a list's length, the values allowed, or an object's keys with words."""
    if isinstance(note, str):
        before = schema.get("description")
        return {"description": f"{note}: {before}" if before else note}
    if isinstance(note, int):
        return {"minItems": note, "maxItems": note}
    if isinstance(note, tuple):
        return {"enum": list(note)}
    value = schema["additionalProperties"]
    named = {name: value | {"description": words} for name, words in note.items()}
    return {"properties": named, "required": list(note), "additionalProperties": False}


if __name__ == "__main__":
    generate(TARGET)
    ANSWER_SCHEMA.write_text(answer_schema(), encoding="utf-8")
