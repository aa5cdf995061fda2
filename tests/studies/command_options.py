"""What each of the benchmarks can be told on the command line."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from vip_factors.cli.options import Flag


@dataclass(frozen=True)
class SpeedOptions:
    """Seconds per iteration by part, and peak memory, on a simulated walk."""

    quick: Flag = False
    """A few frames and iterations only."""
    json: Path | None = None
    """Also write everything to this file, as JSON."""
    overwrite: Flag = False
    """Replace the JSON file if it exists."""


@dataclass(frozen=True)
class StreamFaultsOptions:
    """Live streams with samples lost, late or wrong: what it costs, and how soon all is good again."""

    motions: Path | None = None
    """Folder of motions, searched with all folders below it; the package's own gestures if absent."""
    clips: tuple[str, ...] = ()
    """Names of the motions' files, such as 07_02; with --motions only."""
    json: Path | None = None
    """Also write everything to this file, as JSON, second by second."""
    overwrite: Flag = False
    """Replace the JSON file if it exists."""
    seconds: float = 24.0
    """Of each stream, which begins with a T-pose of 2 s; clips are repeated."""
    fault_s: float = 8.0
    """When the faults begin, in seconds."""
    cameras: tuple[Literal["fixed", "hand-held", "walking"], ...] = ("fixed", "hand-held")
    """What films."""
    faults: tuple[str, ...] = ()
    """Parts of names of faults, such as 'lost', 'shank' or 'clock'; 'killed' for that of the program; all if absent."""
    processes: int = 1
    """Streams worked on side by side."""
    frame_rate: float = 60.0
    """Frames per second."""
    recalibration: Flag = True
    """Find calibrations anew in between, which takes most of the time."""
