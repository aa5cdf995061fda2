"""Settings of the report."""

from dataclasses import dataclass
from typing import Annotated

from vip_factors.errors import InputError
from vip_factors.ranges import Range, check_ranges


@dataclass(frozen=True)
class ReportSettings:
    """The film beside the page.

    Attributes:
        video_height: pixels, of the film beside the page.
        video_seconds: first and last second of the recording that the film shows; all of it if not given.
    """

    video_height: Annotated[int, Range(least=64, most=2160)] = 480  # fills the page's width; 720 takes twice as long
    video_seconds: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.video_seconds is not None and not self.video_seconds[0] < self.video_seconds[1]:
            raise InputError(
                f"film from second {self.video_seconds[0]} to {self.video_seconds[1]}: expected a later end"
            )
