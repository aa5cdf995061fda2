"""SMPL poses: npz in AMASS' style (Z up, hands at rest) and pickle in 3DPW's style (all wearers, camera).

Layout of the pickle, frame by frame of the video: readme of the 3DPW data set (von Marcard et al., ECCV 2018). Its
world has Y up; ``cam_poses`` take it to the camera, whose axes are OpenCV's.
"""

import pickle
from pathlib import Path
from typing import Any

import numpy as np

from vip_factors.body.kinematics import forward_kinematics
from vip_factors.errors import InputError
from vip_factors.estimate import CameraEstimate, Estimate, WearerEstimate, camera_pairs
from vip_factors.geometry.rotations import Array, log, transpose
from vip_factors.io.export.files import R_YUP_WORLD, frame_times, poses_at
from vip_factors.io.motions.files import BODY_JOINTS, P_MODEL_PELVIS
from vip_factors.io.settings import ExportSettings
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.scene import Camera, Scene

POSE_WIDTH = 156  # of SMPL-H: 22 joints of the body and 30 of the hands, three numbers each


def write_amass(estimate: Estimate, path: Path, settings: ExportSettings) -> None:
    """Write one wearer's motion as ``poses`` ``(T, 156)`` rad, ``trans`` ``(T, 3)`` m, ``betas``, ``gender`` and rate.

    The body itself is not SMPL's: ``betas`` are zero, of the mean shape, whose pelvis joint ``trans`` is counted from;
    ``joint_offsets`` ``(24, 3)`` m, which are no part of AMASS, are the wearer's own, each joint in its parent's frame.
    Turns of the two hand bones of SMPL have no place among those of SMPL-H. Soft tissue (``dmpls``) is at rest.
    """
    motion = estimate.wearers[0].motion
    poses = np.zeros((len(motion), POSE_WIDTH))
    poses[:, : 3 * BODY_JOINTS] = log(motion.R_parent_child[:, :BODY_JOINTS]).reshape(len(motion), -1)
    rate = round(motion.rate, 6)  # 59.999999999 Hz is read as 59 by programs that count in whole frames
    with path.open("wb") as file:
        np.savez_compressed(
            file,
            poses=poses,
            trans=motion.p_world_pelvis - P_MODEL_PELVIS,
            betas=np.zeros(16),
            dmpls=np.zeros((len(motion), 8)),
            gender=np.array("neutral"),
            mocap_framerate=np.array(rate),
            mocap_frame_rate=np.array(rate),
            joint_offsets=motion.skeleton.p_parent_joint,
        )


VIDEO_RATE, IMU_RATE = 30.0, 60.0  # of 3DPW: the fields without a rate in their name, and those of "60Hz"
_ARM, _LEG = ("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle")
COCO18 = (
    "nose",
    "neck",
    *(f"{side}_{point}" for limb in (_ARM, _LEG) for side in ("right", "left") for point in limb),
    *("right_eye", "left_eye", "right_ear", "left_ear"),
)


def write_three_dpw(estimate: Estimate, path: Path, settings: ExportSettings) -> None:
    """Write all wearers into one file, with ``N`` frames.

    They are the video's frames if the recording is given, else 30 a second or as many as were asked for. ``betas`` are
    zero, of the mean shape, for the body is not SMPL's: ``jointPositions`` are those of the wearer's own skeleton.
    """
    scene = None if settings.recording is None else _scene(settings.recording, estimate)
    frame_time = estimate.wearers[0].motion.time
    pairs = () if scene is None else camera_pairs(scene, estimate)
    filmed = next(iter(pairs), None)
    if filmed is not None:
        time = filmed[0].detections.timed(filmed[1].clock).time
    else:
        time = frame_times(frame_time, settings.frame_rate or VIDEO_RATE)
    people = [_person(wearer, time) for wearer in estimate.wearers]
    poses2d = [_poses2d(number, filmed, len(time)) for number in range(len(people))]
    frames_60hz = np.rint((time - frame_time[0]) * IMU_RATE).astype(int)
    sexes = {} if scene is None else {wearer.subject.name: wearer.subject.sex for wearer in scene.wearers}
    # Frames in which a wearer is in the picture: by detections, if the recording is given.
    is_inside = (time >= frame_time[0] - 1e-6) & (time <= frame_time[-1] + 1e-6) & (estimate.camera is not None)
    valid = [is_inside & (scene is None or pixels[:, 2].any(axis=1)) for pixels in poses2d]
    content: dict[str, Any] = {
        "sequence": estimate.name,
        "betas": [np.zeros(10) for _ in people],
        "genders": [(sexes.get(wearer.name) or "neutral")[0] for wearer in estimate.wearers],
        **{key: [person[key] for person in people] for key in people[0]},
        "poses2d": poses2d,
        "img_frame_ids": frames_60hz.clip(0, len(people[0]["poses_60Hz"]) - 1),
        **_camera(estimate.camera if filmed is None else filmed[1], time),
        "campose_valid": valid,
    }
    pickled = pickle.dumps(content, protocol=2)  # the newest that Python 2 reads
    # Readers with NumPy before 1.26 know arrays under their old module's name.
    path.write_bytes(pickled.replace(b"cnumpy._core.", b"cnumpy.core."))


