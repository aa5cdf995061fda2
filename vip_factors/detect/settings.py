"""Thresholds and periods of detection."""

from dataclasses import dataclass
from typing import Annotated

from vip_factors.ranges import NotNegative, Range, check_ranges

PositiveShare = Annotated[float, Range(above=0, most=1)]


@dataclass(frozen=True)
class DetectSettings:
    """Thresholds and periods of detection.

    Attributes:
        least_score: of the person detector's finds that the landmark model looks at. MediaPipe's own.
        least_presence: of the landmark model, that its square shows a person. MediaPipe's own.
        search_s: seconds between searches for people who have come in; each costs as much as several people's frames.
        tile_levels: how often the search halves its squares. 0 sees the whole image only, in which people smaller than
            a third of it are easily missed; each level finds people of half the size, at up to four times the cost.
        box_overlap: intersection over union of two boxes of the detector that show one person. MediaPipe's own.
        same_person: mean distance of two poses' landmarks, in sides of their squares, below which they are of one
            person. A side is 1.25 times a person's height and more, so this is a shoulder's width: nobody stands so
            near another without hiding him.
        lost_s: seconds that a person may be out of sight and keep the track's number, if found about where lost.
        least_s: seconds that a track must last to be written: wrong finds last shorter, and help nobody.
        turn_s: seconds in which nobody turns about: left and right that change within them are put right.
        chances: searches that may miss a new track before it is given up as nobody's: things that look like people to
            one search seldom do so to the next ones.
    """

    least_score: PositiveShare = 0.5
    least_presence: PositiveShare = 0.5
    search_s: NotNegative = 0.5
    tile_levels: Annotated[int, Range(least=0, most=4)] = 2
    box_overlap: PositiveShare = 0.3
    same_person: NotNegative = 0.1
    lost_s: NotNegative = 1.0
    least_s: NotNegative = 0.2
    turn_s: NotNegative = 0.25
    chances: Annotated[int, Range(least=1)] = 2

    def __post_init__(self) -> None:
        check_ranges(self)
