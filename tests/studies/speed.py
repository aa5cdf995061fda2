"""How long a reconstruction takes, by its stages, and how much memory it needs."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from time import perf_counter

from tests.studies.processes import apart, peak_memory
from tests.studies.study import MB, Study, Tell, table
from vip_factors.cli.options import Flag
from vip_factors.pipeline import smooth
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.scene import Scene
from vip_factors.settings import Settings
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording
from vip_factors.simulate.scene import Performer, simulate_scene
from vip_factors.simulate.scene_settings import SceneSettings
from vip_factors.simulate.staging import with_initial_pose

THESIS_S = 450.0  # 3.4.1: 1,000 frames of six sensors, 20 iterations in MATLAB, one core
HOLD_S = 2.0
AFTERWARDS = "how sure, and findings"
# Placement, whether a hand-held camera films, frames at 60 Hz; the last one for its memory.
RUNS = (
    ("sip6", False, 1000), ("totalcapture13", False, 1000), ("totalcapture13", True, 1000),
    ("totalcapture13", False, 10_000),
)  # fmt: skip


@dataclass(frozen=True)
class PipelineTime:
    """The whole pipeline on one wearer.

    Attributes:
        placement, filmed: which sensors, and whether a hand-held camera films.
        frames: of the estimate.
        recording_seconds: how long the recording lasts.
        seconds: of the pipeline.
        stages: seconds of each stage, in order, with the number of iterations of those that are solves.
        before, peak: resident memory in bytes: with the recording in memory, and of everything.
    """

    placement: str
    filmed: bool
    frames: int
    recording_seconds: float
    seconds: float
    stages: tuple[tuple[str, float, int], ...]
    before: int
    peak: int

    @property
    def name(self) -> str:
        return f"{self.placement}{' and a hand-held camera' if self.filmed else ''}, {self.frames} frames"


@dataclass(frozen=True, kw_only=True)
class Speed(Study):
    """Seconds by stage, and peak memory, on simulated walks."""

    quick: Flag = False
    """A few frames and iterations only."""

    def rows(self, tell: Tell) -> Iterator[PipelineTime]:
        for done, (placement, filmed, frames) in enumerate(RUNS[1:3] if self.quick else RUNS):
            tell("speed", done / len(RUNS))
            yield apart(timed, placement, filmed, 200 if self.quick else frames, 1 if self.quick else None)

    def tables(self, rows: Sequence[PipelineTime]) -> Iterator[str]:
        """All runs beside the thesis's time, then the stages of each."""
        lines: list[list[object]] = [
            [one.name, one.seconds, f"{one.seconds / one.recording_seconds:.2f}", f"{one.peak / MB:.0f}",
             f"{one.before / MB:.0f}"] for one in rows
        ]  # fmt: skip
        thesis = ["thesis, sip6, 1000 frames, 20 iterations", THESIS_S, "", "", ""]
        yield table(["", "s", "s a second", "peak memory MB", "of it before"], [*lines, thesis])
        for one in rows:
            yield f"By stage: {one.name}"
            yield table(["stage", "s", "iterations"], [[name, s, count or ""] for name, s, count in one.stages])


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


def timed(placement: str, filmed: bool, frames: int, iterations: int | None = None) -> PipelineTime:
    """The pipeline on a walk, in a process of its own; with fewer iterations than its settings' where told so."""
    settings = Settings()
    if iterations is not None:
        settings = replace(settings, solve=replace(settings.solve, max_iterations=iterations))
    motion = with_initial_pose(gestures((frames - 1) / settings.frame_rate - HOLD_S), "t-pose", HOLD_S)
    sensors = preset(placement, motion.skeleton)
    if filmed:
        scene = simulate_scene([Performer("wearer", motion, sensors, "t-pose")], SceneSettings(camera="hand-held"))
    else:
        scene = Scene("walk", (simulate_recording(motion, sensors, initial_pose="t-pose"),))
    before, clock, begin = peak_memory(), StageClock(), perf_counter()
    estimate = smooth(scene, settings, clock)
    clock(AFTERWARDS, 1.0)
    solves: dict[str, list[int]] = {}
    for report in (*estimate.reports, *(one for wearer in estimate.wearers for one in wearer.reports)):
        solves.setdefault(report.stage, []).append(len(report.iterations))
    stages = tuple((name, s, solves[name].pop(0) if solves.get(name) else 0) for name, s in clock.seconds)
    found, seconds = estimate.wearers[0].motion, perf_counter() - begin
    lasts = len(found) / found.rate
    return PipelineTime(placement, filmed, len(found), lasts, seconds, stages, before, peak_memory())
