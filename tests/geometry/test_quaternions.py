"""Quaternions: their storage order, their refusal of what is none, and interpolation."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from vip_factors.errors import InputError
from vip_factors.geometry.quaternions import (
    Order,
    interpolate_rotations,
    interpolate_smoothly,
    matrix_from_quaternion,
    quaternion_from_matrix,
)
from vip_factors.geometry.rotations import angle_between, exp, rotation_z

seeds = st.integers(0, 2**31)


def random_quaternions(seed: int) -> np.ndarray:
    q = np.random.default_rng(seed).normal(size=(6, 4))
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def test_a_quarter_turn_about_x_in_both_orders() -> None:
    c = np.sqrt(0.5)
    expected = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    np.testing.assert_allclose(matrix_from_quaternion([c, c, 0, 0], Order.WXYZ), expected, atol=1e-15)
    np.testing.assert_allclose(matrix_from_quaternion([c, 0, 0, c], Order.XYZW), expected, atol=1e-15)
    np.testing.assert_allclose(quaternion_from_matrix(expected, Order.WXYZ), [c, c, 0, 0], atol=1e-15)
    np.testing.assert_allclose(quaternion_from_matrix(expected, Order.XYZW), [c, 0, 0, c], atol=1e-15)


@given(seeds)
def test_matrices_agree_with_scipy(seed: int) -> None:
    q = random_quaternions(seed)
    np.testing.assert_allclose(matrix_from_quaternion(q, Order.XYZW), Rotation.from_quat(q).as_matrix(), atol=1e-12)


@given(seeds)
def test_stacks_keep_every_row_to_itself(seed: int) -> None:
    q = random_quaternions(seed)
    first_w = q[:, [3, 0, 1, 2]]
    np.testing.assert_allclose(
        matrix_from_quaternion(first_w, Order.WXYZ), matrix_from_quaternion(q, Order.XYZW), atol=1e-14
    )


@given(seeds, st.sampled_from(list(Order)))
def test_there_and_back(seed: int, order: Order) -> None:
    q = random_quaternions(seed)
    back = quaternion_from_matrix(matrix_from_quaternion(q, order), order)
    w = back[:, 0 if order is Order.WXYZ else 3]
    assert np.all(w >= 0)
    np.testing.assert_allclose(np.abs(np.sum(back * q, axis=1)), 1.0, atol=1e-12)


@given(st.floats(-9, -1), st.integers(0, 2))
def test_half_turns_are_kept_accurate(power: float, axis: int) -> None:
    R = exp(np.eye(3)[axis] * (np.pi - 10**power))
    q = quaternion_from_matrix(R, Order.WXYZ)
    assert angle_between(matrix_from_quaternion(q, Order.WXYZ), R) < 1e-9


def test_rounded_quaternions_are_normalised_and_wrong_ones_refused() -> None:
    R = matrix_from_quaternion([0.98, 0.0, 0.0, 0.0], Order.WXYZ)
    np.testing.assert_allclose(R, np.eye(3))
    stack = np.array([[1.0, 0, 0, 0], [0.2, 0, 0, 0]])
    with pytest.raises(InputError, match=r"quaternion \(1,\)"):
        matrix_from_quaternion(stack, Order.WXYZ)
    for bad in ([0.0, 0, 0, 0], [np.nan, 0, 0, 1], [5.0, 5, 5, 5]):
        with pytest.raises(InputError, match="unit length"):
            matrix_from_quaternion(bad, Order.XYZW)


@given(st.floats(-1, 4), st.floats(-1, 1))
def test_interpolation_turns_evenly_and_stops_at_the_ends(query: float, tilt: float) -> None:
    time, base = np.array([0.0, 1.0, 3.0]), exp(np.array([tilt, 0.3, 0.0]))
    R = base @ rotation_z(np.array([0.0, 0.8, -0.4]))
    expected = np.interp(query, time, [0.0, 0.8, -0.4])
    found = interpolate_rotations(time, R, np.array([query]))
    assert angle_between(found[0], base @ rotation_z(expected)) < 1e-7


def test_interpolation_of_a_single_sample_repeats_it() -> None:
    R = rotation_z(np.array([0.3]))
    np.testing.assert_array_equal(interpolate_rotations([1.0], R, [0.0, 1.0, 2.0]), np.repeat(R, 3, axis=0))


def test_smooth_interpolation_goes_through_all_and_keeps_the_ends() -> None:
    """Of a turn that swings through whole turns, so that quaternions change their sign; the nearest ends beyond it."""
    time, query = np.arange(0.0, 6.0, 1 / 15), np.arange(0.0, 5.9, 1 / 60)

    def turned(at: np.ndarray) -> np.ndarray:
        return exp(np.stack([4 * np.sin(at), 2.0 * at, np.cos(3 * at)], axis=-1))

    R = np.stack([turned(time), turned(time[::-1])], axis=1)
    np.testing.assert_allclose(interpolate_smoothly(time, R, time), R, atol=1e-12)
    found, linear = interpolate_smoothly(time, R, query)[:, 0], interpolate_rotations(time, R[:, 0], query)
    smoothly, linearly = (angle_between(one, turned(query))[30:-30].max() for one in (found, linear))
    assert smoothly < 0.02 * linearly
    np.testing.assert_allclose(interpolate_smoothly(time, R, [-1.0, 9.0]), R[[0, -1]], atol=1e-12)
    np.testing.assert_allclose(interpolate_smoothly([1.0], R[:1], [0.0, 2.0]), R[[0, 0]], atol=1e-12)


def test_an_order_may_be_a_plain_string_and_another_word_is_refused() -> None:
    R = exp(np.array([0.3, -0.2, 0.9]))
    for order in Order:
        assert np.array_equal(quaternion_from_matrix(R, order.value), quaternion_from_matrix(R, order))
        assert np.allclose(matrix_from_quaternion(quaternion_from_matrix(R, order), order.value), R)
    with pytest.raises(InputError, match="wxyz or xyzw"):
        quaternion_from_matrix(R, "w-first")
