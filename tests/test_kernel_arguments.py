"""Compiled kernels refuse wrong shapes, indices and outputs: an exception, never an access past the end of an array."""

from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from vip_factors.assembly.compiled_sums import VIEWED
from vip_factors.body.skeleton import PARENTS
from vip_factors.compiled import kernels
from vip_factors.geometry import rotations
from vip_factors.solve import elimination  # noqa: F401  (hands SciPy's BLAS to the kernels)

pytestmark = pytest.mark.skipif(kernels is None, reason="no kernels were built")

REFUSED = (TypeError, ValueError, IndexError)
T, J, S, K, LENGTHS = 5, 24, 2, 3, 3
BODY, POSE = 75, 69
FRAME = BODY + 6  # columns of a frame: a body's and a camera's
RANDOM = np.random.default_rng(0)
PARENT = np.array(PARENTS)
LOSS = ("cauchy", 2.0, 1.0)
BLOCK_WIDTHS = {
    "headings": S, "mountings": 3 * S, "lengths": LENGTHS, "places": 3 * S, "sole": 1, "hinges": 6, "pose mean": POSE,
    "poses": 0, "heading": 1, "camera mounting": 3, "clock": 1, "clock_drift": 1, "zoom": 1, "path scale": 1,
    "offsets": 3 * S,
}  # fmt: skip
STATIC = sum(BLOCK_WIDTHS.values())
WIDTHS = [width or 6 for width in BLOCK_WIDTHS.values()]
WIDTH = 3 * FRAME + STATIC


@dataclass(frozen=True)
class Call:
    """A valid call of a kernel.

    Attributes:
        arguments: arrays and numbers.
        outputs: positions of the arguments that are written.
        free: changes that are allowed, as (position, words of the change).
        signed: positions of index arrays in which a negative number means that there is none.
    """

    arguments: tuple[Any, ...]
    outputs: frozenset[int] = frozenset()
    free: frozenset[tuple[int, str]] = frozenset()
    signed: frozenset[int] = field(default=frozenset())


def call(
    *arguments: Any, out: tuple[int, ...] = (), free: tuple[tuple[int, str], ...] = (), signed: tuple[int, ...] = ()
) -> Call:
    return Call(arguments, frozenset(out), frozenset(free), frozenset(signed))


def normal(*shape: int) -> np.ndarray:
    return RANDOM.standard_normal(shape)


def rotation(*shape: int) -> np.ndarray:
    return np.ascontiguousarray(rotations.exp(normal(*shape, 3)))


def positive(n: int) -> np.ndarray:
    root = normal(n, n)
    return root @ root.T + n * np.eye(n)


def calls() -> dict[str, Call]:
    """A valid call of every function of the module."""
    trio = {
        name: call(normal(T, 3), np.zeros((T, 9)), out=(1,))
        for name in ("exp", "hat", "right_jacobian", "inverse_right_jacobian")
    }
    return trio | {
        "log": call(rotation(T).reshape(T, 9), np.zeros((T, 3)), out=(1,)),
        "pose_right_jacobian": call(normal(T, 6), np.zeros((T, 36)), out=(1,)),
        "forward_kinematics": call(
            rotation(T, J), normal(J, 3), normal(T, 3), PARENT, np.zeros((T, J, 3, 3)), np.zeros((T, J, 3)), out=(4, 5)
        ),
        "points": call(rotation(T, J), normal(T, J, 3), np.array([0, 23]), normal(2, 3), np.zeros((T, 2, 3)), out=(4,)),
        "screws": call(rotation(T, J), normal(T, J, 3), np.zeros((T, J + 1, 6, 3)), out=(2,)),
        "bend_cost": call(
            normal(K, 4), normal(K, 2, 4), normal(T, 4), normal(K, 4), normal(K, 1, 4), normal(T, 4), normal(3, 3),
            np.eye(3), np.zeros((2 * K, K)), out=(8,),
        ),
        "follow_cameras": call(
            normal(S, K, 3), normal(S, K, 2), np.ones((S, K)), np.ones((S, K)), 3, rotation(S), normal(S, 3) + 4.0,
            np.zeros(S), out=(5, 6, 7),
        ),
        "eliminate": call(positive(6), normal(6), 1, 3, out=(0, 1)),
        "reorder": call(positive(6), normal(6), np.array([4, 1, 2]), np.zeros((3, 3)), np.zeros(3), out=(3, 4)),
        "substitute": call(np.triu(normal(3, 5)) + 3 * np.eye(3, 5), normal(2), normal(3), out=(0, 2)),
        "eliminate_stretch": call(
            np.eye(2, 7) + np.zeros((6, 1, 1)), normal(6, 2), np.eye(1), normal(1), np.array([1]), True, 1,
            np.ones(2), np.zeros((4, 4)), np.zeros(4), np.zeros((4, 2, 6)), np.zeros((4, 2)), out=(8, 9, 10, 11),
        ),
        "substitute_stretch": call(
            np.eye(2, 6) + np.zeros((4, 1, 1)), np.array([1]), True, 0, normal(2, 2), normal(1), normal(4, 2),
            out=(0, 6),
        ),
        "slice_in_coordinates": call(
            positive(6), normal(6), normal(3), np.array([0, 2, 5]), np.zeros((3, 3)), np.zeros(3), out=(0, 1, 4, 5)
        ),
        "add_at": call(positive(3), normal(3), np.array([0, 2, 5]), positive(6), normal(6), out=(3, 4)),
    }  # fmt: skip


