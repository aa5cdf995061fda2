"""The page about videos says what the command line takes."""

import re
import shlex
from pathlib import Path

import pytest

from vip_factors.cli.convert import ConvertOptions
from vip_factors.cli.detect import DetectOptions
from vip_factors.cli.options import parse
from vip_factors.cli.report import ReportOptions
from vip_factors.cli.run import RunOptions

PAGE = (Path(__file__).parents[2] / "docs" / "video.md").read_text(encoding="utf-8")
OPTIONS = {"convert": ConvertOptions, "detect": DetectOptions, "report": ReportOptions, "run": RunOptions}
COMMANDS = [
    line
    for text in re.findall(r"^```bash\n(.*?)^```$", PAGE, flags=re.MULTILINE | re.DOTALL)
    for line in text.splitlines()
    if line.startswith("vip-factors")
]


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_are_understood(command: str) -> None:
    _, name, *words = shlex.split(command)
    parse(OPTIONS[name], f"vip-factors {name}", words)


def test_every_command_is_shown() -> None:
    assert {command.split()[1] for command in COMMANDS} == set(OPTIONS)


@pytest.mark.parametrize("option", re.findall(r"`(--[a-z-]+)=", PAGE))
def test_options_that_are_passed_on_exist(option: str) -> None:
    assert option.removeprefix("--").replace("-", "_") in RunOptions.__dataclass_fields__
