"""2D keypoint sets: order, position of each keypoint on the body, and precision of annotations.

Every keypoint is a point fixed to a bone: a detector's "hip" or "shoulder" is not the joint centre of a kinematic
model. Offsets are ours, from the proportions of Drillis & Contini (eyes at 0.936 of stature) and annotated images.
"""

from dataclasses import dataclass

import numpy as np

from vip_factors.body.skeleton import Landmark, Skeleton, joint_index
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array


@dataclass(frozen=True)
class _Site:
    """Point on ``bone``: its joint (or the middle of ``joints`` at rest, or a skeleton's landmark) plus ``offset``.

    ``offset`` is in fractions of stature, bone axes: x left, y up, z forward.
    """

    bone: str
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    joints: tuple[str, ...] = ()
    landmark: str = ""

    def mirrored(self) -> "_Site":
        """Mirror a left site to the right."""
        x, y, z = self.offset
        bone, landmark = (name.replace("left_", "right_") for name in (self.bone, self.landmark))
        return _Site(bone, (-x, y, z), self.joints, landmark)


def _both_sides(**left_sites: _Site) -> dict[str, _Site]:
    right = {f"right_{name}": site.mirrored() for name, site in left_sites.items()}
    return {f"left_{name}": site for name, site in left_sites.items()} | right


_SHOULDERS, _HIPS = ("left_shoulder", "right_shoulder"), ("left_hip", "right_hip")
_SITES = {
    "nose": _Site("head", (0.0, 0.010, 0.062)),
    "head_top": _Site("head", landmark="head_top"),
    "neck": _Site("spine3", joints=_SHOULDERS),  # middle of the shoulders
    "mid_hip": _Site("pelvis", (0.0, 0.008, 0.0), _HIPS),  # middle of the hips
} | _both_sides(
    eye=_Site("head", (0.018, 0.028, 0.050)),
    ear=_Site("head", (0.042, 0.020, 0.0)),
    shoulder=_Site("left_shoulder", (0.0, 0.005, 0.0)),  # the skin above the joint
    elbow=_Site("left_elbow"),
    wrist=_Site("left_wrist"),
    hip=_Site("left_hip", (0.008, 0.008, 0.0)),  # towards the trochanter
    knee=_Site("left_knee"),
    ankle=_Site("left_ankle"),
    heel=_Site("left_ankle", landmark="left_heel"),
    big_toe=_Site("left_foot", landmark="left_toe_tip"),
    small_toe=_Site("left_foot", (0.022, 0.0, 0.004)),
)

# Sites that differ by detector family; both sides alike. From the marker sets of Pose2Sim and OpenCap for OpenSim
# models; knee and heel from OpenPose and markers on two walkers. Needham et al. 2021 (Scientific Reports 11: 20673)
# report 30–50 mm for hips and knees, 1–15 mm for ankles.
_FEET_SITES = _both_sides(
    heel=_Site("left_ankle", (-0.003, 0.014, 0.018), landmark="left_heel"),  # on the shoe's side
    big_toe=_Site("left_foot", (-0.003, 0.012, -0.012), landmark="left_toe_tip"),
    small_toe=_Site("left_foot", (0.022, 0.003, 0.013)),
)
_UPPER_NECK = {"neck": _Site("spine3", (0.0, 0.037, -0.002), _SHOULDERS)}
_OPENPOSE_SITES = _FEET_SITES | _both_sides(
    hip=_Site("left_hip", (0.009, 0.008, 0.009)), knee=_Site("left_knee", (0.0, 0.002, 0.007))
)
_COCO_SITES = _FEET_SITES | _both_sides(
    hip=_Site("left_hip", (0.009, 0.008, 0.007)), knee=_Site("left_knee", (0.0, 0.002, 0.005))
)
_BLAZEPOSE_SITES = _FEET_SITES | _both_sides(
    hip=_Site("left_hip", (0.008, 0.008, 0.004)),
    knee=_Site("left_knee", (0.0, 0.002, 0.002)),
    big_toe=_Site("left_foot", (0.003, 0.014, -0.016), landmark="left_toe_tip"),
)
_FAMILIES = {
    "coco17": _COCO_SITES,
    "openpose18": _OPENPOSE_SITES,
    "body25": _OPENPOSE_SITES,
    "body25b": _OPENPOSE_SITES | _UPPER_NECK,
    "halpe26": _COCO_SITES | _UPPER_NECK,
    "blazepose33": _BLAZEPOSE_SITES,
}

