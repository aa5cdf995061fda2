"""The numbers of a glTF file: one block of bytes, and where in it each array lies."""

from typing import Any

import numpy as np

from vip_factors.errors import InputError

FLOAT, UNSIGNED_BYTE, UNSIGNED_SHORT, UNSIGNED_INT = 5126, 5121, 5123, 5125  # component types of glTF 2.0
_COMPONENTS = {"float32": FLOAT, "uint8": UNSIGNED_BYTE, "uint16": UNSIGNED_SHORT, "uint32": UNSIGNED_INT}
_KINDS = {(): "SCALAR", (2,): "VEC2", (3,): "VEC3", (4,): "VEC4", (4, 4): "MAT4"}
CORNERS, INDICES = 34962, 34963  # what a graphics card is to use an array for


class GltfBuffer:
    """Gathers arrays; ``accessors`` and ``views`` are those of pygltflib, ``data`` the bytes."""

    def __init__(self) -> None:
        self.accessors: list[Any] = []
        self.views: list[Any] = []
        self.data = bytearray()

    def add(self, values: np.ndarray, target: int | None = None, bounds: bool = False, unit: bool = False) -> int:
        """The number of the accessor of an array ``(n, …)`` of float32, uint8, uint16 or uint32.

        Args:
            values: matrices have their columns in rows, as glTF stores them.
            target: what it is for, :data:`CORNERS` or :data:`INDICES`.
            bounds: whether least and greatest values are told, as glTF wants of positions and times.
            unit: whether integers stand for fractions of their greatest value.

        Raises:
            InputError: for numbers that are not finite, or were not before they became float32.
        """
        from pygltflib import Accessor, BufferView

        values = np.ascontiguousarray(values)
        if values.dtype.kind == "f" and not np.all(np.isfinite(values)):
            raise InputError("the estimate holds numbers that glTF cannot (not finite, or above 3e38): is it damaged?")
        self.views.append(BufferView(buffer=0, byteOffset=len(self.data), byteLength=values.nbytes, target=target))
        self.data += values.tobytes()
        self.data += bytes(-len(self.data) % 4)
        flat = values.reshape(len(values), -1)
        self.accessors.append(
            Accessor(
                bufferView=len(self.views) - 1, componentType=_COMPONENTS[values.dtype.name], count=len(values),
                type=_KINDS[values.shape[1:]], normalized=unit,
                min=flat.min(axis=0).tolist() if bounds else None, max=flat.max(axis=0).tolist() if bounds else None,
            )
        )  # fmt: skip
        return len(self.accessors) - 1
