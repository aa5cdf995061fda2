"""Seconds and memory of a reconstruction and milliseconds of a stream's update, by what there is more or less of."""

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from operator import attrgetter
from pathlib import Path
from time import perf_counter, process_time, thread_time
from typing import Annotated

import numpy as np

from tests.studies.processes import apart, peak_memory
from tests.studies.study import MB, Study, Tell, columns, table
from vip_factors.cli.options import Flag, Output
from vip_factors.errors import RecordingError, VipFactorsError
from vip_factors.live.tracker import FixedLagTracker
from vip_factors.pipeline import smooth
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.live import LiveSample, live_samples, stream_head
from vip_factors.sensors.scene import Scene
from vip_factors.settings import LiveSettings, Settings
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording
from vip_factors.simulate.scene import Performer, simulate_scene
from vip_factors.simulate.settings import SceneSettings
from vip_factors.simulate.staging import from_time, placed, with_initial_pose

THESIS_S = 450.0  # 3.4.1: 1,000 frames of six sensors, 20 iterations in MATLAB, one core
HOLD_S = 2.0
APART_M = 1.2  # between people who stand side by side
LATER_S = 2.9  # that each is in the gestures behind the one before: who moves as another cannot be told
AFTERWARDS = "how sure, and findings"
PLACEMENTS = {6: "sip6", 13: "totalcapture13", 17: "mvn17"}
Quantiles = dict[str, float]
AXES = ("frames", "wearers", "strangers", "sensors", "cameras", "cores")


@dataclass(frozen=True)
class Load:
    """What is reconstructed: frames at 60 Hz, people with and without sensors, sensors of each, cameras (the first
    in somebody's hands, further ones on tripods), and the cores that may be used."""

    frames: int = 1000
    wearers: int = 1
    strangers: int = 0
    sensors: int = 13
    cameras: int = 1
    cores: int = 1


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
class LoadTime:
    """What one load took.

    Attributes:
        load: what there was of everything.
        recording_seconds: how long the recording lasts.
        seconds, cpu_seconds: of the pipeline.
        elimination: of it seconds in which linear systems were summed and eliminated.
        stages: seconds of each stage, in order, with the number of iterations of those that are solves.
        before, peak: resident memory in bytes: with the recording in memory, and of everything.
        stream: what updates of the same scene as a stream took; None if it was not fed.
        nothing: seconds of an update that does nothing: of samples that are only handed over.
    """

    load: Load
    recording_seconds: float
    seconds: float
    cpu_seconds: float
    elimination: float
    stages: tuple[tuple[str, float, int], ...]
    before: int
    peak: int
    stream: Latency | None = None
    nothing: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Speed(Study):
    """Seconds, memory and a stream's updates against length, wearers, sensors, cameras and cores, and their floors."""

    vary: tuple[str, ...] = ("frames", "wearers", "sensors", "cameras", "cores")
    """Of what there is more and less: frames, wearers, strangers, sensors, cameras, cores."""
    long: Flag = False
    """Also 10,000 and 100,000 frames."""
    stream: Flag = False
    """Also feed each scene to the tracker, sample by sample."""
    picture: Annotated[Path | None, Output()] = None
    """Draw the curves into this file."""
    quick: Flag = False
    """A few frames and iterations only."""

    def loads(self) -> list[Load]:
        """One thousand frames of one wearer, and what differs from it in one number."""
        values = {
            "frames": (1000, 10_000, 100_000) if self.long else (500, 1000, 2000),
            "wearers": (1, 2, 4),
            "strangers": (0, 3, 8),
            "sensors": tuple(PLACEMENTS),
            "cameras": (0, 1, 4),
            "cores": tuple(n for n in (1, 2, 4, 8) if n <= (os.cpu_count() or 1)),
        }
        loads = [replace(Load(), **{axis: value}) for axis in self.vary for value in values[axis]]
        return list(dict.fromkeys([Load(frames=200)] if self.quick else [Load(), *loads]))

    def rows(self, tell: Tell) -> Iterator[LoadTime]:
        loads = self.loads()
        for done, load in enumerate(loads):
            tell("speed", done / len(loads))
            yield apart(timed, load, 1 if self.quick else None, self.stream and load.cameras == 1)

    def tables(self, rows: Sequence[LoadTime]) -> Iterator[str]:
        """All loads beside the thesis's time, then the stages of each; the picture is drawn where one is asked for."""
        yield columns(rows, {
            **{axis: attrgetter(f"load.{axis}") for axis in AXES},
            "s": lambda one: one.seconds, "CPU s": lambda one: one.cpu_seconds,
            "of it elimination": lambda one: one.elimination, "memory MB": lambda one: f"{one.peak / MB:.0f}",
            "of it before": lambda one: f"{one.before / MB:.0f}",
        })  # fmt: skip
        yield f"The thesis took {THESIS_S:g} s for 20 iterations of 1,000 frames of six sensors without a camera."
        fed = [row for row in rows if row.stream is not None]
        if fed:
            yield table(
                ["stream", "nothing ms", "median ms", "95 %", "99 %", "worst"],
                [[_name(one.load), f"{1e3 * one.nothing:.3f}", *(f"{1e3 * value:.1f}" for value in _quantiles(one))]
                 for one in fed],
            )  # fmt: skip
        for row in rows:
            yield f"By stage: {_name(row.load)}"
            yield table(["stage", "s", "iterations"], [[name, s, count or ""] for name, s, count in row.stages])
        if self.picture is not None:
            draw(rows, self.picture)


