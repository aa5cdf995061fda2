"""Commands that build on one another's files: taken in turn, announced, and not taken again while nothing changed."""

import io
import json
import shlex
import time
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from vip_factors import __version__
from vip_factors.errors import InputError, VipFactorsError

Main = Callable[[str, Sequence[str]], None]


@dataclass(frozen=True)
class Step:
    """One command, and the files between which it stands.

    Attributes:
        name: as the user is told; unlike any other step's.
        command: of ``vip-factors``.
        words: its arguments.
        inputs: files and folders that it reads; a change of one makes it run again.
        outputs: files that it writes; those that it prints, if none are named.
        hint: what a user can do who is told that it failed.
        tells: whether all that it prints is shown, not its notes alone.
    """

    name: str
    command: str
    words: tuple[str, ...]
    inputs: tuple[Path, ...]
    outputs: tuple[Path, ...]
    hint: str = ""
    tells: bool = False

    @property
    def line(self) -> str:
        """The command as one would type it."""
        return shlex.join(["vip-factors", self.command, *self.words])


def take(step: Step, folder: Path, overwrite: bool = False, main: Main | None = None) -> bool:
    """Run a step unless its outputs are there, made by the same words from the same inputs; say in a line which.

    What the command prints is kept with the words in a file of ``folder``, of which notes are shown, or all of it.

    Args:
        step: to take.
        folder: for such files.
        overwrite: whether files may be replaced that no step wrote.
        main: of the command; that of its module if None.

    Returns:
        Whether it was run.

    Raises:
        InputError: with the step's name, if the command fails by what the user can mend.
    """
    record = folder / f"{step.name.replace(' ', '_')}.json"
    before = _read(record)
    if _is_fresh(step, before):
        _tell(step, before, "as before")
        return False
    began = time.perf_counter()
    told = _run(step, overwrite or bool(before), main)
    files = [str(path) for path in step.outputs] or [line for line in told if Path(line).is_file()]
    folder.mkdir(parents=True, exist_ok=True)
    now = {"command": step.line, "version": __version__, "inputs": _stamps(step), "outputs": files, "told": told}
    record.write_text(json.dumps(now, indent=1) + "\n", encoding="utf-8")
    _tell(step, now, f"{time.perf_counter() - began:.1f} s")
    return True


def _run(step: Step, overwrite: bool, main: Main | None) -> list[str]:
    """What the command prints, line by line."""
    if main is None:
        main = import_module(f"vip_factors.cli.{step.command.replace('-', '_')}").main
    printed = io.StringIO()
    hint = f"; {step.hint}" if step.hint else ""
    try:
        with redirect_stdout(printed):
            main(f"vip-factors {step.command}", [*step.words, *(["--overwrite"] if overwrite else [])])
    except VipFactorsError as error:
        raise InputError(f"step {step.name}: {error}{hint}") from error
    except OSError as error:
        raise InputError(f"step {step.name}: {error.filename or step.line}: {error.strerror or error}") from error
    except SystemExit as stop:  # the options were not understood, or help was asked for
        raise InputError(f"step {step.name}: expected options that it knows: {step.line}") from stop
    return printed.getvalue().splitlines()


def _tell(step: Step, record: dict[str, Any], when: str) -> None:
    print(f"{step.name:<16} {when:>9}  {'  '.join(record['outputs'])}", flush=True)
    for line in record["told"]:
        if line.startswith("note:") or (step.tells and line not in record["outputs"]):
            print(f"  {line}", flush=True)


def _read(record: Path) -> dict[str, Any]:
    """What was written of a step before; nothing if it was never taken, or the file is none of ours."""
    try:
        content = json.loads(record.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):  # of brackets within brackets
        return {}
    return content if isinstance(content, dict) and all(_are_words(content.get(one)) for one in WORDS) else {}


WORDS = ("outputs", "told")  # of a record


def _are_words(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(one, str) for one in value)


def _is_fresh(step: Step, before: dict[str, Any]) -> bool:
    same = before.get("command") == step.line and before.get("version") == __version__
    return same and before.get("inputs") == _stamps(step) and all(Path(path).is_file() for path in before["outputs"])


def _stamps(step: Step) -> dict[str, list[int]]:
    """Size and time of change of every file that a step reads."""
    return {str(file): _stamp(file) for path in step.inputs for file in _files(path)}


def _stamp(file: Path) -> list[int]:
    status = file.stat()
    return [status.st_size, status.st_mtime_ns]


def _files(path: Path) -> list[Path]:
    """A file; those in a folder; those whose names begin so; without a camera's name behind a colon."""
    if path.is_file():
        return [path]
    if path.is_dir():
        return sorted(one for one in path.rglob("*") if one.is_file())
    if ":" in path.name:
        return _files(path.with_name(path.name.rpartition(":")[0]))
    return sorted(one for one in path.parent.glob(f"{path.name}*") if one.is_file()) if path.parent.is_dir() else []
