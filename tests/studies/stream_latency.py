"""How long the fixed-lag tracker takes for an answer, on a stream of minutes; and GTSAM's own smoothers beside it."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from time import perf_counter, thread_time

import numpy as np

from tests.studies.long_stream import LongStream, LongStreamStudy, stream_scene
from tests.studies.processes import apart
from tests.studies.stream_references import ReferenceTime, run_references
from tests.studies.study import Tell, columns, table
from vip_factors.errors import RecordingError
from vip_factors.live.settings import LiveSettings
from vip_factors.live.tracker import FixedLagTracker
from vip_factors.sensors.live import LiveSample
from vip_factors.sensors.scene import Scene

Quantiles = dict[str, float]


@dataclass(frozen=True)
class Latency:
    """What updates took, with the samples before that gave no answer; not what a replay waits for.

    Attributes:
        updates: answers after the start.
        frame_s: seconds between frames.
        seconds, cpu_seconds: median, 95 %, 99 % and worst.
        late: share of updates that took longer than a frame, of wall time.
        start_s, start_cpu_s: the call that gave the first answer.
        first_s: the stream's time of the newest frame then.
        total_s: wall time of all calls up to the last answer.
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


@dataclass(frozen=True)
class StreamLatency:
    """Of the tracker, and of GTSAM's smoothers on some of the stream's factors."""

    latency: Latency
    references: tuple[ReferenceTime, ...]


@dataclass(frozen=True, kw_only=True)
class Latencies(LongStreamStudy):
    """What an update of the fixed-lag tracker takes, beside GTSAM's own smoothers on the same factors."""

    lag: float = 0.25
    """Seconds by which smoothed poses come later."""
    references: int = 30
    """Updates of each of GTSAM's smoothers, which take up to a second each; 0 for none."""

    def rows(self, tell: Tell) -> Iterator[StreamLatency]:
        stream, settings = LongStream(apart(stream_scene, self.stream), self.stream), LiveSettings(lag_s=self.lag)
        latency = measure(stream, stream.setup, settings, lambda time: tell("stream", time / self.stream.seconds))
        references: tuple[ReferenceTime, ...] = ()
        if self.references:
            references = run_references(stream, stream.setup, settings, self.references)
        yield StreamLatency(latency, references)

    def tables(self, rows: Sequence[StreamLatency]) -> Iterator[str]:
        (result,) = rows
        stream, latency = self.stream, result.latency
        yield (
            f"Fixed-lag tracker, {stream.placement} at {stream.imu_rate:g} Hz, {stream.keypoints} at "
            f"{stream.video_rate:g} Hz, {stream.camera} camera, lag {self.lag:g} s: {latency.updates} updates of "
            f"{stream.seconds:g} s in {latency.total_s:.1f} s"
        )
        lines = {"wall time": latency.seconds, "CPU time": latency.cpu_seconds}
        cells = [[name, *(f"{1e3 * value:.2f}" for value in quantiles.values())] for name, quantiles in lines.items()]
        yield table(["ms per update", "median", "95 %", "99 %", "worst"], cells)
        yield (
            f"Longer than a frame ({1e3 * latency.frame_s:.1f} ms): {100 * latency.late:.2f} % of updates. Start: "
            f"{latency.start_s:.2f} s ({latency.start_cpu_s:.2f} s of CPU), for {latency.first_s:.2f} s of stream."
        )
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
    samples: Iterable[LiveSample], setup: Scene, settings: LiveSettings, tell: Callable[[float], None]
) -> Latency:
    """Push samples into a new tracker and look at the clocks."""
    tracker, rows = FixedLagTracker(setup, settings), list[tuple[float, float]]()  # wall and CPU time of each answer
    start: tuple[float, float, float] | None = None
    total, wall, cpu = 0.0, 0.0, 0.0
    for sample in samples:
        before = perf_counter(), thread_time()
        answers = tracker.push(sample)
        called, cpu = perf_counter() - before[0], cpu + thread_time() - before[1]
        # What a replay waits for, which a stream does not, is left out of what answers say that they took.
        wall += called if start is None or not answers else sum(one.seconds for one in answers)
        if not answers:
            continue
        if start is None:
            start = wall, cpu, answers[-1].time
        else:
            rows += [(wall / len(answers), cpu / len(answers))] * len(answers)
        total, wall, cpu = total + wall, 0.0, 0.0
        tell(answers[-1].time)
    if start is None or not rows:
        raise RecordingError("the stream is too short: expected answers after the start; ask for more seconds")
    (seconds, cpu_seconds), frame = np.array(rows).T, 1 / settings.frame_rate
    late = float(np.mean(seconds > frame))
    return Latency(len(rows), frame, _quantiles(seconds), _quantiles(cpu_seconds), late, *start, total)


def _quantiles(values: np.ndarray) -> Quantiles:
    found = np.quantile(values, [0.5, 0.95, 0.99, 1.0])
    return dict(zip(("median", "95 %", "99 %", "worst"), found.tolist(), strict=True))
