"""How people are looked for and followed in a video."""

from dataclasses import dataclass

from vip_factors.errors import InputError


@dataclass(frozen=True)
class DetectSettings:
    """Thresholds and periods of detection.

    Attributes:
        least_score: of the person detector; less is looked at by the landmark model no more. MediaPipe's own.
        least_presence: of the landmark model, that its square shows a person. MediaPipe's own.
        search_s: seconds between searches for people who have come in; each costs as much as several people's frames.
        tile_levels: how often the search halves its squares: 0 sees the whole image only, in which people smaller than
            a fifth of it are missed; each level finds people of half the size, at about four times the cost.
        overlap: of two boxes of the person detector that show one person (intersection over union). MediaPipe's own.
        same_person: mean distance of two poses' landmarks, in sides of their squares, below which they are of one
            person: two people side by side are about a quarter apart, two poses of one person a twentieth.
        lost_s: seconds that a person may be out of sight and keep the track's number, if found about where lost.
        least_s: seconds that a track must last to be written: wrong finds last shorter, and help nobody.
    """

    least_score: float = 0.5
    least_presence: float = 0.5
    search_s: float = 0.5
    tile_levels: int = 2
    overlap: float = 0.3
    same_person: float = 0.1
    lost_s: float = 1.0
    least_s: float = 0.2

    def __post_init__(self) -> None:
        for name in ("least_score", "least_presence", "overlap"):
            if not 0 < getattr(self, name) < 1:
                raise InputError(f"{name} {getattr(self, name)}: expected a number between 0 and 1")
        for name in ("search_s", "same_person", "lost_s", "least_s"):
            if not getattr(self, name) >= 0:
                raise InputError(f"{name} {getattr(self, name)}: expected no negative number")
        if not 0 <= self.tile_levels <= 4:
            raise InputError(f"tile_levels {self.tile_levels}: expected 0 to 4")
