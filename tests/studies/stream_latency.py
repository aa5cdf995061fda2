"""How long the fixed-lag tracker takes for an answer, on a stream of minutes; and GTSAM's own smoothers beside it."""

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from time import perf_counter, sleep, thread_time

import numpy as np

from tests.studies.long_stream import LongStream, LongStreamTrials, scene_of_another_process
from tests.studies.stream_references import ReferenceTime, run_references
from vip_factors.errors import RecordingError
from vip_factors.live.settings import LiveSettings
from vip_factors.live.tracker import FixedLagTracker
from vip_factors.live_estimate import LiveEstimate
from vip_factors.sensors.live import LiveSample, LiveSetup

SLOWEST = 5  # updates that are shown one by one
CAUGHT_UP = 4.0  # frames: an answer no older than that came in time; sensors are a frame apart, windows another
Tell = Callable[[str, float], None]
Quantiles = dict[str, float]


@dataclass(frozen=True)
class SlowUpdate:
    """One of the slowest: the stream's time (s), what an answer took then (wall and CPU, s), and what it said."""

    time: float
    seconds: float
    cpu_seconds: float
    findings: tuple[str, ...]


@dataclass(frozen=True)
class Latency:
    """What updates took: whole calls of ``push``, with the samples before that gave no answer.

    Attributes:
        updates: answers after the start.
        frame_s: seconds between frames.
        seconds, cpu_seconds: median, 95 %, 99 % and worst.
        late: share of updates that took longer than a frame, of wall time.
        start_s, start_cpu_s: the call that gave the first answer.
        first_s: the stream's time of the newest frame then.
        total_s: wall time of all calls.
        slowest: the slowest updates.
        age_s: with a stream in real time: from the newest frame to its answer, once the start has been caught up with.
        caught_up_s: seconds from the first answer until answers came in time; NaN if they never did.
    """

    updates: int
    frame_s: float
    seconds: Quantiles
    cpu_seconds: Quantiles
    late: float
    start_s: float
    start_cpu_s: float
    first_s: float
    total_s: float
    slowest: tuple[SlowUpdate, ...]
    age_s: Quantiles | None = None
    caught_up_s: float | None = None


@dataclass(frozen=True)
class StreamLatency:
    """Everything measured."""

    trials: LongStreamTrials
    lag_s: float
    latency: Latency
    real_time: Latency | None
    references: tuple[ReferenceTime, ...]


def run_stream_latency(
    trials: LongStreamTrials, settings: LiveSettings, tell: Tell, real_time_s: float = 0.0, reference_updates: int = 30
) -> StreamLatency:
    """Measure the tracker, in real time too if asked for, and GTSAM's smoothers on some of the stream's own factors.

    Args:
        trials: the stream.
        settings: of the tracker.
        tell: progress.
        real_time_s: seconds of the stream that are fed as they would arrive; 0 for none.
        reference_updates: of each of GTSAM's smoothers, which take up to a second each; 0 for none.
    """
    stream = LongStream(scene_of_another_process(trials), trials)
    latency = measure(stream, stream.setup, settings, lambda time: tell("stream", time / trials.seconds))
    real = None
    if real_time_s > 0:
        within = (sample for sample in stream if sample.time <= real_time_s)
        real = measure(within, stream.setup, settings, lambda time: tell("real time", time / real_time_s), True)
    references: tuple[ReferenceTime, ...] = ()
    if reference_updates:
        references = run_references(stream, stream.setup, settings, reference_updates, tell)
    return StreamLatency(trials, settings.lag_s, latency, real, references)


