"""A whole body from the markers on its skin (Plug-in-Gait's), and what a detector would have seen of it.

The motion is the person's own, and so are the joint centres; the lens, how the camera is held and what the detector
does wrong are the simulator's (:mod:`~vip_factors.simulate.settings`).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from vip_factors.body.keypoints import keypoint_set
from vip_factors.body.kinematics import BodyState
from vip_factors.body.skeleton import JOINT_COUNT, Landmark, Skeleton, joint_index
from vip_factors.errors import FileFormatError
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.camera import CameraPath
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Camera, CameraTruth, Scene
from vip_factors.simulate.detector import detect
from vip_factors.simulate.detector_view import Person
from vip_factors.simulate.scene import camera_motion, camera_mount
from vip_factors.simulate.settings import SceneSettings

SIDES = ("left", "right")
LEGS = tuple(f"{side}_{name}" for name in ("hip", "knee", "ankle") for side in SIDES)
SHOULDERS = tuple(f"{side}_shoulder" for side in SIDES)
ARMS = tuple(f"{side}_{name}" for name in ("elbow", "wrist") for side in SIDES)
# The shoulder lies below the acromion's marker by this share of the distance of the acromia (Rab, Petuskey & Bagley
# 2002, Gait & Posture 15: 113).
SHOULDER_DROP = 0.17
# From the marker on the outer epicondyle inwards, along the elbow's axis: half an elbow's width and the marker's
# radius, as Plug-in-Gait has it; the widths were not measured, 68 mm is a man's mean.
ELBOW_M = 0.041
TOE_M = 0.05  # ours: how far the tip of a shoe is beyond the marker on the second metatarsal's head
HEAD_DROP_M = 0.075  # ours: the head's joint, at the height of the ears' lobes, below a band of markers over the brows

Markers = Callable[..., Array]
CameraName = Literal["standing", "carried"]
# A tripod of unknown pose, or a phone with a sensor in somebody's hands; feet are looked at, as gait is.
FILMING: dict[CameraName, SceneSettings] = {
    "standing": SceneSettings(camera="fixed", keypoints="body25", video_rate=25.0),
    "carried": SceneSettings(camera="hand-held", keypoints="body25", video_rate=25.0),
}


@dataclass(frozen=True)
class MarkerBody:
    """A person in ``T`` frames.

    Attributes:
        time: ``(T,)`` seconds.
        centres: ``(T, 3)`` metres of joint centres by name, world z up: hips, knees and ankles as the laboratory found
            them; shoulders, elbows and wrists from their markers.
        R_world_bone: ``(T, 3, 3)`` by bone name, axes as ours (x left, y up, z forward in a T-pose).
        extra: ``(T, 3)`` metres of what is no joint centre of these: ``head``, ``left_ball``, ``left_heel``,
            ``left_toe`` and so on.
    """

    time: Array
    centres: Mapping[str, Array]
    R_world_bone: Mapping[str, Array]
    extra: Mapping[str, Array]


def read_marker_body(path: Path, begins: float = 0.0) -> MarkerBody:
    """``optical.csv`` of geneva_gait; ``begins`` is the second of its clock at which the recording does."""
    table = np.genfromtxt(path, delimiter=",", names=True)

    def of(*names: str) -> Array:
        """Middle of some markers, ``(T, 3)`` metres."""
        return (
            np.mean([marker_columns(table, [f"{name}_{axis}" for axis in "xyz"], path) for name in names], axis=0)
            / 1000
        )

    pelvis = _axes_facing(of("LASI") - of("RASI"), of("LASI", "RASI") - of("LPSI", "RPSI"))
    front, back = of("CLAV", "STRN"), of("C7", "T10")
    up = of("CLAV", "C7") - of("STRN", "T10")
    thorax = _axes(up, np.cross(up, front - back))
    head = _axes_facing(of("LFHD", "LBHD") - of("RFHD", "RBHD"), of("LFHD", "RFHD") - of("LBHD", "RBHD"))
    bones, centres, extra = {"pelvis": pelvis, "spine3": thorax, "head": head}, dict[str, Array](), dict[str, Array]()
    extra["head"] = of("LFHD", "RFHD", "LBHD", "RBHD") - HEAD_DROP_M * head[..., 1]
    for side in SIDES:
        centres |= _leg_centres(of, side) | _arm_centres(of, side, thorax[..., 1])
        bones |= _limb_axes(centres, side, pelvis, thorax)
        letter = side[0].upper()
        foot = _axes_facing(pelvis[..., 0], of(f"{letter}TOE") - of(f"{letter}HEE"))
        bones |= {f"{side}_ankle": foot, f"{side}_foot": foot}
        extra |= {f"{side}_ball": of(f"{letter}TOE", f"{letter}FMH"), f"{side}_heel": of(f"{letter}HEE")}
        extra[f"{side}_toe"] = of(f"{letter}TOE") + TOE_M * foot[..., 2]
    return MarkerBody(marker_columns(table, ["time_s"], path)[:, 0] - begins, centres, bones, extra)


def marker_columns(table: np.ndarray, names: list[str], path: Path) -> Array:
    """Columns ``(T, n)`` of a table."""
    known = table.dtype.names or ()
    if missing := [name for name in names if name not in known]:
        raise FileFormatError(f"{path}: no column '{missing[0]}'; expected a body as an optical system saw it")
    return np.stack([table[name] for name in names], axis=-1)


def posed(body: MarkerBody, skeleton: Skeleton) -> tuple[Skeleton, BodyState]:
    """All bones of a person, for a camera to look at; what no marker tells lies where the skeleton has it."""
    T, rest = len(body.time), skeleton.p_pelvis_joint
    R, p = np.tile(np.eye(3), (T, JOINT_COUNT, 1, 1)), np.zeros((T, JOINT_COUNT, 3))
    for name, axes in body.R_world_bone.items():
        R[:, joint_index(name)] = axes
    for base, ends in (("pelvis", ("left_hip", "right_hip")), ("spine3", SHOULDERS)):
        middle = np.mean([rest[joint_index(one)] for one in ends], axis=0) - rest[joint_index(base)]
        seen = np.mean([body.centres[one] for one in ends], axis=0)
        p[:, joint_index(base)] = seen - body.R_world_bone[base] @ middle
    chest = joint_index("spine3")
    p[:, joint_index("neck")] = p[:, chest] + R[:, chest] @ (rest[joint_index("neck")] - rest[chest])
    p[:, joint_index("head")] = body.extra["head"]
    for name, centre in body.centres.items():
        p[:, joint_index(name)] = centre
    landmarks = dict(skeleton.landmarks)
    for side in SIDES:
        p[:, joint_index(f"{side}_foot")] = body.extra[f"{side}_ball"]
        for name, bone, point in (("heel", "ankle", "heel"), ("toe_tip", "foot", "toe")):
            j = joint_index(f"{side}_{bone}")
            away = np.einsum("tji,tj->ti", R[:, j], body.extra[f"{side}_{point}"] - p[:, j])
            landmarks[f"{side}_{name}"] = Landmark(j, away.mean(axis=0))
    return replace(skeleton, landmarks=landmarks), BodyState(R, p)


def _leg_centres(of: Markers, side: str) -> dict[str, Array]:
    letter = side[0].upper()
    return {f"{side}_{name}": of(f"{letter}{name[0].upper()}JC") for name in ("hip", "knee", "ankle")}


def _arm_centres(of: Markers, side: str, up: Array) -> dict[str, Array]:
    letter = side[0].upper()
    acromia = np.linalg.norm(of("LSHO") - of("RSHO"), axis=1, keepdims=True)
    shoulder, wrist = of(f"{letter}SHO") - SHOULDER_DROP * acromia * up, of(f"{letter}WRA", f"{letter}WRB")
    outer = of(f"{letter}ELB")
    axis = np.cross(outer - shoulder, wrist - outer)  # of a bent elbow: inwards on the left, outwards on the right
    inwards = (1 if side == "left" else -1) * axis / np.linalg.norm(axis, axis=1, keepdims=True)
    return {f"{side}_shoulder": shoulder, f"{side}_elbow": outer + ELBOW_M * inwards, f"{side}_wrist": wrist}


def _limb_axes(centres: Mapping[str, Array], side: str, pelvis: Array, thorax: Array) -> dict[str, Array]:
    """Long axes are exact, turns about them are the trunk's; arms point to their side, as in a T-pose."""
    bones = {}
    for bone, end in (("hip", "knee"), ("knee", "ankle")):
        bones[f"{side}_{bone}"] = _axes(centres[f"{side}_{bone}"] - centres[f"{side}_{end}"], pelvis[..., 0])
    for bone, end in (("shoulder", "elbow"), ("elbow", "wrist")):
        along = centres[f"{side}_{end}"] - centres[f"{side}_{bone}"]
        bones[f"{side}_{bone}"] = _axes_facing(along if side == "left" else -along, thorax[..., 2])
    return bones


