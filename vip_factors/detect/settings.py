"""How people are searched for in a video."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from vip_factors.ranges import NotNegative, Range, check_ranges


@dataclass(frozen=True)
class DetectSettings:
    """How people are searched for in a video, and by which models."""

    search_s: NotNegative = 0.5
    """Seconds between searches for people who have come in; each costs as much as several people's frames."""
    tile_levels: Annotated[int, Range(least=0, most=4)] = 2
    """How often the search halves its squares. 0 sees the whole image only, in which people smaller than a third of it
    are easily missed; each level finds people of half the size, at up to four times the cost."""
    model: Path | None = None
    """ONNX file of a top-down pose model such as RTMPose (SimCC rows or heat maps), for the keypoints of the people
    that BlazePose finds and follows."""
    keypoints: str | None = None
    """Keypoints of that model: coco17, halpe26 …; told by their number if absent."""
    blazepose: Path | None = None
    """Wheel of mediapipe 0.10.21, or a folder with pose_detection.tflite and pose_landmark_full.tflite; if absent, that
    wheel is fetched with pip, once, and the two files are kept in the user's cache."""
    start_s: float | None = None
    """Second of the video to begin at."""
    end_s: float | None = None
    """Second of the video to end at."""
    every: int = 1
    """Look at each n-th frame only; the others hold nobody."""
    threads: int | None = None
    """Of the processor; as many as there are, up to four, if absent."""

    def __post_init__(self) -> None:
        check_ranges(self)
