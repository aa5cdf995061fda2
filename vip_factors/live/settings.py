"""Settings of the fixed-lag tracker: those of the pipeline, and what only a stream needs, with reasons."""

from dataclasses import dataclass, field, fields

from vip_factors.associate.settings import AssociationSettings
from vip_factors.errors import InputError
from vip_factors.problem.variables import RELINEARISE_DEG, ProcessNoiseSettings
from vip_factors.ranges import NotNegative, NotNegativeInt, Share
from vip_factors.settings import CalibrationSettings, CommonSettings, FusionSettings


@dataclass(frozen=True)
class AssemblySettings:
    """Waiting, silences, clocks; all in seconds of the stream's own time."""

    # Before the first frame: sensors switched on together have all begun by then (radio links take 0.1 s), and the
    # tracker wants a second of samples before its first pose anyway.
    settle: NotNegative = 0.5
    # A frame waits so long for a sensor that has fallen behind the others: three packets at 60 Hz, which is what
    # radio links repeat; a fifth of the lag of a quarter of a second. Sensors slower than 20 Hz need a longer one.
    patience: NotNegative = 0.05
    # A sensor's sample counts as arrived in order, once a sample so much newer has arrived: 0, because TCP, files and
    # drivers keep the order of each sensor. Of sources over UDP, one frame or more: all answers are so much later.
    reordering: NotNegative = 0.0
    # Without a sample for so long a sensor is no longer waited for: longer than a body blocks the radio (0.25 s).
    dead_after: float = 1.0
    # A silence of all sensors: after a longer one nobody knows where the wearers are, and tracking begins anew.
    longest_pause: float = 2.5
    # A step of a clock, between sources or ahead of all others, that no delay explains.
    jump: float = 1.0
    # A smaller one, of a sensor that was there: back behind its own newest sample, as packets seldom overtake one
    # another by more than three, or ahead of it and of all others. Less shows in nothing but the poses.
    step: float = 0.2
    # Samples from such a clock, in a row, after which it is believed to have started again: a lone bad stamp never
    # lasts, and a sensor switched off and on is back within the second.
    restart_after: float = 0.5
    # The same finding about the same sensor is told at most so often.
    repeat_after: float = 10.0

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            zero_allowed = one.name in ("settle", "reordering", "repeat_after")
            if not (0 <= value < float("inf")) or (value == 0 and not zero_allowed):
                raise InputError(
                    f"assembly setting {one.name} = {value:g} s: expected a finite number, "
                    + ("0 or more" if zero_allowed else "above 0")
                )
        if not self.patience <= self.dead_after <= self.longest_pause:
            raise InputError(
                f"assembly settings: patience {self.patience:g} s, dead_after {self.dead_after:g} s and longest_pause "
                f"{self.longest_pause:g} s: expected each to be no longer than the next"
            )


