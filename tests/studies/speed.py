"""How long an iteration takes, by its parts, all of VIP by its stages, and how much memory a reconstruction needs."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from time import perf_counter

import numpy as np

from tests.studies.processes import apart, peak_memory
from tests.studies.study import MB, Study, Tell, table
from vip_factors.assembly.objective import WearerObjective
from vip_factors.cli.options import Flag
from vip_factors.pipeline import smooth
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.frames import resample
from vip_factors.sensors.recording import Recording
from vip_factors.settings import CalibrationSettings, Settings
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording
from vip_factors.simulate.scene import Performer, simulate_scene
from vip_factors.simulate.scene_settings import SceneSettings
from vip_factors.simulate.staging import with_initial_pose
from vip_factors.solve.elimination import eliminate
from vip_factors.solve.levenberg_marquardt import Objective, State
from vip_factors.stages.inertial import inertial_tracker
from vip_factors.stages.inertial_model import with_contacts
from vip_factors.stages.solver import Solver

PLACEMENTS = ("sip6", "totalcapture13")
SECONDS_1000_FRAMES_20_ITERATIONS = 450.0  # thesis, 3.4.1: MATLAB, one core, six sensors
PARTS = ("linearise", "eliminate", "evaluate")
# Of a graph of this size whose arithmetic costs nothing: GTSAM's linear solve and its callbacks into Python.
FLOOR_MS_PER_FRAME = {"eliminate": 1.0, "linearise": 0.6}
HOLD_S = 2.0
MEMORY_ITERATIONS = 2  # memory peaks in the first; the rest would only take time
AFTERWARDS = "how sure, and findings"


@dataclass(frozen=True)
class SolveTime:
    """One solve: seconds in all, and per iteration by part (mean)."""

    placement: str
    frames: int
    iterations: int
    seconds: float
    seconds_per_iteration: dict[str, float]


@dataclass(frozen=True)
class VipTime:
    """The whole pipeline on one wearer of 13 sensors before a hand-held camera.

    Attributes:
        frames: of the estimate.
        recording_seconds: how long the recording lasts.
        seconds: of the pipeline.
        stages: seconds of each stage, in order, with the number of iterations of those that are solves.
        before, peak: resident memory in bytes: with the scene in memory, and of everything.
    """

    frames: int
    recording_seconds: float
    seconds: float
    stages: tuple[tuple[str, float, int], ...]
    before: int
    peak: int


@dataclass(frozen=True)
class PeakMemory:
    """Peak resident memory in bytes: with the recording in memory, and of everything."""

    frames: int
    sensors: int
    before: int
    peak: int


@dataclass(frozen=True, kw_only=True)
class Speed(Study):
    """Seconds per iteration by part, and peak memory, on a simulated walk."""

    quick: Flag = False
    """A few frames and iterations only."""

    def rows(self, tell: Tell) -> Iterator[SolveTime | VipTime | PeakMemory]:
        """SIP with six and with 13 sensors, forced to so many iterations as the thesis (3.4.1); VIP; memory."""
        frames, iterations = (200, 2) if self.quick else (1000, 20)
        for done, placement in enumerate(PLACEMENTS):
            tell("speed", done / 5)
            yield timed_solve(placement, frames, iterations)
        tell("speed", 2 / 5)
        yield apart(timed_vip, frames, 1 if self.quick else None)
        for done, count in enumerate((200,) if self.quick else (1000, 10_000)):
            tell("speed", (3 + done) / 5)
            yield apart(measured_memory, count, PLACEMENTS[-1])

    def tables(self, rows: Sequence[SolveTime | VipTime | PeakMemory]) -> Iterator[str]:
        """Beside the thesis's time and the floor."""
        head = [
            "sensors",
            "frames",
            "iterations",
            "total s",
            *(f"{part} s/it" for part in PARTS),
            "ms per frame and it",
        ]
        lines: list[list[object]] = []
        for one in rows:
            if isinstance(one, SolveTime):
                parts = [one.seconds_per_iteration[part] for part in PARTS]
                cells = (f"{part:.3f}" for part in parts)
                each = f"{1e3 * sum(parts) / one.frames:.2f}"
                lines.append([one.placement, one.frames, one.iterations, one.seconds, *cells, each])
        theirs, floor = SECONDS_1000_FRAMES_20_ITERATIONS, FLOOR_MS_PER_FRAME
        lines.append(["thesis, sip6", 1000, 20, f"{theirs:.0f}", "", "", "", f"{1e3 * theirs / 20_000:.2f}"])
        both = (f"{floor[part]:.3f}" for part in PARTS[:2])
        lines.append(["floor", 1000, 20, f"{20 * sum(floor.values()):.0f}", *both, "", f"{sum(floor.values()):.2f}"])
        yield table(head, lines)
        yield "The floor is GTSAM's: its linear solve, and its callbacks without arithmetic."
        for vip in (one for one in rows if isinstance(one, VipTime)):
            yield (
                f"VIP, {PLACEMENTS[-1]} and a hand-held camera: {vip.frames} frames of {vip.recording_seconds:.1f} s "
                f"in {vip.seconds:.1f} s: {vip.seconds / vip.recording_seconds:.2f} times as long as the recording; "
                f"peak memory {vip.peak / MB:.0f} MB, {vip.before / MB:.0f} MB of it before"
            )
            yield table(["stage", "s", "iterations"], [[name, s, count or ""] for name, s, count in vip.stages])
        memory = [one for one in rows if isinstance(one, PeakMemory)]
        cells_of = ([m.sensors, m.frames, f"{m.peak / MB:.0f}", f"{m.before / MB:.0f}"] for m in memory)
        yield table(["sensors", "frames", "peak memory MB", "of it before solving MB"], cells_of)


