"""What a simulated 2D pose detector does wrong.

"Measured" below: OpenPose (BODY_25B) on the 4 cameras of Pose2Sim's balancing trial, 100 frames at 60 Hz, a person of
about 850 pixels, 8306 keypoints without the nose, against the reprojection of the 3D points triangulated from them
(errors times √(8/5), for what the triangulation took of them). With confidence above 0.3 and errors below 3 units:
0.51 units RMS an axis, 0.40 by the median (0.28 at hips, 0.6 at wrists; 1.2 to 1.7 % of stature at any keypoint);
autocorrelation 0.93 after one frame, 0.80 after 0.1 s, 0.71 after 0.2 s, 0.62 after 0.4 s, 0.58 after 0.75 s;
correlation −0.47 with confidence. The defaults give 0.52, 0.45 and −0.50 for a walker without swaps. A *unit* is a
keypoint's OKS sigma times the square root of the person's area in the image.
"""

from dataclasses import dataclass, fields, replace
from typing import Any

from vip_factors.ranges import RangeError

# The square root of a person's area in the image, over the height at which their whole stature would appear.
ROOT_AREA_PER_HEIGHT = 0.45  # COCO's areas are those of masks: a standing body fills about 0.2 of height squared


@dataclass(frozen=True)
class DetectorSettings:
    """Errors of a simulated detector; the defaults are those of :meth:`realistic`.

    Sizes of errors are in units (see above), so that they grow with the person in the image and are larger at hips
    than at eyes. Shares are shares of time; what happens, lasts for about its time constant. *Doubt* is how unsure
    the detector is of a keypoint, a slow random number, 0 if sure: confidence falls with ``exp(−doubt)`` and errors
    grow with ``1 + doubt_error · doubt``.
    """

    bias_m: float = 0.012  # each axis of the bone, constant for a person: a detector's idea of a hip differs by 1–2 cm
    # Each image axis: measured as the sum of what lasts (0.41 units with the bias, depending on pose and view), what
    # forgets (0.28), and what changes from frame to frame (0.10, second differences). The first two are taken by 0.7:
    # measured errors have long tails, which are doubt's here, and together they have the measured RMS again.
    drift_error: float = 0.26
    drift_time_s: float = 3.0  # measured, 0.3 to 0.75 s apart
    slow_error: float = 0.20
    slow_time_s: float = 0.14
    white_error: float = 0.10

    confidence: float = 0.64  # of a keypoint without doubt; measured median 0.63, 5 to 95 %: 0.38 to 0.71
    confidence_spread: float = 0.07  # lasting slow_time_s; measured within a keypoint 0.07, 0.47 of it after 0.1 s
    plain_doubt: float = -0.4  # mean of a keypoint in plain sight; below 0 is none: with this spread 16 % of the time
    hidden_doubt: float = 0.3  # behind the person's own body; measured confidence below 0.3 for 3 % of all keypoints
    behind_doubt: float = 1.2  # behind somebody else; ours: mostly a guess
    doubt_spread: float = 0.4
    doubt_time_s: float = 0.5  # ours: as long as limbs take to come forth
    # Measured RMS error by confidence: 0.65: 0.4 units, 0.45: 0.65, 0.35: 1.2, 0.25: 2.1, 0.15: 3.0, 0.05: 4.6.
    doubt_error: float = 4.0
    least_confidence: float = 0.05  # OpenPose's own default for drawing a keypoint

    missed: float = 0.005  # share of keypoints in plain sight not found; measured 0 to 2 % by camera, all keypoints
    hidden_missed: float = 0.05  # behind the person's own body: an open side of the trial's cameras
    behind_missed: float = 0.6  # behind somebody else; ours: detectors mostly leave them out
    # Left for right, arms or legs. Measured: 0.5 % of limb keypoints, nearly all knees. PoseFix
    # (Moon et al. 2019) trains with 3 % at arms and 6 % at legs for COCO's pictures. Between the two; by view is ours.
    swap_front: float = 0.005
    swap_side: float = 0.04
    swap_back: float = 0.02
    event_time_s: float = 0.25  # ours: bursts of several frames, as one sees them in OpenPose's videos

    # What follows is ours, to see what an estimator makes of it: no real recording of several people was measured.
    missed_person: float = 0.01  # share of time that a person in sight is not found
    least_keypoints: int = 4  # fewer do not make a person; OpenPose asks for 3 or 4
    least_height_px: float = 60.0  # of a person to be found; COCO's small people
    merge: float = 0.15  # share of the time two people overlap, that one detection has limbs of both
    exchange: float = 0.10  # share of that time, that both are found with limbs exchanged
    false_people: float = 0.03  # detections of nobody, per frame
    false_time_s: float = 0.5

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            positive = one.name.endswith("time_s")
            if one.name.endswith("_doubt"):
                continue
            if not (value > 0 if positive else value >= 0):
                wanted = "above 0" if positive else "0 or more"
                raise RangeError(f"detector.{one.name}", f"is {value:g}: expected {wanted}")
            if value > 1 and one.name in SHARES:
                raise RangeError(f"detector.{one.name}", f"is {value:g}: expected a share from 0 to 1")

    @classmethod
    def realistic(cls, **changes: Any) -> "DetectorSettings":
        """A detector such as OpenPose on ordinary video."""
        return cls(**changes)

    @classmethod
    def noise_free(cls, **changes: Any) -> "DetectorSettings":
        """Every keypoint inside the image, hidden or not, exactly where it is, with confidence one."""
        right = dict.fromkeys((*ERRORS, *SHARES), 0.0) | {"confidence": 1.0}
        right |= dict.fromkeys(("plain_doubt", "hidden_doubt", "behind_doubt"), 0.0)
        return replace(cls(**right, least_keypoints=1), **changes)


SHARES = (
    "confidence", "least_confidence", "missed", "hidden_missed", "behind_missed", "swap_front", "swap_side",
    "swap_back", "missed_person", "merge", "exchange",
)  # fmt: skip
ERRORS = (
    "bias_m", "drift_error", "slow_error", "white_error", "confidence_spread", "doubt_spread", "doubt_error",
    "false_people", "least_height_px",
)  # fmt: skip
