"""Streams that end badly: killed, or on a disk that is full. What is left of their files, and what was said."""

import json
import subprocess
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from tests.studies.process_memory import begun_by, is_running
from tests.studies.stream_program import COMMAND
from vip_factors.io.live_mcap import FLUSH_S, partial_path
from vip_factors.io.mcap_contents import McapWarning
from vip_factors.io.mcap_scene_estimate import read_scene_estimate
from vip_factors.io.mcap_scene_recording import write_scene
from vip_factors.sensors.placement import preset
from vip_factors.sensors.scene import Scene
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording
from vip_factors.viz.rerun_file import is_whole

Tell = Callable[[str, float], None]
RATE = 30.0  # frames per second: one slow core keeps up
VIEWER_S = 60.0  # that the process of Rerun may take to complete its file, and any other to end
LEAST_BYTES = 1000  # that a full disk holds


@dataclass(frozen=True)
class EndTrials:
    """Which streams, and how often they are ended.

    Attributes:
        trials: how often.
        seconds: of each stream, of one wearer of six sensors.
        seed: of the moments.
        command: that runs ``vip-factors``.
    """

    trials: int = 50
    seconds: float = 6.0
    seed: int = 0
    command: tuple[str, ...] = COMMAND


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


def run_stream_kill(trials: EndTrials, tell: Tell | None = None) -> list[KilledStream]:
    """Streams in real time, killed at moments anywhere between their first answers and their end."""
    rng = np.random.default_rng(trials.seed)
    found = []
    with TemporaryDirectory() as root:
        scene = Path(root) / "scene.mcap"
        write_scene(small_scene(trials.seconds), scene)
        for number, share in enumerate(rng.random(trials.trials)):
            folder = Path(root) / str(number)
            folder.mkdir()
            found.append(_killed(trials, scene, folder, int(share * trials.seconds * RATE)))
            if tell is not None:
                tell("killing", (1 + number) / trials.trials)
    return found


def _arguments(scene: Path, folder: Path) -> list[str]:
    return [
        "stream", str(scene), "--out", str(folder / "e.mcap"), "--rerun-save", str(folder / "e.rrd"), "--frame-rate",
        str(RATE),
    ]  # fmt: skip


def _killed(trials: EndTrials, scene: Path, folder: Path, answers: int) -> KilledStream:
    command = [*trials.command, *_arguments(scene, folder), "--real-time", "--json"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
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
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", McapWarning)  # that it was cut off: it was
            motion = read_scene_estimate(path if path.exists() else partial_path(path)).wearers[0].motion
    except (ValueError, OSError, IndexError):
        return None
    return float(motion.time[-1])


def run_disk_full(trials: EndTrials, tell: Tell | None = None) -> list[FullDisk]:
    """Streams whose files may not grow beyond a random size, less than they would have.

    The limit is the process's own (RLIMIT_FSIZE), which needs no file system of its own.
    """
    rng = np.random.default_rng(trials.seed)
    found = []
    with TemporaryDirectory() as root:
        scene, folder = Path(root) / "scene.mcap", Path(root) / "whole"
        folder.mkdir()
        write_scene(small_scene(trials.seconds), scene)
        subprocess.run([*trials.command, *_arguments(scene, folder)], check=True, capture_output=True)
        size = max(path.stat().st_size for path in folder.iterdir())
        for number, share in enumerate(rng.random(trials.trials)):
            folder = Path(root) / str(number)
            folder.mkdir()
            found.append(_on_full_disk(trials, scene, folder, LEAST_BYTES + int(share * 0.9 * size)))
            if tell is not None:
                tell("filling the disk", (1 + number) / trials.trials)
    return found


def _on_full_disk(trials: EndTrials, scene: Path, folder: Path, most: int) -> FullDisk:
    import resource

    done = subprocess.run(
        [*trials.command, *_arguments(scene, folder)], capture_output=True, text=True, check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (most, most)),
    )  # fmt: skip
    said = (done.stderr.splitlines() or [""])[-1]
    names = {path.name for path in folder.iterdir()}
    whole = "e.mcap" not in names or _readable_until(folder / "e.mcap") is not None
    whole &= "e.rrd" not in names or is_whole(folder / "e.rrd")
    whole &= not any(name.startswith(".") for name in names) and "Traceback" not in done.stderr
    return FullDisk(most, done.returncode, said.replace(f"{folder}/", ""), str(folder) in said, whole)


def kill_table(found: Sequence[KilledStream]) -> str:
    """What was lost, in a few lines."""
    lost = [one.lost_s for one in found]
    return (
        f"{len(found)} streams killed after {min(one.after_s for one in found):.1f} to "
        f"{max(one.after_s for one in found):.1f} s: lost of the estimate {np.median(lost):.2f} s (median), "
        f"{max(lost):.2f} s at most; estimate readable {sum(one.estimate for one in found)}, Rerun's file "
        f"{sum(one.rerun for one in found)} times; processes it had begun were gone after "
        f"{max(one.outlived_s for one in found):.1f} s at most\n"
    )


def disk_full_table(found: Sequence[FullDisk]) -> str:
    """How many ended as they should, and what the others said."""
    lines = [
        f"{len(found)} streams on full disks: exit code not 0 {sum(one.code != 0 for one in found)}, file named "
        f"{sum(one.named for one in found)}, nothing half-written {sum(one.orderly for one in found)} times"
    ]
    lines += [f"- {one.bytes} bytes: exit code {one.code}: {one.said}" for one in found if not one.good]
    return "\n".join(lines) + "\n"


def ends_json(found: Sequence[KilledStream] | Sequence[FullDisk]) -> str:
    """Every trial."""
    return json.dumps([asdict(one) for one in found], indent=2) + "\n"
