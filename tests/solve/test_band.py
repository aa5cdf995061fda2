"""The loop of damped steps on a small problem, and bands of frames by themselves."""

import numpy as np
import pytest

from vip_factors.compiled import kernels
from vip_factors.errors import SolveError
from vip_factors.settings import SolveSettings
from vip_factors.solve.band import Band, BandElimination, Shape, inverse_of_square
from vip_factors.solve.levenberg_marquardt import levenberg_marquardt


class Rosenbrock:
    """The banana valley as two residuals of one vector variable."""

    @staticmethod
    def residual(x: np.ndarray) -> np.ndarray:
        return np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]])

    def cost(self, x: np.ndarray) -> dict[str, float]:
        r = self.residual(x)
        return {"valley": 0.5 * float(r @ r)}

    def linearise(self, x: np.ndarray) -> "Linear":
        return Linear(np.array([[-20 * x[0], 10.0], [-1.0, 0.0]]), self.residual(x))

    def retract(self, x: np.ndarray, step: np.ndarray) -> np.ndarray:
        return x + step


class Linear:
    def __init__(self, J: np.ndarray, r: np.ndarray) -> None:
        self.J, self.r = J, r

    def step(self, damping: float) -> np.ndarray:
        H = self.J.T @ self.J
        return np.linalg.solve(H + damping * np.eye(len(H)), -self.J.T @ self.r)


def test_an_inverse_keeps_the_digits_of_its_factor() -> None:
    """Of a factor of condition 10⁶, which elimination finds to the last digit, its square does not keep them."""
    h, e = 2.0**-9, 2.0**-18
    R = np.array([[7.0, 5.0, 0.0], [0.0, 3 * h, 5 * h], [0.0, 0.0, e]])
    inverse = np.array([[1 / 7, -5 / (21 * h), 25 / (21 * e)], [0.0, 1 / (3 * h), -5 / (3 * e)], [0.0, 0.0, 1 / e]])
    exact = inverse @ inverse.T
    assert np.abs(np.linalg.inv(R.T @ R) / exact - 1).max() > 1e-6
    np.testing.assert_allclose(inverse_of_square(R), exact, rtol=1e-12)


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


W, S = 4, 3


def random_band(frames: int, far: list[int], information: float) -> tuple[Band, np.ndarray]:
    """A stretch of a random chain that ends behind it, and its whole Hessian, frames first."""
    random, shape = np.random.default_rng(1), Shape(W, S, np.array(far))
    found, whole = Band(shape, frames), np.zeros(((frames + 2) * W + S,) * 2)
    blocks, hidden = found.blocks, np.setdiff1d(np.arange(W), far)
    for t in range(frames - 2):
        J = np.kron([1.0, -2.0, 1.0], 1e2 * random.standard_normal((W, W)))
        J[:, 2 * W + hidden] = 0.0
        J = np.concatenate([J, random.standard_normal((W, S))], axis=1)
        J[:, :W] += information
        H = np.triu(J.T @ J)
        columns = np.concatenate([np.arange(t * W, (t + 3) * W), len(whole) - S + np.arange(S)])
        whole[np.ix_(columns, columns)] += H
        blocks.frames[t] += H[: 3 * W, : 3 * W].reshape(3, W, 3 * W)
        blocks.coupling[t] += H[: 3 * W, 3 * W :].reshape(3, W, S)
        found.static += H[3 * W :, 3 * W :]
    kept = np.concatenate([np.arange(frames * W), len(whole) - S + np.arange(S)])
    whole = whole[np.ix_(kept, kept)]
    return found, whole + np.triu(whole, 1).T


@pytest.mark.parametrize("pure", [True, False])
def test_marginals_of_many_frames_keep_their_digits(pure: bool) -> None:
    """Of points whose accelerations are known well and places badly: errors do not grow by the frame."""
    own, H = random_band(300, [0, 2], 0.0)
    elimination = BandElimination(own.shape, np.full(W, 1e-2), kernels=None if pure else kernels)
    elimination.eliminate(own)
    information, _ = elimination.border
    border = np.triu(information) + np.triu(information, 1).T + 1e-2 * np.eye(S)
    covariance = np.linalg.inv(H + 1e-2 * np.eye(len(H)))
    for t, (block, _) in zip(reversed(range(300)), elimination.marginals(np.linalg.inv(border)), strict=True):
        expected = covariance[W * t : W * t + W, W * t : W * t + W]
        np.testing.assert_allclose(block, expected, rtol=0.0, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("pure", [True, False])
def test_what_is_not_determined_is_said(pure: bool) -> None:
    own, _ = random_band(9, [0, 2], 0.0)
    own.rows[3, :, :W] = -np.eye(W)
    with pytest.raises(SolveError, match="not determined"):
        BandElimination(own.shape, np.ones(W), kernels=None if pure else kernels).eliminate(own)
