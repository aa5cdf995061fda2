"""What our trials declare: T-poses with straight arms, held with errors about that, as the papers take them."""

from dataclasses import replace
from typing import TypeVar

from vip_factors.settings import Settings

SettingsT = TypeVar("SettingsT", bound=Settings)


def with_nominal_pose(settings: SettingsT) -> SettingsT:
    """The settings for declared poses that are held as they are called."""
    factors = settings.factors
    return replace(settings, factors=replace(factors, initial_pose=replace(factors.initial_pose, nominal=True)))
