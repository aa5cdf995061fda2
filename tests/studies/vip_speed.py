"""How long the whole of VIP takes, by stage, and how much memory: ``python -m`` this module and a number of frames.

Prints JSON. It is run in a process of its own, for that process's peak memory.
"""

import json
import subprocess
import sys
from dataclasses import dataclass, field, replace
from time import perf_counter

from tests.studies.peak_memory import peak_memory
from vip_factors.errors import InputError
from vip_factors.pipeline import smooth_scene
from vip_factors.sensors.placement import preset
from vip_factors.sensors.scene import Scene
from vip_factors.settings import Settings
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.scene import Performer, simulate_scene
from vip_factors.simulate.scene_settings import SceneSettings
from vip_factors.simulate.stance import with_initial_pose

POSE, HOLD_S = "t-pose", 2.0
PLACEMENT = "totalcapture13"
AFTERWARDS = "how sure, and findings"


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


@dataclass
class StageClock:
    """A progress callback that knows how long each stage took; a stage that comes again is counted again."""

    seconds: list[tuple[str, float]] = field(default_factory=list)
    last: float = field(default_factory=perf_counter)

    def __call__(self, stage: str, fraction: float) -> None:
        """The time since the last call goes to ``stage``: stages report what they have done."""
        now = perf_counter()
        before = 0.0
        if self.seconds and self.seconds[-1][0] == stage:
            before = self.seconds.pop()[1]
        self.seconds.append((stage, before + now - self.last))
        self.last = now


def filmed_walk(frames: int, rate: float) -> Scene:
    """A simulated walk of so many frames, filmed by hand."""
    motion = with_initial_pose(gestures((frames - 1) / rate - HOLD_S), POSE, HOLD_S)
    performer = Performer("wearer", motion, preset(PLACEMENT, motion.skeleton), POSE)
    return simulate_scene([performer], SceneSettings.realistic(camera="hand-held"))


def measure_vip(frames: int, max_iterations: int | None = None) -> VipTime:
    """Run the pipeline in a process of its own.

    Raises:
        InputError: if that process ends with an error.
    """
    command = [sys.executable, "-m", "tests.studies.vip_speed", str(frames)]
    command += [] if max_iterations is None else [str(max_iterations)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise InputError(f"the process that runs VIP failed: {done.stderr.strip().splitlines()[-1:]}")
    content = json.loads(done.stdout)
    return VipTime(**{**content, "stages": tuple(tuple(stage) for stage in content["stages"])})


def timed_vip(frames: int, settings: Settings) -> VipTime:
    """The pipeline in this process, whose peak memory may be of something else."""
    scene = filmed_walk(frames, settings.frame_rate)
    before, clock, begin = peak_memory(), StageClock(), perf_counter()
    estimate = smooth_scene(scene, settings, clock)
    clock(AFTERWARDS, 1.0)
    iterations: dict[str, list[int]] = {}
    for report in estimate.reports:
        iterations.setdefault(report.stage, []).append(len(report.iterations))
    stages = tuple(
        (stage, seconds, iterations[stage].pop(0) if iterations.get(stage) else 0) for stage, seconds in clock.seconds
    )
    motion = estimate.wearers[0].motion
    return VipTime(
        len(motion), len(motion) / motion.rate, perf_counter() - begin, stages, before, peak_memory()
    )  # fmt: skip


def vip_lines(time: VipTime) -> list[str]:
    """Markdown."""
    lines = [
        f"VIP, {PLACEMENT} and a hand-held camera: {time.frames} frames of {time.recording_seconds:.1f} s in "
        f"{time.seconds:.1f} s: {time.seconds / time.recording_seconds:.2f} times as long as the recording; "
        f"peak memory {time.peak / 1e6:.0f} MB, {time.before / 1e6:.0f} MB of it before",
        "",
        "| stage | s | iterations |",
        "|---|---:|---:|",
    ]
    return lines + [f"| {stage} | {seconds:.1f} | {count or ''} |" for stage, seconds, count in time.stages]


def _main(frames: int, max_iterations: int | None = None) -> None:
    settings = Settings()
    if max_iterations is not None:
        settings = replace(settings, solve=replace(settings.solve, max_iterations=max_iterations))
    print(json.dumps(vars(timed_vip(frames, settings))))


if __name__ == "__main__":
    _main(*(int(word) for word in sys.argv[1:]))
