"""Imports go one way: a room sees only the rooms in rows above it, and third parties stay in their rooms."""

import ast
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "vip_factors"

ROWS = [
    {"errors", "ranges", "geometry", "atomic", "display", "tables", "findings", "compiled"},
    {"factor_settings"},
    {"settings"},
    {"body", "solve"},
    {"sensors"},
    {"estimate"},
    {"estimate_chunks", "live_estimate", "describe", "evaluate"},
    {"simulate", "associate", "initialise", "io", "viz"},
    {"problem", "detect", "gait", "repetitions"},
    {"terms"},
    {"assembly"},
    {"factor_graph"},
    {"stages"},
    {"pipeline", "live", "report"},
    {"api"},
    {"workflow"},
    {"cli"},
    {"__main__"},
]
ROW_OF = {room: row for row, rooms in enumerate(ROWS) for room in rooms}
# Within row 0, all may raise the package's errors, and rotations are compiled.
NEIGHBOURS = {("geometry", "errors"), ("geometry", "compiled"), ("ranges", "errors"), ("atomic", "errors")}
# Rooms that know the types of one above them, and import nothing of it at run time.
TYPES_ONLY = {("problem", "gtsam")}
# Rooms that open files and sockets: the functions, the commands, and the trades that read videos and write pages.
OPENERS = {"io", "api", "workflow", "cli", "detect", "report"}
# Third parties that only some rooms may see.
FENCED = {
    "gtsam": {"factor_graph"},
    "ezc3d": {"io"},
    "mcap": {"io"},
    "mcap_protobuf": {"io"},
    "lz4": {"io"},
    "zstandard": {"io"},
    "google": {"io"},
    "rerun": {"viz"},
    "matplotlib": {"viz"},
    "websockets": {"io"},
    "pygltflib": {"io"},
    "pythonosc": {"io"},
    "av": {"viz"},
    "cv2": {"associate", "detect", "initialise", "io", "viz", "sensors"},
    "ai_edge_litert": {"detect"},
    "onnxruntime": {"detect"},
    "vqf": {"sensors"},
    "jinja2": {"report"},
    "markupsafe": {"report"},
    "tyro": {"cli"},
    "rich": {"cli"},
    "distributed": {"cli"},
    "upath": {"cli"},
}


def room_of(path: Path) -> str:
    parts = path.relative_to(PACKAGE).parts
    return parts[0].removesuffix(".py")


@cache
def imports_of(path: Path) -> list[tuple[str, bool]]:
    """Names that a file imports, each with whether it is for type checkers alone."""
    tree, found = ast.parse(path.read_text(encoding="utf-8")), list[tuple[str, bool]]()
    nodes = list(ast.walk(tree))
    guards = [node for node in nodes if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"]
    of_types = {id(node) for guard in guards for node in ast.walk(guard)}
    for node in nodes:
        if isinstance(node, ast.Import):
            found += [(alias.name, id(node) in of_types) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import; write the whole name"
            found += [(f"{node.module}.{alias.name}", id(node) in of_types) for alias in node.names]
    return found


FILES = [
    path
    for path in sorted(PACKAGE.rglob("*.py"))
    if path != PACKAGE / "__init__.py" and not path.name.endswith("_pb2.py")
]


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_go_one_way(path: Path) -> None:
    room = room_of(path)
    assert room in ROW_OF, f"{path}: room '{room}' has no row in the table"
    for name, is_type in imports_of(path):
        package, _, rest = name.partition(".")
        if package != "vip_factors":
            rooms = FENCED.get(package, {room})
            allowed = room in rooms or (is_type and (room, package) in TYPES_ONLY)
            assert allowed, f"{path}: {package} may be imported in {sorted(rooms)} only"
            continue
        target = rest.split(".")[0]
        if target in ("__version__", room):
            continue
        assert target != "io" or room in OPENERS, f"{path}: {room} may not open files"
        above = ROW_OF[target] < ROW_OF[room]
        allowed_type = is_type and (room, target) in TYPES_ONLY
        assert above or allowed_type or (room, target) in NEIGHBOURS, f"{path}: {room} may not import {target}"


def test_no_modules_import_each_other() -> None:
    names = {".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts): path for path in FILES}
    imports = {
        name: {
            imported if imported in names else imported.rpartition(".")[0]
            for imported, is_type in imports_of(path)
            if not is_type
        }
        for name, path in names.items()
    }
    TopologicalSorter({name: imported & {*names} for name, imported in imports.items()}).prepare()  # raises CycleError


def test_every_room_is_in_the_table() -> None:
    rooms = {path.name.removesuffix(".py") for path in PACKAGE.iterdir() if path.suffix == ".py" or path.is_dir()}
    assert rooms - {"__init__", "__pycache__", "py.typed", "data"} <= set(ROW_OF)


def test_studies_may_use_tests_but_tests_no_studies() -> None:
    tests, studies = Path(__file__).parent, Path(__file__).parent / "studies"
    for path in (path for path in tests.rglob("*.py") if not path.is_relative_to(studies)):
        found = [name for name, *_ in imports_of(path) if name.startswith("tests.studies")]
        assert not found, f"{path}: imports {found}"
