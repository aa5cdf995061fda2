"""How long the fixed-lag tracker takes for an answer, on a stream of minutes; and GTSAM's own smoothers beside it."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from time import perf_counter, sleep

import numpy as np

from tests.studies.live_run import timed_answers
from tests.studies.long_stream import LongStream, LongStreamStudy, stream_scene
from tests.studies.processes import apart
from tests.studies.stream_references import ReferenceTime, run_references
from tests.studies.study import Tell, columns, table
from vip_factors.errors import RecordingError
from vip_factors.live.settings import LiveSettings
from vip_factors.live.tracker import FixedLagTracker
from vip_factors.live_estimate import LiveEstimate
from vip_factors.sensors.live import LiveSample
from vip_factors.sensors.scene import Scene

SLOWEST = 5  # updates that are shown one by one
CAUGHT_UP = 4.0  # frames: an answer no older than that came in time; sensors are a frame apart, windows another
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
        total_s: wall time of all calls up to the last answer.
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
    """Of the tracker, in real time if that was asked for, and of GTSAM's smoothers on some of the stream's factors."""

    latency: Latency
    real_time: Latency | None
    references: tuple[ReferenceTime, ...]


@dataclass(frozen=True, kw_only=True)
class Latencies(LongStreamStudy):
    """What an update of the fixed-lag tracker takes, beside GTSAM's own smoothers on the same factors."""

    lag: float = 0.25
    """Seconds by which smoothed poses come later."""
    real_time_s: float = 0.0
    """Also feed so many seconds as they would arrive, and measure how old answers are."""
    references: int = 30
    """Updates of each of GTSAM's smoothers, which take up to a second each; 0 for none."""

    def rows(self, tell: Tell) -> Iterator[StreamLatency]:
        stream, settings = LongStream(apart(stream_scene, self.stream), self.stream), LiveSettings(lag_s=self.lag)
        latency = measure(stream, stream.setup, settings, lambda time: tell("stream", time / self.stream.seconds))
        real = None
        if self.real_time_s > 0:
            within = (sample for sample in stream if sample.time <= self.real_time_s)
            real = measure(
                within, stream.setup, settings, lambda time: tell("real time", time / self.real_time_s), True
            )
        references: tuple[ReferenceTime, ...] = ()
        if self.references:
            references = run_references(stream, stream.setup, settings, self.references, tell)
        yield StreamLatency(latency, real, references)

    def tables(self, rows: Sequence[StreamLatency]) -> Iterator[str]:
        (result,) = rows
        stream, latency, real = self.stream, result.latency, result.real_time
        yield (
            f"Fixed-lag tracker, {stream.placement} at {stream.imu_rate:g} Hz, {stream.keypoints} at "
            f"{stream.video_rate:g} Hz, {stream.camera} camera, lag {self.lag:g} s: {latency.updates} updates of "
            f"{stream.seconds:g} s in {latency.total_s:.1f} s"
        )
        lines = {"wall time": latency.seconds, "CPU time": latency.cpu_seconds}
        if real is not None and real.age_s is not None:
            lines |= {"wall time, fed in real time": real.seconds, "age of answers, in real time": real.age_s}
        cells = [[name, *(f"{1e3 * value:.2f}" for value in quantiles.values())] for name, quantiles in lines.items()]
        yield table(["ms per update", "median", "95 %", "99 %", "worst"], cells)
        yield (
            f"Longer than a frame ({1e3 * latency.frame_s:.1f} ms): {100 * latency.late:.2f} % of updates. Start: "
            f"{latency.start_s:.2f} s ({latency.start_cpu_s:.2f} s of CPU), for {latency.first_s:.2f} s of stream."
        )
        if real is not None:
            yield f"In real time, answers came in time {real.caught_up_s:.2f} s after those of the start."
        yield columns(latency.slowest, {
            "slowest at s": lambda one: one.time, "wall ms": lambda one: 1e3 * one.seconds,
            "CPU ms": lambda one: 1e3 * one.cpu_seconds, "said": lambda one: "; ".join(one.findings),
        })  # fmt: skip
        if result.references:
            ours = result.references[0]
            yield "The smoother alone, on the same factors of the same frames (no association, no covariances):"
            yield columns(result.references, {
                "smoother": lambda one: one.name, "updates": lambda one: one.updates,
                "median ms": lambda one: f"{1e3 * one.median_s:.2f}",
                "worst ms": lambda one: f"{1e3 * one.worst_s:.2f}",
                "CPU median ms": lambda one: f"{1e3 * one.median_cpu_s:.2f}",
                "times ours (CPU)": lambda one: one.median_cpu_s / ours.median_cpu_s,
                "differs by mm, at most": lambda one: f"{1e3 * one.differs_m:.2f}",
            })  # fmt: skip


def measure(
    samples: Iterable[LiveSample], setup: Scene, settings: LiveSettings, tell: Callable[[float], None],
    real_time: bool = False,
) -> Latency:  # fmt: skip
    """Push samples into a new tracker and look at the clocks."""
    tracker = FixedLagTracker(setup, settings)
    rows: list[tuple[float, float, float, float]] = []  # stream's time, wall, CPU, age; of each answer
    slowest: list[SlowUpdate] = []
    start: tuple[float, float, float] | None = None
    total, begin = 0.0, perf_counter()
    for _, answers, wall, cpu in timed_answers(_when_due(samples, begin) if real_time else samples, tracker):
        age, total = perf_counter() - begin, total + wall
        if start is None:
            start = wall, cpu, answers[-1].time
        else:
            rows += [(one.time, wall / len(answers), cpu / len(answers), age - one.time) for one in answers]
            slowest = _with_slow(slowest, answers, wall / len(answers), cpu / len(answers))
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


def _when_due(samples: Iterable[LiveSample], begin: float) -> Iterator[LiveSample]:
    """Each sample so many seconds after ``begin`` as its time says."""
    for sample in samples:
        sleep(max(0.0, begin + sample.time - perf_counter()))
        yield sample


def _with_slow(slowest: list[SlowUpdate], answers: Sequence[LiveEstimate], wall: float, cpu: float) -> list[SlowUpdate]:
    said = tuple(sentence for one in answers for sentence in one.findings)
    slowest = [*slowest, SlowUpdate(answers[-1].time, wall, cpu, said)]
    return sorted(slowest, key=lambda one: -one.seconds)[:SLOWEST]


def _quantiles(values: np.ndarray) -> Quantiles:
    found = np.quantile(values, [0.5, 0.95, 0.99, 1.0])
    return dict(zip(("median", "95 %", "99 %", "worst"), found.tolist(), strict=True))
