"""How sure a stream's poses are said to be."""

import numpy as np
import pytest

from vip_factors.body.model_errors import FILMED
from vip_factors.body.skeleton import JOINT_COUNT, joint_index
from vip_factors.live.estimates import _pose
from vip_factors.live.frames import FrameState


def test_hinges_of_a_stream_are_a_fifth_less_sure_than_the_model_says() -> None:
    """Their axes stay where they were found: no later frame mends them."""
    state = FrameState(np.tile(np.eye(3), (1, JOINT_COUNT, 1, 1)), np.zeros((1, 3)), np.eye(3)[None], np.zeros((1, 3)))
    told = _pose(state, 0, 1.0, 1e-4 * np.eye(75), FILMED).joint_covariance
    assert told is not None
    sigmas = 100 * np.sqrt(told[:, 0, 0])
    for joint in ("left_knee", "right_elbow"):
        assert sigmas[joint_index(joint)] == pytest.approx(max(1.2, FILMED.joint[joint_index(joint)]))
    assert sigmas[joint_index("head")] == pytest.approx(FILMED.joint[joint_index("head")])
