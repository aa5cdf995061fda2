"""One command over many recordings: what fails costs itself, what is there is kept, what was killed is cleared away."""

import csv
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from cli.conftest import SMALL, assert_one_sentence

from vip_factors.cli import multi_file, workers
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
    outcome = run("smooth", folder, "--jobs", 2, *SMALL)
    assert outcome.code == 2  # the broken file's
    assert "2 done, 0 there already, 1 failed" in outcome.out
    summary = rows(folder / "smooth.summary.csv")
    assert {name: row["state"] for name, row in summary.items()} == {
        "a.mcap": "done", "b.mcap": "done", "broken.mcap": "failed"
    }  # fmt: skip
    alone = read_estimate(files.estimate)
    assert summary["a.mcap"]["verdict"] == str(alone.verdict)
    assert int(summary["a.mcap"]["frames"]) == len(alone.wearer().motion)
    assert "recording" in summary["broken.mcap"]["error"]
    made = folder / "monday" / "b.estimate.mcap"
    before = made.stat().st_mtime_ns
    again = run("smooth", folder, "--jobs", 2, *SMALL)
    assert "0 done, 2 there already, 1 failed" in again.out
    assert made.stat().st_mtime_ns == before
    assert rows(folder / "smooth.summary.csv")["b.mcap"]["verdict"] == summary["b.mcap"]["verdict"]


def test_a_verdict_and_settings_are_those_of_one_recording(run, folder: Path, tmp_path: Path) -> None:
    settings = tmp_path / "settings.toml"
    settings.write_text("frame_rate = 10.0\n[solve]\nmax_iterations = 1\n")
    out = tmp_path / "out"
    words = ("smooth", f"{folder}/monday/*.mcap", "--out", out, "--settings", settings, "--fail-on", "care")
    assert run(*words).code == 3
    assert read_head(out / "b.estimate.mcap")[0].wearer().motion.rate == 10
    assert run(*words).code == 3  # of what is there already, too


@pytest.mark.parametrize(
    ("words", "is_multi_file"),
    [
        ("smooth a.mcap b.mcap --frame-rate 20", False),
        ("smooth a.mcap --jobs 4", False),  # its windows
        ("smooth a.mcap b.mcap --summary all.csv", True),
        ("smooth *.mcap", True),
        ("smooth s3://bucket/a.mcap", True),
        ("smooth a.mcap --out s3://bucket/estimates", True),
        ("stream a.mcap --jobs 2", True),
        ("stream ws://127.0.0.1:0", False),
    ],
)
def test_one_recording_is_not_many(words: str, is_multi_file: bool) -> None:
    command, *rest = words.split()
    assert multi_file.is_multi_file(command, rest) == is_multi_file


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("smooth IN --frame-rat 20", "--frame-rat"),
        ("smooth IN/monday/*.txt", "no recordings"),
        ("smooth IN/a.mcap IN/monday/a.mcap --summary s.csv --out OUT", "both be written to"),
        ("smooth IN --jobs 0", "1 or more"),
        ("smooth nowhere://in/a.mcap", "vip-factors[cluster]"),
    ],
)
def test_what_cannot_work_is_said_before_the_work(run, folder: Path, tmp_path: Path, words: str, sentence: str) -> None:
    shutil.copy(folder / "a.mcap", folder / "monday" / "a.mcap")
    outcome = run(*(word.replace("IN", str(folder)).replace("OUT", str(tmp_path / "out")) for word in words.split()))
    assert outcome.code == 2
    assert sentence in outcome.err
    assert not list(folder.rglob("*.estimate.mcap"))


def test_s3_without_credentials_is_one_sentence(run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("s3fs")
    for name in [name for name in os.environ if name.startswith("AWS_")]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("AWS_EC2_METADATA_DISABLED", "true")
    ended = run("smooth", "s3://lab/walk.mcap")
    assert_one_sentence(ended, "s3://lab/walk.mcap cannot be reached: Unable to locate credentials")


@pytest.fixture
def port() -> Iterator[int]:
    """A port that takes connections and says nothing."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server.getsockname()[1]


@pytest.mark.parametrize("address", ["none.json", "address.json", "tcp://127.0.0.1:{port}", "nowhere"])
def test_a_cluster_that_is_none_is_one_sentence(
    run, folder: Path, tmp_path: Path, address: str, port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed")
    (tmp_path / "address.json").write_text("{}")
    monkeypatch.chdir(tmp_path)
    ended = run("smooth", folder, "--cluster", address.format(port=port))
    assert_one_sentence(ended, "no Dask scheduler answers there")


def start(folder: Path, temporary: Path) -> "subprocess.Popen[str]":
    """A run over the folder, once a recording is at work."""
    command = [sys.executable, "-m", "vip_factors", "smooth", str(folder), "--jobs", "2"]
    process = subprocess.Popen(
        command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=os.environ | {"TMPDIR": str(temporary)}
    )
    deadline = time.monotonic() + 60
    while process.poll() is None and not list(temporary.glob("*/err.txt")) and time.monotonic() < deadline:
        time.sleep(0.05)
    return process


def children(process: "subprocess.Popen[str]") -> list[Path]:
    tasks = Path(f"/proc/{process.pid}/task")
    if not tasks.exists():
        pytest.skip("children are looked up in Linux's /proc")
    return [Path(f"/proc/{word}") for path in tasks.iterdir() for word in (path / "children").read_text().split()]


def test_an_interrupt_ends_the_children_and_leaves_nothing(folder: Path, tmp_path: Path) -> None:
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    before = set(folder.rglob("*"))
    process = start(folder, temporary)
    started = children(process)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=60)
    assert process.returncode == 130
    assert not [child for child in started if child.exists()]
    assert {path.name for path in set(folder.rglob("*")) - before} <= {"smooth.summary.csv"}
    assert not list(temporary.iterdir())


def test_a_child_ends_with_its_parent() -> None:
    read, write = os.pipe()
    program = "import time, threading; from vip_factors.cli import main as m; m.main = lambda: time.sleep(60);"
    child = subprocess.Popen([sys.executable, "-c", program + workers.CHILD], stdin=read)
    os.close(read)
    os.close(write)
    assert child.wait(timeout=30) == -signal.SIGTERM
