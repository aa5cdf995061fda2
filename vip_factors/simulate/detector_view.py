"""What of people is truly in the image, and what hides behind what."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from vip_factors.body.keypoints import KeypointSet
from vip_factors.body.kinematics import BodyState
from vip_factors.body.skeleton import Landmark, Skeleton, joint_index
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.camera import CameraModel, CameraPath

NEAREST_M = 0.3  # people nearer to the camera than this, or behind it, are not seen

# Bodies as capsules: from joint to joint, radius over stature, and the bones whose own keypoints lie on the capsule.
# Radii are means over the segment's length, rounded from the circumferences of anthropometric surveys (largest, of
# men: thigh 62 cm, calf 39, upper arm 36, forearm 31); the trunk is one column and two flanks.
CAPSULES = (
    ("pelvis", "neck", 0.065, ("pelvis", "spine1", "spine2", "spine3", "neck")),
    *(
        capsule
        for side in ("left", "right")
        for capsule in (
            (f"{side}_shoulder", f"{side}_hip", 0.055, (f"{side}_shoulder", f"{side}_hip", f"{side}_collar")),
            (f"{side}_shoulder", f"{side}_elbow", 0.028, (f"{side}_shoulder", f"{side}_elbow")),
            (f"{side}_elbow", f"{side}_wrist", 0.022, (f"{side}_elbow", f"{side}_wrist")),
            (f"{side}_hip", f"{side}_knee", 0.045, (f"{side}_hip", f"{side}_knee")),
            (f"{side}_knee", f"{side}_ankle", 0.030, (f"{side}_knee", f"{side}_ankle", f"{side}_foot")),
        )
    ),
)


@dataclass(frozen=True)
class Person:
    """Somebody in the scene, at the ``F`` instants of the video frames, where they are ``present`` ``(F,)`` or not."""

    skeleton: Skeleton
    state: BodyState
    present: np.ndarray

    @property
    def stature(self) -> float:
        """Metres, by the skeleton's landmarks or usual."""
        tall_m = 1.72  # stature of a skeleton that does not tell its own
        return self.skeleton.stature if {"head_top", "left_heel"} <= set(self.skeleton.landmarks) else tall_m


@dataclass(frozen=True)
class View:
    """``P`` people in ``F`` frames, ``K`` keypoints each.

    Attributes:
        pixels: ``(P, F, K, 2)`` where the keypoints really are, NaN out of the image.
        aimed: the same of the points that the detector means, not cut at the image's borders.
        height: ``(P, F)`` pixels at which the whole stature would appear at the pelvis's depth; NaN if not seen.
        depth: ``(P, F)`` metres of the pelvis.
        hidden, behind: ``(P, F, K)`` hidden by their own body, and by somebody else.
        facing: ``(P, F)`` cosine of the angle between where the chest points and the camera: 1 from the front.
    """

    pixels: Array
    aimed: Array
    height: Array
    depth: Array
    hidden: np.ndarray
    behind: np.ndarray
    facing: Array


def look(people: Sequence[Person], camera: CameraPath, model: CameraModel, keypoints: KeypointSet, bias: Array) -> View:
    """What a camera would see of people at its ``F`` poses, with a detector that adds ``bias`` ``(P, K, 3)`` metres,
    bone axes, to each keypoint's place.
    """
    views = [_Seen(person, camera, model, keypoints, offsets) for person, offsets in zip(people, bias, strict=True)]
    hidden = np.stack([view.hidden_by(view, is_self=True) for view in views])
    behind = np.zeros_like(hidden)
    for far, near in permutations(range(len(views)), 2):
        behind[far] |= views[far].hidden_by(views[near], is_self=False)
    pixels, aimed, height, depth, facing = (
        np.stack([getattr(view, name) for view in views])
        for name in ("pixels", "aimed", "height", "pelvis_depth", "facing")
    )
    return View(pixels, aimed, height, depth, hidden, behind, facing)