def _axes(up: Array, left: Array) -> Array:
    """``(T, 3, 3)`` with y exactly up, and x as far to the left as it can be."""
    y = up / np.linalg.norm(up, axis=-1, keepdims=True)
    z = np.cross(left, y)
    z /= np.linalg.norm(z, axis=-1, keepdims=True)
    return np.stack([np.cross(y, z), y, z], axis=-1)


def _axes_facing(left: Array, forward: Array) -> Array:
    """``(T, 3, 3)`` with x exactly to the left, and z as far forward as it can be."""
    x = left / np.linalg.norm(left, axis=-1, keepdims=True)
    y = np.cross(forward, x)
    y /= np.linalg.norm(y, axis=-1, keepdims=True)
    return np.stack([x, y, np.cross(x, y)], axis=-1)


def filmed(recording: Recording, body: MarkerBody, camera: CameraName, seed: int) -> Scene:
    """The recording as a scene with one camera, which films while markers were recorded."""
    settings = FILMING[camera]
    skeleton, state = posed(body, recording.subject.body())
    path = camera_motion(state.p_world_joint[None, :, 0], body.time, settings, np.random.default_rng([seed, 0xCA3E7A]))
    every = round(1 / (settings.video_rate * float(np.median(np.diff(body.time)))))
    time = body.time[::every]
    poses = path.bone(0, time)
    lens = CameraPath(time, poses.R_world_bone, poses.position)
    seen = BodyState(state.R_world_bone[::every], state.p_world_joint[::every])
    person = Person(skeleton, seen, np.ones(len(time), bool))
    found, owner, pixels = detect(
        [person], lens, settings.model, keypoint_set(settings.keypoints), settings.detector, seed
    )
    mount, calibration = camera_mount(path, settings, seed) if settings.has_camera_imu else (None, None)
    moving = camera == "carried"
    truth = CameraTruth(lens if moving else _standing(lens), owner, pixels, calibration)
    return Scene(recording.name, (recording,), (Camera(camera, settings.model, found, moving, mount, truth=truth),))


def _standing(path: CameraPath) -> CameraPath:
    return CameraPath(path.time[:1], path.R_world_camera[:1], path.p_world_camera[:1])
