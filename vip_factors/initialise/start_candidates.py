"""Headings and mountings that a start is chosen from, and how likely each is under what is supposed.

Between those of the grid, diverse particles with max-product on a tree (Pacheco, Zuffi, Black and Sudderth, "Preserving
modes and messages via diverse particle selection", ICML 2014): every sensor keeps its likeliest candidates that differ,
each with the others at their best; each round adds small turns of them, and the tree's minimum over all is exact.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from vip_factors.geometry.rotations import Array, angle_between, exp, rotation_y, rotation_z, transpose, wrap_angle
from vip_factors.initialise.calibration import InitialCalibration

# Of the mean lean of trunk, thighs and shanks over a recording: walkers' and standers' are within 10°, sitters' not.
UPRIGHT_SIGMA = np.deg2rad(15.0)


SETTLED_NATS = 3.0  # by which a start has to be more likely than the next that differs: 20 to 1
START_RATE = 10.0  # Hz: steps and swings are slower
BONE_SIGMA = np.deg2rad(10.0)  # of a mounting about the bone that carries it, soft tissue included


@dataclass(frozen=True)
class InitialisationHypothesis:
    """What is taken for granted.

    Attributes:
        name: in words, for people.
        straps: whether sensors sit roughly as placed.
        frames: whether their inertial frames agree.
    """

    name: str
    straps: bool
    frames: bool


HYPOTHESES = (
    InitialisationHypothesis("sensors sit as placed and their inertial frames agree", straps=True, frames=True),
    InitialisationHypothesis("sensors sit as placed", straps=True, frames=False),
    InitialisationHypothesis("inertial frames agree", straps=False, frames=True),
    InitialisationHypothesis("joints and accelerations alone tell", straps=False, frames=False),
)


def strap_cost(R_bone_sensor: Array, R_placed: Array, sigma: float | Array, strange: float) -> Array:
    """How unlikely mountings ``(..., 3, 3)`` are where sensors sit as placed, in nats against any mounting at all.

    A mixture of a Gaussian of ``sigma`` radians about each axis and, for a share ``strange``, no rule.
    """
    density = (
        np.sqrt(8 * np.pi) / sigma**3
    )  # of the Gaussian at its middle, over that of all rotations: 8π² / (2πσ²)^1.5
    off = angle_between(R_placed, R_bone_sensor) / sigma
    return -np.log((1 - strange) * density * np.exp(-0.5 * off**2) + strange)


def frame_cost(headings: Array, common: float | Array, sigma: float, strange: float) -> Array:
    """How unlikely headings are where inertial frames agree on a ``common`` one, in nats against any heading."""
    density = np.sqrt(2 * np.pi) / sigma
    return -np.log((1 - strange) * density * np.exp(-0.5 * (wrap_angle(headings - common) / sigma) ** 2) + strange)


def common_cost(sensors: int, sigma: float) -> float:
    """What not knowing the common heading costs, in nats: the width of the circle over that of what sensors leave."""
    return float(np.log(max(np.sqrt(2 * np.pi * sensors) / sigma, 1.0)))


def upright_cost(R_bone_sensor: Array, up_sensor: Array) -> Array:
    """How unlikely mountings ``(..., 3, 3)`` are on a bone that is upright on the whole, in nats; nought of others.

    ``up_sensor`` ``(..., 3)`` is the mean vertical in the sensor's axes; NaN where the bone is not.
    """
    upright_freedom = 4.0  # of a Student t: some sit
    lean = _lean(R_bone_sensor, up_sensor) / UPRIGHT_SIGMA
    return np.nan_to_num((upright_freedom + 1) / 2 * np.log1p(lean**2 / upright_freedom))


GRID = 24  # headings 15° apart: costs are smooth over that
TILTED = np.deg2rad(40.0)  # on average over a recording, of trunk, thighs and shanks: too much for walking and standing


@dataclass(frozen=True)
class Candidates:
    """Headings that sensors may have, and their mountings with each of them.

    Attributes:
        headings: ``(S, K)`` radians.
        R_bone_sensor: by sensor ``(K, M, 3, 3)``.
        relative: whether all sensors have the same headings, evenly around the circle, and mountings do not depend on
            them: then headings matter by their differences alone.
        declared: whether the mountings are those that a declared pose asks for.
    """

    headings: Array
    R_bone_sensor: tuple[Array, ...]
    relative: bool = False
    declared: bool = False

    @classmethod
    def of(cls, starts: Sequence[InitialCalibration]) -> "Candidates":
        """Headings and mountings of some starts, one mounting with each heading."""
        mountings = np.stack([one.R_bone_sensor for one in starts], axis=1)
        return cls(np.stack([one.headings for one in starts], axis=1), tuple(mountings[:, :, None]))

    def beside(self, *others: "Candidates") -> "Candidates":
        """With other headings besides."""
        every = (self, *others)
        mountings = zip(*(one.R_bone_sensor for one in every), strict=True)
        return Candidates(
            np.concatenate([one.headings for one in every], axis=1), tuple(np.concatenate(own) for own in mountings)
        )


def declared_candidates(usual: InitialCalibration, R_inertial_sensor: Array) -> Candidates:
    """All headings, and with each the mounting that the declared pose asks for.

    Args:
        usual: with the bones in that pose.
        R_inertial_sensor: ``(S, 3, 3)`` orientations in it.
    """
    assert usual.R_world_bone is not None
    headings = _around(float(usual.headings[0]))
    mountings = transpose(usual.R_world_bone)[:, None] @ rotation_z(headings) @ R_inertial_sensor[:, None]
    return Candidates(np.tile(headings, (len(mountings), 1)), tuple(mountings[:, :, None]), declared=True)


def placed_candidates(
    R_placed: Array, limbs: Array, up_sensor: Array, first: float = 0.0
) -> tuple[Candidates, tuple[int, ...]]:
    """All headings, and with each the mounting as placed and all quarter turns of it that keep bones upright.

    Args:
        R_placed: ``(S, 3, 3)``.
        limbs: ``(S, 3)`` unit vectors along the bones, in their axes.
        up_sensor: ``(S, 3)`` the mean vertical in axes of the sensors on bones that are upright on the whole; NaN of
            others.
        first: radians, the heading that the others are counted from.

    Returns:
        The candidates, and the numbers of the sensors that no quarter turn keeps upright. They get the mountings that
        do, nearest to the one as placed and turned about the limb.
    """
    turns = 8  # about its limb, of a sensor that cannot sit as placed
    outwards = 0.75  # the sensor's z axis stays out of the skin: it is not along the limb
    several, tilted = [], []
    for s, (R, limb, up) in enumerate(zip(R_placed, limbs, up_sensor, strict=True)):
        turned = quarter_turns(R)
        turned = turned[np.abs(turned[:, :, 2] @ limb) < outwards]
        if np.all(np.isfinite(up)):
            lean = _lean(turned, up)
            turned = turned[lean <= TILTED]
            if len(turned):  # quarter turns are rough: the vertical knows better, and perhaps than the placement
                kept = turned[[np.array_equal(one, R) for one in turned]]
                turned = np.concatenate([kept, np.stack([_righted(one, up) for one in turned])])
            else:
                tilted.append(s)
                turned = rotation_y(np.arange(turns) * 2 * np.pi / turns) @ _righted(R, up)
        several.append(np.tile(turned, (GRID, 1, 1, 1)))
    return Candidates(np.tile(_around(first), (len(R_placed), 1)), tuple(several), relative=True), tuple(tilted)


def heading_candidates(R_bone_sensor: Array, first: float) -> Candidates:
    """All headings, counted from ``first`` radians, with the one mounting ``(S, 3, 3)`` that each sensor has."""
    mountings = np.repeat(R_bone_sensor[:, None, None], GRID, axis=1)
    return Candidates(np.tile(_around(first), (len(R_bone_sensor), 1)), tuple(mountings), relative=True)


def quarter_turns(R_placed: Array) -> Array:
    """The 24 mountings ``(24, 3, 3)`` of a sensor whose axes lie as placed, in another order; as placed comes first."""
    return R_placed @ _quarter_turns()


@cache
def _quarter_turns() -> Array:
    found = [np.eye(3)]
    about_x, about_y = np.array([[[1, 0, 0], [0, 0, -1], [0, 1, 0]], [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]], float)
    for turn in found:  # grows while it is gone through
        for further in (about_x @ turn, about_y @ turn):
            if not any(np.array_equal(further, one) for one in found):
                found.append(further)
    return np.stack(found)


def _around(first: float) -> Array:
    return first + np.linspace(0, 2 * np.pi, GRID, endpoint=False)


def _lean(R_bone_sensor: Array, up_sensor: Array) -> Array:
    """Angles ``(...)`` radians between a bone's long axis and the vertical."""
    along = np.sum(R_bone_sensor[..., 1, :] * up_sensor, axis=-1) / np.linalg.norm(up_sensor, axis=-1)
    return np.arccos(np.clip(along, -1.0, 1.0))


