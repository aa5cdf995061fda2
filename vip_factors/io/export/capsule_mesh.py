"""The body as one mesh: a rounded, tapered tube for each segment, which bends with the bones that meet at its ends."""

from dataclasses import dataclass

import numpy as np

from vip_factors.body.mannequin import Segment, Side
from vip_factors.body.skeleton import PARENTS, Skeleton
from vip_factors.geometry.rotations import Array

SIDES = 12  # corners of a cross-section
CAP_RINGS = 3  # between the equator of a round end and its pole
BEYOND = 0.25  # share of the next bone in a round end: half would bend more softly, but knees thin at deep bends
AT_JOINT_M = 1e-6  # an end this near to a joint lies there


@dataclass(frozen=True)
class BodyMesh:
    """``V`` corners of a body in its rest pose, pelvis axes.

    Attributes:
        p_pelvis_corner: ``(V, 3)`` metres.
        normal: ``(V, 3)``, outwards.
        bones: ``(V, 2)`` the two bones that move a corner; the same twice where it is one.
        weight: ``(V,)`` share of the first of them; the second has the rest.
        triangles: ``(n, 3)`` corner numbers, counter-clockwise from outside, of each side of the body.
    """

    p_pelvis_corner: Array
    normal: Array
    bones: np.ndarray
    weight: Array
    triangles: dict[Side, np.ndarray]


@dataclass(frozen=True)
class _Tube:
    """A segment's surface.

    Attributes:
        p_bone_corner: ``(V, 3)`` metres, bone axes.
        normal: ``(V, 3)``.
        along: ``(V,)`` metres from the segment's start, along its axis.
        triangles: ``(n, 3)``.
    """

    p_bone_corner: Array
    normal: Array
    along: Array
    triangles: np.ndarray


def body_mesh(skeleton: Skeleton, segments: tuple[Segment, ...]) -> BodyMesh:
    """The mesh of a body's segments."""
    pairs = [(one, _tube(one)) for one in segments]
    blends = [_blend(skeleton, one, tube.along) for one, tube in pairs]
    triangles: dict[Side, list[np.ndarray]] = {}
    corners = 0
    for one, tube in pairs:
        triangles.setdefault(one.side, []).append(tube.triangles + corners)
        corners += len(tube.along)
    return BodyMesh(
        np.concatenate([skeleton.p_pelvis_joint[one.bone] + tube.p_bone_corner for one, tube in pairs]),
        np.concatenate([tube.normal for _, tube in pairs]),
        np.concatenate([bones for bones, _ in blends]),
        np.concatenate([weight for _, weight in blends]),
        {side: np.concatenate(parts) for side, parts in triangles.items()},
    )


def _tube(segment: Segment) -> _Tube:
    arm = segment.p_bone_end - segment.p_bone_start
    length = float(np.linalg.norm(arm))
    axis = arm / length if length > 0 else np.array([0.0, 1.0, 0.0])
    across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    across /= np.linalg.norm(across)
    along, radius, lean = _profile(length, segment.radius_start, segment.radius_end)
    turn = 2 * np.pi * np.arange(SIDES) / SIDES
    outwards = np.cos(turn)[:, None] * across + np.sin(turn)[:, None] * np.cross(axis, across)
    corners = segment.p_bone_start + along[:, None, None] * axis + radius[:, None, None] * outwards
    normal = np.cos(lean)[:, None, None] * outwards + np.sin(lean)[:, None, None] * axis
    ring, corner = np.meshgrid(np.arange(len(along) - 1), np.arange(SIDES), indexing="ij")
    a, b = ring * SIDES + corner, ring * SIDES + (corner + 1) % SIDES
    triangles = np.stack([a, b, b + SIDES, a, b + SIDES, a + SIDES], axis=-1).reshape(-1, 3)
    on_pole = radius[triangles // SIDES] == 0  # with two corners on one pole a triangle has no area
    triangles = triangles[on_pole.sum(axis=1) < 2]
    return _Tube(corners.reshape(-1, 3), normal.reshape(-1, 3), np.repeat(along, SIDES), triangles)


def _profile(length: float, start: float, end: float) -> tuple[Array, Array, Array]:
    """Rings from pole to pole: place along the axis, radius, and how far the normal leans forward (rad)."""
    angle = np.linspace(-np.pi / 2, 0.0, CAP_RINGS + 1)
    between = [x for x in (start, length - end) if 0 < x < length] if start + end < length else []
    shaft = np.array([start + (end - start) * x / length for x in between])
    lean = np.arctan2(start - end, length) if length > 0 else 0.0
    return (
        np.concatenate([start * np.sin(angle), between, length - end * np.sin(angle[::-1])]),
        np.concatenate([_clean(start * np.cos(angle)), shaft, _clean(end * np.cos(angle[::-1]))]),
        np.concatenate([angle, np.full(len(between), lean), -angle[::-1]]),
    )


def _clean(radius: Array) -> Array:
    return np.where(radius < 1e-12, 0.0, radius)


def _blend(skeleton: Skeleton, segment: Segment, along: Array) -> tuple[np.ndarray, Array]:
    """Bones ``(V, 2)`` and the share ``(V,)`` of the first, the segment's own.

    Where a segment ends at a joint, the bone beyond gets its share from one radius before the joint on.
    """
    bones = np.full((len(along), 2), segment.bone)
    share = np.ones(len(along))
    length = float(np.linalg.norm(segment.p_bone_end - segment.p_bone_start))
    parent = PARENTS[segment.bone]
    if parent >= 0 and np.linalg.norm(segment.p_bone_start) < AT_JOINT_M:
        _hand_over(bones, share, parent, along / segment.radius_start)
    for child, above in enumerate(PARENTS):
        at = np.linalg.norm(segment.p_bone_end - skeleton.p_parent_joint[child])
        if above == segment.bone and at < AT_JOINT_M:
            _hand_over(bones, share, child, (length - along) / segment.radius_end)
    return bones, share


def _hand_over(bones: np.ndarray, share: Array, other: int, before: Array) -> None:
    """Let another bone have its part of the corners that lie ``before`` a joint, counted in radii."""
    own = 1 - BEYOND * (1 - _smooth_step(before))
    more = own < share
    bones[more, 1] = other
    share[more] = own[more]


def _smooth_step(x: Array) -> Array:
    x = np.clip(x, 0.0, 1.0)
    return x * x * (3 - 2 * x)
