"""Peak memory of one reconstruction, measured by the process that made it: ``python -m`` this module, frames, sensors.

Prints JSON: peak resident memory in bytes before and after solving.
"""

import json
import resource
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path

from vip_factors.errors import InputError
from vip_factors.pipeline import smooth
from vip_factors.sensors.placement import preset
from vip_factors.settings import Settings
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording
from vip_factors.simulate.stance import with_initial_pose

POSE, HOLD_S = "n-pose", 2.0
ITERATIONS = 2  # memory peaks in the first; the rest would only take time


@dataclass(frozen=True)
class PeakMemory:
    """Peak resident memory in bytes: with the recording in memory, and of everything."""

    frames: int
    sensors: int
    before: int
    peak: int


def measure_peak_memory(frames: int, placement: str) -> PeakMemory:
    """Solve a simulated recording of ``frames`` frames with the default pipeline, in a process of its own.

    Raises:
        InputError: if that process ends with an error.
    """
    command = [sys.executable, "-m", "tests.studies.peak_memory", str(frames), placement]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise InputError(f"the process that measures memory failed: {done.stderr.strip().splitlines()[-1:]}")
    return PeakMemory(**json.loads(done.stdout))


def peak_memory() -> int:
    """Peak resident memory of this process so far, bytes."""
    status = Path("/proc/self/status")
    if status.is_file():  # Linux: there ru_maxrss of a new process begins with its parent's
        line = next((line for line in status.read_text().splitlines() if line.startswith("VmHWM:")), None)
        if line is not None:
            return 1024 * int(line.split()[1])
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak  # macOS counts in bytes, others in KiB


def _main(frames: int, placement: str) -> None:
    defaults = Settings()
    settings = replace(defaults, solve=replace(defaults.solve, max_iterations=ITERATIONS))
    seconds = frames / settings.frame_rate - HOLD_S
    motion = with_initial_pose(gestures(seconds), POSE, HOLD_S)
    recording = simulate_recording(motion, preset(placement, motion.skeleton), initial_pose=POSE)
    before = peak_memory()
    estimate = smooth(recording, settings)
    result = {"frames": len(estimate.motion), "sensors": len(estimate.sensors), "before": before, "peak": peak_memory()}
    print(json.dumps(result))


if __name__ == "__main__":
    _main(int(sys.argv[1]), sys.argv[2])
