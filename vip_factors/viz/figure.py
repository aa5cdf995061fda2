"""Bodies with skin, light and sensors: posed, shaded, and blended into a picture with smooth edges.

Shaded triangles into a picture with a depth buffer: by OpenCV 5, or in NumPy where OpenCV is older.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from vip_factors.body.body_mesh import BodyMesh, body_mesh
from vip_factors.body.kinematics import Motion
from vip_factors.body.mannequin import Colour, Side, side_of
from vip_factors.body.skeleton import JOINT_COUNT
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.calibration import Calibration, Placement
from vip_factors.viz.colours import skin_colours
from vip_factors.viz.drawn_scene import DrawnWearer
from vip_factors.viz.eye import Eye

FAR_M = 1e3  # of pixels that nothing covers, about: OpenCV turns depths over and back
COVERED_M = 0.9 * FAR_M  # anything nearer is covered
NEAREST_M = 0.15  # triangles with a corner nearer than this are left out
LARGEST_PX = 400  # in NumPy, so are larger ones: their pixels would take too much memory
OVERSAMPLING = 2  # pixels a side, averaged: edges without steps
NEARBY_M = 0.3  # nearer skin does not tell where in the picture a body is
AMBIENT, KEY, RIM, GLOSS = 0.52, 0.72, 0.16, 0.10  # shares of light, chosen by eye
OCCLUSION, OCCLUSION_M = 0.45, 0.10  # how dark what lies behind a near limb gets, and how far behind for all of it
SUN_RIGHT, SUN_UP, SUN_BACK = -0.55, 1.0, 0.45  # to the left of the eye, above, and on its side of the scene
OCCLUSION_SPAN_M = 0.22  # around a pixel, in the body's own scale


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


class Figure:
    """A body that moves, ready to be posed at any time.

    Args:
        mesh: its skin.
        motion: in the world to be drawn.
        colours: by side.
        boxes: sensors on it, if they are to be seen.
    """

    def __init__(
        self, mesh: BodyMesh, motion: Motion, colours: Mapping[Side, Colour], boxes: SensorBoxes | None = None
    ) -> None:
        self.mesh, self.motion, self.boxes = mesh, motion, boxes
        by_bone = np.array([colours[side_of(bone)] for bone in range(JOINT_COUNT)]) / 255
        self.base = (mesh.weights @ by_bone).astype(np.float32)
        self.faces = mesh.faces.astype(np.int32)
        if boxes is not None:
            box = np.tile(np.array(BOX_COLOUR, np.float32) / 255, (len(boxes.bone), 1))
            self.faces = np.concatenate([self.faces, boxes.faces + np.int32(len(self.base))])
            self.base = np.concatenate([self.base, box])

    def shown_at(self, time: float) -> bool:
        """Whether the motion knows an instant, within a frame."""
        own = self.motion.time
        return bool(own[0] - 1 / self.motion.rate <= time <= own[-1] + 1 / self.motion.rate)

    def posed(self, time: float) -> "Posed":
        """The skin at the frame nearest to an instant in seconds."""
        motion = self.motion
        frame = int(np.clip(round((time - motion.start) * motion.rate), 0, len(motion) - 1))
        bones = motion.state.R_world_bone[frame], motion.state.p_world_joint[frame]
        p, normal = self.mesh.posed(*bones)
        if self.boxes is not None:
            p, normal = (np.concatenate(both) for both in zip((p, normal), self.boxes.posed(*bones), strict=True))
        return Posed(p.astype(np.float32), normal.astype(np.float32), self.base, self.faces)


@dataclass(frozen=True)
class Posed:
    """One body at one instant: ``p`` and ``normal`` ``(V, 3)`` in the world, ``base`` ``(V, 3)`` colours, ``faces``."""

    p: np.ndarray
    normal: np.ndarray
    base: np.ndarray
    faces: np.ndarray

    def lit(self, eye: Eye, light: Array) -> np.ndarray:
        """Colours ``(V, 3)`` of the skin, 0 to 1: a light sky, a key light, a rim and a little gloss."""
        towards = (eye.p_world_camera - self.p).astype(np.float32)
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        sun = light.astype(np.float32)
        half = towards + sun
        half /= np.linalg.norm(half, axis=1, keepdims=True)
        facing = np.clip(np.einsum("vi,vi->v", self.normal, towards), 0, 1)
        key = np.clip(0.5 + 0.5 * self.normal @ sun, 0, 1) ** 1.7  # wrapped round the body: soft, as from a window
        sky = 0.75 + 0.25 * self.normal[:, 2]
        white = RIM * (1 - facing) ** 3 + GLOSS * np.clip(np.einsum("vi,vi->v", self.normal, half), 0, 1) ** 24
        return np.clip(self.base * (AMBIENT * sky + KEY * key)[:, None] + white[:, None], 0, 1).astype(np.float32)


def blend(
    image: np.ndarray, eye: Eye, bodies: Sequence[Posed], light: Array, opacity: float = 1.0
) -> np.ndarray | None:
    """Draw bodies that hide each other into ``image`` ``(H, W, 3)`` float32, in place.

    Returns:
        How much of each pixel they cover, ``(H, W)``; None if they are not in the picture.
    """
    if not bodies:
        return None
    everyone = together(bodies)
    pixels, depths = eye.project(everyone.p)
    box = _box(pixels[depths > NEARBY_M], image.shape[1], image.shape[0])
    if box is None:
        return None
    x, y, width, height = box
    fine = np.zeros((height * OVERSAMPLING, width * OVERSAMPLING, 3), np.float32)
    depth = empty_depth(height * OVERSAMPLING, width * OVERSAMPLING)
    # A pixel's fine pixels lie around its centre, which is a whole number in both pictures.
    at = (pixels - [x, y]) * OVERSAMPLING + (OVERSAMPLING - 1) / 2
    paint(fine, depth, at, depths, everyone.faces, everyone.lit(eye, light))
    covered = (depth < COVERED_M).astype(np.float32)
    cover = cv2.resize(covered, (width, height), interpolation=cv2.INTER_AREA)
    colour = cv2.resize(fine, (width, height), interpolation=cv2.INTER_AREA)  # already times the cover
    colour *= _occlusion(depth[::OVERSAMPLING, ::OVERSAMPLING], eye)[..., None]
    part = image[y : y + height, x : x + width]
    part *= (1 - opacity * cover)[..., None]
    part += opacity * colour
    whole = np.zeros(image.shape[:2], np.float32)
    whole[y : y + height, x : x + width] = cover
    return whole


def together(bodies: Sequence[Posed]) -> Posed:
    """Several bodies as one."""
    first = np.cumsum([0, *(len(body.p) for body in bodies[:-1])])
    faces = [body.faces + np.int32(start) for body, start in zip(bodies, first, strict=True)]
    p, normal, base = (np.concatenate([getattr(body, name) for body in bodies]) for name in ("p", "normal", "base"))
    return Posed(p, normal, base, np.concatenate(faces))


def _box(pixels: np.ndarray, width: int, height: int) -> tuple[int, int, int, int] | None:
    """Left, top, width and height of the part of the picture in which points lie."""
    if not len(pixels):
        return None
    left, top = np.clip(np.floor(pixels.min(axis=0)).astype(int) - 1, 0, [width, height]).tolist()
    right, bottom = np.clip(np.ceil(pixels.max(axis=0)).astype(int) + 2, 0, [width, height]).tolist()
    return (left, top, right - left, bottom - top) if right > left and bottom > top else None


def _occlusion(depth: np.ndarray, eye: Eye) -> np.ndarray:
    """Brightness: less where skin lies behind the mean depth of the skin around it, as under an arm."""
    body = depth < COVERED_M
    if not body.any():
        return np.ones_like(depth)
    filled: np.ndarray = np.where(body, depth, 0).astype(np.float32)
    span = max(3, int(OCCLUSION_SPAN_M * eye.model.focal[0] / float(depth[body].mean())) | 1)
    total = cv2.boxFilter(filled, -1, (span, span), normalize=False)
    count = cv2.boxFilter(body.astype(np.float32), -1, (span, span), normalize=False)
    behind = np.where(body, filled - total / np.maximum(count, 1), 0)
    behind = np.asarray(cv2.GaussianBlur(behind, (0, 0), max(1.0, span / 12)))
    return 1 - OCCLUSION * np.clip(behind / OCCLUSION_M, 0, 1)


def figure_of(wearer: DrawnWearer, colours: Mapping[Side, Colour] | None = None) -> Figure | None:
    """A wearer with its sensors, in its own colours if there are no others; None without a motion."""
    if wearer.shown is None:
        return None
    mesh, boxes = body_mesh(wearer.shown.skeleton), None
    if wearer.recording is not None:
        calibration = wearer.estimate.calibration if wearer.estimate is not None else None
        boxes = sensor_boxes(mesh, wearer.recording.placement, calibration)
    return Figure(mesh, wearer.shown, colours or skin_colours(wearer.index), boxes)


def lit_from(eye: Eye, up: float = SUN_UP) -> Array:
    """Unit direction ``(3,)`` to a light left of an eye, above the scene; the higher ``up``, the shorter shadows."""
    R = eye.R_world_camera
    back = -R[:, 2] * [1.0, 1.0, 0.0]
    sun = SUN_RIGHT * R[:, 0] + SUN_BACK * back / max(float(np.linalg.norm(back)), 1e-9) + [0.0, 0.0, up]
    return np.asarray(sun / np.linalg.norm(sun))


def as_bytes(image: np.ndarray) -> np.ndarray:
    """Colours 0 to 1 as 0 to 255, rounded."""
    return cv2.convertScaleAbs(image, alpha=255.0)


def empty_depth(height: int, width: int) -> np.ndarray:
    """A depth buffer of nothing."""
    return np.full((height, width), FAR_M, dtype=np.float32)


def paint(
    image: np.ndarray, depth: np.ndarray, pixels: np.ndarray, depths: np.ndarray, faces: np.ndarray, colours: np.ndarray
) -> None:
    """Draw triangles that face the eye into ``image`` where they are nearer than what is there.

    Colours and depths are linear over the image, not over the surface: for triangles of a few pixels that is the same.

    Args:
        image: ``(H, W, 3)`` float32, changed in place.
        depth: ``(H, W)`` float32 metres, changed in place.
        pixels: ``(V, 2)`` of the vertices, x right and y down; pixel centres are whole numbers.
        depths: ``(V,)`` metres before the eye.
        faces: ``(F, 3)`` int32, anticlockwise seen from outside.
        colours: ``(V, 3)`` float32, 0 to 1.
    """
    near = depths <= NEAREST_M
    if near.any():
        faces = faces[~near[faces].any(axis=1)]
    if not len(faces):
        return
    if hasattr(cv2, "triangleRasterize"):
        _by_opencv(image, depth, pixels, depths, faces, colours)
    else:
        _by_numpy(image, depth, pixels, depths, faces, colours)


def _by_opencv(
    image: np.ndarray, depth: np.ndarray, pixels: np.ndarray, depths: np.ndarray, faces: np.ndarray, colours: np.ndarray
) -> None:
    """Undo OpenCV's own projection (90° high, y up, looking along −z), so that any camera's pixels can be given."""
    half = np.float32(image.shape[0] / 2)
    points = np.empty((len(pixels), 3), np.float32)
    points[:, 0] = (pixels[:, 0] + 0.5 - image.shape[1] / 2) / half * depths
    points[:, 1] = (half - 0.5 - pixels[:, 1]) / half * depths
    points[:, 2] = -depths
    cv2.triangleRasterize(
        points, faces, colours, image, depth, np.eye(4, dtype=np.float32), np.pi / 2, NEAREST_M / 2, FAR_M
    )


def _by_numpy(
    image: np.ndarray, depth: np.ndarray, pixels: np.ndarray, depths: np.ndarray, faces: np.ndarray, colours: np.ndarray
) -> None:
    """All candidate pixels of all triangles at once; the nearest of each pixel wins."""
    height, width = depth.shape
    a, b, c = (pixels[faces[:, corner]].astype(np.float32) for corner in range(3))
    ab, ac = b - a, c - a
    area = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
    low = np.maximum(np.ceil(np.minimum(np.minimum(a, b), c)), 0)
    high = np.minimum(np.floor(np.maximum(np.maximum(a, b), c)), np.array([width, height], np.float32) - 1)
    extent = high - low + 1
    # y goes down in the image: what is anticlockwise from outside has a negative area here.
    good = np.flatnonzero((area < 0) & (extent > 0).all(axis=1) & (extent < LARGEST_PX).all(axis=1))
    a, ab, ac, area, low, extent = (one[good] for one in (a, ab, ac, area, low, extent.astype(np.int32)))
    count = extent[:, 0] * extent[:, 1]
    one = np.repeat(np.arange(len(good)), count)
    row, column = np.divmod(np.arange(len(one)) - np.repeat(np.cumsum(count) - count, count), extent[one, 0])
    x, y = low[one, 0] + column - a[one, 0], low[one, 1] + row - a[one, 1]
    share_b = (x * ac[one, 1] - y * ac[one, 0]) / area[one]
    share_c = (y * ab[one, 0] - x * ab[one, 1]) / area[one]
    inside = np.flatnonzero((share_b >= 0) & (share_c >= 0) & (share_b + share_c <= 1))
    one, share_b, share_c = one[inside], share_b[inside], share_c[inside]
    share = np.stack([1 - share_b - share_c, share_b, share_c], axis=1)
    at = (low[one, 1].astype(int) + row[inside]) * width + low[one, 0].astype(int) + column[inside]
    corners = faces[good[one]]
    there = 1 / np.einsum("nc,nc->n", share, 1 / depths[corners])
    order = np.lexsort((there, at))
    order = order[np.flatnonzero(np.diff(at[order], prepend=-1))]
    order = order[there[order] < depth.ravel()[at[order]]]
    depth.ravel()[at[order]] = there[order]
    image.reshape(-1, 3)[at[order]] = np.einsum("nc,nci->ni", share[order], colours[corners[order]])
