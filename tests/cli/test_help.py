"""Help comes without what is slow to import, and says what the settings are; shells complete options."""

import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import fields, is_dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from vip_factors.cli.main import COMMANDS, main, options_of
from vip_factors.cli.options import UNPREFIXED, parse
from vip_factors.io.export.files import FORMATS

SLOW = ("numpy", "gtsam", "scipy", "cv2", "rerun", "mcap", "matplotlib")


def test_help_imports_nothing_slow() -> None:
    program = (
        "import sys\nfrom vip_factors.cli.main import COMMANDS, main\n"
        "assert main(['--help']) == 0\n"
        "for command in COMMANDS:\n"
        "    assert main([command, '--help']) == 0\n"
        f"    slow = [name for name in {SLOW} if name in sys.modules]\n"
        "    assert not slow, (command, slow)\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("command", ["smooth", "stream"])
def test_every_group_of_options_has_a_text_of_its_own(command: str, run) -> None:
    told = re.sub(r"[│╭╮╰╯─]", "", run(command, "--help").out)
    groups = re.findall(r"^ ([a-z.-]+) options *\n(.*?)\n *--", told, re.MULTILINE | re.DOTALL)
    texts = [" ".join(text.split()) for name, text in groups if not name.endswith(".loss")]
    assert len(texts) > 20
    assert [text for text, after in pairwise(texts) if text == after] == []


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("columns", [80, 100])
def test_no_line_of_help_breaks_off(command: str, columns: int, run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    lines = [line.strip("│ ") for line in run(command, "--help").out.splitlines()]
    assert len(lines) > 5
    assert [line for line in lines if line.endswith(("…", "..."))] == []


@pytest.mark.parametrize(
    ("command", "names"),
    [("export", [*FORMATS]), ("stream", [".mcap", "ws://:", "- -:", "--follow"])],
    ids=["export", "stream"],
)
def test_help_names_formats_and_sources_with_an_example(command: str, names: list[str], run) -> None:
    text = run(command, "--help").out.partition("╭")[0]
    assert [name for name in names if name not in text] == []
    example = re.search(rf"^Example: vip-factors {command} (.*)$", text, re.MULTILINE)
    assert example is not None
    parse(options_of(command), f"vip-factors {command}", shlex.split(example.group(1)))


def option_names(options: Any, prefix: str = "") -> set[str]:
    names = set[str]()
    for field in fields(options):
        value = getattr(options, field.name)
        marks = getattr(type(options).__annotations__.get(field.name), "__metadata__", ())
        if is_dataclass(value):
            names |= option_names(value, prefix if UNPREFIXED in marks else f"{prefix}{field.name}.")
        else:
            names.add(f"--{prefix}{field.name}".replace("_", "-"))
    return names


def test_every_setting_is_an_option_with_a_text_of_its_own(run) -> None:
    told = re.sub(r"[│╭╮╰╯─]", "", run("smooth", "--help").out)
    assert told.startswith("usage: vip-factors smooth ")
    names = option_names(options_of("smooth")(recording=()).settings)
    assert len(names) > 100
    assert names <= set(re.findall(r"--[a-z][a-z0-9.-]*", told))
    entries = re.split(r"\n\s*(?=--[a-z])", told)
    texts = [" ".join(entry.partition("\n")[2].partition("(default")[0].split()) for entry in entries]
    assert [text for text, after in pairwise(texts) if len(text) > 25 and text == after] == []


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_bash_completes_settings(tmp_path: Path) -> None:
    script = tmp_path / "vip-factors.bash"
    assert main(["--tyro-write-completion", "bash", str(script)]) == 0
    words = "COMP_WORDS=(vip-factors smooth --factors.orientation.s); COMP_CWORD=2"
    program = f"source '{script}'; {words}; _tyro_vip_factors; echo ${{COMPREPLY[@]}}"
    done = subprocess.run(["bash", "--norc", "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.split()[0] == "--factors.orientation.sigma-deg"
