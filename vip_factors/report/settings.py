"""Settings of the report."""

from dataclasses import dataclass
from typing import Annotated

from vip_factors.ranges import NotNegativeInt, Range, Rate, check_ranges
from vip_factors.viz.film_settings import FilmSettings


@dataclass(frozen=True)
class ReportSettings:
    """How much goes into the page.

    Attributes:
        rate: Hz, of the motion to turn around; as many frames as the estimate has at most.
        most_poses: frames times bodies that the page holds: of longer recordings the motion is shown at a lower rate.
        moments: how many of the least certain moments get a picture.
        video_height: pixels, of the film beside the page.
        video_seconds: first and last second of the recording that the film shows; all of it if not given.
    """

    rate: Rate = 30.0  # as films: faster is not seen, and would double the file
    most_poses: Annotated[int, Range(least=2)] = 9000  # 2.4 MB in the page: five minutes of one wearer at 30 Hz
    moments: NotNegativeInt = 4  # a row or two of pictures: 60 kB each
    video_height: int = 480  # fills the page's width beside the room; 720 takes half as long again
    video_seconds: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        check_ranges(self)
        assert self.film

    @property
    def film(self) -> FilmSettings:
        """Of the film beside the page."""
        return FilmSettings(self.video_height, video_seconds=self.video_seconds, video_skeleton=True)
