"""Streams that end badly: killed, or on a disk that is full. What is left of their files, and what was said."""

import json
import subprocess
import sys
import time
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from tests.running_processes import begun_by, is_running
from tests.studies.stream_program import COMMAND
from tests.studies.study import Fixed, Study, Tell, bullets
from vip_factors.atomic import partial_path
from vip_factors.io.live_mcap import FLUSH_S
from vip_factors.io.mcap_estimate import read_estimate
from vip_factors.io.mcap_reader import McapWarning
from vip_factors.io.mcap_recording import write_recording
from vip_factors.sensors.calibration import preset
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording
from vip_factors.viz.viewer import is_whole

RATE = 30.0  # frames per second: one slow core keeps up
VIEWER_S = 60.0  # that the process of Rerun may take to complete its file, and any other to end
LEAST_BYTES = 1000  # that a full disk holds


@dataclass(frozen=True)
class KilledStream:
    """What a stream that was killed (SIGKILL) in the middle left.

    Attributes:
        after_s: of the stream, that had been answered.
        lost_s: from the end of the poses in the partial estimate to the last smoothed pose that was answered.
        estimate, rerun: whether each file could be read; before its first chunk an estimate need not be.
        left: names of all files.
        outlived_s: how long processes that the stream had begun went on without it.
    """

    after_s: float
    lost_s: float
    estimate: bool
    rerun: bool
    left: tuple[str, ...]
    outlived_s: float


@dataclass(frozen=True)
class FullDisk:
    """What a stream did whose files could not grow any more.

    Attributes:
        bytes: that a file may have.
        code: exit code.
        said: the last line.
        named: whether it names a file.
        orderly: no traceback, nothing under a final name that is not whole, no hidden file.
    """

    bytes: int
    code: int
    said: str
    named: bool
    orderly: bool


@dataclass(frozen=True, kw_only=True)
class EndStudy(Study):
    """Options of studies of streams that end badly."""

    seconds: float = 6.0
    """Of each stream: one wearer of six sensors, 30 frames per second."""
    seed: int = 0
    """Of the moments, or of the sizes."""
    command: Fixed[tuple[str, ...]] = COMMAND

    def ends(self, count: int, root: Path, tell: Tell) -> Iterator[tuple[float, list[str], Path]]:
        """A share of the whole at which each stream is to end, its arguments, and its folder."""
        motion, scene = gestures(self.seconds, 60.0), root / "scene.mcap"
        write_recording(simulate_recording(motion, preset("sip6", motion.skeleton)), scene)
        for number, share in enumerate(np.random.default_rng(self.seed).random(count)):
            tell("streams", number / count)
            folder = root / str(number)
            folder.mkdir()
            files = ["--out", str(folder / "e.mcap"), "--rerun-save", str(folder / "e.rrd")]
            yield share, [*self.command, "stream", str(scene), *files, "--frame-rate", str(RATE)], folder


@dataclass(frozen=True, kw_only=True)
class StreamKill(EndStudy):
    """What is left of the files of streams that are killed (SIGKILL) at random moments.

    Streams run in real time; moments are anywhere between their first answers and their end.
    """

    kills: int = 50
    """How many."""

    def rows(self, tell: Tell) -> Iterator[KilledStream]:
        with TemporaryDirectory() as root:
            for share, arguments, folder in self.ends(self.kills, Path(root), tell):
                yield _killed(arguments, folder, int(share * self.seconds * RATE))

    def tables(self, rows: Sequence[KilledStream]) -> Iterator[str]:
        after, lost, outlived = ([getattr(row, name) for row in rows] for name in ("after_s", "lost_s", "outlived_s"))
        yield (
            f"{len(rows)} streams killed after {min(after):.1f} to {max(after):.1f} s: lost of the estimate "
            f"{np.median(lost):.2f} s (median), {max(lost):.2f} s at most; estimate readable "
            f"{sum(row.estimate for row in rows)}, Rerun's file {sum(row.rerun for row in rows)} times; processes it "
            f"had begun were gone after {max(outlived):.1f} s at most"
        )