def _name(load: Load) -> str:
    return ", ".join(f"{getattr(load, axis)} {axis}" for axis in AXES)


def _quantiles(one: LoadTime) -> list[float]:
    assert one.stream is not None
    return list(one.stream.cpu_seconds.values())


def draw(rows: Sequence[LoadTime], path: Path) -> None:
    """Curves of what was varied and the floors below: seconds, and milliseconds of updates where a stream was fed."""
    from matplotlib.figure import Figure

    base, curves = rows[0].load, list[tuple[str, list[LoadTime]]]()
    for axis in AXES:
        alike = [row for row in rows if replace(row.load, **{axis: getattr(base, axis)}) == base]
        if len(alike) > 1:
            curves.append((axis, sorted(alike, key=attrgetter(f"load.{axis}"))))
    fed, most = [row for row in rows if row.stream is not None], max(len(curves), 1)
    figure = Figure((3.2 * most, 6.4 if fed else 3.2), layout="constrained")
    panes = figure.subplots(2 if fed else 1, most, squeeze=False)
    top = max(row.seconds for row in rows if row.load.frames == base.frames)
    for pane, (axis, ones) in zip(panes[0], curves, strict=False):
        x = [getattr(one.load, axis) for one in ones]
        pane.plot(x, [one.seconds for one in ones], "o-", label="all")
        pane.plot(x, [one.elimination for one in ones], "s--", label="elimination alone")
        if axis == "frames" and max(x) > 20 * min(x):
            pane.set(xlabel=axis, xscale="log", yscale="log")
        else:  # one scale for all, to be compared
            pane.set(xlabel=axis, xticks=x, ylim=(0, None if axis == "frames" else 1.05 * top))
    for pane, (axis, ones) in zip(panes[-1] if fed else (), curves, strict=False):
        updates = [(getattr(one.load, axis), _quantiles(one), one.nothing) for one in ones if one.stream is not None]
        x = [value for value, *_ in updates]
        pane.plot(x, [1e3 * found[2] for _, found, _ in updates], "^-", label="99 %")
        pane.plot(x, [1e3 * found[0] for _, found, _ in updates], "o-", label="median")
        pane.plot(x, [1e3 * nothing for *_, nothing in updates], "s--", label="doing nothing")
        pane.set(xlabel=axis, xticks=x, ylim=(0, None))
    for pane, unit in zip(panes[:, 0], ("s", "ms of an update"), strict=False):
        pane.set_ylabel(unit)
        if curves:
            pane.legend(frameon=False)
    figure.savefig(path)


