"""What is set of a film. Apart from what makes it: the command line shows it without NumPy."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from vip_factors.errors import InputError
from vip_factors.ranges import Range, check_ranges


@dataclass(frozen=True)
class FilmSettings:
    """Of films (--video)."""

    video_height: Annotated[int, Range(least=64, most=2160)] = 720
    """Height in pixels; the width follows. Small films for pages: 360 to 480."""
    video_rate: Annotated[float, Range(above=0, most=120)] = 30.0
    """Most frames per second: of a faster video every second or third frame is shown. 15 makes animated pictures
    (.gif, .webp) half as large."""
    video_seconds: tuple[float, float] | None = None
    """First and last second of the recording to show; all of it if not given."""
    video_opacity: Annotated[float, Range(above=0, most=1)] = 0.72
    """Of the bodies over the camera's picture: the person under them has to be seen."""
    video_skeleton: bool = False
    """Draw skeletons over the camera's picture, and over a plain ground where there is none, instead of bodies."""
    headings: Path | None = None
    """Live estimate of the same recording (vip-factors stream RECORDING --out …): how its headings settle is drawn
    beside the room."""

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.video_seconds is not None and not self.video_seconds[0] < self.video_seconds[1]:
            raise InputError(
                f"film from second {self.video_seconds[0]} to {self.video_seconds[1]}: expected a later end"
            )
