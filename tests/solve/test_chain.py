"""Elimination stretch by stretch, and marginals in one sweep, against plain dense algebra."""

import gtsam
import numpy as np
import pytest

from vip_factors.errors import SolveError
from vip_factors.solve import chain_elimination, segments
from vip_factors.solve.chain_elimination import ChainElimination, chain_marginals, last_covariance, tree_marginals
from vip_factors.solve.chain_system import Chain, ChainSystem, StaticGroup, frame_keys, static_key
from vip_factors.solve.elimination import eliminate
from vip_factors.solve.levenberg_marquardt import SolveSettings, levenberg_marquardt

T, D, S = 7, 3, 2


class RandomChain:
    """A positive definite chain: every frame with the next two and with one shared variable."""

    def __init__(self, determined: bool = True) -> None:
        random = np.random.default_rng(0)
        self.keys = [gtsam.symbol("x", t) for t in range(T)]
        self.shared = gtsam.symbol("z", 0)
        self.factors = []
        for t in range(T - 2):
            A = [random.standard_normal((4, D)) for _ in range(3)]
            for block in A:
                block[:, 0] *= determined
            b = random.standard_normal(4)
            unit = gtsam.noiseModel.Unit.Create(4)
            self.factors.append(
                (t, gtsam.JacobianFactor(self.keys[t], A[0], self.keys[t + 1], A[1], self.keys[t + 2], A[2], b, unit))
            )
        for t in range(T):
            A, B, b = random.standard_normal((4, D)), random.standard_normal((4, S)), random.standard_normal(4)
            unit = gtsam.noiseModel.Unit.Create(4)
            A[:, 0] *= determined  # a direction that nothing sees
            self.factors.append((t, gtsam.JacobianFactor(self.keys[t], A, self.shared, B, b, unit)))

    def stretches(self, damping: float):
        for start, stop in ((0, 3), (3, 5), (5, T)):
            graph, ordering = gtsam.GaussianFactorGraph(), gtsam.Ordering()
            for t, factor in self.factors:
                if start <= t < stop:
                    graph.push_back(factor)
            for key in self.keys[start:stop]:
                ordering.push_back(key)
            if stop == T:
                ordering.push_back(self.shared)
            yield graph, ordering

    def dense(self) -> tuple[np.ndarray, np.ndarray]:
        whole, order = gtsam.GaussianFactorGraph(), gtsam.Ordering()
        for _, factor in self.factors:
            whole.push_back(factor)
        for key in [*self.keys, self.shared]:
            order.push_back(key)
        return whole.hessian(order)


def test_stretches_give_the_same_minimum() -> None:
    chain = RandomChain()
    H, g = chain.dense()
    delta = eliminate(chain.stretches(0.0)).optimize()
    found = np.concatenate([delta.at(key) for key in [*chain.keys, chain.shared]])
    np.testing.assert_allclose(found, np.linalg.solve(H, g), atol=1e-9)


def test_marginals_are_the_blocks_of_the_inverse() -> None:
    chain = RandomChain()
    covariance = np.linalg.inv(chain.dense()[0])
    marginals = chain_marginals(chain)
    for t, key in enumerate(chain.keys):
        np.testing.assert_allclose(marginals[key], covariance[D * t : D * t + D, D * t : D * t + D], atol=1e-9)
    np.testing.assert_allclose(marginals[chain.shared], covariance[-S:, -S:], atol=1e-9)


def test_an_undetermined_chain_is_said_to_be() -> None:
    with pytest.raises(SolveError, match="not determined"):
        eliminate(RandomChain(determined=False).stretches(0.0))


class Rosenbrock:
    """The banana valley as two residuals of one vector variable."""

    def __init__(self) -> None:
        self.key = gtsam.symbol("x", 0)

    @staticmethod
    def residual(x: np.ndarray) -> np.ndarray:
        return np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]])

    def cost(self, x: np.ndarray) -> dict[str, float]:
        r = self.residual(x)
        return {"valley": 0.5 * float(r @ r)}

    def linearise(self, x: np.ndarray) -> "Linear":
        return Linear(self.key, np.array([[-20 * x[0], 10.0], [-1.0, 0.0]]), self.residual(x))

    def retract(self, x: np.ndarray, delta: gtsam.VectorValues) -> np.ndarray:
        return x + delta.at(self.key)


