"""The sensors' boxes, laid onto the skin nearest to where each is said to sit."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vip_factors.body.body_mesh import BodyMesh
from vip_factors.body.mannequin import Colour
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.calibration import Calibration, Placement

HALF_SIZE_M = np.array([0.026, 0.019, 0.009])  # of a usual one with its holder
BOX_COLOUR: Colour = (44, 48, 56)  # dark: seen on every wearer's skin
SUNK_M = 0.003  # into the skin, which is round where the box is flat


@dataclass(frozen=True)
class SensorBoxes:
    """Boxes on bones: each face has its own four corners, so that edges stay sharp.

    Attributes:
        bone: ``(V,)`` index of each vertex's bone.
        p_bone, normal: ``(V, 3)`` metres and unit, in the bone's frame.
        faces: ``(F, 3)``, anticlockwise seen from outside.
    """

    bone: np.ndarray
    p_bone: Array
    normal: Array
    faces: np.ndarray

    def posed(self, R_world_bone: Array, p_world_bone: Array) -> tuple[Array, Array]:
        """Vertices and normals ``(V, 3)`` in the world, bones being at ``(24, 3, 3)`` and ``(24, 3)``."""
        R = R_world_bone[self.bone]
        p = np.einsum("vij,vj->vi", R, self.p_bone) + p_world_bone[self.bone]
        return p, np.einsum("vij,vj->vi", R, self.normal)


def sensor_boxes(mesh: BodyMesh, placement: Placement, calibration: Calibration | None) -> SensorBoxes:
    """Boxes of all sensors: flat on the skin, turned about its normal as their mountings are."""
    corners, normals, faces = _unit_box()
    boxes: list[tuple[np.ndarray, Array, Array]] = []
    for site in placement.sites:
        known = calibration.get(site.sensor) if calibration is not None else None
        R_bone_sensor = known.R_bone_sensor if known is not None else site.R_bone_sensor
        found = _on_skin(mesh, site.bone_index, site.p_bone_sensor)
        if found is None:
            continue
        p, up = found
        R = _flat(up, R_bone_sensor)
        centre = p + (HALF_SIZE_M[2] - SUNK_M) * up
        boxes.append((np.full(len(corners), site.bone_index), centre + corners @ R.T, normals @ R.T))
    if not boxes:
        return SensorBoxes(np.zeros(0, int), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3), np.int32))
    bone, p_bone, normal = (np.concatenate(part) for part in zip(*boxes, strict=True))
    every = np.concatenate([faces + len(corners) * number for number in range(len(boxes))]).astype(np.int32)
    return SensorBoxes(bone, p_bone, normal, every)


def _on_skin(mesh: BodyMesh, bone: int, p_bone: Array) -> tuple[Array, Array] | None:
    """The skin's vertex of a bone nearest to a point, and its normal, in the bone's frame."""
    mine = np.flatnonzero(mesh.bone == bone)
    if not len(mine):
        return None
    p = (mesh.p_bind[mine] - mesh.p_bind_bone[bone]) @ mesh.R_bind_bone[bone]
    nearest = int(np.argmin(np.linalg.norm(p - p_bone, axis=1)))
    return p[nearest], mesh.normal[mine[nearest]] @ mesh.R_bind_bone[bone]


def _flat(up: Array, R_bone_sensor: Array) -> Array:
    """Axes ``(3, 3)`` of a box whose z is ``up``, its x as near to the sensor's x (or else y) as that allows."""
    ahead = R_bone_sensor[:, 0] if abs(R_bone_sensor[:, 0] @ up) < 0.9 else R_bone_sensor[:, 1]
    x = ahead - (ahead @ up) * up
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(up, x), up], axis=1)


def _unit_box() -> tuple[Array, Array, np.ndarray]:
    corners: list[Array] = []
    normals: list[Array] = []
    faces: list[list[int]] = []
    square: Sequence[tuple[int, int]] = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    for axis in range(3):
        for sign in (-1, 1):
            first = len(corners)
            for a, b in square[::sign]:
                corners.append(np.roll([sign, a, b], axis) * HALF_SIZE_M)
                normals.append(np.roll([sign, 0, 0], axis))
            faces += [[first, first + 1, first + 2], [first, first + 2, first + 3]]
    return np.array(corners), np.array(normals, dtype=float), np.array(faces)