# COCO's OKS sigmas: standard deviation of annotations over the square root of the person's area. The last rows are
# ours: neck and head as shoulders, feet as ankles.
_FACE = {"nose": 0.026, "left_eye": 0.025, "right_eye": 0.025, "left_ear": 0.035, "right_ear": 0.035}
_LIMB = {"shoulder": 0.079, "elbow": 0.072, "wrist": 0.062, "hip": 0.107, "knee": 0.087, "ankle": 0.089}
OKS_SIGMA: dict[str, float] = {
    **_FACE,
    **{f"{side}_{name}": sigma for name, sigma in _LIMB.items() for side in ("left", "right")},
    **{f"{side}_{name}": 0.089 for name in ("heel", "big_toe", "small_toe") for side in ("left", "right")},
} | {"neck": 0.079, "mid_hip": 0.107, "head_top": 0.079}

_COCO17 = (
    "nose left_eye right_eye left_ear right_ear left_shoulder right_shoulder left_elbow right_elbow left_wrist "
    "right_wrist left_hip right_hip left_knee right_knee left_ankle right_ankle"
)
_OPENPOSE_ARMS = "nose neck right_shoulder right_elbow right_wrist left_shoulder left_elbow left_wrist"
_OPENPOSE_LEGS = "right_hip right_knee right_ankle left_hip left_knee left_ankle"
_OPENPOSE_FACE = "right_eye left_eye right_ear left_ear"
_FEET = "left_big_toe left_small_toe left_heel right_big_toe right_small_toe right_heel"
_HALPE_FEET = "left_big_toe right_big_toe left_small_toe right_small_toe left_heel right_heel"
_BLAZEPOSE = (
    "nose left_eye_inner left_eye left_eye_outer right_eye_inner right_eye right_eye_outer left_ear right_ear "
    "mouth_left mouth_right left_shoulder right_shoulder left_elbow right_elbow left_wrist right_wrist left_pinky "
    "right_pinky left_index right_index left_thumb right_thumb left_hip right_hip left_knee right_knee left_ankle "
    "right_ankle left_heel right_heel left_big_toe right_big_toe"
)


# Keypoints whose position on the bone depends on the detector, alike on both sides.
OFFSET_KEYPOINTS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")


def offset_of(keypoint: str) -> tuple[int, int]:
    """Index of a keypoint in the :data:`OFFSET_KEYPOINTS`, −1 for none, and the sign of its side's x axis."""
    side, _, name = keypoint.partition("_")
    has_offset = side in ("left", "right") and name in OFFSET_KEYPOINTS
    return (OFFSET_KEYPOINTS.index(name) if has_offset else -1), (-1 if side == "right" else 1)