def body_arguments() -> tuple[Any, ...]:
    """Arguments of ``BodySums`` behind its target."""
    starts = 3 * FRAME + np.cumsum([0, *BLOCK_WIDTHS.values()])
    columns = np.array(starts[:-1])
    columns[list(BLOCK_WIDTHS).index("poses")] = BODY
    body = 0, rotation(T, J), normal(T, J, 3), np.zeros((0, 0, 0, 0)), 0, FRAME, PARENT, columns, normal(J, 3, LENGTHS)
    return *body, columns[[list(BLOCK_WIDTHS).index(name) for name in VIEWED]][None]


def slice_target() -> tuple[Any, ...]:
    return np.zeros((T, WIDTH, WIDTH)), np.zeros((T, WIDTH))


def stretch_target() -> tuple[Any, ...]:
    """A stretch of frames of a body and a camera, with two behind it."""
    return np.zeros((T + 2, FRAME, WIDTH)), np.zeros((T + 2, FRAME)), np.zeros((STATIC, STATIC)), np.zeros(STATIC)


def term_calls() -> dict[str, Call]:
    """A valid call of every method of ``BodySums`` that takes arrays."""
    bones, p_bone, shift = np.array([3, 20]), normal(S, 3), normal(S, 3, LENGTHS)
    valid, R, information = np.ones((T, S), bool), rotation(T, J), positive(POSE)
    follows, camera = np.ones(T - 1, bool), (rotation(T), normal(T, 3) + 5.0, np.zeros((0, 0, 0)))
    return {
        "orientation": call(bones, rotation(S), normal(1, S), rotation(T, S), valid, 0.1, *LOSS, np.zeros((0, 0, 0))),
        "acceleration": call(bones, p_bone, shift, normal(T, S), normal(T, S, 3), valid, 0.02, 1.0, *LOSS),
        "contact": call(bones, p_bone, shift, np.ones((T, S)), 1.0, 0.02, 0.1, *LOSS, follows),
        "reprojection": call(
            bones, p_bone, shift, *camera[:2], np.array([500.0, 500, 320, 240, *np.zeros(8)]), normal(T, S, 2),
            np.ones((T, S)), valid, normal(T, S, 2), normal(T), normal(T), *LOSS, 0, np.zeros((0, 0, 0)),
            np.array([0, 1]), np.ones((S, 3)), signed=(17,),
        ),
        "pose_prior": call(R, information, normal(POSE), 1.0),
        "smoothness": call(R, information, follows, 1.0),
        "joint_limit": call(R, np.full(POSE, -0.5), np.full(POSE, 0.5), 0.1, True, *LOSS),
        "hinge": call(
            R, np.array([0, 1]), np.array([4, 5]), normal(2, 3), normal(2, 3), normal(2, 3, 2), normal(2), np.ones(2),
            *LOSS,
        ),
        "camera_orientation": call(
            *camera, np.eye(3), 0.1, rotation(T, 1), np.ones((T, 1), bool), 0.1, *LOSS, np.zeros((0, 0, 0))
        ),
        "camera_acceleration": call(
            *camera, normal(3), 0.1, normal(T, 1, 3), np.ones((T, 1), bool), 0.02, 1.0, *LOSS
        ),
        "camera_velocity": call(*camera, 0.02, np.ones(6), *LOSS),
    }  # fmt: skip


def wrong(valid: Call) -> Iterator[tuple[str, tuple[Any, ...]]]:
    """The call with one array changed so that it must be refused: name of the change, arguments."""
    for position, argument in enumerate(valid.arguments):
        free = [words for at, words in valid.free if at == position]
        if isinstance(argument, np.ndarray) and argument.size:
            for change, array in changes(argument, position in valid.outputs, position in valid.signed):
                if not any(words in change for words in free):
                    yield f"{position}: {change}", replaced(valid.arguments, position, array)


