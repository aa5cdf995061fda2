"""One command over many recordings: folders, globs and lists; what fails costs itself, what is there is kept."""

import csv
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from cli.conftest import SMALL

from vip_factors.cli import many, many_tasks, workers
from vip_factors.cli.main import main
from vip_factors.io.mcap_estimate import read_estimate, read_head


def rows(path: Path) -> dict[str, dict[str, str]]:
    with open(path, newline="", encoding="utf-8") as file:
        return {Path(row["input"]).name: row for row in csv.DictReader(file)}


@pytest.fixture
def folder(files, tmp_path: Path) -> Path:
    """Two recordings, one of them below, and one that is cut off."""
    (tmp_path / "in" / "monday").mkdir(parents=True)
    shutil.copy(files.recording, tmp_path / "in" / "a.mcap")
    shutil.copy(files.recording, tmp_path / "in" / "monday" / "b.mcap")
    (tmp_path / "in" / "broken.mcap").write_bytes(files.recording.read_bytes()[:3000])
    return tmp_path / "in"


def test_a_broken_file_costs_itself_and_a_second_run_keeps_what_is_there(run, files, folder: Path) -> None:
    told = run("smooth", folder, "--jobs", 2, *SMALL)
    assert told.code == 2  # the broken file's
    assert "2 done, 0 there already, 1 failed" in told.out
    found = rows(folder / "smooth.summary.csv")
    assert {name: row["state"] for name, row in found.items()} == {
        "a.mcap": "done", "b.mcap": "done", "broken.mcap": "failed"
    }  # fmt: skip
    alone = read_estimate(files.estimate)
    assert found["a.mcap"]["verdict"] == str(alone.verdict)
    assert int(found["a.mcap"]["frames"]) == len(alone.only_wearer.motion)
    assert "recording" in found["broken.mcap"]["error"]
    page = (folder / "smooth.summary.html").read_text(encoding="utf-8")
    assert page.index("broken.mcap") < page.index("a.mcap"), "the worst first"
    made = folder / "monday" / "b.estimate.mcap"
    before = made.stat().st_mtime_ns
    again = run("smooth", folder, "--jobs", 2, *SMALL)
    assert "0 done, 2 there already, 1 failed" in again.out
    assert made.stat().st_mtime_ns == before
    assert rows(folder / "smooth.summary.csv")["b.mcap"]["verdict"] == found["b.mcap"]["verdict"]

    # What a folder of estimates is good for: each finds the recording beside it.
    told = run("evaluate", folder / "monday", "--out", folder / "figures")
    assert told.code == 0, told.err
    assert (folder / "figures" / "b.estimate.json").is_file()
    assert rows(folder / "figures" / "evaluate.summary.csv")["b.estimate.mcap"]["evaluation"].startswith("positions")
    told = run("export", folder / "monday", ".bvh", ".npz")
    assert told.code == 0, told.err
    assert {path.suffix for path in (folder / "monday").glob("b.estimate.*")} == {".mcap", ".bvh", ".npz"}


def test_a_head_tells_what_the_whole_does(files) -> None:
    head, frames = read_head(files.estimate)
    whole = read_estimate(files.estimate)
    assert head.verdict == whole.verdict
    assert frames == len(whole.only_wearer.motion)
    assert len(head.only_wearer.motion) == 0


def tasks(command: str, *words: object) -> list[many_tasks.Task]:
    texts = [str(word) for word in words]
    given = many_tasks.leading(texts)
    return list(many_tasks.tasks_of(command, "vip-factors", given, many_tasks.RunOptions(), texts[len(given) :]))


def test_globs_and_lists_name_recordings_and_no_estimates(folder: Path, files) -> None:
    shutil.copy(files.estimate, folder / "a.estimate.mcap")
    names = folder / "list.txt"
    names.write_text(f"# of Monday\n{folder}/a.mcap\n\n{folder}/monday\n", encoding="utf-8")
    assert [Path(one.source).name for one in tasks("smooth", f"@{names}")] == ["a.mcap", "b.mcap"]
    assert [Path(one.source).name for one in tasks("smooth", f"{folder}/**/*.mcap")] == [
        "a.mcap", "broken.mcap", "b.mcap"
    ]  # fmt: skip
    (one,) = tasks("report", f"{folder}/*.mcap")
    assert one.companion == str(folder / "a.mcap")
    for words in (["--recording", folder], [f"--recording={folder}"]):
        (one,) = tasks("report", f"{folder}/*.mcap", *words)
        assert (one.companion, one.words) == (str(folder / "a.mcap"), ())
    (one,) = tasks("report", f"{folder}/*.mcap", f"--recording={folder}/monday/b.mcap")
    assert (one.companion, len(one.words)) == ("", 1)
    (one,) = tasks("stream", folder / "monday", "--lag", 1)
    assert one.outputs == (str(folder / "monday" / "b.live.estimate.mcap"),)
    assert one.words == ("--lag", "1")


