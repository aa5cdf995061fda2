"""Regenerate ``vip_factors/io/schemas`` from the .proto files beside this script.

It needs grpcio-tools (extra ``dev``).

Generated modules run with the protobuf they were made for and later ones, so only the oldest grpcio-tools that
pyproject.toml allows writes them: ``pip install . grpcio-tools==1.66.2`` in an environment of its own.
"""

import re
import sys
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path

from grpc_tools import protoc

SCHEMAS = Path(__file__).parent
OLDEST_TOOLS = "1.66.2"
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


if __name__ == "__main__":
    tools = version("grpcio-tools")
    if tools == OLDEST_TOOLS:
        generate(TARGET)
    else:
        print(f"grpcio-tools is {tools}: the schema modules stay as they are; {OLDEST_TOOLS} alone writes them")
