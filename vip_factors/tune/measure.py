"""How large the errors of a recording are with some settings."""

from enum import StrEnum

import numpy as np

from vip_factors.errors import InputError
from vip_factors.evaluate.evaluation import evaluate_scene
from vip_factors.pipeline import smooth_scene
from vip_factors.sensors.scene import Scene
from vip_factors.settings import Settings


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
    value = evaluate_scene(smooth_scene(scene, settings), scene)[measure.value]
    if not np.isfinite(value) or value <= 0:
        raise InputError(f"scene '{scene.name}': {measure.value} is {value:g}: expected an error above 0")
    return value
