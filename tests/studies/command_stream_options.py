"""What the benchmarks of the fixed-lag tracker's speed can be told on the command line."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from vip_factors.cli.options import Flag


@dataclass(frozen=True)
class StreamLatencyOptions:
    """What an update of the fixed-lag tracker takes, beside GTSAM's own smoothers on the same factors."""

    json: Path | None = None
    """Also write everything to this file, as JSON."""
    overwrite: Flag = False
    """Replace the JSON file if it exists."""
    minutes: float = 10.0
    """Of the simulated stream: 13 IMUs at 60 Hz, 18 keypoints at 30 Hz."""
    scene_s: float = 60.0
    """Of the scene that is played forwards and backwards, with new noise."""
    camera: Literal["fixed", "hand-held", "walking"] = "hand-held"
    """What films."""
    lag: float = 0.25
    """Seconds by which smoothed poses come later."""
    real_time_s: float = 0.0
    """Also feed so many seconds as they would arrive, and measure how old answers are."""
    references: int = 30
    """Updates of each of GTSAM's smoothers, which take up to a second each; 0 for none."""


@dataclass(frozen=True)
class StreamHourOptions:
    """Whether an hour of tracking stays as fast and as small as it began."""

    json: Path | None = None
    """Also write everything to this file, as JSON, after each part."""
    overwrite: Flag = False
    """Replace the JSON file if it exists."""
    minutes: float = 60.0
    """Of the simulated stream: 13 IMUs at 60 Hz, 18 keypoints at 30 Hz."""
    part_minutes: float = 5.0
    """Between looks at clock and memory."""
    scene_s: float = 60.0
    """Of the scene that is played forwards and backwards, with new noise."""
    camera: Literal["fixed", "hand-held", "walking"] = "hand-held"
    """What films."""
    whole: Flag = False
    """The program in place of its tracker alone: in real time over the network, with its files and lines of JSON."""
    frame_rate: float = 60.0
    """Frames per second."""


@dataclass(frozen=True)
class LongOptions:
    """What memory and time a recording of hours takes, solved window by window: simulated, and written to disk."""

    json: Path | None = None
    """Also write everything to this file, as JSON."""
    overwrite: Flag = False
    """Replace the JSON file if it exists."""
    hours: float = 0.25
    """Of the simulated recording, of IMUs at 60 Hz; an hour takes half a GB of disk, with its estimate."""
    sensors: Literal["sip6", "tnt10", "totalcapture13", "mvn17"] = "totalcapture13"
    """Which sensors."""
    clip_s: float = 60.0
    """Of the clip that is played forwards and backwards, with new noise."""


@dataclass(frozen=True)
class StreamKillOptions:
    """What is left of the files of streams that are killed (SIGKILL) at random moments."""

    json: Path | None = None
    """Also write everything to this file, as JSON."""
    overwrite: Flag = False
    """Replace the JSON file if it exists."""
    kills: int = 50
    """How many."""
    seconds: float = 6.0
    """Of each stream, which runs in real time: one wearer of six sensors, 30 frames per second."""
    seed: int = 0
    """Of the moments."""


@dataclass(frozen=True)
class DiskFullOptions:
    """What streams do, and say, whose files cannot grow any more from random sizes on."""

    json: Path | None = None
    """Also write everything to this file, as JSON."""
    overwrite: Flag = False
    """Replace the JSON file if it exists."""
    streams: int = 50
    """How many."""
    seconds: float = 6.0
    """Of each stream: one wearer of six sensors, 30 frames per second."""
    seed: int = 0
    """Of the sizes."""


@dataclass(frozen=True)
class StreamSlowOptions:
    """What a stream does on a machine half as fast as it needs, for a while, and how soon it recovers (Linux)."""

    json: Path | None = None
    """Also write everything to this file, as JSON."""
    overwrite: Flag = False
    """Replace the JSON file if it exists."""
    seconds: float = 75.0
    """Of the simulated stream, in real time: 13 IMUs at 60 Hz, 18 keypoints at 30 Hz."""
    begin_s: float = 25.0
    """When the machine becomes slow."""
    end_s: float = 50.0
    """And when it is fast again."""
    share: float = 0.5
    """Of the processor time that the program took before, which it gets meanwhile."""
    frame_rate: float = 60.0
    """Frames per second."""
    camera: Literal["fixed", "hand-held", "walking"] = "hand-held"
    """What films."""
