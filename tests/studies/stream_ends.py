"""Streams that end badly: killed, or on a disk that is full. What is left of their files, and what was said."""

import json
import subprocess
import time
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from tests.studies.processes import begun_by, is_running
from tests.studies.stream_program import COMMAND
from tests.studies.study import Fixed, Study, Tell, bullets
from vip_factors.atomic import partial_path
from vip_factors.body.kinematics import Motion
from vip_factors.io.live_mcap import FLUSH_S
from vip_factors.io.mcap_estimate import read_estimate
from vip_factors.io.mcap_reader import McapWarning
from vip_factors.io.mcap_recording import write_scene
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.scene import Scene
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording
from vip_factors.viz.rerun_file import is_whole

RATE = 30.0  # frames per second: one slow core keeps up
VIEWER_S = 60.0  # that the process of Rerun may take to complete its file, and any other to end
LEAST_BYTES = 1000  # that a full disk holds


@dataclass(frozen=True, kw_only=True)
class EndStudy(Study):
    """Options of studies of streams that end badly."""

    seconds: float = 6.0
    """Of each stream: one wearer of six sensors, 30 frames per second."""
    seed: int = 0
    """Of the moments, or of the sizes."""
    command: Fixed[tuple[str, ...]] = COMMAND


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
    outlived_s: float = 0.0


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

    @property
    def good(self) -> bool:
        """Whether it was as it should be."""
        return self.code != 0 and self.named and self.orderly


def small_scene(seconds: float) -> Scene:
    """One wearer of six sensors."""
    motion = gestures(seconds, 60.0)
    return Scene("wearer", (simulate_recording(motion, preset("sip6", motion.skeleton)),))


@dataclass(frozen=True, kw_only=True)
class StreamKill(EndStudy):
    """What is left of the files of streams that are killed (SIGKILL) at random moments.

    Streams run in real time; moments are anywhere between their first answers and their end.
    """

    kills: int = 50
    """How many."""

    def rows(self, tell: Tell) -> Iterator[KilledStream]:
        with TemporaryDirectory() as root:
            scene = Path(root) / "scene.mcap"
            write_scene(small_scene(self.seconds), scene)
            for number, share in enumerate(np.random.default_rng(self.seed).random(self.kills)):
                folder = Path(root) / str(number)
                folder.mkdir()
                tell("killing", number / self.kills)
                yield _killed(self.command, scene, folder, int(share * self.seconds * RATE))

    def tables(self, rows: Sequence[KilledStream]) -> Iterator[str]:
        lost = [one.lost_s for one in rows]
        yield (
            f"{len(rows)} streams killed after {min(one.after_s for one in rows):.1f} to "
            f"{max(one.after_s for one in rows):.1f} s: lost of the estimate {np.median(lost):.2f} s (median), "
            f"{max(lost):.2f} s at most; estimate readable {sum(one.estimate for one in rows)}, Rerun's file "
            f"{sum(one.rerun for one in rows)} times; processes it had begun were gone after "
            f"{max(one.outlived_s for one in rows):.1f} s at most"
        )


def _arguments(scene: Path, folder: Path) -> list[str]:
    return [
        "stream", str(scene), "--out", str(folder / "e.mcap"), "--rerun-save", str(folder / "e.rrd"), "--frame-rate",
        str(RATE),
    ]  # fmt: skip


def _killed(command: Sequence[str], scene: Path, folder: Path, answers: int) -> KilledStream:
    started = [*command, *_arguments(scene, folder), "--real-time", "--json"]
    process = subprocess.Popen(started, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
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
    told = [one["time"] for one in smoothed if one is not None]
    rrd = partial_path(folder / "e.rrd")
    while (any(map(is_running, below)) or not is_whole(rrd)) and time.monotonic() - killed < VIEWER_S:
        time.sleep(0.1)
    outlived = time.monotonic() - killed  # those that hold the pipe were waited for above
    end = _readable_until(folder / "e.mcap")
    first, last = (told[0], told[-1]) if told else (0.0, 0.0)
    lost = last - (end if end is not None else first)
    left = tuple(sorted(path.name for path in folder.iterdir()))
    return KilledStream(last, lost, end is not None or last - first < FLUSH_S, is_whole(rrd), left, outlived)


def _readable_until(path: Path) -> float | None:
    """Time of the last pose of what there is of an estimate; None if there is nothing that can be read."""
    try:
        return float(_readable(path if path.exists() else partial_path(path)).time[-1])
    except (ValueError, OSError, IndexError):
        return None


def _readable(path: Path) -> Motion:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", McapWarning)  # that it was cut off: it was
        return read_estimate(path).wearers[0].motion


@dataclass(frozen=True, kw_only=True)
class DiskFull(EndStudy):
    """What streams do, and say, whose files cannot grow any more from random sizes on.

    The limit is the process's own (RLIMIT_FSIZE), which needs no file system of its own.
    """

    streams: int = 50
    """How many."""

    def rows(self, tell: Tell) -> Iterator[FullDisk]:
        with TemporaryDirectory() as root:
            scene, folder = Path(root) / "scene.mcap", Path(root) / "whole"
            folder.mkdir()
            write_scene(small_scene(self.seconds), scene)
            subprocess.run([*self.command, *_arguments(scene, folder)], check=True, capture_output=True)
            size = max(path.stat().st_size for path in folder.iterdir())
            for number, share in enumerate(np.random.default_rng(self.seed).random(self.streams)):
                folder = Path(root) / str(number)
                folder.mkdir()
                tell("filling the disk", number / self.streams)
                yield _on_full_disk(self.command, scene, folder, LEAST_BYTES + int(share * 0.9 * size))

    def tables(self, rows: Sequence[FullDisk]) -> Iterator[str]:
        yield (
            f"{len(rows)} streams on full disks: exit code not 0 {sum(one.code != 0 for one in rows)}, file named "
            f"{sum(one.named for one in rows)}, nothing half-written {sum(one.orderly for one in rows)} times"
        )
        yield bullets("", (f"{one.bytes} bytes: exit code {one.code}: {one.said}" for one in rows if not one.good))


def _on_full_disk(command: Sequence[str], scene: Path, folder: Path, most: int) -> FullDisk:
    import resource

    done = subprocess.run(
        [*command, *_arguments(scene, folder)], capture_output=True, text=True, check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (most, most)),
    )  # fmt: skip
    said = (done.stderr.splitlines() or [""])[-1]
    names = {path.name for path in folder.iterdir()}
    whole = "e.mcap" not in names or _readable_until(folder / "e.mcap") is not None
    whole &= "e.rrd" not in names or is_whole(folder / "e.rrd")
    whole &= not any(name.startswith(".") for name in names) and "Traceback" not in done.stderr
    return FullDisk(most, done.returncode, said.replace(f"{folder}/", ""), str(folder) in said, whole)
