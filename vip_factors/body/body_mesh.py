"""Skinned mesh of the mannequin, for renderers and export.

The skin is the level set ``sum(exp(-distance / softness)) = 1`` over the segments, a union with rounded creases. It is
extracted from a grid by surface nets (Gibson 1998) and moves by linear blend skinning.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from vip_factors.body.kinematics import BodyState, forward_kinematics
from vip_factors.body.mannequin import Segment, mannequin
from vip_factors.body.skeleton import JOINT_COUNT, PARENTS, Landmark, Skeleton, joint_index
from vip_factors.geometry.rotations import Array, rotation_z

REACH = 7.0  # in units of softness: a segment at this distance contributes a thousandth
# Joints whose segments form a piece, and the cell size of its grid, in thousandths of stature.
PIECES = (
    (("pelvis", "spine1", "spine2", "spine3", "neck", "left_collar", "right_collar", "left_hip", "right_hip",
      "left_knee", "right_knee", "left_shoulder", "right_shoulder", "left_elbow", "right_elbow"), 11.0),
    (("head",), 7.5),
    (("left_ankle", "left_foot"), 7.5), (("right_ankle", "right_foot"), 7.5),
    (("left_wrist", "left_hand"), 4.4), (("right_wrist", "right_hand"), 4.4),
)  # fmt: skip


@dataclass(frozen=True)
class BodyMesh:
    """Triangle mesh that moves with a skeleton.

    Attributes:
        p_bind: ``(V, 3)`` metres, vertices in the pelvis frame, in the bind pose.
        normal: ``(V, 3)`` unit normals, outwards, in the bind pose.
        faces: ``(F, 3)`` indices of vertices, anticlockwise seen from outside.
        weights: ``(V, 24)`` skinning weights; rows sum to one.
        R_bind_bone, p_bind_bone: ``(24, 3, 3)`` and ``(24, 3)`` poses of the bones in the bind pose.
    """

    p_bind: Array
    normal: Array
    faces: np.ndarray
    weights: Array
    R_bind_bone: Array
    p_bind_bone: Array

    @property
    def bone(self) -> np.ndarray:
        """Bone ``(V,)`` with the largest weight of each vertex."""
        return np.argmax(self.weights, axis=1)

    def four_bones(self) -> tuple[np.ndarray, np.ndarray]:
        """Four bones with the largest weights of each vertex, ``(V, 4)`` bytes, and their weights, with sum 255.

        Bones without a weight have number 0.
        """
        bones = np.argsort(-self.weights, axis=1)[:, :4]
        largest = np.take_along_axis(self.weights, bones, axis=1)
        shares = np.rint(255 * largest / largest.sum(axis=1, keepdims=True)).astype(np.int16)
        shares[:, 0] += 255 - shares.sum(axis=1)
        return np.where(shares > 0, bones, 0).astype(np.uint8), shares.astype(np.uint8)

    def posed(self, R_world_bone: Array, p_world_bone: Array) -> tuple[Array, Array]:
        """Vertices and unit normals ``(V, 3)`` in the world, for bones at ``(24, 3, 3)`` and ``(24, 3)``."""
        R = np.einsum("bij,bkj->bik", R_world_bone, self.R_bind_bone)
        t = p_world_bone - np.einsum("bij,bj->bi", R, self.p_bind_bone)
        blended = self.weights @ np.concatenate([R.reshape(-1, 9), t], axis=1)
        R_vertex = blended[:, :9].reshape(-1, 3, 3)
        p = np.einsum("vij,vj->vi", R_vertex, self.p_bind) + blended[:, 9:]
        normal = np.einsum("vij,vj->vi", R_vertex, self.normal)
        return p, normal / np.linalg.norm(normal, axis=1, keepdims=True)


def body_mesh(skeleton: Skeleton) -> BodyMesh:
    """Make the skin of a skeleton; takes tenths of a second, and is cached."""
    landmarks = [
        (name, landmark.bone, landmark.p_bone_point.astype(float).tobytes())
        for name, landmark in skeleton.landmarks.items()
    ]
    return _mesh_of(skeleton.p_parent_joint.tobytes(), tuple(landmarks))


@lru_cache(maxsize=8)
def _mesh_of(offsets: bytes, landmarks: tuple[tuple[str, int, bytes], ...]) -> BodyMesh:
    legs_apart = np.deg2rad(14.0)  # in the bind pose, so that the thighs do not merge
    points = {name: Landmark(bone, np.frombuffer(point)) for name, bone, point in landmarks}
    skeleton = Skeleton(np.frombuffer(offsets).reshape(JOINT_COUNT, 3), points)
    R = np.tile(np.eye(3), (1, JOINT_COUNT, 1, 1))
    for side, sign in (("left_hip", 1.0), ("right_hip", -1.0)):
        R[0, joint_index(side)] = rotation_z(sign * legs_apart)
    state = forward_kinematics(skeleton, R, np.zeros((1, 3)))
    field = _Field(mannequin(skeleton), state)
    vertices, faces, count = [], [], 0
    for bones, cell in PIECES:
        chosen = np.isin(field.bone, [joint_index(bone) for bone in bones])
        if not chosen.any():
            continue
        p, triangles = field.skin(chosen, 1e-3 * cell * field.stature)
        vertices.append((p, field.normals(p, chosen), field.weights(p)))
        faces.append(triangles + count)
        count += len(p)
    p, normal, weights = (np.concatenate(arrays) for arrays in zip(*vertices, strict=True))
    return BodyMesh(p, normal, np.concatenate(faces), weights, state.R_world_bone[0], state.p_world_joint[0])


class _Field:
    """Scalar field of the segments: positive inside the skin, increasing inwards."""

    def __init__(self, segments: Sequence[Segment], state: BodyState) -> None:
        softness = 0.16  # relative to a segment's thinner end: rounds creases, keeps fingers apart
        self.bone = np.array([segment.bone for segment in segments])
        R, p = state.R_world_bone[0, self.bone], state.p_world_joint[0, self.bone]
        self.start = np.einsum("nij,nj->ni", R, [s.p_bone_start for s in segments]) + p
        self.axis = np.einsum("nij,nj->ni", R, [s.p_bone_end - s.p_bone_start for s in segments])
        self.radius = np.array([(s.radius_start, s.radius_end) for s in segments])
        self.softness = softness * self.radius.min(axis=1)
        ends = np.concatenate([self.start, self.start + self.axis])
        self.stature = float(np.ptp(ends[:, 1]))

    def _distance(self, n: int, p: Array) -> tuple[Array, Array]:
        """Distance ``(...)`` from segment ``n``'s surface, negative inside, and vector ``(..., 3)`` from its axis."""
        axis, (start_radius, end_radius) = self.axis[n].astype(p.dtype), self.radius[n].astype(p.dtype)
        off = p - self.start[n].astype(p.dtype)
        along = np.clip(off @ axis / max(float(axis @ axis), 1e-12), 0.0, 1.0)
        away = off - along[..., None] * axis
        return np.sqrt(np.einsum("...i,...i->...", away, away)) - (
            start_radius + along * (end_radius - start_radius)
        ), away

    def skin(self, chosen: np.ndarray, cell: float) -> tuple[Array, np.ndarray]:
        """Extract vertices ``(V, 3)`` and triangles ``(F, 3)`` of the skin over some segments."""
        most_cells = 300  # along one axis of a piece's grid, four times a usual one
        reach = self.radius.max(axis=1) + REACH * self.softness
        ends = np.stack([self.start, self.start + self.axis])
        low, high = ends.min(axis=0) - reach[:, None], ends.max(axis=0) + reach[:, None]
        origin = low[chosen].min(axis=0)
        cell = max(cell, float((high[chosen].max(axis=0) - origin).max()) / most_cells)
        shape = np.ceil((high[chosen].max(axis=0) - origin) / cell).astype(int) + 1
        total = np.full(shape, 1e-4, dtype=np.float32)
        for n in np.flatnonzero(chosen).tolist():
            start = np.maximum(np.floor((low[n] - origin) / cell).astype(int), 0)
            end = np.minimum(np.ceil((high[n] - origin) / cell).astype(int) + 1, shape)
            box = tuple(slice(a, b) for a, b in zip(start, end, strict=True))
            axes = [
                np.float32(origin[i]) + np.float32(cell) * np.arange(start[i], end[i], dtype=np.float32)
                for i in range(3)
            ]
            distance, _ = self._distance(n, np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1))
            total[box] += np.exp(np.minimum(-distance / np.float32(self.softness[n]), 20.0))
        total[[0, -1]] = total[:, [0, -1]] = total[:, :, [0, -1]] = 1e-4
        places, faces = surface_net(np.log(total))
        p = origin + cell * places
        for _ in range(2):  # Newton steps onto the skin
            value, slope = self._value(p, chosen)
            step = value / np.maximum(np.einsum("vi,vi->v", slope, slope), 1e-12)
            step = np.clip(step, -cell / np.linalg.norm(slope, axis=1), cell / np.linalg.norm(slope, axis=1))
            p = p - step[:, None] * slope
        return p, faces

    def _value(self, p: Array, chosen: np.ndarray) -> tuple[Array, Array]:
        """Field ``(V,)`` and its gradient ``(V, 3)``."""
        total, slope = np.full(len(p), 1e-12), np.zeros_like(p)
        for n in np.flatnonzero(chosen).tolist():
            distance, away = self._distance(n, p)
            density = np.exp(np.minimum(-distance / self.softness[n], 50.0))
            total += density
            length = np.maximum(np.linalg.norm(away, axis=1), 1e-9)
            slope -= (density / self.softness[n] / length)[:, None] * away
        return np.log(total), slope / total[:, None]

    def normals(self, p: Array, chosen: np.ndarray) -> Array:
        """Unit normals ``(V, 3)`` of the skin, outwards."""
        slope = self._value(p, chosen)[1]
        return -slope / np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-12)

    def weights(self, p: Array) -> Array:
        """Skinning weights ``(V, 24)`` by distance: of the nearest bone, its parent and its children."""
        weight_softness = 0.45  # relative to a segment's thicker end: length over which the skin bends at a joint
        shares = np.zeros((len(p), JOINT_COUNT))
        for n, bone in enumerate(self.bone):
            distance, _ = self._distance(n, p)
            share = np.exp(-np.maximum(distance, 0.0) / (weight_softness * self.radius[n].max()))
            shares[:, bone] = np.maximum(shares[:, bone], share)
        nearest = np.argmax(shares, axis=1)
        shares = np.where(_NEIGHBOURS[nearest], shares**2, 0.0)
        return shares / shares.sum(axis=1, keepdims=True)


