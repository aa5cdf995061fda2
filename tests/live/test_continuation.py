"""Tracking carried over to a calibration found anew."""

from types import SimpleNamespace

import numpy as np
import pytest

from vip_factors.live import prediction
from vip_factors.live.measurement import PlacedVideoFrame
from vip_factors.live.problem import FrameState
from vip_factors.simulate.gestures import gestures


def test_two_sightings_of_one_frame_do_not_tell_how_fast_a_wearer_goes(monkeypatch: pytest.MonkeyPatch) -> None:
    """One depth is off by a tenth: all frames get the mean of both, and none runs away."""
    sightings = np.array([[[1.0, 3.8, 0.9]], [[1.0, 4.2, 0.9]]])
    monkeypatch.setattr(prediction, "locate_wearers", lambda *_: sightings)
    motion = gestures(seconds=0.5)
    found = SimpleNamespace(
        problem=SimpleNamespace(wearers=[motion]), shared=SimpleNamespace(camera=SimpleNamespace(poses=()))
    )
    state = FrameState(motion.R_parent_child[:1], np.zeros((1, 3)), np.eye(3), np.zeros(3))
    placed = prediction._placed(found, [state] * 9, 20, None, [PlacedVideoFrame(23, None)] * 2)  # type: ignore[arg-type]
    assert placed is not None
    np.testing.assert_allclose([one.p_world_pelvis[0] for one in placed], [[1.0, 4.0, 0.9]] * 9, atol=1e-9)
