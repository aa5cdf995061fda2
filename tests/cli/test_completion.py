"""Shells complete commands and their options."""

import shutil
import subprocess
from pathlib import Path

import pytest

from vip_factors.cli import completion
from vip_factors.cli.main import COMMANDS


@pytest.fixture(scope="module")
def bash(tmp_path_factory: pytest.TempPathFactory) -> Path:
    few = {name: COMMANDS[name] for name in ("smooth", "evaluate", "export")}
    script = tmp_path_factory.mktemp("completion") / "vip-factors.bash"
    script.write_text(completion.completion("bash", "vip-factors", few), encoding="utf-8")
    return script


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["ev"], {"evaluate"}),
        (["e"], {"evaluate", "export"}),
        (["smooth", "--factors.orientation.s"], {"--factors.orientation.sigma-deg"}),
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
    monkeypatch.setattr(completion, "command_options", lambda program, command: ["--help-all", "--truth"])
    fish = completion.completion("fish", "vip-factors", {"evaluate": "it's a line"})
    assert "-n '__fish_seen_subcommand_from evaluate' -l truth" in fish
    assert "-a evaluate -d 'it\\'s a line'" in fish
    zsh = completion.completion("zsh", "vip-factors", {"evaluate": "a line"})
    assert zsh.startswith("autoload -U +X bashcompinit")
    assert 'evaluate) words="--help-all --truth"' in zsh


def test_an_unknown_shell_is_refused(run) -> None:
    told = run("--completion", "tcsh")
    assert told.code == 2
    assert "bash, zsh, fish" in told.err
