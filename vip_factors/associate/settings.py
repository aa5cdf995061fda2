"""Settings of the association, with reasons."""

from dataclasses import dataclass
from pathlib import Path

from vip_factors.errors import InputError
from vip_factors.ranges import NotNegative, NotNegativeInt, Share


@dataclass(frozen=True)
class AssociationSettings:
    """How detections are given to wearers."""

    gate: float = -5.0
    """Log-odds below which a hypothesis is not considered at all: one in 150."""
    rivals: NotNegativeInt = 3
    """Hypotheses kept per wearer and frame, the likeliest: the right one is hardly ever fourth."""
    inter_weight: NotNegative = 0.16
    """Weight of each edge between two frames: edges to neighbours tell nearly the same, so all of them together count
    like one."""
    intra_weight: NotNegative = 0.5
    """Weight of the edges between two wearers in a frame."""
    offsets: tuple[int, ...] = (1, 2, 4, 8, 16, 30)
    """Frames, at 30 per second, that edges span: up to a second (thesis 4.4.1), thinned as neighbours are alike."""
    window_s: float = 4.0
    """Seconds decided at once."""
    overlap_s: NotNegative = 1.2
    """Seconds decided again by the next window: more than the longest edge."""
    least_confidence: Share = 0.9
    """Choices less sure are dropped: a frame without a person costs little, a wrong person much."""
    least_choices: int = 3
    """Of a wearer who is surely seen in fewer frames, none is kept: a stranger moves alike for a moment."""
    by_place: bool = True
    """Where the camera is known, detections that are nobody's are given to whom they fit where they stand: half hidden
    people show too few joints to be told by how they move. Off: by motion alone."""
    by_clothes: bool = True
    """Where the recording was converted with its video, clothes count beside motion, as far as those of the surely
    found differ from others'. Off: motion alone."""
    check: bool = True
    """Whether it is told what is odd about detections: in another order, of nobody, of two who move alike. Streams find
    who is who again and again and tell none of it: a tenth of what their start takes."""
    weights: Path | None = None
    """Weights to use instead of the shipped ones."""

    def __post_init__(self) -> None:
        if self.rivals < 1 or not self.offsets or min(self.offsets) < 1:
            raise InputError("association: rivals and offsets must be at least 1")
        if not self.window_s > self.overlap_s >= 0:
            raise InputError(
                f"association: window of {self.window_s:g} s with overlap {self.overlap_s:g} s: must be longer"
            )
