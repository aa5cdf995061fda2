"""From logs, and a video, to files for others in one command; steps are taken again only when something changed."""

from collections.abc import Callable
from pathlib import Path

import pytest

from vip_factors.cli.smooth import RunOptions, run_options, usual_folder
from vip_factors.errors import InputError
from vip_factors.workflow import check, steps

LOG = (Path("a"),)
SMOOTH = "--frame-rate 20 --solve.max-iterations 2"


def test_a_log_alone_to_files_and_a_page(run: Callable, files: object, tmp_path: Path) -> None:
    words = ["run", "--log", files.recording, "--out", tmp_path / "o", "--export", tmp_path / "walk.npz"]
    words += [f"--smooth-options={SMOOTH}"]
    told = run(*words)
    assert told.code == 0, told.err
    names = [line.split("  ")[0] for line in told.out.splitlines() if not line.startswith("  ")]
    assert names[:-1] == ["convert", "smooth", "report", "export walk.npz"]
    assert (tmp_path / "walk.npz").stat().st_size > 1000
    assert "<html" in (tmp_path / "o" / "report.html").read_text()
    assert "verdict: " in told.out

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
    return RunOptions(log=(tmp_path / "xsens",), video=(tmp_path / "walk.mp4",), out=tmp_path / "o", **more)  # type: ignore[arg-type]


def test_the_steps_of_one_wearer_with_a_video(tmp_path: Path) -> None:
    given = options(tmp_path, placement=("ada.toml",), export=(Path("walk.bvh"),), convert_options="--stature-m 1.7")
    made = run_options(given)
    check(made)
    ((_, known),) = made.logs
    assert (known.placement, known.stature_m) == ("ada.toml", 1.7)
    (camera,) = made.cameras
    assert camera.camera is None
    names = [step.name for step in steps(made)]
    assert names == ["detect", "convert", "sync", "smooth", "report", "export walk.bvh"]
    inputs = {step.name: step.inputs for step in steps(made)}
    assert set(inputs["convert"]) >= {tmp_path / "xsens", Path("ada.toml"), tmp_path / "o" / "poses.json"}
    assert inputs["smooth"] == (tmp_path / "o" / "synced.mcap",)


def test_found_poses_need_no_video() -> None:
    given = RunOptions((Path("xsens"),), detections=(Path("poses.json"),), camera=(Path("c.toml"),), video_rate=(30.0,))
    made = run_options(given)
    check(made)
    (camera,) = made.cameras
    assert camera.video_rate == 30.0
    assert [step.name for step in steps(made)] == ["convert", "sync", "smooth", "report"]


def test_the_steps_of_two_videos(tmp_path: Path) -> None:
    for name in ("left.mp4", "right.mov"):
        (tmp_path / name).write_bytes(b"")
    videos = (tmp_path / "left.mp4", tmp_path / "right.mov")
    made = run_options(RunOptions(log=(tmp_path / "xsens",), video=videos, out=tmp_path / "o", overlay=True))
    check(made)
    assert [camera.camera_name for camera in made.cameras] == ["left", "right"]
    assert [camera.video for camera in made.cameras] == list(videos)
    names = [step.name for step in steps(made)]
    assert names == ["detect left", "detect right", "convert", "sync", "smooth", "report"]
    inputs = {step.name: step.inputs for step in steps(made)}
    assert set(inputs["convert"]) >= {tmp_path / "o" / "poses-1.json", tmp_path / "o" / "poses-2.json", *videos}


def test_the_steps_of_two_wearers(tmp_path: Path) -> None:
    given = options(tmp_path)
    given = RunOptions(log=(Path("a"), Path("b")), placement=("a.toml", "b.toml"), video=given.video, out=given.out)
    names = [step.name for step in steps(run_options(given))]
    assert names == ["detect", "convert wearer1", "convert wearer2", "convert", "sync", "smooth", "report"]


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (RunOptions(), "no --log"),
        (RunOptions(log=(Path("a"), Path("b")), placement=("a.toml",)), "2 --log and 1 --placement"),
        (
            RunOptions(log=(Path("a"),), static_camera=True, time_offset_s=(1.0,)),
            "--static-camera, --time-offset-s given",
        ),
        (RunOptions(log=(Path("a"),), video=(Path("no.mp4"),)), "no such video"),
        (
            RunOptions(log=(Path("a"),), detections=(Path("d"),), camera=(Path("c"),), overlay=True),
            "--overlay given without",
        ),
        (RunOptions(log=(Path("a"),), video=(Path(__file__),), detections=(Path("d"),), overlay=True), "--overlay"),
    ],
)
def test_what_cannot_be_is_said_before_anything_is_done(given: RunOptions, words: str) -> None:
    with pytest.raises(InputError, match=words):
        check(run_options(given))


def test_the_folder_is_beside_the_video(tmp_path: Path) -> None:
    (tmp_path / "walk.mp4").touch()
    assert usual_folder(RunOptions((tmp_path,), video=(tmp_path / "walk.mp4",))) == tmp_path / "walk_motion"
    assert usual_folder(RunOptions(log=(tmp_path,))) == tmp_path.with_name(f"{tmp_path.name}_motion")