def replaced(arguments: tuple[Any, ...], position: int, value: Any) -> tuple[Any, ...]:
    return (*arguments[:position], value, *arguments[position + 1 :])


def changes(array: np.ndarray, is_output: bool, is_signed: bool) -> Iterator[tuple[str, Any]]:
    yield "not an array", "a sentence"
    yield "another dimension", array[None]
    for axis in range(array.ndim):
        yield f"longer on axis {axis}", np.repeat(array, np.where(np.arange(array.shape[axis]) == 0, 2, 1), axis)
        yield f"shorter on axis {axis}", np.delete(array, 0, axis)
    if array.dtype.kind == "i":
        yield "an index too large", np.where(np.arange(array.size).reshape(array.shape) == array.size - 1, 10**7, array)
        if not is_signed:
            yield (
                "an index below zero",
                np.where(np.arange(array.size).reshape(array.shape) == array.size - 1, -(10**7), array),
            )
    if is_output:
        yield "an output of another type", array.astype(np.float32)
        yield "an output of another order", np.repeat(array, 2, axis=-1)[..., ::2]


def assert_refused(function: Callable[..., Any], name: str, valid: Call) -> None:
    for change, arguments in wrong(valid):
        try:
            function(*arguments)
        except REFUSED:
            continue
        pytest.fail(f"{name} took argument {change}")


@pytest.mark.parametrize("name", calls())
def test_functions_refuse_what_does_not_fit(name: str) -> None:
    function, valid = getattr(kernels, name), calls()[name]
    function(*deepcopy(valid.arguments))
    assert_refused(function, name, valid)


@pytest.mark.parametrize("target", [slice_target, stretch_target])
@pytest.mark.parametrize("name", term_calls())
def test_terms_refuse_what_does_not_fit(name: str, target: Callable[[], tuple[Any, ...]]) -> None:
    sums, valid = kernels.BodySums(kernels.Target(*target()), *body_arguments()), term_calls()[name]
    assert_refused(getattr(sums, name), name, valid)
    getattr(sums, name)(*valid.arguments)
    sums.expand()


def test_targets_refuse_what_does_not_fit() -> None:
    for target, out in {slice_target: (0, 1), stretch_target: (0, 1, 2, 3)}.items():
        assert_refused(kernels.Target, target.__name__, call(*target(), out=out))


@pytest.mark.parametrize("target", [slice_target, stretch_target])
def test_bodies_refuse_what_does_not_fit(target: Callable[[], tuple[Any, ...]]) -> None:
    sums = kernels.Target(*target())
    assert_refused(
        lambda *arguments: kernels.BodySums(sums, *arguments),
        "BodySums",
        call(*body_arguments(), free=((8, "axis 2"), (9, "axis 0")), signed=(7, 9)),
    )
    begin, *arguments = body_arguments()
    for first, frame in ((WIDTH, FRAME), (0, WIDTH)):
        with pytest.raises(REFUSED):
            kernels.BodySums(sums, begin, *arguments[:3], first, frame, *arguments[5:])
    with pytest.raises(REFUSED):
        kernels.BodySums(sums, begin + 1, *arguments)


@pytest.mark.parametrize("block", range(len(BLOCK_WIDTHS)))
def test_blocks_beyond_a_slice_are_refused(block: int) -> None:
    begin, *arguments = body_arguments()
    columns = arguments[6].copy()
    columns[block] = WIDTH - WIDTHS[block] + 1  # the last column is one too far

    def add_all_terms() -> None:
        cameras = columns[[list(BLOCK_WIDTHS).index(name) for name in VIEWED]][None]
        sums = kernels.BodySums(kernels.Target(*slice_target()), begin, *arguments[:6], columns, arguments[7], cameras)
        for name, valid in term_calls().items():
            getattr(sums, name)(*valid.arguments)

    with pytest.raises(REFUSED):
        add_all_terms()


@pytest.mark.parametrize("name", calls())
def test_inputs_of_another_type_or_order_are_converted(name: str) -> None:
    """Single precision and strides make no difference: every number of these calls is one in either precision."""
    valid = calls()[name]
    plain = deepcopy(valid.arguments)
    changed = list(deepcopy(plain))
    for position, argument in enumerate(plain):
        if isinstance(argument, np.ndarray) and position not in valid.outputs:
            changed[position] = np.repeat(argument, 2, axis=-1)[..., ::2]
    if name == "add_at":  # rows of another matrix, which are read where they lie
        changed[0] = plain[0]
    getattr(kernels, name)(*changed)
    getattr(kernels, name)(*plain)
    for position in valid.outputs:
        np.testing.assert_array_equal(changed[position], plain[position])
