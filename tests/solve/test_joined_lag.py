"""Chains that meet in a few columns, against the whole problem."""

from dataclasses import replace

import numpy as np
import pytest

from vip_factors.solve.fixed_lag import FixedLagChain
from vip_factors.solve.joined_lag import Columns, JoinedChains, marginal
from vip_factors.solve.slices import REACH

OWN, OWN_SHARED, FRAMES, LAG = 4, 2, 14, 6


class People:
    """Random least squares of ``wearers`` with variables of their own and ``common`` ones in each frame.

    Columns of a frame, and of what all frames share: those of each wearer, then the common ones.
    """

    def __init__(self, wearers: int, common: int, common_shared: int, seed: int = 0, frames: int = FRAMES) -> None:
        self.frames, self.width = frames, wearers * OWN + common
        self.static = wearers * OWN_SHARED + common_shared
        theirs = np.arange(wearers * OWN, self.width), np.arange(wearers * OWN_SHARED, self.static)
        self.columns = [
            Columns(
                np.concatenate([w * OWN + np.arange(OWN), theirs[0]]),
                np.concatenate([w * OWN_SHARED + np.arange(OWN_SHARED), theirs[1]]),
            )
            for w in range(wearers)
        ]
        if wearers > 1:
            self.columns.append(Columns(*theirs))
        rng = np.random.default_rng(seed)
        self.slices = [[self._slice(rng, column, t) for column in self.columns] for t in range(frames)]

    def _slice(self, rng: np.random.Generator, one: Columns, t: int) -> tuple[np.ndarray, np.ndarray]:
        """Of one part: a frame alone with what is shared, and over the next two frames if they are there."""
        ahead, w, s = min(REACH, self.frames - 1 - t), len(one.frame), len(one.static)
        n = (1 + ahead) * w + s
        alone = np.zeros((w + s + 3, n))
        alone[:, [*range(w), *range(n - s, n)]] = rng.normal(size=(w + s + 3, w + s))
        J = np.vstack([alone, rng.normal(size=(3, n))])
        return J.T @ J, J.T @ rng.normal(size=len(J))

    def places(self, one: Columns, t: int) -> np.ndarray:
        """Columns of a part's slice in the vector of everything."""
        ahead = range(t, min(t + REACH + 1, self.frames))
        return np.concatenate([*(self.width * f + one.frame for f in ahead), self.width * self.frames + one.static])

    def whole(self) -> tuple[np.ndarray, np.ndarray]:
        """Solution and covariance of everything."""
        n = self.width * self.frames + self.static
        H, v = np.zeros((n, n)), np.zeros(n)
        for t, parts in enumerate(self.slices):
            for one, (information, vector) in zip(self.columns, parts, strict=True):
                own = self.places(one, t)
                H[np.ix_(own, own)] += information
                v[own] += vector
        return np.linalg.solve(H, v), np.linalg.inv(H)

    def joined(self) -> JoinedChains:
        chains = JoinedChains(self.columns)
        for t, parts in enumerate(self.slices):
            chains.eliminate(t, [(np.triu(H), v.copy()) for H, v in parts])
            chains.marginalise_before(t - LAG)
        return chains

    def frame(self, number: int) -> slice:
        return slice(self.width * number, self.width * (number + 1))


def test_a_single_chain_is_the_fixed_lag_chain() -> None:
    people, alone = People(1, 2, 1), FixedLagChain(OWN + 2, OWN_SHARED + 1)
    for t, ((H, v),) in enumerate(people.slices):
        alone.eliminate(t, np.triu(H), v.copy())
    expected, found = alone.solution(), people.joined().solution()
    np.testing.assert_array_equal(found.frames[FRAMES - 1], expected.frames[FRAMES - 1])
    np.testing.assert_array_equal(found.shared_covariance(), expected.shared_covariance())


@pytest.mark.parametrize("common_shared", [0, 3])
def test_chains_that_meet_in_what_all_frames_share_are_exact(common_shared: int) -> None:
    people = People(3, 0, common_shared)
    (expected, covariance), solution = people.whole(), people.joined().solution()
    for number in range(FRAMES - 1 - LAG, FRAMES):
        np.testing.assert_allclose(solution.frames[number], expected[people.frame(number)], rtol=1e-3, atol=1e-4)
    np.testing.assert_allclose(solution.shared, expected[-people.static :], rtol=1e-3, atol=1e-4)
    sigma = np.sqrt(np.diag(covariance)[people.frame(FRAMES - 1)])
    found = solution.covariance(FRAMES - 1)
    np.testing.assert_allclose(np.sqrt(np.diag(found)), sigma, rtol=1e-3)
    assert not found[:OWN, OWN : 2 * OWN].any()


