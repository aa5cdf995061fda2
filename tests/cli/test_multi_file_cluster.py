"""Many recordings on a real Dask cluster of four processes, to and from a real S3 server; both on this machine."""

import csv
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from cli.conftest import SMALL

BUCKET = "s3://lab"
START_S = 120.0  # for servers to come up on a busy machine


def until(true: Callable[[], object], what: str) -> None:
    deadline = time.monotonic() + START_S
    while not true():
        assert time.monotonic() < deadline, what
        time.sleep(0.1)


@pytest.fixture
def scheduler(tmp_path: Path) -> Iterator[Path]:
    """A scheduler and four workers; the file that tells its address."""
    distributed = pytest.importorskip("distributed")
    file = tmp_path / "scheduler.json"
    dask, common = [sys.executable, "-m", "dask"], ["--no-dashboard", "--scheduler-file", str(file)]
    environment = os.environ | {"DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL": "600s"}  # a machine may be busy
    started = [subprocess.Popen([*dask, "scheduler", "--port", "0", "--host", "127.0.0.1", *common], env=environment)]
    try:
        until(file.exists, "no scheduler")
        for number in range(4):
            words = ["worker", *common, "--nthreads", "1", "--name", f"w{number}"]
            started.append(subprocess.Popen([*dask, *words, "--local-directory", str(tmp_path)], env=environment))
        with distributed.Client(scheduler_file=str(file)) as client:
            client.wait_for_workers(4, timeout=START_S)
        yield file
    finally:
        for process in reversed(started):
            process.terminate()
        for process in started:
            process.wait(60)


@pytest.fixture
def s3(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Path]:
    """An S3 server with an empty bucket; its log."""
    pytest.importorskip("s3fs")
    pytest.importorskip("moto")
    log = tmp_path / "s3.log"
    for name, value in (
        ("AWS_ACCESS_KEY_ID", "a"),
        ("AWS_SECRET_ACCESS_KEY", "b"),
        ("AWS_DEFAULT_REGION", "us-east-1"),
    ):
        monkeypatch.setenv(name, value)
    with open(log, "wb") as told:
        server = subprocess.Popen([sys.executable, "-m", "moto.server", "-p", "0"], stderr=told, stdout=told)
    try:
        until(lambda: "http://127.0.0.1:" in log.read_text(), "no S3 server")
        port = log.read_text().partition("http://127.0.0.1:")[2].split()[0]
        monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{port}")
        import s3fs

        s3fs.S3FileSystem.clear_instance_cache()  # of a server before this one
        s3fs.S3FileSystem().mkdir("lab")
        yield log
    finally:
        server.terminate()
        server.wait(60)


def uploads(log: Path, ending: str) -> list[str]:
    """What was put into the bucket, once for each time."""
    lines = [line for line in log.read_text().splitlines() if '"PUT /lab/' in line and " 200 " in line]
    return [
        path for line in lines if (path := line.split('"PUT /lab/')[1].split()[0].partition("?")[0]).endswith(ending)
    ]


@pytest.mark.slow
def test_files_on_s3_are_fetched_and_put_back(run, files, s3: Path, tmp_path: Path) -> None:
    import fsspec

    system = fsspec.filesystem("s3", skip_instance_cache=True)
    for name in ("monday/a.mcap", "b.mcap"):
        system.put_file(str(files.recording), f"lab/in/{name}")
    summary = tmp_path / "all.csv"
    words = ("smooth", f"{BUCKET}/in", "--out", f"{BUCKET}/out", "--summary", summary, *SMALL)
    told = run(*words)
    assert told.code == 0, told.err
    assert sorted(uploads(s3, ".estimate.mcap")) == ["out/b.estimate.mcap", "out/monday/a.estimate.mcap"]
    assert "0 done, 2 there already" in run(*words).out


@pytest.mark.slow
def test_killed_workers_lose_nothing(files, s3: Path, scheduler: Path, tmp_path: Path) -> None:
    """Sixteen recordings, or as many as VIP_FACTORS_MANY says; each is put in place once."""
    import fsspec

    count = int(os.environ.get("VIP_FACTORS_MANY", "16"))
    system = fsspec.filesystem("s3", skip_instance_cache=True)
    for number in range(count):
        system.put_file(str(files.recording), f"lab/in/{number}.mcap")
    summary, told = tmp_path / "all.csv", tmp_path / "told.txt"
    command = [sys.executable, "-m", "vip_factors", "smooth", f"{BUCKET}/in", "--out", f"{BUCKET}/out"]
    command += ["--summary", str(summary), "--cluster", str(scheduler), *SMALL]
    with open(told, "wb") as out, subprocess.Popen(command, stdout=out, stderr=out) as process:
        try:
            for name, done in (("w1", count // 4), ("w2", count // 2)):
                while len(uploads(s3, ".estimate.mcap")) < done:
                    assert process.poll() is None, f"ended before {done} were done: {told.read_text()}"
                    time.sleep(0.1)
                kill_at_work(scheduler, name)
            code = process.wait()
        finally:
            process.kill()
    with open(summary, newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert code == 0, [row["error"] for row in rows if row["error"]]
    assert len({row["input"] for row in rows}) == len(rows) == count
    assert len(uploads(s3, ".estimate.mcap")) == len(set(uploads(s3, ".estimate.mcap"))) == count


def kill_at_work(scheduler: Path, name: str) -> None:
    """Kill the process of a worker that has something to do, and see it gone."""
    from distributed import Client

    with Client(scheduler_file=str(scheduler), set_as_default=False) as client:

        def address() -> str:
            return next(
                (at for at, one in client.scheduler_info(n_workers=-1)["workers"].items() if one["name"] == name), ""
            )

        before = address()
        (number,) = client.run(os.getpid, workers=[before]).values()
        assert client.processing([before])[before]
        os.kill(number, signal.SIGKILL)
        until(lambda: address() != before, f"{name} lives")
