"""Video Inertial Poser: body-worn IMUs (and cameras) to 3D human motion, as a GTSAM factor graph.

    import vip_factors as vip

    recording = vip.read("walk.mcap")
    estimate = vip.smooth(recording)
    print(vip.evaluate(estimate, recording))
    vip.export(estimate, "walk.npz")

Names are imported when they are first used, so that the import itself takes no time.
"""

import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from vip_factors.api import convert, evaluate, export, read, read_estimate, simulate, smooth, write
    from vip_factors.errors import VipFactorsError
    from vip_factors.estimate import Estimate
    from vip_factors.estimate import Estimate as SceneEstimate
    from vip_factors.io.convert import ImportOptions
    from vip_factors.live.tracker import FixedLagTracker
    from vip_factors.sensors.recording import Recording
    from vip_factors.sensors.scene import Scene
    from vip_factors.settings import Settings

__version__ = "0.1.0"
__all__ = [
    "Estimate", "FixedLagTracker", "ImportOptions", "Recording", "Scene", "SceneEstimate", "Settings",
    "VipFactorsError", "convert", "evaluate", "export", "read", "read_estimate", "simulate", "smooth", "write",
]  # fmt: skip
# Name → module that holds it; functions are in the one for all of them.
_WHERE = {
    "Estimate": "estimate",
    "FixedLagTracker": "live.tracker",
    "ImportOptions": "io.convert",
    "Recording": "sensors.recording",
    "Scene": "sensors.scene",
    "Settings": "settings",
    "VipFactorsError": "errors",
}
_FORMER = {"SceneEstimate": "Estimate"}  # names that classes had before


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    from importlib import import_module

    if name in _ROOMS:
        return import_module(f"{__name__}.{name}")
    name = _FORMER.get(name, name)
    return getattr(import_module(f"{__name__}.{_WHERE.get(name, 'api')}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


class _Room(ModuleType):
    """A room whose name is also what is done in it: called, it does that."""

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        from vip_factors import api

        return getattr(api, self.__name__.rpartition(".")[2])(*arguments, **options)


_ROOMS = ("evaluate", "simulate")


class _Package(ModuleType):
    """Python sets a room as an attribute of the package when it is first imported, by whomever."""

    def __setattr__(self, name: str, value: Any) -> None:
        if name in _ROOMS and isinstance(value, ModuleType):
            value.__class__ = _Room
        super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
