"""The settings that ``--help`` tells: the few of some hundreds that people change.

Each is declared here, once, and inherited by the settings that it belongs to: help need not import what those stand on.
"""

from dataclasses import dataclass
from typing import Literal

from vip_factors.ranges import Rate


@dataclass(frozen=True)
class ShownOfBoth:
    """Those of recordings and streams alike."""

    # Brisk motion has its power below 10 Hz.
    frame_rate: Rate = 60.0
    """Frames per second of the estimated motion."""


@dataclass(frozen=True)
class ShownSettings(ShownOfBoth):
    """The settings of recordings most often changed."""

    # Marginals cost about one more iteration a minute.
    covariance: bool = False
    """Also say how sure every joint of every frame is."""


@dataclass(frozen=True)
class ShownClock:
    """How the offset of clocks is looked for."""

    method: Literal["auto", "motion", "clap", "stamp"] = "auto"
    """How people move, an event, or whichever tells."""
    # What two people pressing buttons, or two clocks set by network, differ by.
    max_offset: float = 10.0
    """Seconds either way."""
