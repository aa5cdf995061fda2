"""What is tuned (settings by their dotted names, between bounds), and by which measure."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from difflib import get_close_matches
from enum import StrEnum
from math import isfinite
from typing import Any

import numpy as np

from vip_factors.errors import InputError
from vip_factors.evaluate.evaluation import evaluate_scene
from vip_factors.pipeline import smooth
from vip_factors.sensors.scene import Scene
from vip_factors.settings import Settings, flatten


@dataclass(frozen=True)
class Parameter:
    """A setting, and where its best value is looked for.

    Attributes:
        name: dotted, as in a settings file: ``factors.orientation.sigma_deg``.
        low, high: bounds, both included.
        log: whether ratios count, not differences; of sigmas they do.
    """

    name: str
    low: float
    high: float
    log: bool = True

    def __post_init__(self) -> None:
        if not (isfinite(self.low) and isfinite(self.high) and self.low < self.high):
            raise InputError(f"parameter {self.name} from {self.low:g} to {self.high:g}: expected two growing numbers")
        if self.log and self.low <= 0:
            raise InputError(f"parameter {self.name} from {self.low:g}, in ratios: expected a number above 0")

    @property
    def text(self) -> str:
        """As on the command line."""
        return f"{self.name}:{self.low:g}:{self.high:g}{':log' if self.log else ''}"


# About half to two and a half times the package's own values: beyond, a factor is off or nothing else counts.
DEFAULT_PARAMETERS = (
    Parameter("factors.orientation.sigma_deg", 2.0, 10.0),
    Parameter("factors.acceleration.sigma", 0.6, 4.0),
    Parameter("factors.pose_prior.scale", 0.15, 1.0),
    Parameter("factors.joint_limit.sigma_deg", 1.2, 8.0),
    Parameter("factors.smoothness.time", 0.03, 0.18),
    Parameter("factors.foot_contact.sigma", 0.06, 0.4),
    Parameter("camera.reprojection.spread", 0.2, 1.2),
    Parameter("camera.ground_contact.sigma", 0.06, 0.4),
)


def parsed(text: str) -> Parameter:
    """A parameter from ``NAME:LOW:HIGH`` or ``NAME:LOW:HIGH:log``.

    Raises:
        InputError: if it is not written so, there is no such setting, or it is no number.
    """
    name, *rest = text.split(":")
    if not 2 <= len(rest) <= 3 or (len(rest) == 3 and rest[2] not in ("log", "linear")):
        raise InputError(f"parameter '{text}': expected NAME:LOW:HIGH or NAME:LOW:HIGH:log")
    try:
        low, high = float(rest[0]), float(rest[1])
    except ValueError:
        raise InputError(f"parameter '{text}': expected numbers for {rest[0]} and {rest[1]}") from None
    parameter = Parameter(name.replace("-", "_"), low, high, rest[2:] == ["log"])
    value_of(Settings(), parameter.name)
    return parameter


def value_of(settings: Settings, name: str) -> float:
    """The number that a setting has.

    Raises:
        InputError: if there is no such setting, or it is no number.
    """
    value: Any = settings
    for part in name.split("."):
        if not is_dataclass(value) or part not in [one.name for one in fields(value)]:
            near = get_close_matches(name, flatten(settings), n=1, cutoff=0.4)
            raise InputError(f"unknown setting '{name}'{f'; did you mean {near[0]}?' if near else ''}")
        value = getattr(value, part)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"setting '{name}' is {value}: expected one whose value is a number")
    return float(value)


def changed(settings: Settings, values: Mapping[str, float]) -> Settings:
    """The settings with other numbers at some dotted names; whole numbers stay whole."""
    for name, value in values.items():
        settings = _with(settings, name.split("."), value)
    return settings


def _with(tree: Any, path: list[str], value: float) -> Any:
    own = getattr(tree, path[0])
    if len(path) > 1:
        return replace(tree, **{path[0]: _with(own, path[1:], value)})
    return replace(tree, **{path[0]: round(value) if isinstance(own, int) else value})


class Measure(StrEnum):
    """What is to become small; means over the wearers of a recording."""

    MPJPE = "mpjpe"  # mm, joint positions, every frame aligned rigidly
    MPJAE = "mpjae"  # degrees, orientations of bones, after the same alignment
    WORLD = "scene_position_error"  # cm, one yaw and shift of the whole scene removed


UNITS = {Measure.MPJPE: "mm", Measure.MPJAE: "deg", Measure.WORLD: "cm"}


def measured(scene: Scene, settings: Settings, measure: Measure) -> float:
    """The error of a scene's estimate.

    Raises:
        InputError: if the scene holds no truth, or the error is none to compare others with.
        SolveError: if the problem is not determined with these settings.
    """
    value = evaluate_scene(smooth(scene, settings), scene)[measure.value]
    if not np.isfinite(value) or value <= 0:
        raise InputError(f"scene '{scene.name}': {measure.value} is {value:g}: expected an error above 0")
    return value