def _righted(R_bone_sensor: Array, up_sensor: Array) -> Array:
    """The mounting, turned the short way until the bone's long axis is vertical."""
    up_bone = R_bone_sensor @ (up_sensor / np.linalg.norm(up_sensor))
    axis = np.cross(up_bone, [0.0, 1.0, 0.0])
    length = float(np.linalg.norm(axis))
    if length < 1e-9:
        axis, length = np.array([1.0, 0.0, 0.0]), 1.0
    return exp(float(_lean(R_bone_sensor, up_sensor)) * axis / length) @ R_bone_sensor


KEPT, ADDED = 12, 30  # candidates of each sensor, and turns of them in each round
ROUNDS = np.deg2rad([25, 25, 20, 20, 15, 15, 15, 10, 10, 10, 7, 7, 5, 5, 3, 3])  # sizes of the turns, about each axis
NEAR = np.deg2rad([-20, -15, -10, -5, 5, 10, 15, 20])  # of the best heading, to see how sharp it is


def likely_candidates(candidates: Candidates, costs: Sequence[Array]) -> Candidates:
    """The likeliest of each sensor that differ, likeliest first, as particles: one mounting with each heading.

    ``costs`` by sensor ``(K, M)`` are least costs with each candidate. Where there are few, the first comes again.
    """
    chosen = [_distinct(candidates, s, cost) for s, cost in enumerate(costs)]
    return Candidates(
        np.stack([candidates.headings[s, one[:, 0]] for s, one in enumerate(chosen)]),
        tuple(candidates.R_bone_sensor[s][one[:, 0], one[:, 1]][:, None] for s, one in enumerate(chosen)),
    )


