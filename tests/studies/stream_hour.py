"""Whether the fixed-lag tracker stays as fast and as small as it began, over an hour."""

import gc
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from time import perf_counter, thread_time
from typing import Any

import numpy as np

from tests.studies.long_stream import LongStream, LongStreamStudy, stream_scene
from tests.studies.processes import apart, resident_memory
from tests.studies.stream_whole import WholeEnd, WholePart, whole_stream, whole_tables
from tests.studies.study import MB, NAN, Tell, table
from vip_factors.cli.options import Flag
from vip_factors.errors import RecordingError
from vip_factors.live.settings import LiveSettings
from vip_factors.live.tracker import FixedLagTracker
from vip_factors.sensors.live import LiveSample, LiveSetup

BAR = 30  # characters of the longest bar


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
        before: bytes that were resident before the first sample.
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
    before: int = 0


@dataclass(frozen=True, kw_only=True)
class StreamHour(LongStreamStudy):
    """Whether an hour of tracking stays as fast and as small as it began."""

    minutes: float = 60.0
    """Of the simulated stream: 13 IMUs at 60 Hz, 18 keypoints at 30 Hz."""
    part_minutes: float = 5.0
    """Between looks at clock and memory."""
    whole: Flag = False
    """The program in place of its tracker alone: in real time over the network, with its files and lines of JSON."""
    frame_rate: float = 60.0
    """Frames per second."""

    def rows(self, tell: Tell) -> Iterator[Part | WholePart | WholeEnd]:
        if self.whole:
            yield from whole_stream(self.stream, self.frame_rate, 60 * self.part_minutes, tell)
            return
        stream, found = LongStream(apart(stream_scene, self.stream), self.stream), 0
        settings = LiveSettings(frame_rate=self.frame_rate)
        for part in measured_parts(stream, stream.setup, settings, 60 * self.part_minutes):
            tell("stream", part.until / self.stream.seconds)
            found += 1
            yield part
        if not found:
            raise RecordingError("the stream is too short: expected answers; ask for more seconds")

    def tables(self, rows: Sequence[Any]) -> Iterator[str]:
        parts, stream = [one for one in rows if isinstance(one, Part)], self.stream
        if not parts:
            yield from whole_tables(stream, self.frame_rate, rows)
            return
        most = max(part.memory for part in parts)
        yield (
            f"Fixed-lag tracker, {stream.placement} at {stream.imu_rate:g} Hz and a {stream.camera} camera at "
            f"{stream.video_rate:g} Hz; {parts[0].before / MB:.0f} MB before the first sample"
        )
        head = ["until min", "updates", "ms median", "ms 99 %", "CPU ms median", "CPU ms 99 %", "MB", "", "objects",
                "findings"]  # fmt: skip
        yield table(head, [
            [part.until / 60, part.updates,
             *(f"{1e3 * one:.2f}" for one in (part.median_s, part.p99_s, part.cpu_median_s, part.cpu_p99_s)),
             part.memory / MB, "█" * round(BAR * part.memory / most), part.objects, part.findings] for part in parts
        ])  # fmt: skip
        yield (
            f"After the first part: {growth(parts, lambda part: part.memory) / MB:+.1f} MB, "
            f"{growth(parts, lambda part: part.objects):+.0f} objects, "
            f"{1e3 * growth(parts, lambda part: part.cpu_median_s):+.2f} ms of CPU per update, all per hour"
        )


def measured_parts(
    samples: Iterable[LiveSample], setup: LiveSetup, settings: LiveSettings, part_s: float
) -> Iterable[Part]:
    """Parts of ``part_s`` seconds, as they end; the start's updates are not counted."""
    tracker, started, resident = FixedLagTracker(setup, settings), False, resident_memory()
    rows: list[tuple[float, float]] = []
    wall, cpu, findings, end, time = 0.0, 0.0, 0, part_s, 0.0
    for sample in samples:
        if sample.time >= end and rows:
            yield _part(end, rows, findings, resident)
            rows, findings, end = [], 0, end + part_s
        before = perf_counter(), thread_time()
        answers = tracker.push(sample)
        wall, cpu, time = wall + perf_counter() - before[0], cpu + thread_time() - before[1], sample.time
        if answers:
            findings += sum(len(one.findings) for one in answers)
            rows += [(wall / len(answers), cpu / len(answers))] * len(answers) if started else []
            started, wall, cpu = True, 0.0, 0.0
    if rows:
        yield _part(time, rows, findings, resident)


def _part(until: float, rows: Sequence[tuple[float, float]], findings: int, before: int) -> Part:
    (median, cpu_median), (p99, cpu_p99) = np.quantile(np.array(rows), [0.5, 0.99], axis=0).tolist()
    gc.collect()
    memory, objects = resident_memory(), len(gc.get_objects())
    return Part(until, len(rows), median, p99, cpu_median, cpu_p99, memory, objects, findings, before)


def growth(parts: Sequence[Part], of: Callable[[Part], float]) -> float:
    """Slope of a straight line through the parts after the first one, in units per hour; NaN for fewer than three."""
    if len(parts) < 3:
        return NAN
    time = np.array([part.until for part in parts[1:]]) / 3600
    slope, _ = np.polyfit(time, [of(part) for part in parts[1:]], 1)
    return float(slope)
