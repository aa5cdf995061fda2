"""The step of a single chain as a band, against GTSAM's elimination."""

import numpy as np
import pytest

from vip_factors.solve.chain import eliminate
from vip_factors.solve.chain_system import ChainPart, ChainSystem, StaticGroup, static_key
from vip_factors.solve.one_chain import chain_step, is_one_chain

T, W = 6, 4


def random_chain(tied: bool) -> ChainSystem:
    """Positive definite: every frame with the next two, or alone."""
    random, part = np.random.default_rng(1), ChainPart.empty(0, T, np.array([1.0, 2.0, 0.5, 3.0]), tied)
    for t in range(T - 2):
        J = random.standard_normal((5, 3 * W))
        H = (J.T @ J).reshape(3, W, 3, W)
        for i in range(3):
            part.own[t + i] += H[i, :, i]
            for j in range(i + 1, 3):
                if part.following is not None:
                    part.following[t + i, j - i - 1] += H[i, :, j]
    part.own += np.eye(W)
    part.gradient += random.standard_normal((T, W))
    return ChainSystem([part], [], np.zeros((0, 0)), np.zeros(0), np.zeros(0))


@pytest.mark.parametrize("tied", [True, False])
@pytest.mark.parametrize("damping", [0.0, 0.7])
def test_the_step_is_gtsams(tied: bool, damping: float) -> None:
    system = random_chain(tied)
    expected, step = eliminate(system.stretches(damping)).optimize(), chain_step(system.parts[0], damping)
    assert step is not None
    for key in system.parts[0].keys:
        np.testing.assert_allclose(step.at(key), expected.at(key), rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("tied", [True, False])
def test_what_is_not_determined_has_no_step(tied: bool) -> None:
    system = random_chain(tied)
    system.parts[0].own[3] = -np.eye(W)
    assert chain_step(system.parts[0], 0.0) is None


def test_what_frames_share_makes_it_no_single_chain() -> None:
    system = random_chain(True)
    assert is_one_chain(system)
    system.groups.append(StaticGroup(static_key(0), slice(0, 2)))
    assert not is_one_chain(system)
