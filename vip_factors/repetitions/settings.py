"""What counts as a repetition."""

from dataclasses import dataclass


@dataclass(frozen=True)
class RepetitionSettings:
    """How far, at least, a body goes in what counts as a repetition.

    Attributes:
        least_depth: of a squat or lunge, in lengths of a leg.
        least_knee_deg: flexion of both knees at its lowest.
        least_fall_s: that the body falls freely in a jump.
        least_curl_deg: range of the elbow.
    """

    least_depth: float = 0.12  # who walks sinks by 0.09 at most, shallow squats are 0.18 and deeper
    least_knee_deg: float = 45.0  # of a walker's two knees one is below 35; of squats both are above 60
    least_fall_s: float = 0.23  # runs 0.16, a step with a kick 0.21, a jump of 12 cm 0.25
    least_curl_deg: float = 60.0  # half of a curl's range
