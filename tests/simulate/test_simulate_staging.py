import numpy as np
import pytest

from vip_factors.body.kinematics import Motion
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import angle_between
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.staging import from_time, lasting
from vip_factors.simulate.stance import floor_height


@pytest.fixture(scope="module")
def clip() -> Motion:
    return gestures(3.0, rate=60.0)


def test_repeated_clip_has_its_length_and_no_jumps(clip: Motion) -> None:
    long = lasting(clip, 20.0)
    assert len(long) == 1201
    assert np.array_equal(long.p_world_pelvis[:100], clip.p_world_pelvis[:100])
    step = np.linalg.norm(np.diff(long.p_world_pelvis, axis=0), axis=1)
    assert step.max() * 60 < 2.5  # m/s
    turn = angle_between(long.R_parent_child[:-1], long.R_parent_child[1:])
    assert np.rad2deg(turn.max()) * 60 < 600


def test_repeated_clip_stays_on_the_floor_and_near_home(clip: Motion) -> None:
    long = lasting(clip, 40.0)
    assert np.abs(floor_height(clip.skeleton, long.state)).max() < 0.03
    home = clip.p_world_pelvis[:, :2].mean(axis=0)
    assert np.linalg.norm(long.p_world_pelvis[:, :2] - home, axis=1).max() < 4.0


def test_shorter_is_cut_and_later_starts_at_zero(clip: Motion) -> None:
    assert len(lasting(clip, 1.0)) == 61
    late = from_time(clip, 1.0)
    assert late.start == 0.0
    assert np.array_equal(late.p_world_pelvis, clip.p_world_pelvis[60:])


def test_a_moment_cannot_be_repeated() -> None:
    with pytest.raises(InputError, match="to repeat it"):
        lasting(gestures(0.5), 10.0)
