"""Rotations as three turns, against SciPy's."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vip_factors.errors import InputError
from vip_factors.geometry.axis_sequence import continuous, rotation_of_sequence, sequence_of_rotation

SEQUENCES = ("zxy", "yxz", "xyz", "zyx", "yxy", "zxz", "xyx")


@pytest.mark.parametrize("axes", SEQUENCES)
def test_angles_are_those_of_scipy(axes: str) -> None:
    random = Rotation.random(200, np.random.default_rng(1))  # by place: its name is not the same in every SciPy
    found = sequence_of_rotation(random.as_matrix(), axes)
    assert np.allclose(found, random.as_euler(axes.upper()), atol=1e-9)
    assert np.allclose(rotation_of_sequence(found, axes), random.as_matrix(), atol=1e-12)


@pytest.mark.parametrize("axes", SEQUENCES)
@pytest.mark.parametrize("quarters", [-1, 0, 1, 2])
def test_where_two_axes_fall_together_the_rotation_still_comes_back(axes: str, quarters: int) -> None:
    R = rotation_of_sequence(np.array([0.3, quarters * np.pi / 2, 0.4]), axes)
    assert np.allclose(rotation_of_sequence(sequence_of_rotation(R, axes), axes), R, atol=1e-9)


@pytest.mark.parametrize("axes", ["zz", "zzx", "abc", "zxyz"])
def test_other_axes_are_refused(axes: str) -> None:
    with pytest.raises(InputError, match="axes"):
        sequence_of_rotation(np.eye(3), axes)


def test_continuous_angles_are_the_same_rotations_without_jumps() -> None:
    smooth = np.linspace([0.0, -1.0, 2.0], [9.0, 2.4, 4.0], 200)  # the middle one goes beyond its quarter turn
    R = rotation_of_sequence(smooth, "zxy")
    broken = sequence_of_rotation(R, "zxy")
    assert np.abs(np.diff(broken, axis=0)).max() > 3
    found = continuous(broken)
    assert np.allclose(found, smooth, atol=1e-9)
    assert np.allclose(rotation_of_sequence(found, "zxy"), R, atol=1e-12)
