"""What the benchmarks of the fixed-lag tracker's accuracy can be told on the command line."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from vip_factors.cli.options import Flag


@dataclass(frozen=True)
class StreamAccuracyOptions:
    """The fixed-lag tracker beside the batch pipeline, by lag, camera and beginning, on simulated scenes."""

    motions: Path
    """Folder of the CMU motions as BVH, searched with all folders below it."""
    json: Path | None = None
    """Also write everything to this file, as JSON, after each estimate."""
    overwrite: Flag = False
    """Replace the JSON file if it exists."""
    lags: tuple[float, ...] = (0.1, 0.25, 0.5, 1.0)
    """Seconds by which smoothed poses come later, of scenes with a T-pose; without one it is 0.25."""
    cameras: tuple[Literal["fixed", "hand-held", "none"], ...] = ("fixed", "hand-held", "none")
    """What films."""
    begins: tuple[Literal["t-pose", "in-motion"], ...] = ("t-pose", "in-motion")
    """What the wearer does at first."""
    clips: tuple[str, ...] = ()
    """Names of clips; all if absent."""
    kinds: tuple[str, ...] = ()
    """Kinds of motion: walking, sport, acting, low; all if absent."""
    seconds: float = 8.0
    """Of each clip, from its middle."""
    seeds: int = 1
    """Recordings of each clip, each with other errors."""
    pose_error_deg: float = 4.0
    """How imperfectly the T-pose before each clip is held, sigma of each joint and axis; it adds up along a limb."""


@dataclass(frozen=True)
class KaichiOptions:
    """Table 1 and figure 4b of Kaichi et al. 2020 on simulated scenes: their estimators beside ours."""

    motions: Path
    """Folder of the CMU motions as BVH, searched with all folders below it."""
    json: Path | None = None
    """Also write everything to this file, as JSON, after each estimate."""
    overwrite: Flag = False
    """Replace the JSON file if it exists."""
    imus: tuple[int, ...] = (13, 12, 10, 8)
    """Numbers of IMUs: all, without that on the head, without upper arms, without thighs."""
    forms: tuple[Literal["imu", "no-contact", "unweighted", "full"], ...] = ("imu", "no-contact", "unweighted", "full")
    """What is used: IMUs alone, a camera without ground contact, without adaptive weights, everything."""
    ways: tuple[Literal["theirs", "theirs-live", "newest", "smoothed", "batch"], ...] = (
        "theirs", "theirs-live", "newest", "smoothed", "batch",
    )  # fmt: skip
    """Their estimator frame by frame, and in the live tracker; ours live with zero and full lag, and over whole
    recordings."""
    clips: tuple[str, ...] = ()
    """Names of clips; all if absent."""
    kinds: tuple[str, ...] = ()
    """Kinds of motion: walking, sport, acting, low; all if absent."""
    seconds: float = 8.0
    """Of each clip, from its middle."""
    seeds: int = 1
    """Recordings of each clip, each with other errors."""
    pose_error_deg: float = 1.5
    """How imperfectly the T-pose before each clip is held, sigma of each joint and axis; it adds up along a limb."""
