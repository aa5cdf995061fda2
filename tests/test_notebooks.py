"""The notebooks run from top to bottom, and so does the Python of the documentation."""

import ast
import importlib
import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PAGES = ("docs/reference/index.md", "docs/graph.md", "docs/live.md")
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
LONG = ("camera_and_drift", "factor_graph")  # half a minute each; what they import is looked up all the same


def code_cells(notebook: Path) -> list[str]:
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    return ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]


@pytest.mark.parametrize(
    "notebook",
    [pytest.param(path, id=path.stem, marks=pytest.mark.slow if path.stem in LONG else ()) for path in NOTEBOOKS],
)
def test_notebook_runs(notebook: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("matplotlib", reason="needs the extra dev or notebook")
    monkeypatch.setenv("MPLBACKEND", "agg")
    namespace: dict[str, object] = {"__name__": "__main__"}
    for number, source in enumerate(code_cells(notebook)):
        exec(compile(source, f"{notebook.name}, code cell {number}", "exec"), namespace)


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_what_a_notebook_imports_is_there(notebook: Path) -> None:
    found = [node for source in code_cells(notebook) for node in ast.walk(ast.parse(source))]
    imports = [node for node in found if isinstance(node, ast.ImportFrom) and node.module]
    ours = [node for node in imports if str(node.module).startswith("vip_factors")]
    assert ours
    for node in ours:
        module = importlib.import_module(str(node.module))
        for name in node.names:
            assert hasattr(module, name.name), f"{notebook.name}: {node.module} has no {name.name}"


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_is_kept_without_outputs(notebook: Path) -> None:
    for cell in json.loads(notebook.read_text(encoding="utf-8"))["cells"]:
        assert not cell.get("outputs"), f"{notebook.name}: clear the outputs before committing"


@pytest.mark.parametrize("page", PAGES)
def test_python_of_the_documentation_runs(page: str) -> None:
    blocks = re.findall(r"^```python\n(.*?)^```$", (ROOT / page).read_text("utf-8"), re.MULTILINE | re.DOTALL)
    assert blocks
    for number, source in enumerate(blocks):
        exec(compile(source, f"{page}, Python block {number}", "exec"), {"__name__": "__main__"})