def test_a_first_frame_that_is_seen_by_all_is_exact() -> None:
    people = People(3, 2, 1, frames=1)
    (expected, _), solution = people.whole(), people.joined().solution()
    np.testing.assert_allclose(solution.frames[0], expected[: people.width], rtol=1e-3, atol=1e-4)


def test_what_each_hears_of_the_others_is_nearly_all_that_matters() -> None:
    errors, apart = [], []
    for seed in range(5):
        people = People(2, 2, 1, seed)
        (expected, covariance), solution = people.whole(), people.joined().solution()
        sigma = np.sqrt(np.diag(covariance))
        for number in range(FRAMES - 1 - LAG, FRAMES):
            own = people.frame(number)
            errors.append((solution.frames[number] - expected[own]) / sigma[own])
        deaf = FixedLagChain(OWN + 2, OWN_SHARED + 1)
        for t, parts in enumerate(people.slices):
            deaf.eliminate(t, np.triu(parts[0][0]), parts[0][1].copy())
        newest = people.places(people.columns[0], FRAMES - 1)[: OWN + 2]
        apart.append((deaf.solution().frames[FRAMES - 1] - expected[newest]) / sigma[newest])
    assert np.sqrt(np.mean(np.square(errors))) < 0.25 * np.sqrt(np.mean(np.square(apart)))


def test_common_columns_wander_alike_in_all_chains() -> None:
    people, sigmas = People(2, 2, 2), np.full(6, 0.5)
    chains = JoinedChains(people.columns)
    for t, parts in enumerate(people.slices):
        chains.eliminate(t, [(np.triu(H), v.copy()) for H, v in parts], sigmas if t % 4 == 0 else None)
    first, second = (chain.solution() for chain in chains._chains)
    np.testing.assert_allclose(first.shared[-2:], second.shared[-2:], atol=1e-4)
    of_both = [one.shared_covariance()[-2:, -2:] for one in (first, second)]
    np.testing.assert_allclose(of_both[0], of_both[1], rtol=1e-3)
    newest = [chain.solution().frames[FRAMES - 1][-2:] for chain in chains._chains]
    np.testing.assert_allclose(newest[0], newest[1], atol=1e-4)


def test_columns_that_no_frame_sees_from_two_before_need_not_be_there() -> None:
    people, far = People(2, 2, 1), np.arange(2, OWN + 2)
    less = JoinedChains([*(replace(column, far=far) for column in people.columns[:-1]), people.columns[-1]])
    all_there = JoinedChains(people.columns)
    for t, parts in enumerate(people.slices):
        kept = [np.arange(len(v)) for _, v in parts]
        for own, (H, v) in enumerate(parts[:-1]):
            gone = REACH * (OWN + 2) + np.arange(2) if t + REACH < FRAMES else np.zeros(0, int)
            kept[own] = np.setdiff1d(kept[own], gone)
            H[gone], H[:, gone], v[gone] = 0.0, 0.0, 0.0
        fewer = [(np.triu(H[np.ix_(own, own)]), v[own]) for own, (H, v) in zip(kept, parts, strict=True)]
        less.eliminate(t, fewer)
        all_there.eliminate(t, [(np.triu(H), v.copy()) for H, v in parts])
    found, expected = less.solution(), all_there.solution()
    np.testing.assert_allclose(found.values, expected.values, atol=1e-10)
    np.testing.assert_allclose(found.covariance(0), expected.covariance(0), atol=1e-10)


def test_a_marginal_is_that_of_the_inverse() -> None:
    A = np.random.default_rng(0).normal(size=(9, 5))
    information = np.zeros((6, 6))
    information[1:, 1:] = A.T @ A  # of the first nothing is known
    expected = np.linalg.inv(np.linalg.inv(A.T @ A)[2:, 2:])
    np.testing.assert_allclose(marginal(information, np.arange(3, 6)), expected, rtol=1e-10)