@dataclass(frozen=True)
class OnlineAssociationSettings:
    """How persons are given to wearers, on-line.

    All evidence is in log-odds that a person is the wearer. The first numbers are logistic regressions on 24 000 pairs
    of simulated scenes (two wearers, four bystanders; gestures and recorded clips) with poses that are 10° off, cameras
    that are 2° off and roots known to 5 cm: rounded, as they are much alike from scene to scene.
    """

    shape_weight: NotNegative = 4.5
    """Log-odds lost with each e-fold of the shape's mean squared error (in sigmas; 0.4 if right, 2.5 if wrong)."""
    misfit_weight: NotNegative = 0.75
    """Log-odds lost with each major joint that is seen and does not fit."""
    bias: float = 1.0
    """Log-odds where both are zero: a person taken at random is mostly a wrong one."""
    near: float = 1.5
    """Log-odds won by being exactly where the wearer should be."""
    position_weight: NotNegative = 3.5
    """Log-odds lost with each e-fold of ``1 +`` a quarter of the squared Mahalanobis distance of the position."""
    least_shape: NotNegative = 0.1
    """Added to the shape's error: a better fit than that is luck."""
    surely: float = 5.0
    """Most that one frame's appearance may say for or against a person: errors of detectors last for many frames."""
    far_off: float = 6.0
    """Most that a position may say against: after a mistake the prediction is wrong, and the shape must win."""
    camera_sigma_deg: float = 2.0
    """By which the camera may be turned from where it is predicted: hands shake, orientation filters lag."""
    depth_share: float = 0.15
    """Error of a depth, as share of it, that wrongly predicted limbs make: they look shorter than they are."""
    side_m: float = 0.1
    """The like across the view: the middle of a body whose limbs are predicted wrongly."""
    known_m: float = 0.25
    """Uncertainty across the view up to which the regression above holds; a wider one makes a position say less."""
    memory_s: float = 1.0
    """Over which a track's evidence is averaged: a step and its swing, after which people have moved differently."""
    memory_weight: NotNegative = 2.0
    """Of that evidence against one frame's: a second holds a few independent looks at somebody, not thirty."""
    stay: NotNegative = 2.0
    """Log-odds for the person who continues, in the image, whom the wearer was before: a bystander may pass."""
    gate: float = 14.0
    """Squared Mahalanobis distance of a position (three numbers) beyond which nobody is taken: one in 300 if all
    uncertainties are as they are said to be."""
    enough_joints: float = 6.0
    """Major joints that must fit: half of them, and what the truth of simulated scenes asks for, seven, less what
    predicted poses err."""
    accept: float = 0.0
    """Log-odds, everything taken together, from which a person is taken."""
    patience_s: float = 0.5
    """Unseen for longer, a wearer is lost: the prediction has drifted, and others may have come to its place."""
    drift_m_s: float = 0.5
    """By which the position of a lost wearer becomes more uncertain, besides what the caller says: a slow walk."""
    most_lost_m: float = 4.0
    """At most so much: the size of a room."""
    recover: Share = 0.3
    """Mean log-odds of appearance over ``memory_s`` that a track needs to be taken for a lost wearer. It starts at
    zero, so that this is reached after a tenth of a second by a person who fits well, never by one who does not."""
    recover_margin: float = 0.5
    """By which that must be more than that of any other track which is not another wearer's."""
    drop: float = -0.5
    """Mean log-odds of the wearer's own track below which the wearer is lost: it was somebody else."""
    dropped_m: float = 1.5
    """Uncertainty of the position after that: the prediction has followed the wrong person."""
    switch: float = 6.0
    """Log-odds lost, within the lag, with a step from one track to another."""
    blink: NotNegative = 0.5
    """Log-odds lost, within the lag, with a step to nobody or back: detectors blink, but not every other frame."""

    def __post_init__(self) -> None:
        for name in ("memory_s", "known_m", "patience_s", "camera_sigma_deg", "depth_share", "side_m", "least_shape"):
            if not getattr(self, name) > 0:
                raise InputError(f"on-line association: {name} = {getattr(self, name):g}: expected more than 0")


@dataclass(frozen=True)
class RecalibrationSettings:
    """When a stream's calibration is found anew, and how much of it is believed."""

    use: bool = True
    # s of data: a start of one second is 60–120 mm off on foreign scenes, and with two it is half as wrong.
    first_s: float = 2.5
    settled_s: NotNegative = 2.0  # of data: poses by a calibration from less are marked as preliminary
    # °, by which a quarter of the sensors must have turned before: who holds a pose shows nothing else, and which way
    # sensors point in it nobody knows. A fifth of a second of walking tells it to 15°.
    moving_deg: float = 20.0
    still_s: NotNegative = 5.0  # of data: after so much it is found anyway, however still somebody sits
    growth: float = 2.0  # each time with so many times as much data: what is left to learn halves with it
    # of data, the most recent: headings of a minute ago are no longer today's. So often it is found anew from then on.
    longest_s: float = 40.0
    # s of the stream between the last of that data and the first answer that has it, at least, and as share of the data
    # where that is less: on a core of its own one wearer's takes a quarter of what it lasted or less, two wearers' in a
    # crowd as long. A replay waits, and gives the same answers on any machine.
    delay_s: NotNegative = 2.0
    delay_share: NotNegative = 0.5
    # Standard deviations are taken so many times as large: on foreign scenes mountings are off by 1.4 sigma.
    inflation: float = 2.0
    frames: int = 30  # that tracking goes on from
    # Coarse frames that it is found on, at most, spread over the data: of 40 s every 0.27 s. Neighbours tell nearly the
    # same, and what it takes grows with their number.
    most_frames: int = 150
    # Constant headings: the tracker goes on from the last of them, and follows them by itself.
    calibration: CalibrationSettings = field(default_factory=lambda: CalibrationSettings(heading_knot_s=None))


@dataclass(frozen=True)
class WatchSettings:
    """When a sensor is believed to have moved, and how much is forgotten of it then."""

    # °/s², of one sensor from frame to frame: 11° within a sixtieth of a second. A kick reaches 20 000; tissue that
    # rings after a step 160 000, so a knock alone says nothing yet.
    knock_deg_s2: float = 40_000.0
    knock_deg: float = 30.0  # by which a knocked sensor is still turned when it is quiet, if it has moved
    impact_s: float = 0.2  # within which three sensors or more are knocked by a landing: straps slip one by one
    quiet_s: NotNegative = 0.07  # without a knock: tissue rings at 8 Hz and more
    ringing_s: NotNegative = 0.5  # and no longer than that
    steady_s: NotNegative = 0.05  # over which a limb's turning is averaged: what it would have gone on with
    rest_s: NotNegative = 3.0  # after which the same sensor may be judged again: that long re-estimating takes
    settle_s: NotNegative = 2.0  # after a start nothing is judged: mountings are still being found
    heading_sigma_deg: float = 40.0  # how far a sensor set anew may point elsewhere
    mounting_sigma_deg: float = 30.0  # how far a strap slips


