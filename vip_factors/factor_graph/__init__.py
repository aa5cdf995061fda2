"""The objective as a ``gtsam.NonlinearFactorGraph``, to inspect, to extend and to validate the solver."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submodules=["keys"])
