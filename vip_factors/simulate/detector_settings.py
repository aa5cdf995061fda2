"""What a simulated 2D pose detector does wrong."""

from dataclasses import dataclass, fields, replace
from typing import Any

from vip_factors.errors import InputError

# The square root of a person's area in the image, over the height at which their whole stature would appear.
ROOT_AREA_PER_HEIGHT = 0.45  # COCO's areas are those of masks: a standing body fills about 0.2 of height squared


@dataclass(frozen=True)
class DetectorSettings:
    """Errors of a simulated detector; the defaults are those of :meth:`realistic`.

    Sizes of errors are multiples of a keypoint's OKS sigma times the square root of the person's area, so that they
    grow with the person in the image and are larger at hips than at eyes. Shares are shares of time; what happens,
    lasts for about its time constant.
    """

    bias_m: float = 0.012  # each axis of the bone, constant for a person: the detector's idea of the keypoint
    slow_error: float = 0.45  # each image axis, Gauss–Markov
    slow_time_s: float = 0.35  # its time constant
    white_error: float = 0.10  # each image axis, from frame to frame
    hidden_error: float = 2.0  # factor on both while a keypoint is hidden: the detector guesses

    confidence: float = 0.82  # of a keypoint in plain sight
    confidence_spread: float = 0.10  # of its slow variation
    confidence_slope: float = 0.08  # lost per unit of error, in the same multiples
    hidden_confidence: float = 0.6  # factor while hidden by the person's own body
    behind_confidence: float = 0.4  # factor while hidden by somebody else
    least_confidence: float = 0.05  # keypoints below are not reported

    missed: float = 0.01  # share of keypoints in plain sight not found
    hidden_missed: float = 0.15  # of those behind the person's own body
    behind_missed: float = 0.7  # of those behind somebody else
    swap_front: float = 0.003  # left and right exchanged, arms or legs, seen from the front
    swap_side: float = 0.03
    swap_back: float = 0.02
    event_time_s: float = 0.25  # how long such things last

    missed_person: float = 0.01  # share of time that a person in sight is not found
    least_keypoints: int = 4  # fewer do not make a person
    least_height_px: float = 60.0  # of a person to be found
    merge: float = 0.15  # share of the time two people overlap, that one detection has limbs of both
    exchange: float = 0.10  # share of that time, that both are found with a limb exchanged
    false_people: float = 0.03  # detections of nobody, per frame
    false_time_s: float = 0.5

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            positive = one.name.endswith("time_s")
            if not (value > 0 if positive else value >= 0):
                wanted = "above 0" if positive else "0 or more"
                raise InputError(f"detector setting {one.name} = {value:g}: expected {wanted}")
            if value > 1 and one.name in SHARES:
                raise InputError(f"detector setting {one.name} = {value:g}: expected a share from 0 to 1")

    @classmethod
    def realistic(cls, **changes: Any) -> "DetectorSettings":
        """A detector such as OpenPose on ordinary video."""
        return cls(**changes)

    @classmethod
    def noise_free(cls, **changes: Any) -> "DetectorSettings":
        """Every keypoint inside the image, hidden or not, exactly where it is, with confidence one."""
        right = {name: 0.0 for name in (*ERRORS, *SHARES)}
        right |= {"confidence": 1.0, "hidden_confidence": 1.0, "behind_confidence": 1.0, "hidden_error": 1.0}
        return replace(cls(**right, least_keypoints=1), **changes)


SHARES = (
    "confidence", "hidden_confidence", "behind_confidence", "least_confidence", "missed", "hidden_missed",
    "behind_missed", "swap_front", "swap_side", "swap_back", "missed_person", "merge", "exchange",
)  # fmt: skip
ERRORS = (
    "bias_m", "slow_error", "white_error", "confidence_spread", "confidence_slope", "false_people", "least_height_px"
)  # fmt: skip
