"""The only door to ``gtsam.CustomFactor``: it checks what a wrong callback would otherwise answer with a crash.

GTSAM reads the Jacobians that a callback leaves in ``H`` without looking: one that is unset or not a matrix of the
residual's height ends the process, and a wrong width or a NaN passes in silence.
"""

from collections.abc import Callable, Sequence

import gtsam
import numpy as np

from vip_factors.errors import SolveError
from vip_factors.geometry.rotations import Array

Evaluate = Callable[[gtsam.Values, bool], tuple[Array, list[Array]]]
"""From values, and whether Jacobians are asked for, to the residual ``(m,)`` and one ``(m, d)`` per key, in the order
of the keys; or to the residual alone."""


def custom_factor(
    name: str, noise: gtsam.noiseModel.Base, keys: Sequence[int], dimensions: Sequence[int], evaluate: Evaluate
) -> gtsam.CustomFactor:
    """A GTSAM factor from a plain function.

    Args:
        name: of the factor kind, for messages.
        noise: its noise model; its dimension is the residual's.
        keys: of its variables.
        dimensions: tangent dimension of each variable.
        evaluate: residual, and Jacobians if asked for; must not hold on to the graph (it would never be freed).

    Raises:
        SolveError: from inside GTSAM, if ``evaluate`` returns wrong shapes or numbers that are not finite.
    """
    rows = noise.dim()

    def callback(_: gtsam.CustomFactor, values: gtsam.Values, H: list[Array] | None) -> Array:
        residual, jacobians = evaluate(values, H is not None)
        if residual.shape != (rows,) or not np.all(np.isfinite(residual)):
            raise SolveError(f"{name} factor: residual {residual}: expected {rows} finite numbers")
        if H is not None:
            for index, (jacobian, columns) in enumerate(zip(jacobians, dimensions, strict=True)):
                if jacobian.shape != (rows, columns) or not np.all(np.isfinite(jacobian)):
                    raise SolveError(
                        f"{name} factor: Jacobian {index} has shape {jacobian.shape}: expected a finite "
                        f"({rows}, {columns})"
                    )
                H[index] = np.asfortranarray(jacobian)
        return residual

    return gtsam.CustomFactor(noise, list(keys), callback)
