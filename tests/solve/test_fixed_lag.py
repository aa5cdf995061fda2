"""The fixed-lag chain against the whole problem, and against GTSAM's own smoothers."""

import gtsam
import numpy as np
import pytest

from vip_factors.compiled import kernels
from vip_factors.errors import SolveError
from vip_factors.solve.fixed_lag import FixedLagChain

WIDTH, SHARED, FRAMES, LAG = 4, 3, 12, 5
Z = gtsam.symbol("z", 0)


def frame_key(number: int) -> int:
    return int(gtsam.symbol("x", number))


def slices(frames: int = FRAMES, seed: int = 0) -> list[gtsam.GaussianFactorGraph]:
    """Each frame's factors: on itself, with the next two, and with what all share."""
    rng, graphs = np.random.default_rng(seed), []
    unit = gtsam.noiseModel.Unit.Create(6)
    for t in range(frames):
        graph = gtsam.GaussianFactorGraph()
        graph.add(gtsam.JacobianFactor(frame_key(t), rng.normal(size=(6, WIDTH)), rng.normal(size=6), unit))
        graph.add(
            gtsam.JacobianFactor(
                frame_key(t), rng.normal(size=(6, WIDTH)), Z, rng.normal(size=(6, SHARED)), rng.normal(size=6), unit
            )
        )
        if t + 2 < frames:
            keys = [frame_key(t + ahead) for ahead in range(3)]
            blocks = [rng.normal(size=(6, WIDTH)) for _ in keys]
            pairs = [item for pair in zip(keys, blocks, strict=True) for item in pair]
            graph.add(gtsam.JacobianFactor(*pairs, rng.normal(size=6), unit))
        graphs.append(graph)
    return graphs


def whole(graphs: list[gtsam.GaussianFactorGraph]) -> gtsam.GaussianFactorGraph:
    graph = gtsam.GaussianFactorGraph()
    for one in graphs:
        graph.push_back(one)
    return graph


def dense(t: int, graph: gtsam.GaussianFactorGraph) -> tuple[np.ndarray, np.ndarray]:
    """A frame's factors in the columns of a slice; nothing below the diagonal, which does not count."""
    order = gtsam.Ordering()
    for key in (*(frame_key(t + ahead) for ahead in range(min(3, FRAMES - t))), Z):
        order.push_back(key)
        width = SHARED if key == Z else WIDTH
        graph.push_back(gtsam.HessianFactor(key, np.zeros((width, width)), np.zeros(width), 0.0))
    information, vector = graph.hessian(order)
    return np.triu(information), vector


def run(graphs: list[gtsam.GaussianFactorGraph], lag: int = LAG) -> FixedLagChain:
    chain = FixedLagChain(WIDTH, SHARED)
    for t, graph in enumerate(graphs):
        chain.eliminate(t, *dense(t, _copy(graph)))
        chain.marginalise_before(t - lag)
    return chain


def _copy(graph: gtsam.GaussianFactorGraph) -> gtsam.GaussianFactorGraph:
    copy = gtsam.GaussianFactorGraph()
    copy.push_back(graph)
    return copy


def test_the_lag_equals_the_whole_problem() -> None:
    graphs = slices()
    chain, expected = run(graphs), whole(graphs).optimize()
    solution = chain.solution()
    assert chain.numbers == range(FRAMES - 1 - LAG, FRAMES)
    for t in chain.numbers:
        np.testing.assert_allclose(solution.frames[t], expected.at(frame_key(t)), atol=1e-10)
    np.testing.assert_allclose(solution.shared, expected.at(Z), atol=1e-10)


def test_covariances_are_those_of_the_whole_problem() -> None:
    graphs = slices(seed=1)
    solution, tree = run(graphs).solution(), whole(graphs).eliminateMultifrontal()
    for t in (FRAMES - 1, FRAMES - 1 - LAG):
        np.testing.assert_allclose(solution.covariance(t), tree.marginalCovariance(frame_key(t)), atol=1e-10)
    np.testing.assert_allclose(solution.shared_covariance(), tree.marginalCovariance(Z), atol=1e-10)


def test_a_frame_within_the_lag_can_be_replaced() -> None:
    graphs, other = slices(), slices(seed=7)
    chain = run(graphs)
    for t in range(FRAMES - 3, FRAMES):
        chain.eliminate(t, *dense(t, _copy(other[t])))
    expected = whole([*graphs[: FRAMES - 3], *other[FRAMES - 3 :]]).optimize()
    np.testing.assert_allclose(chain.solution().frames[FRAMES - 1], expected.at(frame_key(FRAMES - 1)), atol=1e-9)


def test_what_is_shared_may_wander() -> None:
    graphs, later = slices(), int(gtsam.symbol("z", 1))
    half, sigmas = FRAMES // 2, np.array([0.5, 1.0, 2.0])
    noise = gtsam.noiseModel.Diagonal.Sigmas(sigmas)
    step = gtsam.JacobianFactor(Z, -np.eye(SHARED), later, np.eye(SHARED), np.zeros(SHARED), noise)
    renamed = []
    for t, graph in enumerate(graphs):
        copy = gtsam.GaussianFactorGraph()
        for index in range(graph.size()):
            copy.push_back(_with_key(graph.at(index), Z, later) if t > half else graph.at(index))
        if t == half:
            copy.add(step)
        renamed.append(copy)
    chain = FixedLagChain(WIDTH, SHARED)
    for t, graph in enumerate(graphs):
        chain.eliminate(t, *dense(t, _copy(graph)), sigmas if t == half else None)
    solution, expected, tree = chain.solution(), whole(renamed).optimize(), whole(renamed).eliminateMultifrontal()
    np.testing.assert_allclose(solution.shared, expected.at(later), atol=1e-9)
    for t in (0, half, FRAMES - 1):
        np.testing.assert_allclose(solution.frames[t], expected.at(frame_key(t)), atol=1e-9)
        np.testing.assert_allclose(solution.covariance(t), tree.marginalCovariance(frame_key(t)), atol=1e-9)


