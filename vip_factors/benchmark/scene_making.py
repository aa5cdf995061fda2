"""What the scenes are like that the association is trained on and measured by."""

from dataclasses import dataclass


@dataclass(frozen=True)
class SceneMaking:
    """What the scenes are like."""

    seconds: float = 10.0
    wearers: int = 2
    bystanders: tuple[int, int] = (3, 6)  # fewest and most
    tracker_deg: tuple[float, float] = (10.0, 15.0)  # of an inertial tracker's bones: sensors mounted by eye
    tracker_heading_deg: float = 4.0  # of each of its sensors
    stature_error: float = 0.02  # of the wearers' skeletons: measured in shoes, proportions of others
    fused_deg: tuple[float, float] = (2.0, 6.0)  # of bones after a first fusion
    fused_m: float = 0.06  # of the root after it
    path_deg: float = 0.7  # of the camera after it
    path_m: float = 0.06
    exits: float = 0.4  # share of wearers who are out of the picture for a while, or for good
