"""Sensor place: where on its bone a sensor sits, against where it was said to.

``r = s − s₀`` in bone axes, metres; linear. A lever arm that is centimetres off errs in every frame alike: taken as
known it pulls the mounting, which has the same effect on the accelerations that a limb's swing causes.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class SensorPlaceSettings:
    """How well it is known where sensors sit; of the sensor's distance from the joint and beside it."""

    # Of the bone's length: a shank's sensor was found at half of it that was to sit at three tenths.
    along: float = 0.05
    across: float = 0.023  # m: limbs differ in thickness, thighs' sensors were 4–8 cm off in depth
    elsewhere: float = 0.023  # m, on bones that are no limb: head, trunk, pelvis, feet, hands
