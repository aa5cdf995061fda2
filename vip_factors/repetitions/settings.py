"""What counts as a repetition."""

from dataclasses import dataclass


@dataclass(frozen=True)
class RepetitionSettings:
    """What counts as a repetition.

    The shortest times are the geometric mean of the longest that was seen of others that repeat (runs, kicks, boxing,
    dribbling, the ways into jumps) and the shortest of exercises; with any one recording left out, the limit that the
    others give still tells it.

    Attributes:
        least_depth: of a squat or lunge, in lengths of a leg.
        least_knee_deg: flexion of both knees at its lowest.
        lunge_apart: fore-aft distance of the ankles from which a squat is a lunge, in lengths of a leg.
        least_fall_s: that the body falls freely in a jump.
        least_curl_deg: range of the elbow.
        most_arm_deg: that the upper arm turns against the chest in a curl, and is away from hanging.
        least_dip_s, least_curl_s: that a squat or lunge, and a curl, is beyond half of its depth.
        alike: depth of a repetition beside that of a neighbour, at least, of the same kind.
        longest_pause_s: between two of a set.
    """

    least_depth: float = 0.12  # who walks sinks by 0.09 at most, shallow squats are 0.18 and deeper
    least_knee_deg: float = 45.0  # of a walker's two knees one is below 35; of squats both are above 60
    lunge_apart: float = 0.4  # squats 0.2 at most, lunges 0.6 and more
    least_fall_s: float = 0.23  # runs 0.16, a step with a kick 0.21, a jump of 12 cm 0.25
    least_curl_deg: float = 60.0  # half of a curl's range
    most_arm_deg: float = 45.0  # pouring and washing 48 and more, curls 20
    least_dip_s: float = 0.63  # before and after jumps, and boxers: 0.57 at most; quick squats 0.69 and more
    least_curl_s: float = 0.83  # dribbling 0.64 at most, curls 1.07 and more
    alike: float = 0.5  # people's repetitions differ by a third
    longest_pause_s: float = 5.0  # 2 within a set; two dips of a dancer or footballer lay 7 apart
