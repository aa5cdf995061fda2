"""Headings and mountings between those of the grid: a few likely ones of each sensor wander and are chosen anew.

Diverse particles and max-product on a tree (Pacheco, Zuffi, Black and Sudderth, "Preserving modes and messages via
diverse particle selection", ICML 2014): every sensor keeps its likeliest candidates that differ, each with the others
at their best; each round adds small turns of them, and the tree's minimum over all is exact.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from vip_factors.geometry.rotations import Array, exp, rotation_y, wrap_angle
from vip_factors.initialise.calibration import InitialCalibration
from vip_factors.initialise.start_candidates import Candidates

# Nearer candidates wander into the same valley and would crowd out others. 60°, but less than four steps of the grid.
DISTINCT = np.deg2rad(59.9)
KEPT, ADDED = 12, 30  # candidates of each sensor, and turns of them in each round
ROUNDS = np.deg2rad([25, 25, 20, 20, 15, 15, 15, 10, 10, 10, 7, 7, 5, 5, 3, 3])  # sizes of the turns, about each axis
TIED = 6  # decimals of nats: what rounding errors tell apart is alike, however the world is turned
SLACK = 50.0  # nats: a candidate that is less likely than the best by more wanders no further
NEAR = np.deg2rad([-20, -15, -10, -5, 5, 10, 15, 20])  # of the best heading, to see how sharp it is


@dataclass(frozen=True)
class Particles:
    """Some headings and mountings of each sensor.

    Attributes:
        headings: ``(S, N)`` radians.
        R_bone_sensor: ``(S, N, 3, 3)``.
    """

    headings: Array
    R_bone_sensor: Array

    def candidates(self) -> Candidates:
        """One mounting with each heading."""
        return Candidates(self.headings, tuple(self.R_bone_sensor[:, :, None]))

    def and_starts(self, starts: Sequence[InitialCalibration]) -> "Particles":
        """With those of some starts besides."""
        headings = np.stack([one.headings for one in starts], axis=1)
        mountings = np.stack([one.R_bone_sensor for one in starts], axis=1)
        return _together(self, Particles(headings, mountings))


def likely_particles(candidates: Candidates, costs: Sequence[Array], kept: int = KEPT) -> Particles:
    """The likeliest candidates of each sensor that differ, likeliest first; where there are few, the first again.

    ``costs`` by sensor ``(K, M)`` are least costs with each candidate.
    """
    chosen = [_distinct(candidates, s, cost, kept) for s, cost in enumerate(costs)]
    return Particles(
        np.stack([candidates.headings[s, one[:, 0]] for s, one in enumerate(chosen)]),
        np.stack([candidates.R_bone_sensor[s][one[:, 0], one[:, 1]] for s, one in enumerate(chosen)]),
    )


def _distinct(candidates: Candidates, s: int, cost: Array, kept: int) -> np.ndarray:
    left, chosen = np.round(cost, TIED), list[tuple[int, int]]()
    headings, mountings = candidates.headings[s], candidates.R_bone_sensor[s]
    rows = mountings.reshape(*mountings.shape[:2], 9)
    worst = float(cost.min()) + SLACK
    while len(chosen) < kept and float(left.min()) < worst:
        k, m = np.unravel_index(int(left.argmin()), left.shape)
        # The trace of the rotation between two, of which one plus twice its angle's cosine is made.
        alike = rows @ rows[k, m] > 1 + 2 * np.cos(DISTINCT)
        left[alike & (np.abs(wrap_angle(headings - headings[k])) < DISTINCT)[:, None]] = np.inf
        chosen.append((int(k), int(m)))
    return np.array([*chosen, *[chosen[0]] * (kept - len(chosen))])


def wandered(particles: Particles, size: float, root: int, random: np.random.Generator) -> Particles:
    """The particles, and turns of them by ``size`` radians about each axis of the bone, and about the vertical.

    The heading of the sensor ``root`` stays: the world turns with it.
    """
    S, N = particles.headings.shape
    of = np.tile(np.arange(N), -(-ADDED // N))[:ADDED]
    about = size * random.standard_normal((S, ADDED))
    about[root] = 0.0
    turns = exp(size * random.standard_normal((S, ADDED, 3)))
    return _together(particles, Particles(particles.headings[:, of] + about, turns @ particles.R_bone_sensor[:, of]))


def wander(particles: Particles, costs: Callable[[Candidates], Sequence[Array]], root: int) -> Particles:
    """The particles after all rounds; ``costs`` tells the least cost with each candidate of each sensor."""
    random = np.random.default_rng(0)
    for size in ROUNDS:
        several = wandered(particles, float(size), root, random).candidates()
        particles = likely_particles(several, costs(several))
    return particles


def about_best(particles: Particles, root: int) -> Candidates:
    """The particles, and the first of each sensor with other headings near by: what those cost tells its scatter.

    The bone may turn with the heading, or stay as it is: as long as it is upright, the mounting then turns back.
    """
    offsets = np.tile(NEAR, (len(particles.headings), 1))
    offsets[root] = 0.0
    headings = particles.headings[:, :1] + offsets
    kept = particles.R_bone_sensor[:, :1]
    near = Particles(headings, np.repeat(kept, len(NEAR), axis=1)), Particles(headings, rotation_y(offsets) @ kept)
    return _together(particles, *near).candidates()


def _together(*several: Particles) -> Particles:
    return Particles(
        np.concatenate([one.headings for one in several], axis=1),
        np.concatenate([one.R_bone_sensor for one in several], axis=1),
    )
