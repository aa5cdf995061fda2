"""The page about Python runs as it stands, and names what there is."""

import re
from pathlib import Path

import vip_factors as vip

PAGE = (Path(__file__).resolve().parent.parent / "docs" / "python.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```python\n(.*?)^```$", PAGE, flags=re.MULTILINE | re.DOTALL)


def test_the_table_names_every_name() -> None:
    table = "\n".join(line for line in PAGE.splitlines() if line.startswith("|"))
    for name in vip.__all__:
        assert f"`{name}" in table, name


def test_the_examples_run(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    vip.write(vip.simulate(seconds=1.2, placement="sip6"), "walk.mcap")
    assert len(BLOCKS) == 3
    for block in BLOCKS:
        exec(compile(block.replace("seconds=2.0", "seconds=1.2"), "docs/python.md", "exec"), {})
    assert Path("walk.npz").is_file()