class Linear:
    def __init__(self, key: int, J: np.ndarray, r: np.ndarray) -> None:
        self.key, self.J, self.r = key, J, r

    def stretches(self, damping: float):
        graph, ordering = gtsam.GaussianFactorGraph(), gtsam.Ordering()
        H = self.J.T @ self.J
        graph.push_back(gtsam.HessianFactor(self.key, H + damping * np.eye(len(H)), -self.J.T @ self.r, 0.0))
        ordering.push_back(self.key)
        yield graph, ordering


def test_the_last_covariance_keeps_the_digits_of_its_factor() -> None:
    """Of a factor of condition 10⁶, which elimination finds to the last digit, its square does not keep them."""
    h, e = 2.0**-9, 2.0**-18
    R = np.array([[7.0, 5.0, 0.0], [0.0, 3 * h, 5 * h], [0.0, 0.0, e]])
    inverse = np.array([[1 / 7, -5 / (21 * h), 25 / (21 * e)], [0.0, 1 / (3 * h), -5 / (3 * e)], [0.0, 0.0, 1 / e]])
    exact = inverse @ inverse.T
    assert np.abs(np.linalg.inv(R.T @ R) / exact - 1).max() > 1e-6
    system = Linear(gtsam.symbol("z", 0), R, np.zeros(3))
    np.testing.assert_allclose(last_covariance(system, [system.key]), exact, rtol=1e-12)


def test_the_banana_valley_is_walked_to_its_end() -> None:
    told: list[float] = []
    settings = SolveSettings(max_iterations=200, relative_decrease=0.0)
    x, report = levenberg_marquardt(Rosenbrock(), np.array([-1.2, 1.0]), settings, "valley", told.append)
    np.testing.assert_allclose(x, 1.0, atol=1e-6)
    costs = [iteration.cost for iteration in report.iterations]
    assert costs == sorted(costs, reverse=True)
    assert report.final_cost["valley"] < 1e-12 < report.initial_cost["valley"]
    assert told == sorted(told)


def test_a_cost_that_is_not_finite_is_refused() -> None:
    with pytest.raises(SolveError, match="not finite"):
        levenberg_marquardt(Rosenbrock(), np.array([np.nan, 1.0]), SolveSettings())


T, W = 11, 4


def random_chain(tied: bool) -> ChainSystem:
    """Positive definite: every frame with the next two, or alone."""
    random, part = np.random.default_rng(1), Chain.empty(0, T, np.array([1.0, 2.0, 0.5, 3.0]), tied)
    for t in range(T - 2):
        J = random.standard_normal((5, 3 * W))
        J[:, 2 * W + 1] = 0.0  # which the frame two before does not see
        H = (J.T @ J).reshape(3, W, 3, W)
        for i in range(3):
            part.own[t + i] += H[i, :, i]
            for j in range(i + 1, 3):
                if part.following is not None:
                    part.following[t + i, j - i - 1] += H[i, :, j]
    part.own[:] += np.eye(W)
    part.gradient += random.standard_normal((T, W))
    return ChainSystem([part], [], np.zeros((0, 0)), np.zeros(0), np.zeros(0))


