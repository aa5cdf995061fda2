"""Memory and time that a long recording takes, read, solved and written in windows: each in a process of its own.

``python -m`` this module makes one recording, or solves one, and prints JSON.
"""

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

from tests.studies.long_recording import LongRecordingTrials, write_long_recording
from tests.studies.peak_memory import peak_memory
from vip_factors.errors import InputError
from vip_factors.io.mcap_long_estimate import write_long_estimate
from vip_factors.io.mcap_sampled import open_sampled
from vip_factors.pipeline import smooth_long

MB, HOUR = 1e6, 3600.0


@dataclass(frozen=True)
class LongRun:
    """One recording.

    Attributes:
        trials: what it was.
        frames: of the estimate.
        seconds, cpu_seconds: of wall and of processors, from opening the recording to the estimate's name.
        before, peak: resident bytes before the recording was opened, and at most.
        recording_bytes, estimate_bytes: of the files.
    """

    trials: LongRecordingTrials
    frames: int
    seconds: float
    cpu_seconds: float
    before: int
    peak: int
    recording_bytes: int
    estimate_bytes: int


def run_long(trials: LongRecordingTrials, tell: Callable[[str, float], None]) -> LongRun:
    """Make a recording, and smooth it as ``vip-factors smooth`` does; both files are deleted.

    Raises:
        InputError: if one of the processes ends with an error.
    """
    with tempfile.TemporaryDirectory(prefix="vip_factors_") as folder:
        recording, estimate = Path(folder) / "long.mcap", Path(folder) / "long.estimate.mcap"
        tell("recording", 0.0)
        _child(["make", json.dumps(asdict(trials)), str(recording)], tell)
        measured = _child(["smooth", str(recording), str(estimate)], tell)
        sizes = {"recording_bytes": recording.stat().st_size, "estimate_bytes": estimate.stat().st_size}
    return LongRun(trials, **measured, **sizes)


def _child(arguments: list[str], tell: Callable[[str, float], None]) -> dict[str, Any]:
    """The result of a process of its own, which prints a line of JSON now and then; the last one is the result."""
    command = [sys.executable, "-m", "tests.studies.long", *arguments]
    last: dict[str, Any] = {}
    with tempfile.TemporaryFile("w+") as errors:
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True) as child:
            assert child.stdout is not None
            try:
                for line in child.stdout:
                    last = json.loads(line)
                    if "stage" in last:
                        tell(str(last["stage"]), float(last["fraction"]))
            except BaseException:
                child.kill()
                raise
        if child.returncode:
            errors.seek(0)
            raise InputError(f"the process that measures failed: {errors.read().strip().splitlines()[-1:]}")
    return last


def _smooth(recording: Path, estimate: Path) -> dict[str, float]:
    def tell(stage: str, fraction: float) -> None:
        print(json.dumps({"stage": stage, "fraction": fraction}), flush=True)

    before, begin, cpu = peak_memory(), perf_counter(), process_time()
    sampled = open_sampled(recording)
    assert sampled is not None
    scene, estimates = smooth_long(sampled.name, sampled.wearers, progress=tell)
    write_long_estimate(scene, estimates, estimate)
    seconds, cpu_seconds = perf_counter() - begin, process_time() - cpu
    frames = estimates[0].frames
    return {
        "frames": frames, "seconds": seconds, "cpu_seconds": cpu_seconds, "before": before, "peak": peak_memory()
    }  # fmt: skip


def long_table(result: LongRun) -> str:
    """Markdown."""
    trials = result.trials
    return "\n".join(
        [
            f"{trials.hours:g} h of {trials.sensors}, a clip of {trials.clip_s:g} s repeated",
            "",
            "| frames | peak MB | of which before | s | s an hour | CPU s an hour | recording MB | estimate MB |",
            "|---:|---:|---:|---:|---:|---:|---:|---:|",
            f"| {result.frames} | {result.peak / MB:.0f} | {result.before / MB:.0f} | {result.seconds:.0f} | "
            f"{result.seconds / trials.hours:.0f} | {result.cpu_seconds / trials.hours:.0f} | "
            f"{result.recording_bytes / MB:.0f} | {result.estimate_bytes / MB:.0f} |",
            "",
        ]
    )


def long_json(result: LongRun) -> str:
    """Everything measured."""
    return json.dumps(asdict(result), indent=2) + "\n"


def _main(what: str, one: str, other: str) -> None:
    if what == "make":
        write_long_recording(LongRecordingTrials(**json.loads(one)), Path(other))
        print("{}")
    else:
        print(json.dumps(_smooth(Path(one), Path(other))))


if __name__ == "__main__":
    _main(*sys.argv[1:])
