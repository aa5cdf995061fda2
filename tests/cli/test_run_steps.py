"""Steps are taken once, again when something has changed, and say which of them failed."""

from collections.abc import Sequence
from pathlib import Path

import pytest

from vip_factors.cli.run_steps import Step, take
from vip_factors.errors import InputError


class Command:
    """Copies its first word's file to its second's, and tells."""

    def __init__(self) -> None:
        self.taken: list[list[str]] = []

    def __call__(self, prog: str, words: Sequence[str]) -> None:
        self.taken.append(list(words))
        Path(words[1]).write_text(Path(words[0]).read_text())
        print(f"note: copied by {prog}")
        print(words[1])


@pytest.fixture
def step(tmp_path: Path) -> Step:
    (tmp_path / "a").write_text("a")
    return Step("copy", "copy", (str(tmp_path / "a"), str(tmp_path / "b")), (tmp_path / "a",), (tmp_path / "b",))


def again(step: Step, **changes: object) -> Step:
    return Step(**{**vars(step), **changes})  # type: ignore[arg-type]


def test_what_is_there_is_used_again(step: Step, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command, folder = Command(), tmp_path / "steps"
    assert take(step, folder, main=command)
    told = capsys.readouterr().out
    assert told.startswith("copy ")
    assert f" s  {tmp_path / 'b'}\n  note: copied by vip-factors copy\n" in told
    assert not take(step, folder, main=command)
    assert "as before" in (told := capsys.readouterr().out)
    assert "note: copied" in told
    assert len(command.taken) == 1
    assert "--overwrite" not in command.taken[0]


@pytest.mark.parametrize("change", ["input", "option", "output", "record"])
def test_a_change_has_it_taken_again(step: Step, tmp_path: Path, change: str) -> None:
    command, folder = Command(), tmp_path / "steps"
    take(step, folder, main=command)
    if change == "input":
        (tmp_path / "a").write_text("longer")
    elif change == "option":
        step = again(step, words=(*step.words, "--more"))
    elif change == "output":
        (tmp_path / "b").unlink()
    else:
        (folder / "copy.json").write_text("{")
    assert take(step, folder, main=command)
    assert ("--overwrite" in command.taken[1]) == (change != "record")  # then nobody knows whose the file is
    assert not take(step, folder, main=command)


def test_a_file_in_a_folder_or_of_a_common_name_counts(step: Step, tmp_path: Path) -> None:
    command, folder = Command(), tmp_path / "steps"
    (tmp_path / "log").mkdir()
    for path in (tmp_path / "log", tmp_path / "log" / "walk-1", tmp_path / "Calib.toml:cam_01"):
        one = again(step, name=path.name, inputs=(path,))
        (tmp_path / "log" / "walk-1_0.txt").write_text("0")
        (tmp_path / "Calib.toml").write_text("0")
        take(one, folder, main=command)
        assert not take(one, folder, main=command)
        (tmp_path / "log" / "walk-1_0.txt").write_text("more")
        (tmp_path / "Calib.toml").write_text("more")
        assert take(one, folder, main=command)


def test_files_that_are_printed_count_where_none_is_named(step: Step, tmp_path: Path) -> None:
    command, folder = Command(), tmp_path / "steps"
    step = again(step, outputs=())
    take(step, folder, main=command)
    assert not take(step, folder, main=command)
    (tmp_path / "b").unlink()
    assert take(step, folder, main=command)


def test_an_error_names_the_step_and_what_to_do(step: Step, tmp_path: Path) -> None:
    def failing(prog: str, words: Sequence[str]) -> None:
        raise InputError("a: no such thing")

    with pytest.raises(InputError, match="step copy: a: no such thing; turn it round"):
        take(again(step, hint="turn it round"), tmp_path / "steps", main=failing)
    (tmp_path / "a").unlink()
    with pytest.raises(InputError, match=r"step copy: .*a: No such file"):
        take(again(step, inputs=()), tmp_path / "steps", main=Command())
    with pytest.raises(InputError, match="step simulate: expected options that it knows"):
        take(again(step, name="simulate", command="simulate", words=("--no-such",), inputs=()), tmp_path / "steps")
    assert not (tmp_path / "steps").exists()


@pytest.mark.parametrize("record", ["[" * 100_000, '{"command": "c", "outputs": 1, "told": []}', "[]", "", '"outputs"'])
def test_a_damaged_record_is_none(step: Step, tmp_path: Path, record: str) -> None:
    command, folder = Command(), tmp_path / "steps"
    take(step, folder, main=command)
    (folder / "copy.json").write_text(record)
    assert take(step, folder, main=command)
