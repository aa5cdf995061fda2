"""A tiny recording, written once by the command line itself, and a way to run it in this process."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from vip_factors.cli.main import main

SMALL = [
    "--frame-rate", "20", "--solve.max-iterations", "3", "--assignment.no-check", "--calibration.start.no-search",
]  # fmt: skip


@dataclass(frozen=True)
class Outcome:
    code: int
    out: str
    err: str


@dataclass(frozen=True)
class Files:
    recording: Path
    estimate: Path


def assert_one_sentence(told: Outcome, *words: str) -> None:
    """Refused in a line that holds the words."""
    assert told.code == 2
    assert told.err.startswith("vip-factors: ")
    assert told.err.count("\n") == 1
    assert "Traceback" not in told.err
    for word in words:
        assert word in told.err


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Callable[..., Outcome]:
    def run_command(*arguments: object) -> Outcome:
        capsys.readouterr()
        code = main([str(argument) for argument in arguments])
        told = capsys.readouterr()
        return Outcome(code, told.out, told.err)

    return run_command


@pytest.fixture(scope="session")
def files(tmp_path_factory: pytest.TempPathFactory) -> Files:
    """A recording of six sensors over five seconds, and its estimate after a few steps."""
    folder = tmp_path_factory.mktemp("cli")
    made = Files(folder / "walk.mcap", folder / "walk.estimate.mcap")
    simulate = ["simulate", "gestures", str(made.recording), "--seconds", "3", "--placement", "sip6"]
    assert main(simulate) == 0
    assert main(["smooth", str(made.recording), *SMALL]) == 0
    return made