_NEIGHBOURS = np.eye(JOINT_COUNT, dtype=bool)  # each bone, its parent and its children
for _bone, _parent in enumerate(PARENTS[1:], start=1):
    _NEIGHBOURS[_bone, _parent] = _NEIGHBOURS[_parent, _bone] = True


def surface_net(field: Array) -> tuple[Array, np.ndarray]:
    """Extract the zero level set of a field ``(X, Y, Z)``.

    Returns:
        Vertices ``(V, 3)`` in units of cells, and triangles ``(F, 3)``, anticlockwise seen from the negative side.
    """
    inside = field > 0
    corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    size = np.array(field.shape) - 1
    count = np.zeros(size, dtype=np.int8)
    for x, y, z in corners:
        count += inside[x : x + size[0], y : y + size[1], z : z + size[2]]
    cells = np.argwhere((count > 0) & (count < 8))
    number = np.full(size, -1)
    number[tuple(cells.T)] = np.arange(len(cells))
    values = np.stack([field[tuple((cells + corner).T)] for corner in corners], axis=1)
    total, crossings = np.zeros((len(cells), 3)), np.zeros(len(cells))
    for a in range(8):
        for b in range(a + 1, 8):
            if np.abs(corners[a] - corners[b]).sum() != 1:
                continue
            crossed = (values[:, a] > 0) != (values[:, b] > 0)
            share = np.where(crossed, values[:, a] / np.where(crossed, values[:, a] - values[:, b], 1.0), 0.0)
            total += crossed[:, None] * (corners[a] + share[:, None] * (corners[b] - corners[a]))
            crossings += crossed
    return cells + total / crossings[:, None], _net_faces(inside, number)


def _net_faces(inside: np.ndarray, number: np.ndarray) -> np.ndarray:
    """Make two triangles for every grid edge that crosses the surface, between the four cells around it."""
    faces = []
    for axis in range(3):
        low = np.moveaxis(inside, axis, 0)[:-1]
        high = np.moveaxis(inside, axis, 0)[1:]
        edges = np.argwhere(low != high)
        outwards = low[tuple(edges.T)]  # the field falls along the axis
        cells = np.moveaxis(number, axis, 0)
        i, j, k = edges.T
        ring = np.stack([cells[i, j - 1, k - 1], cells[i, j, k - 1], cells[i, j, k], cells[i, j - 1, k]], axis=1)
        # the other two axes follow cyclically for x and z only
        turned = outwards if axis != 1 else ~outwards
        ring = np.where(turned[:, None], ring, ring[:, ::-1])
        faces += [ring[:, [0, 1, 2]], ring[:, [0, 2, 3]]]
    return np.concatenate(faces)
