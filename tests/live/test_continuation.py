"""Tracking carried over to a calibration found anew."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.geometry.rotations import rotation_z
from vip_factors.live import prediction
from vip_factors.live.frames import FrameState
from vip_factors.live.prediction import correction_findings
from vip_factors.problem.state import CameraPoses, CameraState, SceneState, WearerState
from vip_factors.sensors.live import VideoFrame
from vip_factors.simulate.gestures import gestures


def test_two_sightings_of_one_frame_do_not_tell_how_fast_a_wearer_goes(monkeypatch: pytest.MonkeyPatch) -> None:
    """One depth is off by a tenth: all frames get the mean of both, and none runs away."""
    sightings = np.array([[[1.0, 3.8, 0.9]], [[1.0, 4.2, 0.9]]])
    monkeypatch.setattr(prediction, "locate_wearers", lambda *_: sightings)
    motion = gestures(seconds=0.5)
    R, p = motion.R_parent_child[:0], motion.p_world_pelvis[:0]
    wearer = WearerState(R, p, np.zeros(0), np.zeros((0, 3, 3)), np.zeros(69))
    carried = CameraState(CameraPoses(np.zeros((0, 3, 3)), np.zeros((0, 3))))
    camera: Any = SimpleNamespace(name="phone")
    found: Any = SimpleNamespace(
        problem=SimpleNamespace(wearers=[motion]),
        shared=SceneState((wearer,), (carried,)),
        associated=[SimpleNamespace(camera=camera)],
        with_lens=lambda camera: camera,
    )
    frames: Any = [VideoFrame("phone", 0.0, np.zeros((0, 17, 2)), np.zeros((0, 17)), 23)] * 2
    state = FrameState(motion.R_parent_child[:1], np.zeros((1, 3)), np.eye(3)[None], np.zeros((1, 3)))
    placed = prediction._placed(found, [state] * 9, 20, camera, frames)
    assert placed is not None
    np.testing.assert_allclose([one.p_world_pelvis[0] for one in placed], [[1.0, 4.0, 0.9]] * 9, atol=1e-9)


def test_bones_that_were_wrong_are_told_of_the_last_frame_before() -> None:
    """One bone against the others counts; that all are turned together does not, nor does what comes later."""
    skeleton, bones = skeleton_from_stature(1.8), [0, 4, 5, 18, 19]
    wearer = SimpleNamespace(
        skeleton=skeleton, sensors=[SimpleNamespace(bone=bone) for bone in bones], name="anna",
        frames=SimpleNamespace(sensors=[f"sensor{bone}" for bone in bones]),
    )  # fmt: skip

    def smoother(numbers: range, turned: int, by: float, at: int) -> Any:
        def state(number: int) -> SimpleNamespace:
            R = np.tile(np.eye(3), (1, 24, 1, 1))
            R[0, turned] = rotation_z(np.deg2rad(by if number == at else 0.0))
            return SimpleNamespace(R_parent_child=R)

        return SimpleNamespace(numbers=numbers, problem=SimpleNamespace(wearers=[wearer]), state=state)

    before = smoother(range(10, 20), 0, 0.0, 19)
    (told,) = correction_findings(12.0, before, smoother(range(11, 21), 19, 50.0, 19))
    assert "sensor19" in str(told)
    assert "12 s" in str(told)
    assert not correction_findings(12.0, before, smoother(range(11, 21), 19, 50.0, 20))
    assert not correction_findings(12.0, before, smoother(range(11, 21), 0, 50.0, 19))


def test_a_camera_that_was_not_carried_at_the_calibration_keeps_its_pose() -> None:
    """Tracking begins without a camera that shows nobody, and takes it up before the calibration is ready."""
    R, p, p_camera = np.tile(np.eye(3), (1, 24, 1, 1)), np.zeros((1, 3)), np.array([[0.0, -3.0, 1.5]])
    with_camera = FrameState(R, p, np.eye(3)[None], p_camera)
    without_camera = FrameState(R, p, np.zeros((0, 3, 3)), np.zeros((0, 3)))
    R_world_camera, p_world_camera = prediction._carried_poses(0.5, with_camera, without_camera, with_camera)
    np.testing.assert_array_equal(R_world_camera, np.eye(3)[None])
    np.testing.assert_array_equal(p_world_camera, p_camera)
