"""How long an iteration takes, by its parts, and how much memory a reconstruction needs."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from time import perf_counter

import numpy as np

from tests.studies.peak_memory import POSE, PeakMemory, measure_peak_memory
from tests.studies.thesis import SECONDS_1000_FRAMES_20_ITERATIONS
from tests.studies.vip_speed import VipTime, measure_vip, vip_lines
from vip_factors.assembly.objective import WearerObjective
from vip_factors.sensors.frames import resample
from vip_factors.sensors.placement import preset
from vip_factors.settings import CalibrationSettings, Settings
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording
from vip_factors.simulate.stance import with_initial_pose
from vip_factors.solve.chain import eliminate
from vip_factors.solve.levenberg_marquardt import Objective, State
from vip_factors.stages.inertial import inertial_tracker
from vip_factors.stages.inertial_model import with_contacts
from vip_factors.stages.solver import Solver

PLACEMENTS = ("sip6", "totalcapture13")
PARTS = ("linearise", "eliminate", "evaluate")
# Of a graph of this size whose arithmetic costs nothing: GTSAM's linear solve and its callbacks into Python.
FLOOR_MS_PER_FRAME = {"eliminate": 1.0, "linearise": 0.6}
HOLD_S = 2.0
Tell = Callable[[str, float], None]


@dataclass(frozen=True)
class SpeedTrials:
    """How much is run."""

    frames: int = 1000  # as the thesis (3.4.1)
    iterations: int = 20  # forced, converged or not: as the thesis
    memory_frames: tuple[int, ...] = (1000, 10_000)
    vip_frames: int = 1000
    vip_iterations: int | None = None  # at most, of each solve; None: as the pipeline does by default

    @classmethod
    def quick(cls) -> "SpeedTrials":
        """Just enough to see that it runs."""
        return cls(200, 2, (200,), 200, 1)


@dataclass(frozen=True)
class SolveTime:
    """One solve: seconds in all, and per iteration by part (mean)."""

    placement: str
    stage: str
    frames: int
    iterations: int
    seconds: float
    seconds_per_iteration: dict[str, float]


@dataclass(frozen=True)
class Speed:
    """Everything measured."""

    solves: tuple[SolveTime, ...]
    memory: tuple[PeakMemory, ...]
    vip: VipTime | None = None


def run_speed(trials: SpeedTrials | None = None, tell: Tell | None = None) -> Speed:
    """Time SIP with six and with 13 sensors on a simulated walk, then VIP by stage, then measure memory."""
    trials, told = trials or SpeedTrials(), tell or (lambda stage, fraction: None)
    steps = len(PLACEMENTS) + 1 + len(trials.memory_frames)
    solves, memory = [], []
    for done, placement in enumerate(PLACEMENTS):
        told("benchmark", done / steps)
        solves.append(_timed(placement, trials))
    told("benchmark", len(PLACEMENTS) / steps)
    vip = measure_vip(trials.vip_frames, trials.vip_iterations)
    for done, frames in enumerate(trials.memory_frames, start=len(PLACEMENTS) + 1):
        told("benchmark", done / steps)
        memory.append(measure_peak_memory(frames, PLACEMENTS[-1]))
    return Speed(tuple(solves), tuple(memory), vip)


def _timed(placement: str, trials: SpeedTrials) -> SolveTime:
    """All variables of SIP at the full rate at once, for as many rounds as asked for."""
    settings = Settings()
    motion = with_initial_pose(gestures(trials.frames / settings.frame_rate - HOLD_S), POSE, HOLD_S)
    recording = simulate_recording(motion, preset(placement, motion.skeleton), initial_pose=POSE)
    # The six of SIP wear their true calibration, as in the thesis; that of 13 sensors is estimated.
    six = placement == "sip6"
    calibration = CalibrationSettings(not six, not six, from_truth=six)
    settings = replace(settings, calibration=calibration)
    frames = resample(recording, settings.frame_rate)
    tracked = inertial_tracker(recording, frames, settings, Solver(settings.solve, lambda stage, fraction: None))
    model = with_contacts(tracked.model, tracked.state)
    rounds = timed_rounds(WearerObjective(model), tracked.state, trials.iterations, settings.solve.initial_damping)
    parts = {part: float(np.mean([one[part] for one in rounds])) for part in PARTS}
    total = sum(sum(one.values()) for one in rounds)
    return SolveTime(placement, "sparse inertial poser", len(frames), len(rounds), total, parts)


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


def speed_table(speed: Speed) -> str:
    """Markdown, beside the thesis's time and the floor."""
    head = ["sensors", "frames", "iterations", "total s", *(f"{part} s/it" for part in PARTS), "ms per frame and it"]
    lines = [f"| {' | '.join(head)} |", "|---|" + "---:|" * (len(head) - 1)]
    for one in speed.solves:
        per_iteration = sum(one.seconds_per_iteration.values())
        parts = [f"{one.seconds_per_iteration[part]:.3f}" for part in PARTS]
        cells = [one.placement, str(one.frames), str(one.iterations), f"{one.seconds:.1f}", *parts]
        lines.append(f"| {' | '.join(cells)} | {1e3 * per_iteration / one.frames:.2f} |")
    lines += [
        f"| thesis, sip6 | 1000 | 20 | {SECONDS_1000_FRAMES_20_ITERATIONS:.0f} | | | | "
        f"{1e3 * SECONDS_1000_FRAMES_20_ITERATIONS / 20_000:.2f} |",
        f"| floor | 1000 | 20 | {20 * sum(FLOOR_MS_PER_FRAME.values()):.0f} | "
        f"{FLOOR_MS_PER_FRAME['linearise']:.3f} | {FLOOR_MS_PER_FRAME['eliminate']:.3f} | | "
        f"{sum(FLOOR_MS_PER_FRAME.values()):.2f} |",
        "",
        "The floor is GTSAM's: its linear solve, and its callbacks without arithmetic.",
    ]
    vip = [] if speed.vip is None else ["", *vip_lines(speed.vip)]
    return "\n".join([*lines, *vip, "", *_memory_lines(speed.memory)]) + "\n"


def _memory_lines(memory: Sequence[PeakMemory]) -> list[str]:
    lines = ["| sensors | frames | peak memory MB | of it before solving MB |", "|---|---:|---:|---:|"]
    return lines + [f"| {m.sensors} | {m.frames} | {m.peak / 1e6:.0f} | {m.before / 1e6:.0f} |" for m in memory]


def speed_json(speed: Speed) -> str:
    """Everything measured, as JSON."""
    return json.dumps(asdict(speed), indent=2) + "\n"
