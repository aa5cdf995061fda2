"""Settings of the on-line association, with reasons."""

from dataclasses import dataclass

from vip_factors.errors import InputError
from vip_factors.ranges import NotNegative, Share


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
