"""How an IMU sits on a camera, if nobody said: from how the camera turned by the picture and by the IMU.

With ``C`` the camera's rotations by the picture and ``S`` the IMU's, ``C R_camera_imu = Rz(γ) S`` in every frame. For a
heading ``γ`` the mounting is the mean of ``Cᵀ Rz(γ) S`` (Wahba's problem), the better the nearer these lie to each
other; their sum is linear in ``cos γ``, ``sin γ`` and 1, so all headings can be tried.
"""

import numpy as np

from vip_factors.geometry.rotations import Array, angle_between, rotation_z, transpose

ROUNDS = 10  # of reweighting: a robust mean settles in five
SCALE = np.deg2rad(10.0)  # beyond which a frame counts less: a camera by PnP on an inertial skeleton is off by so much
HEADINGS = np.deg2rad(np.arange(0.0, 360.0, 0.5))


def camera_mounting(R_world_camera: Array, R_inertial_imu: Array) -> tuple[Array, float]:
    """``R_camera_imu`` ``(3, 3)`` and the IMU's heading in radians that fit best, outliers discounted.

    A camera that only turns about the vertical leaves the two free to turn against each other; any pair that fits does
    then, for all that is measured.

    Args:
        R_world_camera: ``(n, 3, 3)``, the world's z up.
        R_inertial_imu: ``(n, 3, 3)`` at the same instants.
    """
    weights = np.ones(len(R_world_camera))
    mounting, heading = np.eye(3), 0.0
    for _ in range(ROUNDS):
        mounting, heading = _weighted(R_world_camera, R_inertial_imu, weights)
        off = angle_between(R_world_camera @ mounting, rotation_z(heading) @ R_inertial_imu)
        weights = 1 / (1 + (off / SCALE) ** 2)
    return mounting, heading


def _weighted(C: Array, S: Array, weights: Array) -> tuple[Array, float]:
    """The best pair: the heading whose mountings lie nearest to each other, and their mean."""
    horizontal, turned = np.diag([1.0, 1.0, 0.0]), np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    cosine, sine, rest = (
        np.einsum("n,nij->ij", weights, transpose(C) @ part @ S) for part in (horizontal, turned, np.diag([0, 0, 1.0]))
    )
    sums = np.cos(HEADINGS)[:, None, None] * cosine + np.sin(HEADINGS)[:, None, None] * sine + rest
    U, size, Vt = np.linalg.svd(sums)
    signs = np.ones((len(sums), 3))
    signs[:, 2] = np.sign(np.linalg.det(U) * np.linalg.det(Vt))
    best = int(np.argmax(np.sum(signs * size, axis=1)))
    return (U[best] * signs[best]) @ Vt[best], float(HEADINGS[best])