def measure(
    samples: Iterable[LiveSample], setup: LiveSetup, settings: LiveSettings, tell: Callable[[float], None],
    real_time: bool = False,
) -> Latency:  # fmt: skip
    """Push samples into a new tracker and look at the clocks.

    Args:
        samples: in the order of their times.
        setup: of the stream.
        settings: of the tracker.
        tell: progress, with the stream's time.
        real_time: wait for each sample's time; else all come as fast as they are taken.

    Raises:
        RecordingError: if there is no answer after the start.
    """
    tracker = FixedLagTracker(setup, settings)
    rows: list[tuple[float, float, float, float]] = []  # stream's time, wall, CPU, age; of each answer
    slowest: list[SlowUpdate] = []
    start: tuple[float, float, float] | None = None
    wall, cpu, total, begin = 0.0, 0.0, 0.0, perf_counter()
    for sample in samples:
        if real_time:
            sleep(max(0.0, begin + sample.time - perf_counter()))
        before = perf_counter(), thread_time()
        answers = tracker.push(sample)
        after = perf_counter(), thread_time()
        wall, cpu, total = wall + after[0] - before[0], cpu + after[1] - before[1], total + after[0] - before[0]
        if not answers:
            continue
        if start is None:
            start = wall, cpu, answers[-1].time
        else:
            age = after[0] - begin
            rows += [(one.time, wall / len(answers), cpu / len(answers), age - one.time) for one in answers]
            slowest = _with_slow(slowest, answers, wall / len(answers), cpu / len(answers))
        wall, cpu = 0.0, 0.0
        tell(answers[-1].time)
    if start is None or not rows:
        raise RecordingError("the stream is too short: expected answers after the start; ask for more seconds")
    time, seconds, cpu_seconds, age_s = np.array(rows).T
    frame, aged, caught = 1 / settings.frame_rate, None, None
    if real_time:
        in_time = np.flatnonzero(age_s <= CAUGHT_UP * frame)
        caught = float(time[in_time[0]] - start[2]) if len(in_time) else float("nan")
        aged = _quantiles(age_s[in_time[0] :]) if len(in_time) else _quantiles(age_s)
    return Latency(
        len(rows), frame, _quantiles(seconds), _quantiles(cpu_seconds), float(np.mean(seconds > frame)), *start, total,
        tuple(slowest), aged, caught,
    )  # fmt: skip


def _with_slow(slowest: list[SlowUpdate], answers: Sequence[LiveEstimate], wall: float, cpu: float) -> list[SlowUpdate]:
    said = tuple(sentence for one in answers for sentence in one.findings)
    slowest = [*slowest, SlowUpdate(answers[-1].time, wall, cpu, said)]
    return sorted(slowest, key=lambda one: -one.seconds)[:SLOWEST]


def _quantiles(values: np.ndarray) -> Quantiles:
    found = np.quantile(values, [0.5, 0.95, 0.99, 1.0])
    return dict(zip(("median", "95 %", "99 %", "worst"), found.tolist(), strict=True))


def latency_table(result: StreamLatency) -> str:
    """Markdown."""
    trials, latency = result.trials, result.latency
    lines = [
        f"Fixed-lag tracker, {trials.placement} at {trials.imu_rate:g} Hz, {trials.keypoints} at "
        f"{trials.video_rate:g} Hz, {trials.camera} camera, lag {result.lag_s:g} s: {latency.updates} updates of "
        f"{trials.seconds:g} s in {latency.total_s:.1f} s",
        "",
        "| ms per update | median | 95 % | 99 % | worst |",
        "|---|---:|---:|---:|---:|",
        _row("wall time", latency.seconds),
        _row("CPU time", latency.cpu_seconds),
    ]
    real = result.real_time
    if real is not None and real.age_s is not None:
        lines += [_row("wall time, fed in real time", real.seconds), _row("age of answers, in real time", real.age_s)]
    frame = 1e3 * latency.frame_s
    lines += [
        "",
        f"Longer than a frame ({frame:.1f} ms): {100 * latency.late:.2f} % of updates. Start: {latency.start_s:.2f} s "
        f"({latency.start_cpu_s:.2f} s of CPU), for {latency.first_s:.2f} s of stream.",
    ]
    if real is not None:
        lines += [f"In real time, answers came in time {real.caught_up_s:.2f} s after those of the start."]
    lines += ["", "| slowest at s | wall ms | CPU ms | said |", "|---:|---:|---:|---|"]
    lines += [
        f"| {one.time:.1f} | {1e3 * one.seconds:.1f} | {1e3 * one.cpu_seconds:.1f} | {'; '.join(one.findings)} |"
        for one in latency.slowest
    ]
    return "\n".join([*lines, *_reference_lines(result)]) + "\n"


def _row(name: str, seconds: Quantiles) -> str:
    return f"| {name} | {' | '.join(f'{1e3 * value:.2f}' for value in seconds.values())} |"


def _reference_lines(result: StreamLatency) -> list[str]:
    if not result.references:
        return []
    ours = result.references[0]
    lines = [
        "",
        "The smoother alone, on the same factors of the same frames (no association, no covariances):",
        "",
        "| smoother | updates | median ms | worst ms | CPU median ms | times ours (CPU) | differs by mm, at most |",
        "|---|---:|---:|---:|---:|---:|---:|",
    ]
    for one in result.references:
        lines.append(
            f"| {one.name} | {one.updates} | {1e3 * one.median_s:.2f} | {1e3 * one.worst_s:.2f} | "
            f"{1e3 * one.median_cpu_s:.2f} | {one.median_cpu_s / ours.median_cpu_s:.1f} | {1e3 * one.differs_m:.2f} |"
        )
    return lines


def latency_json(result: StreamLatency) -> str:
    """Everything measured, as JSON."""
    return json.dumps(asdict(result), indent=2) + "\n"