@pytest.mark.parametrize(
    ("words", "is_many"),
    [
        ("smooth a.mcap b.mcap --frame-rate 20", False),
        ("smooth a.mcap --jobs 4", False),  # its windows
        ("smooth a.mcap b.mcap --summary all.csv", True),
        ("smooth *.mcap", True),
        ("smooth @list.txt", True),
        ("smooth s3://bucket/a.mcap", True),
        ("smooth a.mcap --out s3://bucket/estimates", True),
        ("report a.estimate.mcap --jobs 2", True),
        ("stream ws://:5555", False),
        ("export a.estimate.mcap a.bvh", False),
        ("info *.mcap", False),
        ("smooth * --help", False),
    ],
)
def test_one_recording_is_not_many(words: str, is_many: bool) -> None:
    command, *rest = words.split()
    assert many_tasks.is_many(command, rest) == is_many


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("smooth IN --frame-rat 20", "--frame-rat"),
        ("smooth IN/monday/*.txt", "no recordings"),
        ("smooth IN/a.mcap IN/monday/a.mcap --summary s.csv --out OUT", "both be written to"),
        ("export IN", "by suffixes"),
        ("smooth IN --jobs 0", "1 or more"),
        ("smooth nowhere://in/a.mcap", "vip-factors[cluster]"),
    ],
)
def test_what_cannot_work_is_said_before_the_work(run, folder: Path, tmp_path: Path, words: str, told: str) -> None:
    shutil.copy(folder / "a.mcap", folder / "monday" / "a.mcap")
    ended = run(*(word.replace("IN", str(folder)).replace("OUT", str(tmp_path / "out")) for word in words.split()))
    assert ended.code == 2
    assert told in ended.err
    assert not list(folder.rglob("*.estimate.mcap"))


def test_a_process_that_is_killed_is_tried_once_more(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "CHILD", "import os, signal; os.kill(os.getpid(), signal.SIGKILL)")
    seen = list[many_tasks.Task]()
    work = many.work
    monkeypatch.setattr(many, "work", lambda place, task: seen.append(task) or work(place, task))
    assert main(["smooth", str(folder / "monday"), "--jobs", "1"]) == 128 + signal.SIGKILL
    assert len(seen) == many.TRIES
    row = rows(folder / "monday" / "smooth.summary.csv")["b.mcap"]
    assert "SIGKILL" in row["error"]


def test_an_interrupt_ends_the_children_and_leaves_nothing(folder: Path) -> None:
    before = set(folder.rglob("*"))
    command = [sys.executable, "-m", "vip_factors", "smooth", str(folder), "--jobs", "2"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    children = Path(f"/proc/{process.pid}/task")
    deadline = time.monotonic() + 60
    while process.poll() is None and not _children(children) and time.monotonic() < deadline:
        time.sleep(0.1)
    started = _children(children)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=60)
    assert process.returncode == 130
    assert not [one for one in started if Path(f"/proc/{one}").exists()]
    made = {path.name for path in set(folder.rglob("*")) - before}
    assert made <= {"smooth.summary.csv", "smooth.summary.html"}


def _children(tasks: Path) -> list[str]:
    if not tasks.exists():
        pytest.skip("children are looked up in Linux's /proc")
    return [one for path in tasks.iterdir() for one in (path / "children").read_text().split()]


def test_a_child_ends_with_its_parent(tmp_path: Path) -> None:
    read, write = os.pipe()
    program = "import time, threading; from vip_factors.cli import main as m; m.main = lambda w: time.sleep(60);"
    child = subprocess.Popen([sys.executable, "-c", program + workers.CHILD], stdin=read)
    os.close(read)
    os.close(write)
    assert child.wait(timeout=30) != 0
