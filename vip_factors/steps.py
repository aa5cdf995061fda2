"""Steps from files to files, each of which is taken again only when its inputs or parameters have changed."""

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import msgspec

from vip_factors import __version__
from vip_factors.display import ProgressCallback, silent
from vip_factors.errors import InputError, VipFactorsError


@dataclass(frozen=True)
class Result:
    """Files that a step made, and what there is to say about them, line by line."""

    files: tuple[Path, ...]
    lines: tuple[str, ...] = ()


@dataclass(frozen=True)
class Step:
    """One step, and the files that it reads.

    Attributes:
        name: unlike any other step's.
        inputs: files and folders that it reads.
        parameters: all else that its result depends on.
        make: writes its files, given whether they may be replaced and a callback for progress.
        hint: what a user can do if it fails.
    """

    name: str
    inputs: tuple[Path, ...]
    parameters: object
    make: Callable[[bool, ProgressCallback], Result]
    hint: str = ""


@dataclass(frozen=True)
class StepOutcome:
    """Result of a step, and the seconds that it took; None where the files of an earlier run were still right."""

    step: Step
    result: Result
    seconds: float | None


@dataclass(frozen=True)
class _Record:
    """What a step was made from, and what it made."""

    version: str
    parameters: str
    inputs: dict[str, tuple[int, int]]  # file → bytes, time of change in ns
    files: list[str]
    lines: list[str]


def take(step: Step, folder: Path, overwrite: bool = False, progress: ProgressCallback = silent) -> StepOutcome:
    """Take a step, unless its files are there, made with the same parameters from the same inputs.

    Args:
        step: to take.
        folder: for records of what was done.
        overwrite: whether files may be replaced that no step wrote.
        progress: called with what goes on and the fraction of it that is done.

    Raises:
        InputError: with the step's name, if it fails by what the user can mend.
    """
    path = folder / f"{step.name.replace(' ', '_')}.json"
    record = _read_record(path)
    if record is not None and _is_fresh(step, record):
        return StepOutcome(step, Result(tuple(map(Path, record.files)), tuple(record.lines)), None)
    begin = time.perf_counter()
    try:
        result = step.make(overwrite or record is not None, progress)
    except VipFactorsError as error:
        raise InputError(f"step {step.name}: {error}{f'; {step.hint}' if step.hint else ''}") from error
    except OSError as error:
        raise InputError(f"step {step.name}: {error.filename or step.name}: {error.strerror or error}") from error
    record = _Record(
        __version__, repr(step.parameters), _stamps(step.inputs), list(map(str, result.files)), list(result.lines)
    )
    folder.mkdir(parents=True, exist_ok=True)
    path.write_bytes(msgspec.json.format(msgspec.json.encode(record)) + b"\n")
    return StepOutcome(step, result, time.perf_counter() - begin)


def _read_record(path: Path) -> _Record | None:
    """What was written of a step before; None if it was never taken, or the file is none of ours."""
    try:
        return msgspec.json.decode(path.read_bytes(), type=_Record)
    except (OSError, ValueError, RecursionError):  # the last of brackets in brackets
        return None


def _is_fresh(step: Step, record: _Record) -> bool:
    made_alike = record.version == __version__ and record.parameters == repr(step.parameters)
    return made_alike and record.inputs == _stamps(step.inputs) and all(Path(file).is_file() for file in record.files)


def _stamps(inputs: Iterable[Path]) -> dict[str, tuple[int, int]]:
    """Size and time of change of every file that a step reads."""
    statuses = {str(file): file.stat() for path in inputs for file in _files(path)}
    return {name: (status.st_size, status.st_mtime_ns) for name, status in statuses.items()}


def _files(path: Path) -> list[Path]:
    """A file; those in a folder; those whose names begin so; without a camera's name behind a colon."""
    if path.is_file():
        return [path]
    if path.is_dir():
        return sorted(file for file in path.rglob("*") if file.is_file())
    if ":" in path.name:
        return _files(path.with_name(path.name.rpartition(":")[0]))
    return sorted(file for file in path.parent.glob(f"{path.name}*") if file.is_file()) if path.parent.is_dir() else []
