"""The settings that ``--help`` tells of: the few of some hundreds that people change.

They stand here once more, so that help need not import what all the others belong to. A test holds names and defaults
to those of :class:`~vip_factors.settings.Settings`; the reasons are there.
"""

from dataclasses import dataclass, field
from typing import Literal


@dataclass(frozen=True)
class CommonCalibration:
    """What is found about sensors and body."""

    estimate_headings: bool = True
    """Find how sensors are turned about the vertical; off where they agree already."""
    estimate_mountings: bool = True
    """Find how sensors sit on their bones; off where that was measured."""
    estimate_body: bool = True
    """Find the lengths of the body, where a camera sees it."""


@dataclass(frozen=True)
class CommonFusion:
    """What is done with a camera."""

    use_camera: bool = True
    """Off: the body-worn sensors alone."""
    camera_imu: bool = True
    """Off: the sensor on the camera is not used."""
    estimate_clock: bool = True
    """Find how far the video's clock is off, within some milliseconds."""


@dataclass(frozen=True)
class CommonOrientation:
    """Trust in the sensors' orientations."""

    sigma_deg: float = 4.0
    """Standard deviation in degrees."""


@dataclass(frozen=True)
class CommonAcceleration:
    """Trust in the sensors' accelerations."""

    sigma: float = 1.5
    """Standard deviation in m/s²."""


@dataclass(frozen=True)
class CommonFactors:
    """Weights of the sensors' factors."""

    orientation: CommonOrientation = field(default_factory=CommonOrientation)
    acceleration: CommonAcceleration = field(default_factory=CommonAcceleration)


@dataclass(frozen=True)
class CommonWindows:
    """How long recordings are solved."""

    above_s: float = 300.0
    """What is longer, in seconds, is calibrated from stretches of it, and read window by window."""


@dataclass(frozen=True)
class CommonPipelineSettings:
    """Those of recordings and streams alike."""

    frame_rate: float = 60.0
    """Frames per second of the estimated motion."""
    calibration: CommonCalibration = field(default_factory=CommonCalibration)
    factors: CommonFactors = field(default_factory=CommonFactors)
    fusion: CommonFusion = field(default_factory=CommonFusion)


@dataclass(frozen=True)
class CommonSettings(CommonPipelineSettings):
    """The settings most often changed."""

    covariance: bool = False
    """Also say how sure every joint is."""
    windows: CommonWindows = field(default_factory=CommonWindows)


@dataclass(frozen=True)
class CommonLiveCalibration(CommonCalibration):
    """What is found about sensors and body while it streams."""

    estimate_body: bool = False
    """Find the lengths of the body, where a camera sees it."""


@dataclass(frozen=True)
class CommonLiveFusion(CommonFusion):
    """What is done with a camera while it streams."""

    estimate_clock: bool = False
    """Find how far the video's clock is off, within some milliseconds."""


@dataclass(frozen=True)
class CommonLiveSettings(CommonPipelineSettings):
    """The settings of a stream most often changed."""

    calibration: CommonCalibration = field(default_factory=CommonLiveCalibration)
    fusion: CommonFusion = field(default_factory=CommonLiveFusion)
    lag_s: float = 0.25
    """Seconds between the newest pose and the smoothed one."""
    start_s: float = 1.0
    """Seconds of data before the first answer."""


@dataclass(frozen=True)
class CommonClock:
    """How the offset of clocks is looked for."""

    method: Literal["auto", "motion", "clap", "stamp"] = "auto"
    """How people move, an event, or whichever tells."""
    max_offset: float = 10.0
    """Seconds either way."""
