"""Errors of the camera: its path, and how the IMU on it was found to sit."""

from dataclasses import dataclass

import numpy as np

from vip_factors.errors import InputError
from vip_factors.evaluate.frames import TIME_TOLERANCE
from vip_factors.evaluate.table import Metric
from vip_factors.geometry.alignment import Alignment
from vip_factors.geometry.rotations import Array, log, transpose
from vip_factors.sensors.camera_path import CameraPath
from vip_factors.sensors.gauge import PathPair, move_path


@dataclass(frozen=True)
class CameraError:
    """Errors of a camera path in the true world.

    Attributes:
        time: ``(T,)`` seconds.
        tangent: ``(T, 6)``: ``T_true = T_estimated Exp(e)`` to first order: rotation (rad), then translation (m), both
            in the estimated camera's axes.
    """

    time: Array
    tangent: Array

    @property
    def rotation(self) -> Array:
        """Geodesic angles ``(T,)``, radians."""
        return np.linalg.norm(self.tangent[:, :3], axis=1)

    @property
    def translation(self) -> Array:
        """Distances ``(T,)``, metres."""
        return np.linalg.norm(self.tangent[:, 3:], axis=1)


def common_instants(estimate: CameraPath, truth: CameraPath) -> tuple[CameraPath, CameraPath, np.ndarray]:
    """Both paths at the estimate's instants within the truth (at the truth's, if the estimate stands still).

    Returns:
        The estimate, the truth, and which instants of the estimate they are.

    Raises:
        InputError: if they share no time.
    """
    if len(estimate) == 1:
        return estimate.at(truth.time), truth, np.zeros(len(truth), int)
    chosen = np.arange(len(estimate))
    if len(truth) > 1:
        late, early = truth.time[0] - TIME_TOLERANCE, truth.time[-1] + TIME_TOLERANCE
        chosen = np.flatnonzero((estimate.time >= late) & (estimate.time <= early))
    if not len(chosen):
        raise InputError(
            f"camera path ({estimate.time[0]:.3f} to {estimate.time[-1]:.3f} s) and its truth ({truth.time[0]:.3f} to "
            f"{truth.time[-1]:.3f} s) share no time: check that both use the recording's clock"
        )
    part = CameraPath(estimate.time[chosen], estimate.R_world_camera[chosen], estimate.p_world_camera[chosen])
    return part, truth.at(part.time), chosen


def camera_error(pair: PathPair, gauge: Alignment) -> CameraError:
    """Errors of an estimated path, moved into the true world by the gauge, against the true one."""
    moved, truth = move_path(pair[0], gauge), pair[1]
    R_camera_world = transpose(moved.R_world_camera)
    rotation = log(R_camera_world @ truth.R_world_camera)
    translation = np.einsum("tij,tj->ti", R_camera_world, truth.p_world_camera - moved.p_world_camera)
    return CameraError(moved.time, np.concatenate([rotation, translation], axis=1))


def camera_metrics(error: CameraError) -> dict[str, Metric]:
    """Mean, 95th percentile and maximum of translation and rotation."""
    table: dict[str, Metric] = {}
    for name, values, unit in (
        ("camera_translation", error.translation, "m"),
        ("camera_rotation", np.rad2deg(error.rotation), "deg"),
    ):
        table[name] = Metric(float(values.mean()), unit)
        table[f"{name}_95th"] = Metric(float(np.quantile(values, 0.95)), unit)
        table[f"{name}_max"] = Metric(float(values.max()), unit)
    return table
