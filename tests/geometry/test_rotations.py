"""SO(3) in three regimes: generic, near the identity, and near half turns."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from vip_factors.geometry import rotations as so3
from vip_factors.geometry.rotations import continuous, sequence_of_rotation

finite = st.floats(-1.0, 1.0)


@st.composite
def directions(draw: st.DrawFn) -> np.ndarray:
    v = np.array(draw(st.tuples(finite, finite, finite)))
    length = np.linalg.norm(v)
    return v / length if length > 1e-3 else np.array([0.0, 0.6, 0.8])


@st.composite
def rotation_vectors(draw: st.DrawFn) -> np.ndarray:
    """Generic angles, tiny ones over seven decades, and half turns approached over eight."""
    tiny = st.floats(-9, -2).map(lambda power: 10**power)
    nearly_half = st.floats(-9, -1).map(lambda power: np.pi - 10**power)
    angle = draw(st.one_of(st.floats(0.0, 3.0), tiny, nearly_half, st.sampled_from([0.0, so3.SMALL_ANGLE, np.pi])))
    return draw(directions()) * angle


@st.composite
def rotations(draw: st.DrawFn) -> np.ndarray:
    return so3.exp(draw(rotation_vectors()))


def is_rotation(R: np.ndarray) -> bool:
    orthogonal = np.allclose(so3.transpose(R) @ R, np.eye(3), atol=1e-12)
    return bool(orthogonal and np.allclose(np.linalg.det(R), 1.0))


@given(rotation_vectors())
def test_log_undoes_exp(v: np.ndarray) -> None:
    found = so3.log(so3.exp(v))
    if np.linalg.norm(v) > np.pi - 1e-8:  # v and its opposite are nearly the same half turn
        found *= np.sign(found @ v)
    np.testing.assert_allclose(found, v, rtol=1e-7, atol=1e-14)


@given(rotation_vectors())
def test_exp_undoes_log(v: np.ndarray) -> None:
    R = so3.exp(v)
    assert is_rotation(R)
    np.testing.assert_allclose(so3.exp(so3.log(R)), R, atol=1e-12)


@given(rotation_vectors(), directions())
def test_exp_turns_about_its_axis_by_its_angle(v: np.ndarray, w: np.ndarray) -> None:
    R, angle = so3.exp(v), np.linalg.norm(v)
    np.testing.assert_allclose(R @ v, v, atol=1e-12)
    assert np.isclose(np.trace(R), 1 + 2 * np.cos(angle), atol=1e-12)
    axis = v / angle if angle > 0 else w
    across = np.cross(axis, w)
    np.testing.assert_allclose(R @ across, across * np.cos(angle) + np.cross(axis, across) * np.sin(angle), atol=1e-9)


@given(rotation_vectors(), directions())
def test_right_jacobian_is_the_derivative_of_exp(v: np.ndarray, w: np.ndarray) -> None:
    h = 1e-6
    change = so3.log(so3.transpose(so3.exp(v - h * w)) @ so3.exp(v + h * w)) / (2 * h)
    np.testing.assert_allclose(so3.right_jacobian(v) @ w, change, atol=1e-8)


@given(rotation_vectors(), directions())
def test_inverse_right_jacobian_is_the_derivative_of_log(v: np.ndarray, w: np.ndarray) -> None:
    v = v * min(1.0, 3.1 / max(np.linalg.norm(v), 1e-9))  # log jumps at half turns: stay a step away
    h, R = 1e-6, so3.exp(v)
    right = (so3.log(R @ so3.exp(h * w)) - so3.log(R @ so3.exp(-h * w))) / (2 * h)
    np.testing.assert_allclose(so3.inverse_right_jacobian(v) @ w, right, atol=1e-7)


@pytest.mark.parametrize("function", [so3.exp, so3.right_jacobian, so3.inverse_right_jacobian])
def test_series_and_closed_form_meet(function) -> None:  # type: ignore[no-untyped-def]
    axis = np.array([0.36, 0.48, 0.8])
    below, above = (function(axis * so3.SMALL_ANGLE * (1 + side * 1e-12)) for side in (-1, 1))
    np.testing.assert_allclose(below, above, atol=1e-11)


@given(st.floats(-10, 10))
def test_elementary_rotations_are_exponentials_of_the_axes(angle: float) -> None:
    elementary = (so3.rotation_x, so3.rotation_y, so3.rotation_z)
    for axis, rotate in zip(np.eye(3), elementary, strict=True):
        np.testing.assert_allclose(rotate(angle), so3.exp(axis * angle), atol=1e-12)


@given(rotations(), rotations(), rotations())
def test_angle_between_is_a_distance_that_no_turn_changes(A: np.ndarray, B: np.ndarray, C: np.ndarray) -> None:
    distance = so3.angle_between(A, B)
    assert 0 <= distance <= np.pi + 1e-12
    assert np.isclose(distance, so3.angle_between(B, A), atol=1e-7)
    assert np.isclose(distance, so3.angle_between(C @ A, C @ B), atol=1e-7)
    assert distance <= so3.angle_between(A, C) + so3.angle_between(C, B) + 1e-7


@given(st.floats(-50, 50))
def test_wrapped_angles_are_the_same_angle(angle: float) -> None:
    wrapped = so3.wrap_angle(angle)
    assert -np.pi <= wrapped < np.pi
    assert np.isclose(np.exp(1j * wrapped), np.exp(1j * angle), atol=1e-9)


@given(st.floats(-3.1, 3.1), st.floats(-1.2, 1.2), st.floats(-3, 3))
def test_yaw_survives_tilt(yaw: float, tilt: float, towards: float) -> None:
    lean = so3.exp(tilt * np.array([np.cos(towards), np.sin(towards), 0.0]))
    assert abs(so3.wrap_angle(so3.yaw_of(so3.rotation_z(yaw) @ lean) - yaw)) < 1e-9
    assert abs(so3.wrap_angle(so3.yaw_of(lean @ so3.rotation_z(yaw)) - yaw)) < 1e-9


@settings(max_examples=30)
@given(rotations(), st.integers(0, 2**31))
def test_nearest_rotation_is_nearer_than_its_neighbours(R: np.ndarray, seed: int) -> None:
    rng = np.random.default_rng(seed)
    noisy = R + 0.2 * rng.normal(size=(3, 3))
    found = so3.nearest_rotation(noisy)
    assert is_rotation(found)
    neighbours = found @ so3.exp(0.05 * rng.normal(size=(50, 3)))
    assert np.linalg.norm(found - noisy) <= np.min(np.linalg.norm(neighbours - noisy, axis=(1, 2))) + 1e-12


@given(rotations(), directions(), st.floats(0, 1.0))
def test_mean_of_two_rotations_is_halfway(R: np.ndarray, w: np.ndarray, angle: float) -> None:
    mean = so3.mean_rotation(np.stack([R @ so3.exp(angle * w), R @ so3.exp(-angle * w)]))
    assert so3.angle_between(mean, R) < 1e-7


def test_stacks_are_treated_one_by_one() -> None:
    v = np.random.default_rng(0).normal(size=(4, 5, 3))
    R = so3.exp(v)
    assert R.shape == (4, 5, 3, 3)
    for i, j in ((0, 0), (3, 4)):
        np.testing.assert_array_equal(R[i, j], so3.exp(v[i, j]))
        np.testing.assert_allclose(so3.log(R)[i, j], so3.log(R[i, j]), atol=1e-15)
        np.testing.assert_allclose(so3.right_jacobian(v)[i, j], so3.right_jacobian(v[i, j]))


@given(directions(), directions())
def test_the_smallest_rotation_between_directions(start: np.ndarray, end: np.ndarray) -> None:
    assume(start @ end > -0.99)
    R = so3.rotation_between(2 * start, end)
    assert is_rotation(R)
    np.testing.assert_allclose(R @ start, end, atol=1e-9)
    np.testing.assert_allclose(so3.angle_between(np.eye(3), R), np.arccos(np.clip(start @ end, -1, 1)), atol=1e-6)


def rotation_of_sequence(angles: np.ndarray, axes: str) -> np.ndarray:
    return Rotation.from_euler(axes.upper(), angles).as_matrix()


SEQUENCES = ("zxy", "yxz", "xyz", "zyx", "yxy", "zxz", "xyx")


@pytest.mark.parametrize("axes", SEQUENCES)
def test_angles_are_those_of_scipy(axes: str) -> None:
    random = Rotation.random(200, np.random.default_rng(1))  # by place: its name is not the same in every SciPy
    found = sequence_of_rotation(random.as_matrix(), axes)
    assert np.allclose(found, random.as_euler(axes.upper()), atol=1e-9)


@pytest.mark.parametrize("axes", SEQUENCES)
@pytest.mark.parametrize("quarters", [-1, 0, 1, 2])
def test_where_two_axes_fall_together_the_rotation_still_comes_back(axes: str, quarters: int) -> None:
    R = rotation_of_sequence(np.array([0.3, quarters * np.pi / 2, 0.4]), axes)
    assert np.allclose(rotation_of_sequence(sequence_of_rotation(R, axes), axes), R, atol=1e-9)


def test_continuous_angles_are_the_same_rotations_without_jumps() -> None:
    smooth = np.linspace([0.0, -1.0, 2.0], [9.0, 2.4, 4.0], 200)  # the middle one goes beyond its quarter turn
    R = rotation_of_sequence(smooth, "zxy")
    broken = sequence_of_rotation(R, "zxy")
    assert np.abs(np.diff(broken, axis=0)).max() > 3
    found = continuous(broken)
    assert np.allclose(found, smooth, atol=1e-9)
    assert np.allclose(rotation_of_sequence(found, "zxy"), R, atol=1e-12)