def test_columns_that_no_frame_sees_from_two_before_need_not_be_there() -> None:
    far = np.array([0, 3])
    less, all_there = FixedLagChain(WIDTH, SHARED, far), FixedLagChain(WIDTH, SHARED)
    for t, graph in enumerate(slices(seed=3)):
        information, vector = dense(t, _copy(graph))
        gone = 2 * WIDTH + np.array([1, 2]) if t + 2 < FRAMES else np.zeros(0, int)
        kept = np.setdiff1d(np.arange(len(vector)), gone)
        information[gone], information[:, gone], vector[gone] = 0.0, 0.0, 0.0
        sigmas = np.ones(SHARED) if t % 4 == 1 else None
        less.eliminate(t, information[np.ix_(kept, kept)], vector[kept], sigmas)
        all_there.eliminate(t, information, vector, sigmas)
    found, expected = less.solution(), all_there.solution()
    np.testing.assert_allclose(found.values, expected.values, atol=1e-10)
    np.testing.assert_allclose(found.shared, expected.shared, atol=1e-10)
    for t in range(FRAMES):
        np.testing.assert_allclose(found.covariance(t), expected.covariance(t), atol=1e-10)


@pytest.mark.skipif(kernels is None, reason="without kernels slices begin as zeros")
def test_what_lies_below_the_diagonal_is_never_summed() -> None:
    """It is memory as it comes: sums of it are no error, but warn of what it may hold."""
    signalling = np.array(0x7FF0000000000001, np.uint64).view(float)
    chain = FixedLagChain(WIDTH, SHARED)
    with np.errstate(all="raise"):
        for t, graph in enumerate(slices()):
            information, vector = dense(t, graph)
            information[np.tril_indices(len(vector), -1)] = signalling
            chain.eliminate(t, information, vector, np.ones(SHARED))
    assert np.all(np.isfinite(chain.solution().shared))


def _with_key(factor: gtsam.GaussianFactor, old: int, new: int) -> gtsam.GaussianFactor:
    keys = [int(key) for key in list(factor.keys())]
    if old not in keys:
        return factor
    A, b = factor.jacobian()
    blocks, start = [], 0
    for key in keys:
        width = SHARED if key == old else WIDTH
        blocks += [new if key == old else key, A[:, start : start + width]]
        start += width
    return gtsam.JacobianFactor(*blocks, b, gtsam.noiseModel.Unit.Create(len(b)))


def test_gtsams_batch_fixed_lag_smoother_says_the_same() -> None:
    graphs = slices(seed=3)
    reference = gtsam.BatchFixedLagSmoother(float(LAG), gtsam.LevenbergMarquardtParams())
    for t in range(FRAMES):
        factors, values, stamps = gtsam.NonlinearFactorGraph(), gtsam.Values(), []
        values.insert(frame_key(t), np.zeros(WIDTH))
        stamps.append((frame_key(t), float(t)))
        if t == 0:
            values.insert(Z, np.zeros(SHARED))
        stamps.append((Z, float(t)))
        # A factor can only come when all of its frames have.
        ready = [*_own(graphs[t], 1), *(_own(graphs[t - 2], 3) if t >= 2 else [])]
        for factor in ready:
            factors.push_back(gtsam.LinearContainerFactor(factor, _zeros(factor)))
        reference.update(factors, values, dict(stamps))
    found, solution = reference.calculateEstimate(), run(graphs).solution()
    for t in range(FRAMES - LAG, FRAMES):
        np.testing.assert_allclose(solution.frames[t], found.atVector(frame_key(t)), atol=1e-6)
    np.testing.assert_allclose(solution.shared, found.atVector(Z), atol=1e-6)


def _zeros(factor: gtsam.GaussianFactor) -> gtsam.Values:
    values = gtsam.Values()
    for key in list(factor.keys()):
        values.insert(int(key), np.zeros(SHARED if int(key) == Z else WIDTH))
    return values


def _own(graph: gtsam.GaussianFactorGraph, frames: int) -> list[gtsam.GaussianFactor]:
    """Factors that see so many frames."""
    factors = [graph.at(index) for index in range(graph.size())]
    return [factor for factor in factors if len([key for key in list(factor.keys()) if int(key) != Z]) == frames]


def test_an_undetermined_frame_and_a_gap_are_said() -> None:
    n = 3 * WIDTH + SHARED
    with pytest.raises(SolveError, match="not determined"):
        FixedLagChain(WIDTH, SHARED).eliminate(0, np.zeros((n, n)), np.zeros(n))
    chain = run(slices())
    with pytest.raises(SolveError, match="does not follow"):
        chain.eliminate(FRAMES + 3, *dense(0, slices()[0]))
