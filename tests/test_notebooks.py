"""The notebooks run from top to bottom, and so does the Python of the documentation."""

import ast
import json
import re
import socket
import time
from pathlib import Path
from threading import Thread

import pytest
from live_sender import live_messages

import vip_factors as vip
from vip_factors.io.settings import LiveSourceSettings
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.scene import Scene
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording

ROOT = Path(__file__).resolve().parent.parent
PAGES = ("docs/reference/index.md", "docs/graph.md", "docs/live.md")
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
PYTHON = [
    page for page in (ROOT / "README.md", *(ROOT / "docs").rglob("*.md")) if "```python" in page.read_text("utf-8")
]
SECONDS = {"first_recording": 2.0, "live_stream": 3.0}  # as much as the cells need; others 4
LONG = ("camera_and_drift", "factor_graph", "two_phones")  # up to half a minute each


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
    for number, cell in enumerate(code_cells(notebook)):
        source = re.sub(r"seconds=[68]\.0", f"seconds={SECONDS.get(notebook.stem, 4.0)}", cell)
        exec(compile(source, f"{notebook.name}, code cell {number}", "exec"), namespace)


def python_of(path: Path) -> list[str]:
    if path.suffix == ".ipynb":
        return code_cells(path)
    return re.findall(r"^```python\n(.*?)^```$", path.read_text("utf-8"), re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("path", [*NOTEBOOKS, *PYTHON], ids=lambda path: path.stem)
def test_what_people_read_has_public_names_alone(path: Path) -> None:
    for node in (node for source in python_of(path) for node in ast.walk(ast.parse(source))):
        if isinstance(node, ast.Import):
            assert not [one.name for one in node.names if one.name.startswith("vip_factors.")], path.name
        elif isinstance(node, ast.ImportFrom):
            assert not str(node.module).startswith("vip_factors"), f"{path.name}: from {node.module}"
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "vip":
            assert node.attr in vip.__all__, f"{path.name}: vip.{node.attr}"


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_ships_with_its_outputs(notebook: Path) -> None:
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    outputs = [output for cell in cells for output in cell.get("outputs", ())]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    assert {output["output_type"] for output in outputs} <= {"stream", "display_data", "execute_result"}
    text = json.dumps([output.get("text", output.get("data", {}).get("text/plain")) for output in outputs])
    assert not re.search(r"/(home|tmp|root|Users)/", text), "run it where no path of a machine is printed"


@pytest.mark.parametrize("page", PAGES)
def test_python_of_the_documentation_runs(page: str) -> None:
    blocks = re.findall(r"^```python\n(.*?)^```$", (ROOT / page).read_text("utf-8"), re.MULTILINE | re.DOTALL)
    assert blocks
    for number, source in enumerate(blocks):
        if ":8080" not in source and ":5005" not in source:  # those need each other
            exec(compile(source, f"{page}, Python block {number}", "exec"), {"__name__": "__main__"})


def test_the_live_program_and_its_reader_run(capsys: pytest.CaptureFixture) -> None:
    connect = pytest.importorskip("websockets.sync.client", reason="needs the extra live").connect
    blocks = re.findall(
        r"^```python\n(.*?)^```$", (ROOT / "docs" / "live.md").read_text("utf-8"), re.MULTILINE | re.DOTALL
    )
    (program,), (reader,) = (
        [one for one in blocks if word in one] for word in ('"ws://:5005"', '"ws://127.0.0.1:8080')
    )
    with socket.create_server(("127.0.0.1", 0)) as one, socket.create_server(("127.0.0.1", 0)) as other:
        ports = [str(probe.getsockname()[1]) for probe in (one, other)]
    program = program.replace('"ws://:5005"', f'"ws://:{ports[0]}", settings=ONCE').replace("8080", ports[1])
    once = LiveSourceSettings(next_client_wait=0.0)

    def run(source: str) -> None:
        while True:
            try:
                exec(compile(source, "docs/live.md", "exec"), {"__name__": "__main__", "ONCE": once})
                return
            except ConnectionRefusedError:  # the page is not there yet
                time.sleep(0.05)

    def send() -> None:
        scene = Scene("short", (simulate_recording(gestures(1.3), preset("sip6", gestures(0.1).skeleton)),))
        while True:
            try:
                with connect(f"ws://127.0.0.1:{ports[0]}") as connection:
                    for message in live_messages(scene):
                        connection.send(message)
                return
            except ConnectionRefusedError:
                time.sleep(0.05)

    threads = [
        Thread(target=send, daemon=True),
        Thread(target=run, args=(reader.replace("8080", ports[1]),), daemon=True),
    ]
    for thread in threads:
        thread.start()
    run(program)
    for thread in threads:
        thread.join(20)
    told = capsys.readouterr().out
    assert "the live page is at http://127.0.0.1:" in told
    assert re.search(r"^\d\.\d+ \[-?\d", told, flags=re.MULTILINE), told
