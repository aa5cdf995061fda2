"""From logs, and a video, to files for others in one command; steps are taken again only when something changed."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from films import write_video

from vip_factors.cli import report
from vip_factors.cli.report import ReportOptions
from vip_factors.cli.run import RunOptions, Step, check, guess_camera, steps, take, usual_folder
from vip_factors.errors import InputError
from vip_factors.io.camera_file import read_camera_file

SMOOTH = "--frame-rate 20 --solve.max-iterations 2"


@pytest.fixture(autouse=True)
def reporting(monkeypatch: pytest.MonkeyPatch) -> None:
    """A report of one line."""

    def main(options: ReportOptions) -> None:
        assert options.out is not None
        options.out.write_text(f"{options.estimate} {options.recording} {options.video}")

    monkeypatch.setattr(report, "main", main)


def test_a_log_alone_to_files_and_a_page(run: Callable, files: object, tmp_path: Path) -> None:
    words = ["run", "--log", files.recording, "--out", tmp_path / "o", "--export", tmp_path / "walk.npz"]
    words += [f"--smooth-options={SMOOTH}"]
    told = run(*words)
    assert told.code == 0, told.err
    names = [line.split("  ")[0] for line in told.out.splitlines() if not line.startswith("  ")]
    assert names[:-1] == ["convert", "smooth", "report", "export walk.npz"]
    assert (tmp_path / "walk.npz").stat().st_size > 1000
    assert str(tmp_path / "o" / "recording.mcap") in (tmp_path / "o" / "report.html").read_text()

    told = run(*words)
    assert told.code == 0, told.err
    assert told.out.count("as before") == 4
    assert run(*words, "--fail-on", "care").code == 3  # by the estimate, which is as before
    assert run(*words, "--smooth-options=--fail-on care").code == 2

    (tmp_path / "other.npz").write_text("mine")
    told = run(*words, "--export", tmp_path / "other.npz")
    assert told.code == 2
    assert "step export other.npz: " in told.err
    assert "exists already" in told.err
    assert (tmp_path / "other.npz").read_text() == "mine"


def options(tmp_path: Path, **more: object) -> RunOptions:
    (tmp_path / "walk.mp4").write_bytes(b"")
    return RunOptions(log=(tmp_path / "xsens",), video=tmp_path / "walk.mp4", **more)  # type: ignore[arg-type]


def test_the_steps_of_one_wearer_with_a_video(tmp_path: Path) -> None:
    given = options(tmp_path, placement=("ada.toml",), export=(Path("walk.bvh"),), convert_options="--stature-m 1.7")
    found = list(steps(given, tmp_path / "o"))
    assert [one.name for one in found] == ["detect", "convert", "sync", "smooth", "report", "export walk.bvh"]
    _, convert, sync, smooth, report, export = found
    assert convert.words[:4] == (
        str(tmp_path / "xsens"),
        str(tmp_path / "o" / "recording.mcap"),
        "--placement",
        "ada.toml",
    )
    assert convert.words[4:6] == ("--stature-m", "1.7")
    assert ("--camera", str(tmp_path / "o" / "camera.toml")) == convert.words[-2:]
    assert convert.outputs == sync.inputs
    assert smooth.inputs == sync.outputs
    assert report.inputs[0] == export.inputs[0] == smooth.outputs[0]


def test_a_known_offset_and_found_poses_leave_steps_out(tmp_path: Path) -> None:
    given = options(tmp_path, time_offset_s=-1.5, detections=Path("poses.json"), camera=Path("c.toml"))
    convert, smooth, _ = steps(given, tmp_path)
    assert convert.words[-6:] == ("--detections", "poses.json", "--camera", "c.toml", "--time-offset-s", "-1.5")
    assert smooth.inputs == convert.outputs


def test_found_poses_need_no_video(tmp_path: Path) -> None:
    given = RunOptions((Path("xsens"),), detections=Path("poses.json"), camera=Path("c.toml"), video_rate=30.0)
    check(given)
    convert, sync, *_ = steps(given, tmp_path)
    assert convert.words[-6:] == ("--detections", "poses.json", "--camera", "c.toml", "--video-rate", "30.0")
    assert convert.inputs[1:] == (Path("poses.json"), Path("c.toml"))
    assert sync.name == "sync"


def test_the_steps_of_two_wearers(tmp_path: Path) -> None:
    given = options(tmp_path)
    given = RunOptions(log=(Path("a"), Path("b")), placement=("a.toml", "b.toml"), video=given.video)
    names = [one.name for one in steps(given, tmp_path)]
    assert names == ["detect", "convert wearer1", "convert wearer2", "convert", "sync", "smooth", "report"]
    convert = list(steps(given, tmp_path))[3]
    assert convert.words[:4] == (
        str(tmp_path / "wearer1.mcap"), str(tmp_path / "recording.mcap"), "--join", str(tmp_path / "wearer2.mcap"),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (RunOptions(), "no --log"),
        (RunOptions(log=(Path("a"), Path("b")), placement=("a.toml",)), "2 --log and 1 --placement"),
        (RunOptions(log=(Path("a"),), static_camera=True, time_offset_s=1.0), "--static-camera, --time-offset-s given"),
        (RunOptions(log=(Path("a"),), video=Path("no.mp4")), "no such video"),
        (RunOptions(log=(Path("a"),), detections=Path("d")), "give --camera"),
        (RunOptions(log=(Path("a"),), detections=Path("d"), camera=Path("c"), overlay=True), "--overlay given without"),
        (RunOptions(log=(Path("a"),), video=Path(__file__), detections=Path("d"), overlay=True), "--overlay"),
        (RunOptions(log=(Path("a"),), video=Path(__file__), field_of_view_deg=180.0), "between 0 and 180"),
    ],
)
def test_what_cannot_be_is_said_before_anything_is_done(given: RunOptions, words: str) -> None:
    with pytest.raises(InputError, match=words):
        check(given)


def test_a_failing_step_is_named(run: Callable, tmp_path: Path) -> None:
    told = run("run", "--log", tmp_path / "none", "--out", tmp_path / "o")
    assert told.code == 2
    assert "step convert: " in told.err
    assert "none" in told.err


def test_the_folder_is_beside_the_video(tmp_path: Path) -> None:
    assert usual_folder(options(tmp_path)) == tmp_path / "walk_motion"
    assert usual_folder(RunOptions(log=(tmp_path,))) == tmp_path.with_name(f"{tmp_path.name}_motion")


def test_a_guessed_camera(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    video, path = write_video(tmp_path / "a.mp4", np.zeros((1, 320, 240, 3), np.uint8)), tmp_path / "camera.toml"
    guess_camera(video, 90.0, path)
    model = read_camera_file(path)
    assert (model.width, model.height) == (240, 320)
    assert model.focal == (160.0, 160.0)  # half the longer side at 45 degrees
    assert model.centre == (120.0, 160.0)
    assert "no --camera is given" in capsys.readouterr().err
    stamp = path.stat().st_mtime_ns
    guess_camera(video, 90.0, path)
    assert path.stat().st_mtime_ns == stamp


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
