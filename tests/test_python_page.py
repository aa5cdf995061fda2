"""The page about Python runs as it stands, and names what there is."""

import re
from pathlib import Path

import pytest

import vip_factors as vip

PAGE = (Path(__file__).resolve().parent.parent / "docs" / "python.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```python\n(.*?)^```$", PAGE, flags=re.MULTILINE | re.DOTALL)
PROGRAM = PAGE.partition("<!-- program -->\n```python\n")[2].partition("```")[0]


def test_the_tables_name_every_name() -> None:
    tables = "\n".join(line for line in PAGE.splitlines() if line.startswith("|"))
    for name in vip.__all__:
        assert re.search(rf"\b{name}\b", tables), name


@pytest.mark.parametrize("number", range(len(BLOCKS)))
def test_the_examples_run(number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    quick = re.sub(r"seconds=\d(\.0)?", "seconds=1.2", BLOCKS[number])
    names: dict[str, object] = {}
    exec(compile(quick.replace("frame_rate=30.0", "frame_rate=20.0"), "docs/python.md", "exec"), names)
    made = {path.name for path in tmp_path.iterdir()}
    assert BLOCKS[number] != PROGRAM or made == {"angles.csv", "walk.bvh", "walk.html"}
    estimate = names.get("estimate")  # what newcomers run first is fit for use
    assert number > 1 or (isinstance(estimate, vip.Estimate) and estimate.verdict.severity != "doubt")
