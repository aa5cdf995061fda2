"""The Gaussian pose prior: which joint rotations people like, and which go together (thesis eqs. 3.14, 3.28)."""

from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

import numpy as np

from vip_factors.body.npz_file import read_npz
from vip_factors.body.skeleton import JOINT_COUNT, JOINT_NAMES
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import Array, log

POSE_SIZE = 3 * (JOINT_COUNT - 1)
SHIPPED_PRIOR = Path(__file__).parent.parent / "data" / "pose_prior.npz"


@dataclass(frozen=True)
class PosePrior:
    """A Gaussian over the joint rotations of a pose; its residual is ``whitening @ (x − mean)``.

    ``x`` is the stack of rotation vectors Log(R_parent_child) of joints 1 … 23, in radians (:func:`joint_vector`).

    Attributes:
        mean: ``(69,)`` radians.
        whitening: ``(69, 69)`` per radian: ``L`` with ``Σ⁻¹ = Lᵀ L`` (thesis eq. 3.28).
        provenance: one line: data, number of frames, what was held out.
    """

    mean: Array
    whitening: Array
    provenance: str = "unknown"

    def __post_init__(self) -> None:
        mean, whitening = np.asarray(self.mean, float), np.asarray(self.whitening, float)
        if mean.shape != (POSE_SIZE,) or whitening.shape != (POSE_SIZE, POSE_SIZE):
            raise InputError(
                f"pose prior: mean {mean.shape} and whitening {whitening.shape}: expected (69,) and (69, 69)"
            )
        if not (np.all(np.isfinite(mean)) and np.all(np.isfinite(whitening))):
            raise InputError("pose prior: mean or whitening holds a number that is not finite")
        object.__setattr__(self, "mean", mean)
        object.__setattr__(self, "whitening", whitening)

    def residual(self, x: Array) -> Array:
        """Whitened deviation ``(..., 69)`` of joint vectors ``(..., 69)``: unit variance where the prior holds."""
        return (x - self.mean) @ self.whitening.T

    @cached_property
    def information(self) -> Array:
        """The inverse ``(69, 69)`` of the covariance, ``Lᵀ L``."""
        return self.whitening.T @ self.whitening

    @property
    def sigma(self) -> Array:
        """Standard deviation ``(69,)`` of each coordinate, in radians."""
        inverse = np.linalg.inv(self.whitening)
        return np.sqrt(np.sum(inverse * inverse, axis=1))


def joint_vector(R_parent_child: Array) -> Array:
    """Stacked rotation vectors ``(..., 69)`` in radians of joints 1 … 23, from rotations ``(..., 24, 3, 3)``."""
    return log(R_parent_child[..., 1:, :, :]).reshape(*R_parent_child.shape[:-3], POSE_SIZE)


def mirror_joint_vector(x: Array) -> Array:
    """The pose ``(..., 69)`` seen in a mirror: sides exchanged, and (x, y, z) → (x, −y, −z)."""
    vectors = np.asarray(x, float).reshape(*np.shape(x)[:-1], JOINT_COUNT - 1, 3)
    other = [name.replace("left_", "_").replace("right_", "left_") for name in JOINT_NAMES[1:]]
    swapped = [JOINT_NAMES.index(f"right{name}" if name[0] == "_" else name) - 1 for name in other]
    return (vectors[..., swapped, :] * np.array([1.0, -1.0, -1.0])).reshape(np.shape(x))


@cache
def _read(path: Path) -> PosePrior:
    file = read_npz(path, "not a pose prior")
    try:
        return PosePrior(file["mean"], file["whitening"], str(file["provenance"]))
    except (KeyError, TypeError, ValueError) as error:
        raise FileFormatError(
            f"{path}: not a pose prior ({error}); expected an npz with mean (69,), whitening (69, 69) and provenance, "
            "as the shipped file has them"
        ) from error


def load_pose_prior(path: str | Path | None = None) -> PosePrior:
    """A trained prior; the one shipped with the package if no path is given.

    Raises:
        FileFormatError: if the file is not one.
    """
    return _read(Path(path) if path is not None else SHIPPED_PRIOR)
