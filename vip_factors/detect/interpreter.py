"""TensorFlow Lite models as functions of one array; the only place that knows the library which runs them."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Protocol

import numpy as np

from vip_factors.errors import FileFormatError, InputError


class Model(Protocol):
    """A model: one input, named outputs in the order of the file."""

    def __call__(self, given: np.ndarray) -> list[np.ndarray]:
        """Outputs for ``(1, height, width, 3)`` floats."""
        ...


def check_interpreter() -> None:
    """Make sure of the library before models are fetched for it.

    Raises:
        InputError: if it is not installed.
    """
    if find_spec("ai_edge_litert") is None:
        raise InputError("BlazePose needs ai-edge-litert, which is not installed: pip install 'vip-factors[detect]'")


class LiteModel:
    """A ``.tflite`` file, run on the CPU.

    Args:
        path: of the file.
        threads: of the CPU.

    Raises:
        InputError: if the library is not installed.
        FileFormatError: if the file is no such model.
    """

    def __init__(self, path: Path, threads: int) -> None:
        check_interpreter()
        from ai_edge_litert.interpreter import Interpreter

        try:
            with _silent():
                self._interpreter = Interpreter(model_path=str(path), num_threads=threads)
                self._interpreter.allocate_tensors()
        except (ValueError, RuntimeError) as error:
            raise FileFormatError(f"{path}: expected a TensorFlow Lite model ({error})") from error
        self._input = self._interpreter.get_input_details()[0]["index"]
        self._outputs = [one["index"] for one in self._interpreter.get_output_details()]

    def __call__(self, given: np.ndarray) -> list[np.ndarray]:
        """Outputs for ``(1, height, width, 3)`` floats."""
        self._interpreter.set_tensor(self._input, given.astype(np.float32, copy=False))
        self._interpreter.invoke()
        return [self._interpreter.get_tensor(one) for one in self._outputs]


@contextmanager
def _silent() -> Iterator[None]:
    """The library says on stderr which delegate it made, past Python and whatever is asked of its log."""
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
