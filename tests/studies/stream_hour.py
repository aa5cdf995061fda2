"""Whether the fixed-lag tracker stays as fast and as small as it began, over an hour."""

import gc
import json
import os
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter, thread_time

import numpy as np

from tests.studies.long_stream import LongStream, LongStreamTrials, scene_of_another_process
from tests.studies.peak_memory import peak_memory
from vip_factors.errors import RecordingError
from vip_factors.live.settings import LiveSettings
from vip_factors.live.tracker import FixedLagTracker
from vip_factors.sensors.live import LiveSample, LiveSetup

PART_S = 300.0
BAR = 30  # characters of the longest bar
MB = 1e6


@dataclass(frozen=True)
class Part:
    """Some minutes of the stream.

    Attributes:
        until: the stream's time at the end, seconds.
        updates: answers.
        median_s, p99_s: wall time of an update.
        cpu_median_s, cpu_p99_s: CPU time of it.
        memory: resident bytes at the end.
        objects: that Python's garbage collector follows, after a collection.
        findings: sentences said in that time.
    """

    until: float
    updates: int
    median_s: float
    p99_s: float
    cpu_median_s: float
    cpu_p99_s: float
    memory: int
    objects: int
    findings: int


@dataclass(frozen=True)
class StreamHour:
    """All parts, and the bytes that were resident before the first sample."""

    trials: LongStreamTrials
    before: int
    parts: tuple[Part, ...]


def run_stream_hour(
    trials: LongStreamTrials, settings: LiveSettings, tell: Callable[[str, float], None], part_s: float = PART_S,
    keep: Callable[[StreamHour], None] = lambda so_far: None,
) -> StreamHour:  # fmt: skip
    """Track a long stream, and look at clock and memory every ``part_s`` seconds of it; ``keep`` sees each result."""
    stream = LongStream(scene_of_another_process(trials), trials)
    before, parts = resident_memory(), list[Part]()
    for part in measured_parts(stream, stream.setup, settings, part_s):
        parts.append(part)
        tell("stream", part.until / trials.seconds)
        keep(StreamHour(trials, before, tuple(parts)))
    if not parts:
        raise RecordingError("the stream is too short: expected answers; ask for more seconds")
    return StreamHour(trials, before, tuple(parts))


def measured_parts(
    samples: Iterable[LiveSample], setup: LiveSetup, settings: LiveSettings, part_s: float
) -> Iterable[Part]:
    """Parts of ``part_s`` seconds, as they end; the start's updates are not counted."""
    tracker, started = FixedLagTracker(setup, settings), False
    rows: list[tuple[float, float]] = []
    wall, cpu, findings, end, time = 0.0, 0.0, 0, part_s, 0.0
    for sample in samples:
        if sample.time >= end and rows:
            yield _part(end, rows, findings)
            rows, findings, end = [], 0, end + part_s
        before = perf_counter(), thread_time()
        answers = tracker.push(sample)
        wall, cpu, time = wall + perf_counter() - before[0], cpu + thread_time() - before[1], sample.time
        if answers:
            findings += sum(len(one.findings) for one in answers)
            rows += [(wall / len(answers), cpu / len(answers))] * len(answers) if started else []
            started, wall, cpu = True, 0.0, 0.0
    if rows:
        yield _part(time, rows, findings)


def _part(until: float, rows: Sequence[tuple[float, float]], findings: int) -> Part:
    (median, cpu_median), (p99, cpu_p99) = np.quantile(np.array(rows), [0.5, 0.99], axis=0).tolist()
    gc.collect()
    memory, objects = resident_memory(), len(gc.get_objects())
    return Part(until, len(rows), median, p99, cpu_median, cpu_p99, memory, objects, findings)


def resident_memory() -> int:
    """Bytes of this process that are in memory now; where the system does not say, the most there have been."""
    statm = Path("/proc/self/statm")
    if sys.platform == "linux" and statm.is_file():
        return int(statm.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    return peak_memory()


def growth(parts: Sequence[Part], of: Callable[[Part], float]) -> float:
    """Slope of a straight line through the parts after the first one, in units per hour; NaN for fewer than three."""
    if len(parts) < 3:
        return float("nan")
    time = np.array([part.until for part in parts[1:]]) / 3600
    slope, _ = np.polyfit(time, [of(part) for part in parts[1:]], 1)
    return float(slope)


def hour_table(result: StreamHour) -> str:
    """Markdown, with a bar for the memory of each part."""
    trials, parts = result.trials, result.parts
    most = max(part.memory for part in parts)
    lines = [
        f"Fixed-lag tracker, {trials.placement} at {trials.imu_rate:g} Hz and a {trials.camera} camera at "
        f"{trials.video_rate:g} Hz; {result.before / MB:.0f} MB before the first sample",
        "",
        "| until min | updates | ms median | ms 99 % | CPU ms median | CPU ms 99 % | MB | | objects | findings |",
        "|---:|---:|---:|---:|---:|---:|---:|:---|---:|---:|",
    ]
    for part in parts:
        times = [part.median_s, part.p99_s, part.cpu_median_s, part.cpu_p99_s]
        lines.append(
            f"| {part.until / 60:.1f} | {part.updates} | {' | '.join(f'{1e3 * one:.2f}' for one in times)} | "
            f"{part.memory / MB:.1f} | {'█' * round(BAR * part.memory / most)} | {part.objects} | {part.findings} |"
        )
    lines += [
        "",
        f"After the first part: {growth(parts, lambda part: part.memory) / MB:+.1f} MB, "
        f"{growth(parts, lambda part: part.objects):+.0f} objects, "
        f"{1e3 * growth(parts, lambda part: part.cpu_median_s):+.2f} ms of CPU per update, all per hour",
    ]
    return "\n".join(lines) + "\n"


def hour_json(result: StreamHour) -> str:
    """Everything measured, as JSON."""
    return json.dumps(asdict(result), indent=2) + "\n"
