"""The same objective as a ``gtsam.NonlinearFactorGraph``: to look at, to extend, to hold the fast solver against."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submodules=["keys"])
