"""``vip-factors benchmark fuzz``."""

from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from importlib import import_module
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING

from vip_factors.cli.options import Flag
from vip_factors.cli.terminal import Tell

if TYPE_CHECKING:
    from tests.studies.fuzz.corpus import Commands


@dataclass(frozen=True)
class FuzzOptions:
    """Damage small files of every format, and live streams, thousands of times, and read them.

    Each must be read or refused in a sentence, within 10 s and 2 GB. What is not is kept, with the command that
    repeats it, one of each kind of exception and place in the code.
    """

    json: Path | None = None
    """Also write the counts and failures to this file, as JSON."""
    overwrite: Flag = False
    """Replace the JSON file if it exists."""
    mutations: int = 2000
    """How many."""
    seed: int = 0
    """Same seed, same mutations."""
    first: int = 0
    """Number of the first mutation: to repeat a single one, with --mutations 1."""
    out: Path = Path("failures")
    """Folder for files that failed; it is made when there are any."""
    formats: tuple[str, ...] = ()
    """Formats to damage; all if absent."""


def fuzz(options: FuzzOptions, tell: Tell) -> tuple[str, str]:
    """The table and the JSON; failures are in their folder."""
    from tests.studies.fuzz.corpus import all_cases
    from tests.studies.fuzz.run import chosen_cases, fuzz_json, fuzz_table, run_fuzz, save_failure
    from vip_factors.errors import InputError

    if options.mutations < 1 or options.first < 0:
        raise InputError(f"--mutations {options.mutations}, --first {options.first}: expected at least 1 and 0")
    tell("making files", 0.0)
    cases = chosen_cases(all_cases(commands()), options.formats)
    result = run_fuzz(
        cases, options.mutations, options.seed, options.first, tell, lambda one: save_failure(one, options.out)
    )
    if result.failures:
        print(f"{options.out}: files of {len(result.failures)} failures")
    return fuzz_table(result, cases), fuzz_json(result)


def commands() -> "Commands":
    """What the other commands do with what is read."""
    from tests.studies.fuzz.corpus import Commands
    from vip_factors.cli.info import file_text
    from vip_factors.cli.info_recording import motion_text, recording_text
    from vip_factors.cli.settings_file import flattened, read_settings
    from vip_factors.configurations import configured
    from vip_factors.settings import Settings

    def read(path: Path) -> Settings:
        return read_settings(path, Settings(), lambda name: configured(Settings(), name))

    lines = [f"{name} = {value}" for name, value in flattened(Settings()).items() if _is_number(value)]
    settings = "\n".join([*lines, ""])
    return Commands(file_text, recording_text, motion_text, read, settings, _run, _take_step)


def _run(command: str, words: Sequence[str]) -> None:
    """A command, without the lines that it prints."""
    module = import_module(f"vip_factors.cli.{command.replace('-', '_')}")
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
        module.main(f"vip-factors {command}", words)


def _take_step(folder: Path) -> None:
    """One that does nothing, as ``run`` takes it again."""
    from vip_factors.cli.run_steps import Step, take

    with redirect_stdout(StringIO()):
        take(Step("info", "info", (), (), ()), folder, main=lambda prog, words: None)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