def _walk(frames: float, rate: float, placement: str) -> Recording:
    motion = with_initial_pose(gestures(frames / rate - HOLD_S), "n-pose", HOLD_S)
    return simulate_recording(motion, preset(placement, motion.skeleton), initial_pose="n-pose")


def timed_solve(placement: str, frames: int, iterations: int) -> SolveTime:
    """All variables of SIP at the full rate at once, for as many rounds as asked for."""
    settings = Settings()
    recording = _walk(frames, settings.frame_rate, placement)
    # The six of SIP wear their true calibration, as in the thesis; that of 13 sensors is estimated.
    six = placement == "sip6"
    settings = replace(settings, calibration=CalibrationSettings(not six, not six, from_truth=six))
    streams = resample(recording, settings.frame_rate)
    tracked = inertial_tracker(recording, streams, settings, Solver(settings.solve, lambda stage, fraction: None))
    model = with_contacts(tracked.model, tracked.state)
    rounds = timed_rounds(WearerObjective(model), tracked.state, iterations, settings.solve.initial_damping)
    parts = {part: float(np.mean([one[part] for one in rounds])) for part in PARTS}
    return SolveTime(placement, len(streams), len(rounds), sum(sum(one.values()) for one in rounds), parts)


def timed_rounds(objective: Objective[State], state: State, count: int, damping: float) -> list[dict[str, float]]:
    """Seconds by part of so many rounds of linearising, eliminating and evaluating, with the damping as it is.

    A step that does not lower the cost is not taken, and its round counts all the same: what is measured is the work
    of an iteration, not how many a start needs.
    """
    rounds = []
    cost = sum(objective.cost(state).values())
    for _ in range(count):
        laps = [perf_counter()]
        system = objective.linearise(state)
        laps.append(perf_counter())
        delta = eliminate(system.stretches(damping)).optimize()
        laps.append(perf_counter())
        candidate = objective.retract(state, delta)
        after = sum(objective.cost(candidate).values())
        laps.append(perf_counter())
        rounds.append(dict(zip(PARTS, np.diff(laps).tolist(), strict=True)))
        if after < cost:
            state, cost = candidate, after
    return rounds


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


def _limited(iterations: int | None) -> Settings:
    settings = Settings()
    return settings if iterations is None else replace(
        settings, solve=replace(settings.solve, max_iterations=iterations)
    )  # fmt: skip


def timed_vip(frames: int, iterations: int | None = None) -> VipTime:
    """The pipeline on a filmed walk, in a process of its own."""
    settings = _limited(iterations)
    motion = with_initial_pose(gestures((frames - 1) / settings.frame_rate - HOLD_S), "t-pose", HOLD_S)
    performer = Performer("wearer", motion, preset(PLACEMENTS[-1], motion.skeleton), "t-pose")
    scene = simulate_scene([performer], SceneSettings(camera="hand-held"))
    before, clock, begin = peak_memory(), StageClock(), perf_counter()
    estimate = smooth(scene, settings, clock)
    clock(AFTERWARDS, 1.0)
    solves: dict[str, list[int]] = {}
    for report in estimate.reports:
        solves.setdefault(report.stage, []).append(len(report.iterations))
    stages = tuple((name, s, solves[name].pop(0) if solves.get(name) else 0) for name, s in clock.seconds)
    found = estimate.wearers[0].motion
    return VipTime(len(found), len(found) / found.rate, perf_counter() - begin, stages, before, peak_memory())


def measured_memory(frames: int, placement: str) -> PeakMemory:
    """Of the default pipeline on a simulated recording, in a process of its own."""
    settings = _limited(MEMORY_ITERATIONS)
    recording, before = _walk(frames, settings.frame_rate, placement), peak_memory()
    estimate = smooth(recording, settings).only_wearer
    return PeakMemory(len(estimate.motion), len(estimate.sensors), before, peak_memory())
