"""Help is short, quick because it imports little, and says what the settings really are; shells complete it."""

import shutil
import subprocess
import sys
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import pytest

from vip_factors.cli import main as program
from vip_factors.cli.main import COMMANDS
from vip_factors.initialise.clock import ClockSettings
from vip_factors.live.settings import LiveSettings
from vip_factors.settings import Settings
from vip_factors.shown_settings import ShownClock, ShownOfBoth, ShownSettings

HEAVY = ("gtsam", "scipy", "cv2", "rerun", "mcap", "google.protobuf", "numpy")
MOST_LINES, COLUMNS = 20, 80  # a screen


def test_help_imports_nothing_heavy() -> None:
    program = (
        "import sys\nfrom vip_factors.cli.main import COMMANDS, main\n"
        "for command in COMMANDS:\n"
        "    assert main([command, '--help']) == 0\n"
        f"    heavy = [name for name in {HEAVY} if name in sys.modules]\n"
        "    assert not heavy, (command, heavy)\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("command", COMMANDS)
def test_short_help_fits_a_screen_and_names_the_way_to_all_of_it(run, command: str) -> None:
    short, full = run(command, "--help"), run(command, "--help-all")
    assert short.code == full.code == 0
    lines = short.out.splitlines()
    assert lines[0].startswith(f"usage: vip-factors {command} [OPTIONS]")
    assert lines[-1] == f"All options: vip-factors {command} --help-all"
    assert len(lines) <= MOST_LINES
    assert max(map(len, lines)) <= COLUMNS
    options = {word.strip(",") for line in lines[:-1] for word in line.split() if line.lstrip().startswith("-")}
    assert {word for word in options if word.startswith("-")} <= {word.strip(",") for word in full.out.split()}


def test_help_of_the_program_fits_a_screen_and_names_every_command(run) -> None:
    short, full = run("--help").out, run("--help-all").out.splitlines()
    assert len(short.splitlines()) <= MOST_LINES
    assert max(map(len, [*short.splitlines(), *full])) <= COLUMNS
    assert {*COMMANDS} <= {word.strip(",") for word in short.split()}
    assert {*COMMANDS} <= {line.split()[0] for line in full if line}


@pytest.mark.parametrize(
    ("shown", "tree"), [(ShownSettings, Settings), (ShownOfBoth, LiveSettings), (ShownClock, ClockSettings)]
)
def test_settings_told_by_short_help_are_those_of_the_tree(shown: type, tree: type) -> None:
    """They are declared once, in a class that the tree's inherits; a stream's defaults differ, in both alike."""
    _same(shown(), tree(), "")


def _same(shown: Any, tree: Any, above: str) -> None:
    assert isinstance(tree, type(shown))
    for one in fields(shown):
        told, real = getattr(shown, one.name), getattr(tree, one.name)
        if is_dataclass(told):
            _same(told, real, f"{above}{one.name}.")
        else:
            assert told == real, f"{above}{one.name}"
            assert type(told) is type(real)


@pytest.fixture(scope="module")
def bash(tmp_path_factory: pytest.TempPathFactory) -> Path:
    few = {name: COMMANDS[name] for name in ("smooth", "evaluate", "export")}
    script = tmp_path_factory.mktemp("completion") / "vip-factors.bash"
    script.write_text(program.completion("bash", "vip-factors", few), encoding="utf-8")
    return script


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["ev"], {"evaluate"}),
        (["e"], {"evaluate", "export"}),
        (["smooth", "--factors.orientation.s"], {"--factors.orientation.sigma-deg"}),
        (["smooth", "--windows.w"], {"--windows.window-s"}),  # the last group of help
        (["smooth", "a.mcap", "--fusion.no-use"], {"--fusion.no-use-camera"}),
        (["evaluate", "--t"], {"--truth"}),
        (["evaluate", "--frame"], set()),
        (["smooth", "wal"], set()),  # a file's name: left to the shell
        (["--completion", "z"], {"zsh"}),
    ],
)
def test_bash_completes(bash: Path, words: list[str], expected: set[str]) -> None:
    line = " ".join(f"'{word}'" for word in ["vip-factors", *words])
    program = f"source '{bash}'; COMP_WORDS=({line}); COMP_CWORD={len(words)}; _vip_factors; echo \"${{COMPREPLY[@]}}\""
    done = subprocess.run(["bash", "--norc", "-c", program], capture_output=True, text=True, check=True)
    assert set(done.stdout.split()) == expected


def test_other_shells_know_the_same_words(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(program, "command_options", lambda program, command: ["--help-all", "--truth"])
    fish = program.completion("fish", "vip-factors", {"evaluate": "it's a line"})
    assert "-n '__fish_seen_subcommand_from evaluate' -l truth" in fish
    assert "-a evaluate -d 'it\\'s a line'" in fish
    zsh = program.completion("zsh", "vip-factors", {"evaluate": "a line"})
    assert zsh.startswith("autoload -U +X bashcompinit")
    assert 'evaluate) words="--help-all --truth"' in zsh


def test_an_unknown_shell_is_refused(run) -> None:
    told = run("--completion", "tcsh")
    assert told.code == 2
    assert "bash, zsh, fish" in told.err
