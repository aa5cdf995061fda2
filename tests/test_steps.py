"""Steps are taken again only when their inputs or parameters have changed, or their files are gone."""

from dataclasses import replace
from pathlib import Path

import pytest

from vip_factors.display import ProgressCallback
from vip_factors.errors import InputError
from vip_factors.workflow import Result, Step, take


class Copy:
    """Copies a file, and remembers each time whether it might have replaced one."""

    def __init__(self, source: Path, target: Path) -> None:
        self.source, self.target = source, target
        self.overwrites = list[bool]()

    def __call__(self, overwrite: bool, progress: ProgressCallback) -> Result:
        progress("copying", 0.5)
        self.overwrites.append(overwrite)
        self.target.write_text(self.source.read_text())
        return Result((self.target,), ("copied",))


@pytest.fixture
def copy(tmp_path: Path) -> Copy:
    (tmp_path / "a").write_text("a")
    return Copy(tmp_path / "a", tmp_path / "b")


@pytest.fixture
def step(copy: Copy) -> Step:
    return Step("copy", (copy.source,), "parameters", copy)


def test_files_that_are_there_are_used_again(step: Step, copy: Copy, tmp_path: Path) -> None:
    first, second = take(step, tmp_path / "steps"), take(step, tmp_path / "steps")
    assert first.seconds is not None
    assert second.seconds is None
    assert replace(first, seconds=None) == second == Result((copy.target,), ("copied",))
    assert copy.overwrites == [False]


@pytest.mark.parametrize("change", ["input", "parameters", "output", "record"])
def test_a_change_has_it_taken_again(step: Step, copy: Copy, tmp_path: Path, change: str) -> None:
    folder = tmp_path / "steps"
    take(step, folder)
    if change == "input":
        copy.source.write_text("longer")
    elif change == "parameters":
        step = replace(step, parameters="other")
    elif change == "output":
        copy.target.unlink()
    else:
        (folder / "copy.json").write_text("{")
    assert take(step, folder).seconds is not None
    assert copy.overwrites == [False, change != "record"]  # without a record nobody knows whose the file is
    assert take(step, folder).seconds is None


@pytest.mark.parametrize("record", ["[" * 100_000, '{"version": "1", "inputs": {}, "files": 1, "lines": []}', "[]", ""])
def test_a_damaged_record_is_none(step: Step, tmp_path: Path, record: str) -> None:
    take(step, tmp_path / "steps")
    (tmp_path / "steps" / "copy.json").write_text(record)
    assert take(step, tmp_path / "steps").seconds is not None


def test_a_file_in_a_folder_or_of_a_common_name_counts(step: Step, tmp_path: Path) -> None:
    (tmp_path / "log").mkdir()
    for path in (tmp_path / "log", tmp_path / "log" / "walk-1", tmp_path / "Calib.toml:cam_01"):
        of_path = replace(step, name=path.name, inputs=(path,))
        (tmp_path / "log" / "walk-1_0.txt").write_text("0")
        (tmp_path / "Calib.toml").write_text("0")
        take(of_path, tmp_path / "steps")
        assert take(of_path, tmp_path / "steps").seconds is None
        (tmp_path / "log" / "walk-1_0.txt").write_text("more")
        (tmp_path / "Calib.toml").write_text("more")
        assert take(of_path, tmp_path / "steps").seconds is not None


def test_an_error_names_the_step_and_what_to_do(step: Step, copy: Copy, tmp_path: Path) -> None:
    def failing(overwrite: bool, progress: ProgressCallback) -> Result:
        raise InputError("a: no such thing")

    with pytest.raises(InputError, match="step copy: a: no such thing; turn it round"):
        take(replace(step, make=failing, hint="turn it round"), tmp_path / "steps")
    copy.source.unlink()
    with pytest.raises(InputError, match=r"step copy: .*a: No such file"):
        take(step, tmp_path / "steps")
    assert not (tmp_path / "steps").exists()
