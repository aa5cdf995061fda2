"""Settings of the report."""

from dataclasses import dataclass
from typing import Annotated

from vip_factors.errors import InputError
from vip_factors.ranges import Range, Rate, check_ranges


@dataclass(frozen=True)
class ReportSettings:
    """How much goes into the page.

    Attributes:
        rate: Hz, of the motion to turn around; as many frames as the estimate has at most.
        most_poses: frames times bodies that the page holds: of longer recordings the motion is shown at a lower rate.
        video_height: pixels, of the film beside the page.
        video_seconds: first and last second of the recording that the film shows; all of it if not given.
    """

    rate: Rate = 30.0  # as films: faster is not seen, and would double the file
    most_poses: Annotated[int, Range(least=2)] = 9000  # 2.4 MB in the page: five minutes of one wearer at 30 Hz
    video_height: Annotated[int, Range(least=64, most=2160)] = 480  # fills the page's width; 720 takes twice as long
    video_seconds: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.video_seconds is not None and not self.video_seconds[0] < self.video_seconds[1]:
            raise InputError(
                f"film from second {self.video_seconds[0]} to {self.video_seconds[1]}: expected a later end"
            )