@dataclass(frozen=True)
class KeypointSet:
    """Names and order of a detector's keypoints; names that the skeleton does not have are not used."""

    name: str
    keypoints: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.keypoints)

    @property
    def sigmas(self) -> Array:
        """OKS sigma ``(K,)`` of each keypoint, a fraction of the square root of the person's area in the image."""
        return np.array([OKS_SIGMA.get(name, 0.1) for name in self.keypoints])

    @property
    def offset_spread(self) -> float:
        """Uncertainty of the keypoints' positions on the body, relative to OpenPose's."""
        return {"coco17": 1.1, "halpe26": 1.1, "blazepose33": 1.25}.get(self.name, 1.0)

    @property
    def mirrored(self) -> np.ndarray:
        """Index ``(K,)`` of each keypoint's counterpart on the other side, or of the keypoint itself."""

        def counterpart(name: str) -> str:
            swap = {"left": "right", "right": "left"}
            return "_".join(swap.get(word, word) for word in name.split("_"))

        row_of = {name: row for row, name in enumerate(self.keypoints)}
        return np.array([row_of.get(counterpart(name), row) for row, name in enumerate(self.keypoints)])

    def on_body(self, skeleton: Skeleton) -> tuple[Landmark | None, ...]:
        """Position of each keypoint on a skeleton; None if the skeleton does not have it."""
        sites = _SITES | _FAMILIES.get(self.name, {})
        return tuple(_landmark(sites[name], skeleton) if name in sites else None for name in self.keypoints)


def _landmark(site: _Site, skeleton: Skeleton) -> Landmark | None:
    p_pelvis_joint, bone = skeleton.p_pelvis_joint, joint_index(site.bone)
    centre = np.zeros(3)
    if site.landmark:
        landmark = skeleton.landmarks.get(site.landmark)
        if landmark is None:
            return None
        bone, centre = landmark.bone, landmark.p_bone_point
    if site.joints:
        centre = np.mean([p_pelvis_joint[joint_index(name)] for name in site.joints], axis=0) - p_pelvis_joint[bone]
    height = skeleton.stature if {"head_top", "left_heel"} <= set(skeleton.landmarks) else 1.72
    return Landmark(bone, centre + height * np.array(site.offset))


KEYPOINT_SETS: dict[str, KeypointSet] = {
    name: KeypointSet(name, tuple(keypoints.split()))
    for name, keypoints in {
        "coco17": _COCO17,
        "openpose18": f"{_OPENPOSE_ARMS} {_OPENPOSE_LEGS} {_OPENPOSE_FACE}",
        "body25": f"{_OPENPOSE_ARMS} mid_hip {_OPENPOSE_LEGS} {_OPENPOSE_FACE} {_FEET}",
        "body25b": f"{_COCO17} neck head_top {_FEET}",
        "halpe26": f"{_COCO17} head_top neck mid_hip {_HALPE_FEET}",
        "blazepose33": _BLAZEPOSE,
    }.items()
}

# Pairs of keypoints that are connected in drawings.
LIMBS = (
    ("nose", "left_eye"), ("nose", "right_eye"), ("left_eye", "left_ear"), ("right_eye", "right_ear"),
    ("left_shoulder", "right_shoulder"), ("left_shoulder", "left_elbow"), ("left_elbow", "left_wrist"),
    ("right_shoulder", "right_elbow"), ("right_elbow", "right_wrist"), ("left_shoulder", "left_hip"),
    ("right_shoulder", "right_hip"), ("left_hip", "right_hip"), ("left_hip", "left_knee"),
    ("left_knee", "left_ankle"), ("right_hip", "right_knee"), ("right_knee", "right_ankle"),
    ("left_ankle", "left_big_toe"), ("right_ankle", "right_big_toe"),
)  # fmt: skip


def keypoint_set(name: str) -> KeypointSet:
    """Return one of the :data:`KEYPOINT_SETS`.

    Raises:
        InputError: for an unknown name.
    """
    if name not in KEYPOINT_SETS:
        raise InputError(f"unknown keypoint set '{name}': expected one of {', '.join(KEYPOINT_SETS)}")
    return KEYPOINT_SETS[name]


@dataclass(frozen=True)
class KeypointOffsets:
    """Gaussian over the offsets of the :data:`OFFSET_KEYPOINTS`: mean and sigma ``(K, 3)`` m.

    Offsets from the table's positions are in bone axes of the left side; x is mirrored on the right side.
    """

    mean: Array
    sigma: Array
