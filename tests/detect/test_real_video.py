"""The true models on a real video beside OpenPose's results on the same frames."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from vip_factors.body.keypoints import keypoint_set
from vip_factors.detect.models import blazepose_files
from vip_factors.detect.settings import DetectSettings
from vip_factors.detect.tracks import blazepose_tracker
from vip_factors.detect.video import detect_video
from vip_factors.errors import InputError

BODY25B = keypoint_set("body25b")


@pytest.mark.slow
@pytest.mark.data
@pytest.mark.parametrize("camera", ["cam01", "cam02"])
def test_the_person_is_found_where_openpose_found_him(data_folder: Path, camera: str) -> None:
    """``VIP_FACTORS_BLAZEPOSE`` names the wheel or folder of the models; without it they are fetched."""
    pytest.importorskip("ai_edge_litert")
    given = os.environ.get("VIP_FACTORS_BLAZEPOSE")
    try:
        files = blazepose_files(Path(given) if given else None)
    except InputError as error:
        pytest.skip(str(error))
    folder = data_folder / "pose2sim" / "balancing"
    poses = detect_video(folder / "videos" / f"{camera}.mp4", blazepose_tracker(files, DetectSettings(), 2))
    names = [name for name in poses.keypoints.keypoints if name in BODY25B.keypoints]
    ours, theirs = ([one.keypoints.index(name) for name in names] for one in (poses.keypoints, BODY25B))
    found, distances = 0, []
    for index, people in enumerate(poses.frames):
        file = folder / "pose-associated" / f"{camera}_json" / f"{camera}.{index:04d}.json"
        person = np.array(json.loads(file.read_text())["people"][0]["pose_keypoints_2d"]).reshape(-1, 3)
        sure = person[theirs, 2] > 0.3
        height = np.ptp(person[person[:, 2] > 0.3][:, 1])
        apart = [np.linalg.norm(one.pixels[ours] - person[theirs, :2], axis=1)[sure] / height for one in people]
        nearest = min(apart, key=lambda one: float(np.median(one)), default=np.array([np.inf]))
        if np.median(nearest) < 0.1:
            found += 1
            distances.append(nearest)
    assert found >= 0.98 * len(poses.frames)
    assert np.median(np.concatenate(distances)) < 0.03
    assert np.quantile(np.concatenate(distances), 0.95) < 0.08