def _killed(arguments: Sequence[str], folder: Path, answers: int) -> KilledStream:
    process = subprocess.Popen([*arguments, "--real-time", "--json"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    assert process.stdout is not None
    lines = [process.stdout.readline()]
    while len(lines) < answers and lines[-1]:
        lines.append(process.stdout.readline())
    below = begun_by(process.pid)
    process.kill()
    killed = time.monotonic()
    rest, _ = process.communicate()
    whole = [line for line in b"".join([*lines, rest]).split(b"\n")[:-1] if line]
    smoothed = [one["wearers"][0]["smoothed"] for one in map(json.loads, whole)]
    times = [one["time"] for one in smoothed if one is not None] or [0.0]
    rrd = partial_path(folder / "e.rrd")
    while any(map(is_running, below)) and time.monotonic() - killed < VIEWER_S:
        time.sleep(0.1)
    outlived = time.monotonic() - killed  # those that hold the pipe were waited for above
    end = _readable_until(folder / "e.mcap")
    lost = times[-1] - (times[0] if end is None else end)
    readable = end is not None or times[-1] - times[0] < FLUSH_S
    left = tuple(sorted(path.name for path in folder.iterdir()))
    # Cut off where the kill came: Rerun reads what is before.
    read = subprocess.run([sys.executable, "-m", "rerun", "rrd", "stats", str(rrd)], capture_output=True, check=False)
    return KilledStream(times[-1], lost, readable, read.returncode == 0, left, outlived)


def _readable_until(path: Path) -> float | None:
    """Time of the last pose of what there is of an estimate; None if there is nothing that can be read."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", McapWarning)  # that it was cut off: it was
            return float(read_estimate(path if path.exists() else partial_path(path)).wearers[0].motion.time[-1])
    except (ValueError, OSError, IndexError):
        return None


@dataclass(frozen=True, kw_only=True)
class DiskFull(EndStudy):
    """What streams do, and say, whose files cannot grow any more from random sizes on.

    The limit is the process's own (RLIMIT_FSIZE), which needs no file system of its own.
    """

    streams: int = 50
    """How many."""

    def rows(self, tell: Tell) -> Iterator[FullDisk]:
        with TemporaryDirectory() as root:
            size = 0
            for share, arguments, folder in self.ends(self.streams, Path(root), tell):
                if not size:  # of a whole one
                    subprocess.run(arguments, check=True, capture_output=True)
                    size = max(path.stat().st_size for path in folder.iterdir())
                    for path in folder.iterdir():
                        path.unlink()
                yield _on_full_disk(arguments, folder, LEAST_BYTES + int(share * 0.9 * size))

    def tables(self, rows: Sequence[FullDisk]) -> Iterator[str]:
        yield (
            f"{len(rows)} streams on full disks: exit code not 0 {sum(row.code != 0 for row in rows)}, file named "
            f"{sum(row.named for row in rows)}, nothing half-written {sum(row.orderly for row in rows)} times"
        )
        bad = (row for row in rows if not (row.code and row.named and row.orderly))
        yield bullets("", (f"{one.bytes} bytes: exit code {one.code}: {one.said}" for one in bad))


def _on_full_disk(arguments: Sequence[str], folder: Path, most: int) -> FullDisk:
    import resource

    done = subprocess.run(
        arguments, capture_output=True, text=True, check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (most, most)),
    )  # fmt: skip
    said = (done.stderr.splitlines() or [""])[-1]
    names = {path.name for path in folder.iterdir()}
    whole = "e.mcap" not in names or _readable_until(folder / "e.mcap") is not None
    whole &= "e.rrd" not in names or is_whole(folder / "e.rrd")
    whole &= not any(name.startswith(".") for name in names) and "Traceback" not in done.stderr
    return FullDisk(most, done.returncode, said.replace(f"{folder}/", ""), str(folder) in said, whole)
