"""Whether the tracker stays as fast and as small as it began over an hour, alone or in the whole program.

The program is fed over the network, writes into all its files, and its lines are read.
"""

import gc
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Lock
from typing import Any

import numpy as np

from tests.studies.live_run import timed_answers
from tests.studies.long_stream import LongStream, LongStreamStudy, LongStreamTrials, stream_scene
from tests.studies.processes import ProcessTree, apart, process_tree, resident_memory
from tests.studies.stream_program import COMMAND, StreamProgram
from tests.studies.study import MB, NAN, Tell, bullets, table
from vip_factors.atomic import partial_path
from vip_factors.cli.options import Flag
from vip_factors.errors import RecordingError
from vip_factors.io.mcap_estimate import read_estimate
from vip_factors.live.settings import LiveSettings
from vip_factors.live.tracker import FixedLagTracker
from vip_factors.sensors.live import LiveSample
from vip_factors.sensors.scene import Scene
from vip_factors.viz.rerun_file import is_whole

BAR = 30  # characters of the longest bar
LOOK_S = 5.0  # between looks at memory
START_S = 10.0  # of the stream: the first answers come together, once there is a second to answer
ESTIMATE, RERUN = "stream.mcap", "stream.rrd"
DROPPED = re.compile(r"does not keep up: (?:(\d+) video frames)?(?: and )?(?:(\d+) IMU samples)? were dropped")


def dropped(sentence: str) -> np.ndarray:
    """Video frames and samples of IMUs ``(2,)`` that a finding says were dropped."""
    found = DROPPED.search(sentence)
    return np.array([int(number or 0) for number in found.groups()] if found else (0, 0))


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


def measured_parts(
    samples: Iterable[LiveSample], setup: Scene, settings: LiveSettings, part_s: float
) -> Iterable[Part]:
    """Parts of ``part_s`` seconds, as they end; the start's updates are not counted."""
    tracker, started, resident = FixedLagTracker(setup, settings), False, resident_memory()
    rows: list[tuple[float, float]] = []
    findings, end, time = 0, part_s, 0.0
    for time, answers, wall, cpu in timed_answers(samples, tracker):
        if time >= end and rows:
            yield _part(end, rows, findings, resident)
            rows, findings, end = [], 0, end + part_s
        findings += sum(len(one.findings) for one in answers)
        rows += [(wall / len(answers), cpu / len(answers))] * len(answers) if started else []
        started = True
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


@dataclass(frozen=True)
class WholePart:
    """Some minutes of the stream.

    Attributes:
        until: the stream's time at the end, seconds.
        answers: lines of JSON.
        missing: frames without one.
        latency_s: of answers, from when their newest sample was due to when their line was read: median, 99 %, worst.
            Those of the first ten seconds of the stream are left out.
        dropped: video frames and samples of IMUs that the program dropped.
        findings: sentences.
        memory: resident bytes of the program, of the processes that it has begun, and the most of all together that
            was seen.
        cpu_s: seconds of processor time that the program took, without the processes that it has begun.
        bytes: of the estimate and of Rerun's file.
    """

    until: float
    answers: int
    missing: int
    latency_s: tuple[float, float, float]
    dropped: tuple[int, int]
    findings: int
    memory: tuple[int, int, int]
    cpu_s: float
    bytes: tuple[int, int]


@dataclass(frozen=True)
class WholeEnd:
    """How it ended.

    Attributes:
        latest_s: by which the sender itself was late at most, seconds.
        code: exit code.
        estimate_s: duration of the estimate that can be read.
        rerun: whether Rerun's file is whole.
        said: every sentence, with the time (s) when it was said.
    """

    latest_s: float
    code: int
    estimate_s: float
    rerun: bool
    said: tuple[tuple[float, str], ...] = ()


def whole_stream(
    trials: LongStreamTrials, frame_rate: float, part_s: float, tell: Tell, command: Sequence[str] = COMMAND
) -> Iterator[WholePart | WholeEnd]:
    """Send a long stream to the program in real time, and look at it every ``part_s`` seconds."""
    stream = LongStream(apart(stream_scene, trials), trials)
    watch = Watch(frame_rate)
    with TemporaryDirectory() as name:
        folder = Path(name)
        files = ["--out", str(folder / ESTIMATE), "--rerun-save", str(folder / RERUN)]
        with StreamProgram([*files, "--frame-rate", f"{frame_rate:g}"], watch.take, command) as program:
            for time in program.send(stream.setup, stream):
                ends = time >= part_s * (1 + watch.ended)
                if time >= watch.next_look or ends:
                    watch.look(time, process_tree(program.pid))
                    tell("stream", time / trials.seconds)
                if ends:
                    yield watch.end_part(time, folder)
            watch.look(trials.seconds, process_tree(program.pid))
            code = program.end()
            if watch.has_answers:
                yield watch.end_part(trials.seconds, folder)
        estimate = read_estimate(folder / ESTIMATE).wearers[0].motion
        duration, rerun = (len(estimate) - 1) / estimate.rate, is_whole(folder / RERUN)
        yield WholeEnd(program.latest_s, code, duration, rerun, tuple(watch.said))


