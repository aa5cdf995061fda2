"""The page about public recordings says what the command line takes."""

import re
import shlex
import tomllib
from pathlib import Path

import pytest

from vip_factors.cli.convert import ConvertOptions
from vip_factors.cli.options import parse
from vip_factors.io.placement_file import placement_from_file

PAGE = (Path(__file__).parents[2] / "docs" / "converting.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(\w*)\n(.*?)^```$", PAGE, flags=re.MULTILINE | re.DOTALL)
COMMANDS = [
    line for kind, text in BLOCKS if kind == "bash" for line in text.replace("\\\n", " ").splitlines() if line.strip()
]


@pytest.mark.parametrize("command", [one for one in COMMANDS if one.startswith("vip-factors convert")])
def test_commands_are_understood(command: str) -> None:
    options = parse(ConvertOptions, "vip-factors convert", shlex.split(command)[2:])
    assert (options.out is None) == (options.template is not None)


def test_placements_are_placements(tmp_path: Path) -> None:
    placements = [text for kind, text in BLOCKS if kind == "toml"]
    assert len(placements) == 2
    for text in placements:
        path = tmp_path / "placement.toml"
        path.write_text(text)
        assert set(placement_from_file(path).sensors) == set(tomllib.loads(text)["sensors"])
