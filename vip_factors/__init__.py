"""Video Inertial Poser: body-worn IMUs (and cameras) to 3D human motion, as a GTSAM factor graph.

    import vip_factors as vip

    recording = vip.read("walk.mcap")
    estimate = vip.smooth(recording)
    print(vip.evaluate(estimate, recording))
    vip.export(estimate, "walk.npz")

Names are imported when they are first used, so that the import itself takes no time. ``docs/python.md`` tells them all,
and for how long a name stays.
"""

import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from vip_factors.api import (
        convert,
        detect,
        evaluate,
        export,
        factor_graph,
        gait,
        picture,
        read,
        read_estimate,
        repetitions,
        report,
        serve,
        simulate,
        smooth,
        sync,
        write,
    )
    from vip_factors.body.joint_angles import joint_angles
    from vip_factors.body.kinematics import Motion
    from vip_factors.body.skeleton import JOINT_NAMES
    from vip_factors.cli.run import RunOptions, run
    from vip_factors.detect.settings import DetectSettings
    from vip_factors.errors import VipFactorsError
    from vip_factors.estimate import Estimate
    from vip_factors.estimate import Estimate as SceneEstimate
    from vip_factors.factor_graph import keys
    from vip_factors.io.convert import ImportOptions
    from vip_factors.io.live.open import open_source
    from vip_factors.io.motions import read_motion
    from vip_factors.io.scene_building import CameraOptions
    from vip_factors.io.settings import ExportSettings
    from vip_factors.live.settings import LiveSettings
    from vip_factors.live.stream import Stream, stream
    from vip_factors.live.tracker import FixedLagTracker
    from vip_factors.live_estimate import LiveEstimate
    from vip_factors.report.settings import ReportSettings
    from vip_factors.sensors.camera_model import CameraModel
    from vip_factors.sensors.detections import Detections
    from vip_factors.sensors.live import ImuSample, VideoFrame, live_samples
    from vip_factors.sensors.recording import Recording, Subject
    from vip_factors.sensors.scene import Camera, Scene
    from vip_factors.settings import Settings
    from vip_factors.simulate.scene_settings import SceneSettings
    from vip_factors.simulate.settings import SimulateSettings

__version__ = "0.1.0"
__all__ = [
    "JOINT_NAMES", "Camera", "CameraModel", "CameraOptions", "DetectSettings", "Detections", "Estimate",
    "ExportSettings", "FixedLagTracker", "ImportOptions", "ImuSample", "LiveEstimate", "LiveSettings", "Motion",
    "Recording", "ReportSettings", "RunOptions", "Scene", "SceneEstimate", "SceneSettings", "Settings",
    "SimulateSettings", "Stream", "Subject", "VideoFrame", "VipFactorsError", "convert", "detect", "evaluate",
    "export", "factor_graph", "gait", "joint_angles", "keys", "live_samples", "open_source", "picture", "read",
    "read_estimate", "read_motion", "repetitions", "report", "run", "serve", "simulate", "smooth", "stream", "sync",
    "write",
]  # fmt: skip
# Module → names that it holds; all other functions are in one for all of them.
_WHERE = {
    "body.joint_angles": ("joint_angles",),
    "body.kinematics": ("Motion",),
    "body.skeleton": ("JOINT_NAMES",),
    "cli.run": ("RunOptions", "run"),
    "detect.settings": ("DetectSettings",),
    "errors": ("VipFactorsError",),
    "estimate": ("Estimate",),
    "io.convert": ("ImportOptions",),
    "io.settings": ("ExportSettings",),
    "io.live.open": ("open_source",),
    "io.motions": ("read_motion",),
    "io.scene_building": ("CameraOptions",),
    "live.settings": ("LiveSettings",),
    "live.stream": ("Stream", "stream"),
    "live.tracker": ("FixedLagTracker",),
    "live_estimate": ("LiveEstimate",),
    "report.settings": ("ReportSettings",),
    "sensors.camera_model": ("CameraModel",),
    "sensors.detections": ("Detections",),
    "sensors.live": ("ImuSample", "VideoFrame", "live_samples"),
    "sensors.recording": ("Recording", "Subject"),
    "sensors.scene": ("Camera", "Scene"),
    "settings": ("Settings",),
    "simulate.scene_settings": ("SceneSettings",),
    "simulate.settings": ("SimulateSettings",),
}
_FORMER = {"SceneEstimate": "Estimate"}  # names that will go, and what stands for them


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    from importlib import import_module

    if name in _ROOMS:
        return import_module(f"{__name__}.{name}")
    if name == "keys":
        return import_module(f"{__name__}.factor_graph.keys")
    if name in _FORMER:
        import warnings

        warnings.warn(f"vip.{name} will go: vip.{_FORMER[name]} stands for it", DeprecationWarning, stacklevel=2)
        name = _FORMER[name]
    where = next((module for module, names in _WHERE.items() if name in names), "api")
    return getattr(import_module(f"{__name__}.{where}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


class _Room(ModuleType):
    """A room whose name is also what is done in it: called, it does that."""

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        from vip_factors import api

        return getattr(api, self.__name__.rpartition(".")[2])(*arguments, **options)


_ROOMS = ("detect", "evaluate", "factor_graph", "gait", "repetitions", "report", "simulate")


class _Package(ModuleType):
    """Python sets a room as an attribute of the package when it is first imported, by whomever."""

    def __setattr__(self, name: str, value: Any) -> None:
        if name in _ROOMS and isinstance(value, ModuleType):
            value.__class__ = _Room
        super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
