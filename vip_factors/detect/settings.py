"""Settings of the detection of people in a video."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from vip_factors.ranges import NotNegative, Range, check_ranges


@dataclass(frozen=True)
class DetectSettings:
    """Settings of the detection of people in a video: frames, search and models."""

    search_s: NotNegative = 0.5
    """Seconds between searches for new people; each takes as long as several people's frames."""
    tile_levels: Annotated[int, Range(least=0, most=4)] = 2
    """Number of times the search halves its squares. 0 searches the whole image only, where people smaller than a third
    of it are easily missed; each level finds people of half the size, at up to four times the cost."""
    model: Path | None = None
    """ONNX file of a top-down pose model such as RTMPose (SimCC rows or heat maps), for the keypoints of the people
    that BlazePose detects and tracks."""
    keypoints: str | None = None
    """Keypoint set of that model: coco17, halpe26 …; chosen by their number if absent."""
    blazepose: Path | None = None
    """Wheel of mediapipe 0.10.21, or a folder with pose_detection.tflite and pose_landmark_full.tflite; if absent, the
    wheel is fetched with pip, once, and the two files are kept in the user's cache."""
    start_s: float | None = None
    """Second of the video at which to begin."""
    end_s: float | None = None
    """Second of the video at which to end."""
    every: int = 1
    """Process every n-th frame only; the others get no people."""
    threads: int | None = None
    """Number of processor threads; all processors, up to four, if absent."""

    def __post_init__(self) -> None:
        check_ranges(self)
