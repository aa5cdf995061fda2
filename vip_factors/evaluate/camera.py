"""Errors of the camera: its path, and how the IMU on it was found to sit."""

from dataclasses import dataclass

import numpy as np

from vip_factors.errors import InputError
from vip_factors.evaluate.metrics import TIME_TOLERANCE
from vip_factors.evaluate.table import Metric
from vip_factors.geometry.poses import Alignment
from vip_factors.geometry.rotations import Array, log, transpose
from vip_factors.sensors.camera_path import CameraPath, PathPair, move_path


@dataclass(frozen=True)
class CameraError:
    """Errors of a camera path in the true world, at ``time`` ``(T,)`` seconds.

    ``tangent`` ``(T, 6)``: ``T_true = T_estimated Exp(e)`` to first order: rotation (rad), then translation (m), both
    in the estimated camera's axes.
    """

    time: Array
    tangent: Array

    @property
    def rotation(self) -> Array:
        """Geodesic angles ``(T,)`` off the truth, radians."""
        return np.linalg.norm(self.tangent[:, :3], axis=1)

    @property
    def translation(self) -> Array:
        """Distances ``(T,)`` from the truth, metres."""
        return np.linalg.norm(self.tangent[:, 3:], axis=1)


def common_instants(estimate: CameraPath, truth: CameraPath) -> tuple[CameraPath, CameraPath, np.ndarray]:
    """Both paths at the instants of the coarser one, as far as they overlap, so that least is interpolated.

    Returns:
        The estimate, the truth, and which instants of the estimate (the nearest ones) those are.

    Raises:
        InputError: if they share no time.
    """
    time = truth.time if _spacing(truth) > _spacing(estimate) else estimate.time
    for path in (estimate, truth):
        if len(path) > 1:  # one instant stands for all times
            time = time[(time >= path.time[0] - TIME_TOLERANCE) & (time <= path.time[-1] + TIME_TOLERANCE)]
    if not len(time):
        raise InputError(
            f"camera path ({estimate.time[0]:.3f} to {estimate.time[-1]:.3f} s) and its truth ({truth.time[0]:.3f} to "
            f"{truth.time[-1]:.3f} s) share no time: check that both use the recording's clock"
        )
    after = np.clip(np.searchsorted(estimate.time, time), 1, max(len(estimate) - 1, 1))
    nearest = after - (time - estimate.time[after - 1] < estimate.time[after % len(estimate)] - time)
    return estimate.at(time), truth.at(time), nearest if len(estimate) > 1 else np.zeros(len(time), int)


def _spacing(path: CameraPath) -> float:
    """Seconds between instants (median); −1 for a camera that stands still, whose instant is no sample in time."""
    return float(np.median(np.diff(path.time))) if len(path) > 1 else -1.0


def camera_error(pair: PathPair, gauge: Alignment) -> CameraError:
    """Errors of an estimated path, moved into the true world by the gauge, against the true one."""
    moved, truth = move_path(pair[0], gauge), pair[1]
    R_camera_world = transpose(moved.R_world_camera)
    rotation = log(R_camera_world @ truth.R_world_camera)
    translation = np.einsum("tij,tj->ti", R_camera_world, truth.p_world_camera - moved.p_world_camera)
    return CameraError(moved.time, np.concatenate([rotation, translation], axis=1))


def camera_metrics(error: CameraError, seen: np.ndarray | None = None) -> dict[str, Metric]:
    """Mean, 95th percentile and maximum of translation and rotation.

    Where it is known at which instants a wearer was ``seen`` ``(T,)``, the means over those alone are given too, for
    between them the path is only as good as the camera's IMU.
    """
    table: dict[str, Metric] = {}
    for name, values, unit in (
        ("camera_translation", error.translation, "m"),
        ("camera_rotation", np.rad2deg(error.rotation), "deg"),
    ):
        table[name] = Metric(float(values.mean()), unit)
        table[f"{name}_95th"] = Metric(float(np.quantile(values, 0.95)), unit)
        table[f"{name}_max"] = Metric(float(values.max()), unit)
        if seen is not None and np.any(seen):
            table[f"{name}_seen"] = Metric(float(values[seen].mean()), unit)
    return table


def seen_instants(residual_px: Array | None, path: CameraPath, chosen: np.ndarray) -> np.ndarray | None:
    """At which of the chosen instants ``(n,)`` of a path any wearer was in view; None if that is not known."""
    if residual_px is None or len(residual_px) != len(path) or len(path) == 1:
        return None
    return np.isfinite(residual_px[chosen]).any(axis=1)
