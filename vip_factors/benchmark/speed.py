"""How long an iteration takes, by its parts, and how much memory a reconstruction needs."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from vip_factors.benchmark.peak_memory import POSE, PeakMemory, measure_peak_memory
from vip_factors.benchmark.thesis import SECONDS_1000_FRAMES_20_ITERATIONS
from vip_factors.pipeline import smooth
from vip_factors.sensors.placement import preset
from vip_factors.settings import CalibrationSettings, Settings
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording
from vip_factors.simulate.stance import with_initial_pose

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

    @classmethod
    def quick(cls) -> "SpeedTrials":
        """Just enough to see that it runs."""
        return cls(240, 3, (240,))


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


def run_speed(trials: SpeedTrials | None = None, tell: Tell | None = None) -> Speed:
    """Time SIP with six and with 13 sensors on a simulated walk, then measure memory."""
    trials, told = trials or SpeedTrials(), tell or (lambda stage, fraction: None)
    steps = len(PLACEMENTS) + len(trials.memory_frames)
    solves, memory = [], []
    for done, placement in enumerate(PLACEMENTS):
        told("benchmark", done / steps)
        solves.append(_timed(placement, trials))
    for done, frames in enumerate(trials.memory_frames, start=len(PLACEMENTS)):
        told("benchmark", done / steps)
        memory.append(measure_peak_memory(frames, PLACEMENTS[-1]))
    return Speed(tuple(solves), tuple(memory))


def _timed(placement: str, trials: SpeedTrials) -> SolveTime:
    """The last solve of the pipeline, all variables at the full rate at once, with as many iterations as asked for."""
    defaults = Settings()
    solve = replace(defaults.solve, max_iterations=trials.iterations, relative_decrease=-1.0)  # never satisfied
    calibration = CalibrationSettings() if placement != "sip6" else CalibrationSettings(False, False)
    settings = replace(defaults, solve=solve, calibration=calibration, coarse_factor=1)
    motion = with_initial_pose(gestures(trials.frames / settings.frame_rate - HOLD_S), POSE, HOLD_S)
    recording = simulate_recording(motion, preset(placement, motion.skeleton), initial_pose=POSE)
    report = smooth(recording, settings).reports[-1]
    parts = {part: float(np.mean([one.seconds.get(part, 0.0) for one in report.iterations])) for part in PARTS}
    return SolveTime(placement, report.stage, trials.frames, len(report.iterations), report.seconds, parts)


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
    return "\n".join([*lines, "", *_memory_lines(speed.memory)]) + "\n"


def _memory_lines(memory: Sequence[PeakMemory]) -> list[str]:
    lines = ["| sensors | frames | peak memory MB | of it before solving MB |", "|---|---:|---:|---:|"]
    return lines + [f"| {m.sensors} | {m.frames} | {m.peak / 1e6:.0f} | {m.before / 1e6:.0f} |" for m in memory]


def speed_json(speed: Speed) -> str:
    """Everything measured, as JSON."""
    return json.dumps(asdict(speed), indent=2) + "\n"