def _distinct(candidates: Candidates, s: int, cost: Array) -> np.ndarray:
    # Nearer candidates move into the same valley and would crowd out others. 60°, but less than four steps of the grid.
    slack = 50.0  # nats: a candidate that is less likely than the best by more wanders no further
    tied = 6  # decimals of nats: what rounding errors tell apart is alike, however the world is turned
    distinct = np.deg2rad(59.9)
    left, chosen = np.round(cost, tied), list[tuple[int, int]]()
    headings, mountings = candidates.headings[s], candidates.R_bone_sensor[s]
    rows = mountings.reshape(*mountings.shape[:2], 9)
    worst = float(cost.min()) + slack
    while len(chosen) < KEPT and float(left.min()) < worst:
        k, m = np.unravel_index(int(left.argmin()), left.shape)
        # The trace of the rotation between two, of which one plus twice its angle's cosine is made.
        alike = rows @ rows[k, m] > 1 + 2 * np.cos(distinct)
        left[alike & (np.abs(wrap_angle(headings - headings[k])) < distinct)[:, None]] = np.inf
        chosen.append((int(k), int(m)))
    return np.array([*chosen, *[chosen[0]] * (KEPT - len(chosen))])


def refined_candidates(particles: Candidates, costs: Callable[[Candidates], Sequence[Array]], root: int) -> Candidates:
    """The particles after all rounds; ``costs`` tells the least cost with each candidate of each sensor.

    Each round adds turns about each axis of the bone, and about the vertical; but the heading of the sensor ``root``
    stays: the world turns with it.
    """
    random = np.random.default_rng(0)
    for size in ROUNDS:
        S, N = particles.headings.shape
        of = np.tile(np.arange(N), -(-ADDED // N))[:ADDED]
        about = size * random.standard_normal((S, ADDED))
        about[root] = 0.0
        turns = exp(size * random.standard_normal((S, ADDED, 3)))[:, :, None]
        turned = tuple(turn @ R[of] for turn, R in zip(turns, particles.R_bone_sensor, strict=True))
        several = particles.beside(Candidates(particles.headings[:, of] + about, turned))
        particles = likely_candidates(several, costs(several))
    return particles


def about_best(particles: Candidates, root: int) -> Candidates:
    """The particles, and the first of each sensor with other headings near by: what those cost tells its scatter.

    The bone may turn with the heading, or stay as it is: as long as it is upright, the mounting then turns back.
    """
    offsets = np.tile(NEAR, (len(particles.headings), 1))
    offsets[root] = 0.0
    headings, kept = particles.headings[:, :1] + offsets, [R[:1] for R in particles.R_bone_sensor]
    turned = tuple(rotation_y(own)[:, None] @ R for own, R in zip(offsets, kept, strict=True))
    unturned = tuple(np.repeat(R, len(NEAR), axis=0) for R in kept)
    return particles.beside(Candidates(headings, unturned), Candidates(headings, turned))
