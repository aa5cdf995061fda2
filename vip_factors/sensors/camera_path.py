"""Where a camera was over time."""

from dataclasses import dataclass

import numpy as np

from vip_factors.errors import InputError
from vip_factors.geometry.quaternions import interpolate_rotations
from vip_factors.geometry.rotations import Array, transpose


@dataclass(frozen=True)
class CameraPath:
    """Camera poses ``T_world_camera`` at ``T`` instants; one instant is a camera that stands still.

    Attributes:
        time: ``(T,)`` seconds from the recording's start, increasing.
        R_world_camera: ``(T, 3, 3)``; camera axes are OpenCV's (x right, y down, z forward).
        p_world_camera: ``(T, 3)`` metres.
    """

    time: Array
    R_world_camera: Array
    p_world_camera: Array

    def __post_init__(self) -> None:
        T = len(self.time)
        if T == 0 or self.R_world_camera.shape != (T, 3, 3) or self.p_world_camera.shape != (T, 3):
            raise InputError(
                f"camera path of {T} instants with rotations {self.R_world_camera.shape} and positions "
                f"{self.p_world_camera.shape}: expected (T, 3, 3) and (T, 3)"
            )

    def __len__(self) -> int:
        return len(self.time)

    def at(self, time: Array) -> "CameraPath":
        """Interpolated at other instants ``(N,)``; before the first and after the last, those are kept."""
        time = np.asarray(time, dtype=float)
        if len(self) == 1:
            count = len(time)
            return CameraPath(
                time, np.repeat(self.R_world_camera, count, axis=0), np.repeat(self.p_world_camera, count, axis=0)
            )
        inside = np.clip(time, self.time[0], self.time[-1])
        p = np.stack([np.interp(inside, self.time, column) for column in self.p_world_camera.T], axis=1)
        return CameraPath(time, interpolate_rotations(self.time, self.R_world_camera, inside), p)

    def to_camera(self, p_world: Array) -> Array:
        """World points ``(T, N, 3)`` in the camera's frame at each instant."""
        return np.einsum(
            "tij,tnj->tni", transpose(self.R_world_camera), p_world - self.p_world_camera[:, None], optimize=True
        )