@dataclass
class StageClock:
    """A progress callback that knows how long each stage took; a stage that comes again is counted again."""

    seconds: list[tuple[str, float]] = field(default_factory=list)
    last: float = field(default_factory=perf_counter)

    def __call__(self, stage: str, fraction: float) -> None:
        """The time since the last call goes to ``stage``: stages report what they have done."""
        now, before = perf_counter(), 0.0
        if self.seconds and self.seconds[-1][0] == stage:
            before = self.seconds.pop()[1]
        self.seconds.append((stage, before + now - self.last))
        self.last = now


def scene_of(load: Load) -> Scene:
    """People who make gestures side by side, each somewhat later than the one before."""
    performers, people = list[Performer](), load.wearers + load.strangers
    seconds = (load.frames - 1) / Settings().frame_rate - HOLD_S
    for number in range(people):
        late = LATER_S * number
        motion = with_initial_pose(from_time(gestures(seconds + late), late), "t-pose", HOLD_S)
        motion = placed(motion, 0.4 * number,
                        (0.0, APART_M * (number - (people - 1) / 2)))  # fmt: skip
        sensors = preset(PLACEMENTS[load.sensors], motion.skeleton) if number < load.wearers else None
        performers.append(Performer(f"person{number + 1}", motion, sensors, "t-pose"))
    if not load.cameras:
        return Scene("gestures", tuple(
            simulate_recording(one.motion, one.placement, initial_pose="t-pose", seed=number)
            for number, one in enumerate(performers) if one.placement is not None
        ))  # fmt: skip
    return simulate_scene(performers, SceneSettings(camera="hand-held", cameras=load.cameras))


def timed(load: Load, iterations: int | None = None, stream: bool = False) -> LoadTime:
    """One load, in a process of its own; with fewer iterations than the settings' where told so."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: load.cores])
    settings = Settings()
    if iterations is not None:
        settings = replace(settings, solve=replace(settings.solve, max_iterations=iterations))
    scene = scene_of(load)
    before, clock, begin, cpu = peak_memory(), StageClock(), perf_counter(), process_time()
    estimate = smooth(scene, settings, clock)
    clock(AFTERWARDS, 1.0)
    seconds, cpu, peak = perf_counter() - begin, process_time() - cpu, peak_memory()
    solves, elimination = dict[str, list[int]](), 0.0
    for report in (*estimate.reports, *(report for wearer in estimate.wearers for report in wearer.reports)):
        solves.setdefault(report.stage, []).append(len(report.iterations))
        elimination += sum(iteration.seconds.get("eliminate", 0.0) for iteration in report.iterations)
    stages = tuple((name, s, solves[name].pop(0) if solves.get(name) else 0) for name, s in clock.seconds)
    found = estimate.wearers[0].motion
    updates = _streamed(scene) if stream else (None, 0.0)
    return LoadTime(load, len(found) / found.rate, seconds, cpu, elimination, stages, before, peak, *updates)


def _streamed(scene: Scene) -> tuple[Latency | None, float]:
    """What updates take, and what handing over the samples of one does."""
    samples, setup, settings = list(live_samples(scene)), stream_head(scene), LiveSettings()
    begin = process_time()
    for sample in samples:
        np.asarray(sample.time)
    frames = settings.frame_rate * (samples[-1].time - samples[0].time)
    nothing = (process_time() - begin) / frames
    try:
        return measure(samples, setup, settings, lambda time: None), nothing
    except VipFactorsError:  # too short for an answer
        return None, nothing


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
        wall += called if start is None or not answers else sum(answer.seconds for answer in answers)
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
    return Latency(len(rows), frame, _quantiles_of(seconds), _quantiles_of(cpu_seconds), late, *start, total)


def _quantiles_of(values: np.ndarray) -> Quantiles:
    found = np.quantile(values, [0.5, 0.95, 0.99, 1.0])
    return dict(zip(("median", "95 %", "99 %", "worst"), found.tolist(), strict=True))
