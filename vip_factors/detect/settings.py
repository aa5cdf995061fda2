"""How people are searched for in a video."""

from dataclasses import dataclass
from typing import Annotated

from vip_factors.ranges import NotNegative, Range, check_ranges


@dataclass(frozen=True)
class DetectSettings:
    """How people are searched for.

    Attributes:
        search_s: seconds between searches for people who have come in; each costs as much as several people's frames.
        tile_levels: how often the search halves its squares. 0 sees the whole image only, in which people smaller than
            a third of it are easily missed; each level finds people of half the size, at up to four times the cost.
    """

    search_s: NotNegative = 0.5
    tile_levels: Annotated[int, Range(least=0, most=4)] = 2

    def __post_init__(self) -> None:
        check_ranges(self)
