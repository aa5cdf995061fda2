"""Compiled functions where they were built (``kernels/``); without them everything is the same, but slower.

``VIP_FACTORS_PURE=1`` in the environment leaves them out.
"""

import importlib
import os
from collections.abc import Callable
from contextlib import suppress
from functools import wraps
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

OnStack = Callable[[ArrayLike], NDArray[np.float64]]


Kernels = ModuleType | None  # the argument of a function that has a kernel: None for NumPy, which defines it


kernels: Any = None  # where there is no extension module
if not os.environ.get("VIP_FACTORS_PURE"):
    with suppress(ImportError):
        kernels = importlib.import_module("vip_factors._kernels")


def compiled(of: tuple[int, ...], to: tuple[int, ...]) -> Callable[[OnStack], OnStack]:
    """Run the kernel of a function's name instead of it: on stacks ``(..., *of)``, giving ``(..., *to)``.

    The function itself, which is the definition, stays as ``__wrapped__``.
    """

    def with_kernel(pure: OnStack) -> OnStack:
        if kernels is None:
            return pure
        kernel, width, result = getattr(kernels, pure.__name__), int(np.prod(of)), int(np.prod(to))

        @wraps(pure)
        def fast(stack: ArrayLike) -> NDArray[np.float64]:
            stack = np.ascontiguousarray(stack, dtype=float)
            found = np.empty((*stack.shape[: stack.ndim - len(of)], *to))
            kernel(stack.reshape(-1, width), found.reshape(-1, result))
            return found

        return fast

    return with_kernel
