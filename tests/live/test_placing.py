"""A video frame places wearers whose poses are known."""

import numpy as np
import pytest
from tracked import placed_camera

from vip_factors.body.kinematics import forward_kinematics
from vip_factors.live.prediction import locate_wearers
from vip_factors.sensors.live import VideoFrame, stream_head
from vip_factors.stages.views import points_on_body


@pytest.mark.parametrize("strangers", [0, 2])
def test_the_root_is_where_the_keypoints_say(strangers: int) -> None:
    scene = placed_camera()
    camera = stream_head(scene).cameras[0]
    truth, path = scene.wearers[0].truth, camera.known_path
    assert truth is not None
    assert path is not None
    motion, pose = truth.motion.frames(slice(60, 61)), (path.R_world_camera[:1], path.p_world_camera[:1])
    used, points = points_on_body(camera.keypoints, motion.skeleton)
    seen = np.concatenate([point.of(motion.state) for point in points])
    pixels = np.full((1 + strangers, len(camera.keypoints), 2), np.nan)
    pixels[strangers, used] = camera.model.project((seen - pose[1][0]) @ pose[0][0])
    random = np.random.default_rng(0)
    for person in range(strangers):  # in no pose of ours
        pixels[person, used] = random.uniform(100, 500, (len(used), 2))
    video = VideoFrame(camera.name, 1.0, pixels, np.isfinite(pixels[..., 0]).astype(float))
    elsewhere = forward_kinematics(
        motion.skeleton, motion.R_parent_child, motion.p_world_pelvis + np.array([2.0, -3.0, 1.0])
    )
    found = locate_wearers(camera, pose, [elsewhere], [motion.skeleton], [video])
    np.testing.assert_allclose(found[0, 0], motion.p_world_pelvis[0], atol=1e-6)


def test_a_wearer_who_is_not_there_is_not_placed() -> None:
    scene = placed_camera()
    camera = stream_head(scene).cameras[0]
    truth, path = scene.wearers[0].truth, camera.known_path
    assert truth is not None
    assert path is not None
    motion = truth.motion.frames(slice(60, 61))
    body = forward_kinematics(motion.skeleton, motion.R_parent_child, motion.p_world_pelvis)
    pixels = np.random.default_rng(1).uniform(100, 500, (2, len(camera.keypoints), 2))
    video = VideoFrame(camera.name, 1.0, pixels, np.ones(pixels.shape[:2]))
    pose = path.R_world_camera[:1], path.p_world_camera[:1]
    assert np.all(np.isnan(locate_wearers(camera, pose, [body], [motion.skeleton], [video])))
