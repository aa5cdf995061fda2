"""Small files of 2D poses, of exactly the form that detectors write."""

import json
from pathlib import Path

import numpy as np

from vip_factors.body.keypoints import KeypointSet, keypoint_set

# A standing figure of unit height, seen from in front: x to the image's right, y down.
_MIDDLE = {"nose": (0, 0.08), "neck": (0, 0.2), "head_top": (0, 0.0), "mid_hip": (0, 0.5)}
_LEFT = {
    "eye": (0.02, 0.06), "ear": (0.04, 0.07), "shoulder": (0.1, 0.2), "elbow": (0.14, 0.35), "wrist": (0.15, 0.5),
    "hip": (0.06, 0.5), "knee": (0.06, 0.73), "ankle": (0.06, 0.95), "heel": (0.055, 0.97), "big_toe": (0.07, 1.0),
    "small_toe": (0.09, 1.0),
}  # fmt: skip


def figure(keypoints: KeypointSet, x: float = 300, y: float = 100, height: float = 250) -> np.ndarray:
    """Pixels ``(K, 2)`` of a standing person."""
    places: dict[str, tuple[float, float]] = dict(_MIDDLE)
    for name, (dx, dy) in _LEFT.items():
        places |= {f"left_{name}": (dx, dy), f"right_{name}": (-dx, dy)}
    return np.array([places[name] for name in keypoints.keypoints]) * height + [x, y]


def person(name: str = "coco17", **where: float) -> np.ndarray:
    """``(K, 3)`` x, y, confidence."""
    points = figure(keypoint_set(name), **where)
    return np.column_stack([points, np.full(len(points), 0.8)])


People = dict[int, list[np.ndarray]]
"""By frame number."""


def write_openpose(folder: Path, people: People, prefix: str = "walk_") -> Path:
    folder.mkdir(exist_ok=True)
    for number, here in people.items():
        entries = [
            {"person_id": [-1], "pose_keypoints_2d": one.ravel().tolist(), "face_keypoints_2d": []} for one in here
        ]
        text = json.dumps({"version": 1.3, "people": entries})
        (folder / f"{prefix}{number:012d}_keypoints.json").write_text(text)
    return folder


def write_alphapose(path: Path, people: People) -> Path:
    entries = [
        {
            "image_id": f"{number}.jpg", "category_id": 1, "keypoints": one.ravel().tolist(), "score": 2.9,
            "box": [0, 0, 1, 1], "idx": [0.0],
        }
        for number, here in people.items()
        for one in here
    ]  # fmt: skip
    path.write_text(json.dumps(entries))
    return path


def write_mmpose(path: Path, people: People, names: tuple[str, ...] = ()) -> Path:
    frames = [
        {
            "frame_id": number,
            "instances": [
                {"keypoints": one[:, :2].tolist(), "keypoint_scores": one[:, 2].tolist(), "bbox_score": 0.9}
                for one in here
            ],
        }
        for number, here in people.items()
    ]
    meta = {"dataset_name": "coco", "keypoint_id2name": {str(i): name for i, name in enumerate(names)}}
    path.write_text(json.dumps({"meta_info": meta, "instance_info": frames} if names else frames))
    return path


def write_coco(path: Path, people: People) -> Path:
    entries = [
        {"image_id": number, "category_id": 1, "keypoints": one.ravel().tolist(), "score": 0.9}
        for number, here in people.items()
        for one in here
    ]
    path.write_text(json.dumps(entries))
    return path
