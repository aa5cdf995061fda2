"""Video Inertial Poser: body-worn IMUs (and cameras) to 3D human motion, as a GTSAM factor graph.

    import vip_factors as vip

    scene = vip.simulate("walk", "sip6", camera="hand-held", seconds=4.0, seed=1)  # or vip.read, vip.convert
    estimate = vip.smooth(scene)
    print(vip.evaluate(estimate, scene))
    vip.export(estimate, "walk.bvh")

The public names stand in ``__init__.pyi`` and are imported at their first use: ``docs/python.md`` describes them all.
"""

import lazy_loader

from vip_factors import detect, evaluate, factor_graph, gait, repetitions, report, simulate

# Python binds a package to its parent at its first import only. That was now; the names are free for the functions.
del detect, evaluate, factor_graph, gait, repetitions, report, simulate

__version__ = "0.1.0"
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
