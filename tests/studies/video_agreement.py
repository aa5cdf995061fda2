"""How bent knees or elbows are by the sensors and by somebody else's video: their clocks' lag, and how far they agree.

Neither is a reference: what a monocular video takes for the depth of a wrist is off by decimetres.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.studies.leg_angles import GaitMotion
from tests.studies.marker_body import SIDES, marker_columns
from vip_factors.evaluate.joint_angle import bend_deg, rmse, rmse_without_offset
from vip_factors.geometry.rotations import Array

VIDEO_HZ = 30.0  # of VIDIMU's camera
BENDS = {"knee": ("hip", "knee", "ankle"), "elbow": ("shoulder", "elbow", "wrist")}
MOST_LAG_S, STEP_S = 1.5, 1 / 60  # both were started by hand within a second
LEAST_BEND_DEG = 10.0  # standard deviation in the video: a joint that hardly moves tells of no lag
LEAST_CORRELATION = 0.4  # the best of all lags of two unrelated motions is about 0.2


@dataclass(frozen=True)
class Agreement:
    """Of one joint on both sides.

    Attributes:
        joint: ``knee`` or ``elbow``.
        lag_s: to add to the video's times to get the sensors'; NaN if the joint hardly moves or both do not agree.
        correlation: the highest of all lags, both sides together; their means removed.
        degrees, without_offset: RMS difference at that lag, or none, mean of both sides; the same, its mean removed.
        least, most: degrees, 1 % and 99 % of the bend by the sensors.
    """

    joint: str
    lag_s: float
    correlation: float
    degrees: float
    without_offset: float
    least: float
    most: float


def video_motion(path: Path, begins: float) -> GaitMotion:
    """Of VIDIMU's ``.csv``: joint centres that a network found in one camera's video, in the camera's axes.

    ``begins`` is the second of the recording at which both were started.
    """
    table = np.genfromtxt(path, delimiter=",", names=True, autostrip=True)
    centres = {
        f"{side}_{name}": marker_columns(table, [f"{side}_{name}_{axis}" for axis in "xyz"], path) / 1000
        for chain in BENDS.values()
        for name in chain
        for side in SIDES
    }
    time = begins + np.arange(len(table)) / VIDEO_HZ
    flexion = {
        f"{side}_{joint}": bend_deg(*(centres[f"{side}_{name}"] for name in chain))
        for joint, chain in BENDS.items()
        for side in SIDES
    }
    return GaitMotion(time, flexion, centres)


def agreement(joint: str, sensors: GaitMotion, video: GaitMotion) -> Agreement:
    """How far both agree about a joint, at the lag at which they do most."""
    names = [f"{side}_{joint}" for side in SIDES]
    own = np.stack([sensors.flexion[name] for name in names])
    least, most = np.quantile(own, [0.01, 0.99])
    moving = [name for name in names if np.std(video.flexion[name]) > LEAST_BEND_DEG]
    lags = np.arange(-MOST_LAG_S, MOST_LAG_S + STEP_S / 2, STEP_S)
    scores = [_correlation(moving, sensors, video, lag) for lag in lags] if moving else [np.nan]
    best = int(np.argmax(scores))
    lag = float(lags[best]) if scores[best] > LEAST_CORRELATION else np.nan
    pairs = [_shifted(name, sensors, video, float(np.nan_to_num(lag))) for name in names]
    return Agreement(
        joint, lag, float(scores[best]), float(np.mean([rmse(ours, theirs) for ours, theirs in pairs])),
        float(np.mean([rmse_without_offset(ours, theirs) for ours, theirs in pairs])), float(least), float(most),
    )  # fmt: skip


def _shifted(name: str, sensors: GaitMotion, video: GaitMotion, lag: float) -> tuple[Array, Array]:
    """Both at the video's instants that the sensors have too."""
    time = video.time + lag
    both = (time >= sensors.time[0]) & (time <= sensors.time[-1])
    return np.interp(time[both], sensors.time, sensors.flexion[name]), video.flexion[name][both]


def _correlation(names: list[str], sensors: GaitMotion, video: GaitMotion, lag: float) -> float:
    pairs = [_shifted(name, sensors, video, lag) for name in names]
    ours, theirs = (np.concatenate([pair[k] - np.mean(pair[k]) for pair in pairs]) for k in range(2))
    return float(ours @ theirs / max(np.linalg.norm(ours) * np.linalg.norm(theirs), 1e-9))