def _scene(path: Path, estimate: Estimate) -> Scene:
    from vip_factors.io.mcap_recording import read_scene

    scene = read_scene(path)
    for camera, estimated in camera_pairs(scene, estimate):
        count, labelled = len(camera.detections), len(estimated.wearer_of_detection)
        if labelled not in (0, count):
            raise InputError(
                f"{path}, camera '{camera.name}', has {count} detections, the estimate knows of {labelled}: expected "
                "the recording that it was made from"
            )
    return scene


def _person(estimate: WearerEstimate, video_time: Array) -> dict[str, Array]:
    motion = estimate.motion
    poses, trans, joints = {}, {}, np.zeros((0, 72))
    for key, time in (("", video_time), ("_60Hz", frame_times(motion.time, IMU_RATE))):
        R_parent_child, p_world_pelvis = poses_at(motion, time)
        R_parent_child[:, 0] = R_YUP_WORLD @ R_parent_child[:, 0]
        p_yup_pelvis = p_world_pelvis @ R_YUP_WORLD.T
        poses[f"poses{key}"] = log(R_parent_child).reshape(len(time), -1)
        trans[f"trans{key}"] = p_yup_pelvis - P_MODEL_PELVIS
        if not key:
            state = forward_kinematics(motion.skeleton, R_parent_child, p_yup_pelvis)
            joints = state.p_world_joint.reshape(len(time), -1)
    return {**poses, **trans, "jointPositions": joints}


def _camera(camera: CameraEstimate | None, time: Array) -> dict[str, Array]:
    """Extrinsics ``(N, 4, 4)`` from the world, Y up, to the camera, and intrinsics; identity without a camera."""
    cam_poses = np.broadcast_to(np.eye(4), (len(time), 4, 4)).copy()
    if camera is None:
        return {"cam_poses": cam_poses, "cam_intrinsics": np.eye(3)}
    path = camera.path.at(time)
    R_camera_world = transpose(path.R_world_camera)
    cam_poses[:, :3, :3] = R_camera_world @ R_YUP_WORLD.T
    cam_poses[:, :3, 3] = -np.einsum("tij,tj->ti", R_camera_world, path.p_world_camera)
    return {"cam_poses": cam_poses, "cam_intrinsics": camera.model.K}


def _poses2d(number: int, pair: tuple[Camera, CameraEstimate] | None, frames: int) -> Array:
    """``(N, 3, 18)`` pixels x, y and confidence of a wearer's keypoints, undistorted; zero without a detection."""
    poses = np.zeros((frames, 3, len(COCO18)))
    if pair is None:
        return poses
    mine = pair[0].detections.select(np.flatnonzero(pair[1].wearer_of_detection == number))
    confidence, pixels = _coco18(mine)
    model = pair[1].model
    straight = model.normalise(pixels) * np.array(model.focal) + np.array(model.centre)
    is_visible = (confidence > 0) & np.isfinite(straight).all(axis=-1)
    rows = np.concatenate([straight, confidence[..., None]], axis=-1)
    poses[mine.frame] = np.where(is_visible[..., None], rows, 0.0).transpose(0, 2, 1)
    return poses


def _coco18(detections: Detections) -> tuple[Array, Array]:
    """Confidence ``(n, 18)`` and pixels ``(n, 18, 2)``; a neck that no detector gave lies between the shoulders."""
    names = detections.keypoints.keypoints
    confidence = np.zeros((len(detections), len(COCO18)))
    pixels = np.full((*confidence.shape, 2), np.nan)
    for column, name in enumerate(COCO18):
        if name in names:
            confidence[:, column] = detections.confidence[:, names.index(name)]
            pixels[:, column] = detections.pixels[:, names.index(name)]
    if "neck" not in names:
        shoulders = [COCO18.index("left_shoulder"), COCO18.index("right_shoulder")]
        confidence[:, COCO18.index("neck")] = confidence[:, shoulders].min(axis=1)
        pixels[:, COCO18.index("neck")] = pixels[:, shoulders].mean(axis=1)
    return confidence, pixels
