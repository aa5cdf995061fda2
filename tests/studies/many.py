"""What a cluster makes of many recordings: the same folder by one worker and by several, and what eats the rest.

All processes are on this machine: more workers than it has cores only share these.
"""

import csv
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from tests.studies.processes import apart, cpu_seconds
from tests.studies.speed import Load, scene_of, timed
from tests.studies.study import Study, Tell, columns
from vip_factors.cli.workers import cluster
from vip_factors.errors import InputError
from vip_factors.io.mcap_recording import write_recording

START_S = 120.0  # for a scheduler and its workers to come up on a busy machine
FRAMES_A_SECOND = 60


@dataclass(frozen=True)
class ManyTime:
    """What a folder took.

    Attributes:
        workers: of the cluster, one thread each.
        recordings: in the folder.
        seconds: from the command's start to its end.
        working: of all workers together: each recording from its start to its end, its process's start included.
        command, scheduler, own, children: CPU seconds of the command itself, of Dask's scheduler, of Dask's workers
            themselves, and of the processes that they begin, one for each recording.
        alone: CPU seconds of the reconstructions alone: of one, its recording in memory, so many times.
    """

    workers: int
    recordings: int
    seconds: float
    working: float
    command: float
    scheduler: float
    own: float
    children: float
    alone: float

    @property
    def idle(self) -> float:
        """Seconds in which workers, of all together, were at no recording: until the first, after the last, between."""
        return self.workers * self.seconds - self.working

    @property
    def cores(self) -> float:
        """That were busy, in the mean."""
        return (self.command + self.scheduler + self.own + self.children) / self.seconds


@dataclass(frozen=True, kw_only=True)
class ManyRecordings(Study):
    """Seconds of a folder of recordings by the workers of a Dask cluster, and what eats the rest."""

    count: int = 60
    """Recordings."""
    seconds: float = 5.0
    """How long each is, 4 at least."""
    workers: tuple[int, ...] = (1, 2, 4)
    """So many at a time, in turn."""

    def rows(self, tell: Tell) -> Iterator[ManyTime]:
        load = Load(frames=round(FRAMES_A_SECOND * self.seconds), cameras=0)
        with TemporaryDirectory() as folder:
            first = Path(folder) / "in" / "0.mcap"
            first.parent.mkdir()
            write_recording(scene_of(load).wearers[0], first)
            for number in range(1, self.count):
                shutil.copy(first, first.with_name(f"{number}.mcap"))
            alone = self.count * apart(timed, load).cpu_seconds
            for done, workers in enumerate(self.workers):
                tell(f"{workers} workers", done / len(self.workers))
                yield replace(_worked(Path(folder), first.parent, workers), alone=alone)

    def tables(self, rows: Sequence[ManyTime]) -> Iterator[str]:
        one = next((row for row in rows if row.workers == 1), rows[0])
        yield columns(rows, {
            "workers": lambda row: row.workers, "recordings": lambda row: row.recordings,
            "s": lambda row: row.seconds, "times as fast": lambda row: f"{one.seconds / row.seconds:.2f}",
            "cores busy": lambda row: f"{row.cores:.2f}", "idle, s of workers": lambda row: row.idle,
            "CPU s: reconstruction alone": lambda row: row.alone,
            "processes' start, reading, writing": lambda row: row.children - row.alone,
            "Dask's workers": lambda row: row.own, "scheduler": lambda row: row.scheduler,
            "command": lambda row: row.command,
        })  # fmt: skip
        yield f"{os.cpu_count()} cores; in the folder each recording is the same, of 13 sensors without a camera."


def _worked(folder: Path, recordings: Path, workers: int) -> ManyTime:
    out, summary = folder / f"out{workers}", folder / f"out{workers}.csv"
    with _started(folder, workers) as (scheduler, processes, address):
        before = [cpu_seconds(one) for one in (scheduler, *processes)]
        words = ["smooth", str(recordings), "--out", str(out), "--summary", str(summary), "--cluster", str(address)]
        begin, own = time.monotonic(), os.times().children_user + os.times().children_system
        ended = subprocess.run([sys.executable, "-m", "vip_factors", *words], capture_output=True, text=True)
        seconds = time.monotonic() - begin
        command = os.times().children_user + os.times().children_system - own
        after = [cpu_seconds(one) for one in (scheduler, *processes)]
    if ended.returncode not in (0, 3):
        raise InputError(f"vip-factors {' '.join(words)} ended with {ended.returncode}: {ended.stderr[-300:]}")
    with open(summary, newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    took = [(b[0] - a[0], b[1] - a[1]) for a, b in zip(before, after, strict=True)]
    return ManyTime(
        workers, len(rows), seconds, sum(float(row["seconds"]) for row in rows), command, took[0][0],
        sum(one for one, _ in took[1:]), sum(one for _, one in took[1:]), 0.0,
    )  # fmt: skip


@contextmanager
def _started(folder: Path, workers: int) -> Iterator[tuple[int, list[int], Path]]:
    """Process numbers of a scheduler and of its workers, and the file that tells the scheduler's address."""
    address = folder / f"scheduler{workers}.json"
    dask, common = [sys.executable, "-m", "dask"], ["--no-dashboard", "--scheduler-file", str(address)]
    more = ["--nthreads", "1", "--no-nanny", "--local-directory", str(folder)]
    silent: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    begun = [subprocess.Popen([*dask, "scheduler", "--port", "0", "--host", "127.0.0.1", *common], **silent)]
    try:
        end = time.monotonic() + START_S
        while not address.exists():
            if time.monotonic() > end or begun[0].poll() is not None:
                raise InputError("no Dask scheduler comes up: pip install 'vip-factors[cluster]'")
            time.sleep(0.1)
        begun += [subprocess.Popen([*dask, "worker", *common, *more], **silent) for _ in range(workers)]
        with cluster(str(address)) as client:
            client.wait_for_workers(workers, timeout=START_S)
        yield begun[0].pid, [one.pid for one in begun[1:]], address
    finally:
        for process in reversed(begun):
            process.terminate()
        for process in begun:
            process.wait(60)