def scene_system(tied: bool, moving: bool) -> ChainSystem:
    """Two chains of one width, tied to the next two frames or not, each with a group of its own; a third chain that
    both meet, and its group, which they see, or that group alone."""
    first, second = random_chain(tied), random_chain(tied)
    random, chains = np.random.default_rng(3), [first.chains[0], second.chains[0]]
    chains[1].keys[:] = frame_keys(1, T)
    groups = [StaticGroup(static_key(g), slice(2 * g, 2 * g + 2)) for g in range(3)]
    system = ChainSystem(chains, groups, 9.0 * np.eye(6), random.standard_normal(6), np.ones(6))
    system.static[:2, 4:] = system.static[4:, :2] = 0.3
    if moving:
        camera = random_chain(True).chains[0]
        camera.keys[:] = frame_keys(2, T)
        chains.append(camera)
        system.between |= {(p, 2): 0.2 * random.standard_normal((T, W, W)) for p in range(2)}
    for chain, group in [(0, 0), (0, 2), (1, 1), (1, 2), *([(2, 2)] if moving else [])]:
        system.coupling[chain, group] = 0.2 * random.standard_normal((T, W, 2))
    for one in chains:
        one.own[:] += 3.0 * np.eye(W)
    return system


@pytest.mark.parametrize("tied", [True, False])
@pytest.mark.parametrize("moving", [True, False])
@pytest.mark.parametrize("apart", [True, False])
@pytest.mark.parametrize("damping", [0.0, 0.7])
def test_the_step_and_the_covariance_are_gtsams(
    tied: bool, moving: bool, apart: bool, damping: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    if apart:
        monkeypatch.setattr(segments, "SEGMENT", 2)  # three of them
        monkeypatch.setattr(chain_elimination, "_met_by_all", lambda system: 2 if tied and system.between else None)
    alone, system = random_chain(tied), scene_system(tied, moving)
    for one in (alone, system):
        expected, step = eliminate(one.stretches(damping)).optimize(), ChainElimination(one, damping).step()
        for key in [key for chain in one.chains for key in chain.keys] + [group.key for group in one.groups]:
            np.testing.assert_allclose(step.at(key), expected.at(key), rtol=1e-9, atol=1e-12)
    keys, marginals = [group.key for group in system.groups], tree_marginals(system)
    found = last_covariance(system, keys)
    for number, key in enumerate(keys):
        own = slice(2 * number, 2 * number + 2)
        np.testing.assert_allclose(found[own, own], marginals[key], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("tied", [True, False])
@pytest.mark.parametrize("moving", [True, False])
def test_all_marginals_are_gtsams(tied: bool, moving: bool) -> None:
    for system in (random_chain(tied), scene_system(tied, moving)):
        told = list[float]()
        found, expected = chain_marginals(system, told.append), tree_marginals(system)
        assert found.keys() == expected.keys()
        for key, block in expected.items():
            np.testing.assert_allclose(found[key], block, rtol=0.0, atol=1e-10 * np.abs(block).max())
        assert told == sorted(told)
        assert (told[0], told[-1]) == (0.0, 1.0)


def test_marginals_of_many_frames_keep_their_digits() -> None:
    """Of points whose accelerations are known well and places badly: errors do not grow by the frame."""
    frames, random = 300, np.random.default_rng(4)
    part = Chain.empty(0, frames, np.ones(W), tied=True)
    assert part.following is not None
    part.own[:] = 1e-2 * np.eye(W)
    for t in range(frames - 2):
        mixed = 1e2 * random.standard_normal((W, W))
        J = np.kron([1.0, -2.0, 1.0], mixed).reshape(W, 3, W)
        for i in range(3):
            part.own[t + i] += J[:, i].T @ J[:, i]
            for j in range(i + 1, 3):
                part.following[t + i, j - i - 1] += J[:, i].T @ J[:, j]
    system = ChainSystem([part], [], np.zeros((0, 0)), np.zeros(0), np.zeros(0))
    found = chain_marginals(system)
    for key, block in tree_marginals(system).items():
        np.testing.assert_allclose(found[key], block, rtol=0.0, atol=1e-8 * np.abs(block).max())


@pytest.mark.parametrize("tied", [True, False])
def test_what_is_not_determined_has_no_step(tied: bool) -> None:
    system = random_chain(tied)
    system.chains[0].own[3] = -np.eye(W)
    with pytest.raises(SolveError, match="not determined"):
        ChainElimination(system, 0.0)
    with pytest.raises(SolveError, match="standard deviations: the data do not determine"):
        chain_marginals(system)
