"""What a start of headings and mountings may suppose, and how likely a candidate is then."""

from dataclasses import dataclass

import numpy as np

from vip_factors.geometry.rotations import Array, angle_between, wrap_angle
from vip_factors.ranges import RangeError, Share

# Of the mean lean of trunk, thighs and shanks over a recording: walkers' and standers' are within 10°, sitters' not.
UPRIGHT_SIGMA = np.deg2rad(15.0)
UPRIGHT_FREEDOM = 4.0  # of a Student t: some sit


@dataclass(frozen=True)
class StartSettings:
    """How the first headings and mountings are looked for."""

    search: bool = True  # off: the straps and the low-passed motion alone, as in the papers
    # Degrees, how well the inertial frames of sensors that were started together agree (where they do at all), unless
    # factors.agreeing_headings states it. Thirteen of one make lay within −10° to +4°, one of them at −33°.
    agree_deg: float = 15.0
    strange_strap: Share = 0.1  # chance of a sensor that was strapped on anyhow: three of thirteen were
    strange_frame: Share = 0.05  # chance of a sensor that was started elsewhere: one of thirteen was
    # Nats by which a start has to be more likely than the next that differs, to be taken for settled: 20 to 1.
    settled: float = 3.0
    stretch_s: float = 30.0  # of the recording that is looked at
    rate: float = 10.0  # Hz: steps and swings are slower
    bone_sigma_deg: float = 10.0  # of a mounting about the bone that carries it, soft tissue included

    def __post_init__(self) -> None:
        for name in ("agree_deg", "stretch_s", "rate", "bone_sigma_deg"):
            if not getattr(self, name) > 0:
                raise RangeError(f"calibration.start.{name}", f"is {getattr(self, name):g}: expected a number above 0")
        for name in ("strange_strap", "strange_frame"):
            if not 0 < getattr(self, name) < 1:
                told = f"is {getattr(self, name):g}: expected a share between 0 and 1"
                raise RangeError(f"calibration.start.{name}", told)


@dataclass(frozen=True)
class Supposition:
    """What is taken for granted.

    Attributes:
        name: in words, for people.
        straps: whether sensors sit roughly as placed.
        frames: whether their inertial frames agree.
    """

    name: str
    straps: bool
    frames: bool


SUPPOSITIONS = (
    Supposition("sensors sit as placed and their inertial frames agree", straps=True, frames=True),
    Supposition("sensors sit as placed", straps=True, frames=False),
    Supposition("inertial frames agree", straps=False, frames=True),
    Supposition("joints and accelerations alone tell", straps=False, frames=False),
)


def strap_cost(R_bone_sensor: Array, R_placed: Array, sigma: float, strange: float) -> Array:
    """How unlikely mountings ``(..., 3, 3)`` are where sensors sit as placed, in nats against any mounting at all.

    A mixture of a Gaussian of ``sigma`` radians about each axis and, for a share ``strange``, no rule.
    """
    density = (
        np.sqrt(8 * np.pi) / sigma**3
    )  # of the Gaussian at its middle, over that of all rotations: 8π² / (2πσ²)^1.5
    off = angle_between(R_placed, R_bone_sensor) / sigma
    return -np.log((1 - strange) * density * np.exp(-0.5 * off**2) + strange)


def frame_cost(headings: Array, common: float | Array, sigma: float, strange: float) -> Array:
    """How unlikely headings are where inertial frames agree on a ``common`` one, in nats against any heading."""
    density = np.sqrt(2 * np.pi) / sigma
    return -np.log((1 - strange) * density * np.exp(-0.5 * (wrap_angle(headings - common) / sigma) ** 2) + strange)


def common_cost(sensors: int, sigma: float) -> float:
    """What not knowing the common heading costs, in nats: the width of the circle over that of what sensors leave."""
    return float(np.log(max(np.sqrt(2 * np.pi * sensors) / sigma, 1.0)))


def upright_cost(R_bone_sensor: Array, up_sensor: Array) -> Array:
    """How unlikely mountings ``(..., 3, 3)`` are on a bone that is upright on the whole, in nats; nought of others.

    ``up_sensor`` ``(3,)`` is the mean vertical in the sensor's axes; NaN where the bone is not.
    """
    if not np.all(np.isfinite(up_sensor)):
        return np.zeros(R_bone_sensor.shape[:-2])
    up_bone = R_bone_sensor @ (up_sensor / np.linalg.norm(up_sensor))
    lean = np.arccos(np.clip(up_bone[..., 1], -1.0, 1.0)) / UPRIGHT_SIGMA
    return (UPRIGHT_FREEDOM + 1) / 2 * np.log1p(lean**2 / UPRIGHT_FREEDOM)
