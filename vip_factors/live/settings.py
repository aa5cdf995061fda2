"""Settings of the fixed-lag tracker: those of the pipeline, and what only a stream needs."""

from dataclasses import dataclass, field

from vip_factors.live.assembly_settings import AssemblySettings
from vip_factors.live.association import OnlineAssociationSettings
from vip_factors.live.recalibration_settings import RecalibrationSettings
from vip_factors.live.slip_test import SlipSettings
from vip_factors.live.watch import WatchSettings
from vip_factors.problem.blocks import RELINEARISE_DEG, WanderSettings
from vip_factors.ranges import NotNegative, NotNegativeInt
from vip_factors.settings import CalibrationSettings, FusionSettings, Settings


@dataclass(frozen=True)
class RelinearisationSettings:
    """Which frames of the lag are linearised anew."""

    angle_deg: float = 1.0  # a joint that moved by less is linear to some thousandths
    length_m: float = 0.02
    shared_deg: float = RELINEARISE_DEG
    most: NotNegativeInt = 6  # frames at once, the newest: what an update may cost


@dataclass(frozen=True)
class LiveSettings(Settings):
    """All settings of a live session."""

    # A body does not show within the second that tracking begins with.
    calibration: CalibrationSettings = field(
        default_factory=lambda: CalibrationSettings(
            estimate_body=False,
            estimate_hinges=False,
            estimate_places=False,
            estimate_sole=False,
            estimate_keypoints=False,
        )
    )
    # The second of a start does not tell how clocks differ, and a stream takes its video's as it comes.
    fusion: FusionSettings = field(default_factory=lambda: FusionSettings(estimate_clock=False))
    lag_s: float = 0.25  # Kaichi's users and animators want answers within a blink
    camera_retry_s: float = 0.5  # until the first camera is looked for again that showed no wearer; then ever rarer
    start_s: float = 1.0  # of data before the first answer: a step or a gesture shows where the sensors point
    spread_share: NotNegative = (
        0.02  # of what one video frame says of how detections scatter: two seconds of them count
    )
    start_iterations: NotNegativeInt = 2  # over the first frames, from where the batch stages put them
    # Over which answers make up for what is believed anew of the past; else they tremble by some millimetres.
    answer_filter_s: NotNegative = 0.1
    # Frames to each update; those between are predicted, by how their sensors turned. Video comes 30 times a second.
    solve_every: int = 2
    covariance_every: int = 12  # frames between covariances of the smoothed pose, which cost 4 ms
    assembly: AssemblySettings = field(default_factory=AssemblySettings)
    online_association: OnlineAssociationSettings = field(default_factory=OnlineAssociationSettings)
    recalibration: RecalibrationSettings = field(default_factory=RecalibrationSettings)
    walk: WanderSettings = field(default_factory=WanderSettings)
    watch: WatchSettings = field(default_factory=WatchSettings)
    slip: SlipSettings = field(default_factory=SlipSettings)
    relinearisation: RelinearisationSettings = field(default_factory=RelinearisationSettings)
