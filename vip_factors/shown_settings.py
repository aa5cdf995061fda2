"""The settings that short help shows: the few of some hundreds that people change.

Each is declared here, once, and inherited by the settings that it belongs to: help need not import what those stand on.
"""

from dataclasses import dataclass, field
from typing import Literal

from vip_factors.ranges import Rate


@dataclass(frozen=True)
class ShownCalibration:
    """What is found about sensors and body."""

    # Sensors drift apart by tens of degrees.
    estimate_headings: bool = True
    """Find how sensors are turned about the vertical; off where they agree already."""
    # A calibration pose is held 10–15° off.
    estimate_mountings: bool = True
    """Find how sensors sit on their bones; off where that was measured."""
    # People of one stature differ by 3–6 % in each length.
    estimate_body: bool = True
    """Find the lengths of the body, where a camera sees it."""


@dataclass(frozen=True)
class ShownFusion:
    """What is done with a camera."""

    use_camera: bool = True
    """Off: the body-worn sensors alone, each wearer by itself (SIP)."""
    camera_imu: bool = True
    """Off: the sensor on the camera is not used."""
    # Two numbers for a recording, and within 2 ms where clocks agree. Off: as whoever made the recording has them.
    estimate_clock: bool = True
    """Find how far the video's clock is off, within some milliseconds, and how it drifts."""


@dataclass(frozen=True)
class ShownOrientation:
    """Trust in the sensors' orientations."""

    # Soft tissue and filter errors: 2–8° against optical references on well mounted sensors.
    sigma_deg: float = 4.0
    """Standard deviation in degrees."""


@dataclass(frozen=True)
class ShownAcceleration:
    """Trust in the sensors' accelerations."""

    # Each row: soft tissue wobbles by 1–3 at the limbs in brisk motion (1.3–2.5 below 8 Hz on a walk with optical
    # reference), less at rest.
    sigma: float = 1.5
    """Standard deviation in m/s²."""


@dataclass(frozen=True)
class ShownFactors:
    """Weights of the sensors' factors."""

    orientation: ShownOrientation = field(default_factory=ShownOrientation)
    acceleration: ShownAcceleration = field(default_factory=ShownAcceleration)


@dataclass(frozen=True)
class ShownWindows:
    """How long recordings are solved."""

    # What is shorter is calibrated by all of its coarse frames (four minutes before a camera take 3 GB), and its
    # sensors' clocks and accelerometers are looked over first, which wants the whole.
    above_s: float = 300.0
    """What is longer, in seconds, is calibrated from stretches of it, and read window by window."""


@dataclass(frozen=True)
class ShownOfBoth:
    """Those of recordings and streams alike."""

    # Brisk motion has its power below 10 Hz.
    frame_rate: Rate = 60.0
    """Frames per second of the estimated motion."""
    calibration: ShownCalibration = field(default_factory=ShownCalibration)
    factors: ShownFactors = field(default_factory=ShownFactors)
    fusion: ShownFusion = field(default_factory=ShownFusion)
    floor: Literal["found", "none"] | float = "found"
    """Where z = 0 is: under the soles, or where a known camera pose has it (found); where the camera was put at the
    start (none); at this height in metres in the world of a known camera pose (-0.74: its board lay on a table)."""


@dataclass(frozen=True)
class ShownSettings(ShownOfBoth):
    """The settings of recordings most often changed."""

    # Marginals cost about one more iteration a minute.
    covariance: bool = False
    """Also say how sure every joint of every frame is."""
    assign: bool = False
    """Take sensors for one another that are found in each other's places."""
    windows: ShownWindows = field(default_factory=ShownWindows)


@dataclass(frozen=True)
class ShownLiveSettings(ShownOfBoth):
    """The settings of a stream most often changed."""

    # A body does not show within the second that tracking begins with.
    calibration: ShownCalibration = field(default_factory=lambda: ShownCalibration(estimate_body=False))
    # The second of a start does not tell how clocks differ, and a stream takes its video's as it comes.
    fusion: ShownFusion = field(default_factory=lambda: ShownFusion(estimate_clock=False))
    # Kaichi's users and animators want answers within a blink.
    lag_s: float = 0.25
    """Seconds between the newest pose and the smoothed one."""
    # A step or a gesture shows where the sensors point.
    start_s: float = 1.0
    """Seconds of data before the first answer."""


@dataclass(frozen=True)
class ShownClock:
    """How the offset of clocks is looked for."""

    method: Literal["auto", "motion", "clap", "stamp"] = "auto"
    """How people move, an event, or whichever tells."""
    # What two people pressing buttons, or two clocks set by network, differ by.
    max_offset: float = 10.0
    """Seconds either way."""