class _Seen:
    """One person in the image: keypoints and capsules."""

    def __init__(
        self, person: Person, camera: CameraPath, model: CameraModel, keypoints: KeypointSet, bias: Array
    ) -> None:
        self.landmarks = keypoints.on_body(person.skeleton)
        pelvis = camera.to_camera(person.state.p_world_joint[:, :1])[:, 0]
        self.seen = person.present & (pelvis[:, 2] > NEAREST_M)
        self.pelvis_depth = pelvis[:, 2]
        unit = model.focal[1] / np.maximum(pelvis[:, 2], NEAREST_M)
        self.height = np.where(self.seen, unit * person.stature, np.nan)
        right, self.depth = self._project(person, camera, model, np.zeros_like(bias))
        self.pixels = np.where(model.inside(right)[..., None], right, np.nan)
        self.aimed, _ = self._project(person, camera, model, bias)
        self._capsules(person, camera, model)
        chest = person.state.R_world_bone[:, joint_index("spine3"), :, 2]
        to_camera = camera.p_world_camera - person.state.p_world_joint[:, joint_index("spine3")]
        self.facing = np.sum(chest * to_camera, axis=1) / np.linalg.norm(to_camera, axis=1)

    def _project(self, person: Person, camera: CameraPath, model: CameraModel, bias: Array) -> tuple[Array, Array]:
        """Pixels ``(F, K, 2)`` and depths ``(F, K)``, NaN where there is no such point before the camera."""
        F = len(camera)
        points = np.full((F, len(self.landmarks), 3), np.nan)
        for k, landmark in enumerate(self.landmarks):
            if landmark is not None:
                points[:, k] = person.state.point(landmark.bone, landmark.p_bone_point + bias[k])
        points = camera.to_camera(points)
        good = self.seen[:, None] & (points[..., 2] > NEAREST_M)
        points[~good] = np.nan
        return model.project(points), points[..., 2]

    def _capsules(self, person: Person, camera: CameraPath, model: CameraModel) -> None:
        """Ends of the capsules in the image ``(F, C, 2 ends, 2)``, their depths and radii in metres and pixels."""
        head_radius, head_from, head_to = 0.044, 0.02, 0.08  # over stature, above the head's joint
        state, tall, head = person.state, person.stature, joint_index("head")
        ends = [[state.p_world_joint[:, joint_index(end)] for end in capsule[:2]] for capsule in CAPSULES]
        ends.append([state.point(head, np.array([0, tall * up, 0])) for up in (head_from, head_to)])
        points = np.stack([np.stack(pair, axis=1) for pair in ends], axis=1)
        F, C = points.shape[:2]
        points = camera.to_camera(points.reshape(F, 2 * C, 3)).reshape(F, C, 2, 3)
        usable = self.seen[:, None] & np.all(points[..., 2] > NEAREST_M, axis=2)
        self.capsule_depth = np.where(usable[..., None], points[..., 2], np.nan)
        self.capsule_pixels = np.where(usable[..., None, None], model.project(points), np.nan)
        self.capsule_radius = tall * np.array([*[capsule[2] for capsule in CAPSULES], head_radius])
        self.focal = model.focal[0]
        reach = 0.5 * np.nan_to_num(self.height)[:, None]
        self.low = np.nan_to_num(np.nanmin(_or_zero(self.capsule_pixels), axis=(1, 2)), nan=0.0) - 0.2 * reach
        self.high = np.nan_to_num(np.nanmax(_or_zero(self.capsule_pixels), axis=(1, 2)), nan=0.0) + 0.2 * reach

    def hidden_by(self, occluder: "_Seen", is_self: bool) -> np.ndarray:
        """``(F, K)`` whether the occluder's capsules hide the keypoints; of one's own not those they lie on."""
        buried = 0.3  # of its radius: how far behind the axis of a limb a point must be, to be hidden by it
        hidden = np.zeros(self.depth.shape, bool)
        near = self.seen & occluder.seen & np.all((self.low <= occluder.high) & (occluder.low <= self.high), axis=1)
        frames = np.flatnonzero(near)
        if not len(frames):
            return hidden
        for c in range(len(occluder.capsule_radius)):
            a, b = occluder.capsule_pixels[frames, c, 0], occluder.capsule_pixels[frames, c, 1]
            from_a, along = self.aimed[frames] - a[:, None], (b - a)[:, None]
            share = np.sum(from_a * along, axis=2) / np.maximum(np.sum(along**2, axis=2), 1e-9)
            share = np.clip(share, 0, 1)
            depth = occluder.capsule_depth[frames, c]
            depth = depth[:, :1] + share * (depth[:, 1:] - depth[:, :1])
            radius = occluder.capsule_radius[c]
            with np.errstate(invalid="ignore"):
                inside = np.linalg.norm(from_a - share[..., None] * along, axis=2) < radius * self.focal / depth
                inside &= self.depth[frames] > depth + buried * radius
            if is_self:
                inside[:, [_lies_on(landmark, c) for landmark in self.landmarks]] = False
            hidden[frames] |= inside
        return hidden


def _lies_on(landmark: Landmark | None, capsule: int) -> bool:
    """Whether a keypoint lies on this capsule of its own body; on the head, front and back tell for themselves."""
    if landmark is None or capsule == len(CAPSULES):
        return landmark is None
    return landmark.bone in {joint_index(bone) for bone in CAPSULES[capsule][3]}


def _or_zero(pixels: Array) -> Array:
    """Frames without any finite pixel as zeros, so that minima have something to look at."""
    return np.where(np.isfinite(pixels).any(axis=(1, 2, 3), keepdims=True), pixels, 0.0)
