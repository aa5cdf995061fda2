"""What each of the benchmarks can be told on the command line."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from vip_factors.cli.options import Flag


@dataclass(frozen=True)
class SipOptions:
    """Six simulated sensors on the motions held out of the pose prior, beside the thesis's tables."""

    motions: Path
    """Folder of the CMU motions as BVH, searched with all folders below it."""
    json: Path | None = None
    """Also write everything to this file, as JSON."""
    overwrite: Flag = False
    """Replace the JSON file if it exists."""
    seconds: float = 8.0
    """Of each clip, from its middle."""
    seeds: int = 1
    """Recordings of each clip, each with other sensor errors."""
    pose_error_deg: float = 8.0
    """How imperfectly the T-pose before each clip is held, sigma of each joint and axis; it adds up along a limb."""
    frame_rate: float = 60.0
    """Frames per second of the reconstructions."""


@dataclass(frozen=True)
class VipOptions:
    """The thesis's video-inertial trackers on simulated scenes or on TotalCapture, beside its tables."""

    motions: Path | None = None
    """Folder of the CMU motions as BVH, searched with all folders below it."""
    totalcapture: Path | None = None
    """Folder of TotalCapture: its sequences are used instead of simulated scenes."""
    json: Path | None = None
    """Also write everything to this file, as JSON, after each recording."""
    overwrite: Flag = False
    """Replace the JSON file if it exists."""
    variants: tuple[str, ...] = ()
    """Names of trackers, such as IT VIP VIP-IT; all if absent."""
    clips: tuple[str, ...] = ()
    """Names of clips (or of TotalCapture's sequences); all if absent."""
    kinds: tuple[str, ...] = ()
    """Kinds of motion: walking, sport, acting, low; all if absent."""
    seconds: float = 8.0
    """Of each clip, from its middle."""
    seeds: int = 1
    """Recordings of each clip, each with other errors."""
    camera: Literal["fixed", "hand-held", "walking"] = "fixed"
    """What films."""
    pose_error_deg: float = 5.0
    """How imperfectly the T-pose before each clip is held, sigma of each joint and axis; it adds up along a limb."""
    frame_rate: float = 60.0
    """Frames per second of the reconstructions."""
    iterations: int = 30
    """At most, of each solve."""


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
class WalkOptions:
    """Seven real sensors on a walk with optical reference, beside Xsens MVN."""

    folder: Path
    """The folder xsens_vicon_walk, with raw_mtw, vicon and mvn in it."""
    json: Path | None = None
    """Also write everything to this file, as JSON."""
    overwrite: Flag = False
    """Replace the JSON file if it exists."""