@dataclass
class Watch:
    """Counts what comes, from the thread that reads and the one that sends."""

    frame_rate: float
    ended: int = 0  # parts
    said: list[tuple[float, str]] = field(default_factory=list)
    next_look: float = 0.0  # of the stream, seconds

    def __post_init__(self) -> None:
        self._lock = Lock()
        self._last: float | None = None  # time of the last answer, s
        self._tree, self._most, self._cpu_s = ProcessTree(0, 0, 0.0), 0, 0.0
        self._clear()

    def _clear(self) -> None:
        self._latency: list[float] = []
        self._answers, self._missing, self._findings, self._most = 0, 0, 0, 0
        self._dropped = np.zeros(2, int)

    @property
    def has_answers(self) -> bool:
        """Whether there were any since the last part."""
        return self._answers > 0

    def take(self, answer: dict[str, Any], age: float) -> None:
        """A line has been read."""
        with self._lock:
            time = float(answer["time"])
            if self._last is not None:
                self._missing += round((time - self._last) * self.frame_rate) - 1
            self._last = time
            self._answers += 1
            if time >= START_S:
                self._latency.append(age)
            for sentence in answer.get("findings", ()):
                self._findings += 1
                self.said.append((time, sentence))
                self._dropped += dropped(sentence)

    def look(self, time: float, tree: ProcessTree | None) -> None:
        """At memory."""
        self.next_look = time + LOOK_S
        if tree is not None:
            self._tree, self._most = tree, max(self._most, tree.own + tree.others)

    def end_part(self, until: float, folder: Path) -> WholePart:
        """What came since the last one."""
        sizes = [_size(folder / name) for name in (ESTIMATE, RERUN)]
        with self._lock:
            waits = self._latency or [float("nan")]
            median, late, worst = np.quantile(waits, [0.5, 0.99, 1.0]).tolist()
            tree = self._tree
            part = WholePart(
                until, self._answers, self._missing, (median, late, worst),
                (int(self._dropped[0]), int(self._dropped[1])), self._findings, (tree.own, tree.others, self._most),
                tree.cpu_s - self._cpu_s, (sizes[0], sizes[1]),
            )  # fmt: skip
            self._cpu_s = tree.cpu_s
            self.ended += 1
            self._clear()
            return part


def _size(path: Path) -> int:
    """Of a file under its final name or the one that it has until then."""
    return max((one.stat().st_size for one in (path, partial_path(path)) if one.exists()), default=0)


def whole_tables(trials: LongStreamTrials, frame_rate: float, rows: Sequence[WholePart | WholeEnd]) -> Iterator[str]:
    """A line for each part, the end, and all that was said."""
    parts, ends = [r for r in rows if isinstance(r, WholePart)], [r for r in rows if isinstance(r, WholeEnd)]
    yield (
        f"The whole program at {frame_rate:g} frames per second: {trials.placement} at {trials.imu_rate:g} Hz and a "
        f"{trials.camera} camera at {trials.video_rate:g} Hz over the loopback in real time; an estimate, Rerun's file "
        "and lines of JSON written"
    )
    head = [
        "until min", "answers", "missing", "latency ms: median", "99 %", "worst", "dropped: video", "IMU", "findings",
        "MB", "MB of its processes", "MB at most", "CPU share", "estimate MB", "Rerun MB",
    ]  # fmt: skip
    lines, before = [], 0.0
    for part in parts:
        latency, memory = (f"{1e3 * one:.0f}" for one in part.latency_s), (f"{one / MB:.0f}" for one in part.memory)
        share = f"{part.cpu_s / (part.until - before):.2f}" if part.until - before > 1.0 else "-"
        sizes = (one / MB for one in part.bytes)
        lines.append([part.until / 60, part.answers, part.missing, *latency, *part.dropped, part.findings, *memory,
                      share, *sizes])  # fmt: skip
        before = part.until
    yield table(head, lines)
    for end in ends:
        yield (
            f"The sender itself was {1e3 * end.latest_s:.0f} ms late at most. Exit code {end.code}; estimate readable, "
            f"{end.estimate_s:.1f} s; Rerun's file {'whole' if end.rerun else 'NOT whole'}."
        )
        yield bullets("", (f"{time:.1f} s: {sentence}" for time, sentence in end.said))


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