@dataclass(frozen=True)
class SlipSettings:
    """When the last seconds contradict what was known of a sensor."""

    # of data that the calibration was found from, before anything is judged by it, or it is called unsettled: that of
    # five seconds is 40° off at times.
    learnt_s: float = 9.0
    windows_s: tuple[float, ...] = (1.0, 2.0, 4.0)  # a gesture shows a slip within one; a slow one takes longer
    # Directions in which the last seconds say less than this share of what is known by now are not judged.
    share: Share = 0.2
    # By which models err for as long as somebody moves in one way: soft tissue turns sensors by 4 to 7°.
    model_deg: float = 7.0
    evidence: float = 20.0  # squared standard deviations, with that: a turn of 31° at least
    angle_deg: float = 20.0  # of the mounting or heading, by the last seconds alone
    # A sensor that was knocked or seems to slip is estimated anew at once, and has moved if it is elsewhere by then.
    confirmed_s: NotNegative = 1.0
    confirming: float = 16.0  # squared standard deviations: it was suspected already; steps of feet reach 4
    rest_s: NotNegative = 1.0  # after which a sensor that is estimated anew can be judged again


@dataclass(frozen=True)
class PaceSettings:
    """When fewer frames are solved, because the tracker is behind a stream that goes on by itself."""

    # s that a sample has waited for each frame more to the next update: the longest of an update on a machine that has
    # time for all is shorter, and what is six times as long is still not late for whoever watches.
    frame_wait_s: float = 0.025
    widest: int = 6  # frames to each update, at most: 10 solved each second, on 15 frames of the lag
    told_s: float = 2.0  # of the stream, over which the rate is told; a shorter stretch is not worth a word
    recover_s: NotNegative = 5.0  # of the stream with all of them solved, before that is told


@dataclass(frozen=True)
class RelinearisationSettings:
    """Which frames of the lag are linearised anew."""

    angle_deg: float = 1.0  # a joint that moved by less is linear to some thousandths
    length_m: float = 0.02
    shared_deg: float = RELINEARISE_DEG
    most: NotNegativeInt = 6  # frames at once, the newest: what an update may cost


@dataclass(frozen=True)
class LiveSettings(CommonSettings):
    """All settings of a live session."""

    # Kaichi's users and animators want answers within a blink.
    lag_s: float = 0.25
    """Seconds between the newest pose and the smoothed one."""
    # A step or a gesture shows where the sensors point.
    start_s: float = 1.0
    """Seconds of data before the first answer."""
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
    # The second of a start does not tell how clocks differ, and a stream takes its video's as it comes. Which feet
    # stand it tells from the last frames alone: held as hard as in batch they cost 14 mm of 34 (MPJPE).
    fusion: FusionSettings = field(default_factory=lambda: FusionSettings(estimate_clock=False, contact_tightening=1.0))
    association: AssociationSettings = field(default_factory=lambda: AssociationSettings(check=False))
    camera_retry_s: float = 0.5  # until the first camera is looked for again that showed no wearer; then ever rarer
    spread_share: NotNegative = (
        0.02  # of what one video frame says of how detections scatter: two seconds of them count
    )
    start_iterations: NotNegativeInt = 2  # over the first frames, from where the batch stages put them
    # Over which answers make up for what is believed anew of the past; else they tremble by some millimetres.
    answer_filter_s: NotNegative = 0.1
    # Frames to each update; those between are predicted, by how their sensors turned. Of one wearer every frame can be
    # solved: an update takes half of the time between two at 60 Hz.
    solve_every: int = 1
    pace: PaceSettings = field(default_factory=PaceSettings)
    covariance_every: int = 12  # frames between covariances of the smoothed pose, which cost 4 ms
    assembly: AssemblySettings = field(default_factory=AssemblySettings)
    online_association: OnlineAssociationSettings = field(default_factory=OnlineAssociationSettings)
    recalibration: RecalibrationSettings = field(default_factory=RecalibrationSettings)
    walk: ProcessNoiseSettings = field(default_factory=ProcessNoiseSettings)
    watch: WatchSettings = field(default_factory=WatchSettings)
    slip: SlipSettings = field(default_factory=SlipSettings)
    relinearisation: RelinearisationSettings = field(default_factory=RelinearisationSettings)
