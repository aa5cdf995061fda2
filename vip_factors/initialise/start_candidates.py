"""Candidates of headings and mountings for the initialisation, and their costs under hypotheses.

Candidates of a grid are refined by diverse particle max-product on a tree (Pacheco, Zuffi, Black and Sudderth,
"Preserving modes and messages via diverse particle selection", ICML 2014): every sensor keeps its likeliest distinct
candidates, and each round adds small rotations of them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from vip_factors.geometry.rotations import Array, angle_between, exp, rotation_y, rotation_z, transpose, wrap_angle
from vip_factors.initialise.calibration import InitialCalibration

UPRIGHT_SIGMA = np.deg2rad(15.0)  # mean lean of trunk, thighs and shanks over a recording: within 10° unless people sit
SETTLED_NATS = 3.0  # by which a start has to be likelier than the next distinct one: 20 to 1
START_RATE = 10.0  # Hz: steps and swings are slower
BONE_SIGMA = np.deg2rad(10.0)  # of a mounting about the bone that carries it, soft tissue included


@dataclass(frozen=True)
class InitialisationHypothesis:
    """Assumptions of the initialisation.

    Attributes:
        name: in words.
        straps: True if mountings are roughly those of the placement.
        frames: True if inertial frames agree.
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
    """Cost in nats of mountings ``(..., 3, 3)`` that should be as placed, relative to uniform ones.

    A mixture of a Gaussian of ``sigma`` radians about each axis and, with probability ``strange``, a uniform density.
    """
    density = np.sqrt(8 * np.pi) / sigma**3  # of the Gaussian's middle over the uniform one: 8π² / (2πσ²)^1.5
    off = angle_between(R_placed, R_bone_sensor) / sigma
    return -np.log((1 - strange) * density * np.exp(-0.5 * off**2) + strange)


def frame_cost(headings: Array, common: float | Array, sigma: float, strange: float) -> Array:
    """Cost in nats of headings whose inertial frames should agree on a ``common`` one, relative to uniform ones."""
    density = np.sqrt(2 * np.pi) / sigma
    return -np.log((1 - strange) * density * np.exp(-0.5 * (wrap_angle(headings - common) / sigma) ** 2) + strange)


def upright_cost(R_bone_sensor: Array, up_sensor: Array) -> Array:
    """Cost in nats of mountings ``(..., 3, 3)`` on a bone that is upright on average; zero for others.

    ``up_sensor`` ``(..., 3)`` is the mean vertical in the sensor's axes; NaN for other bones.
    """
    upright_freedom = 4.0  # of a Student t: some people sit
    lean = _lean(R_bone_sensor, up_sensor) / UPRIGHT_SIGMA
    return np.nan_to_num((upright_freedom + 1) / 2 * np.log1p(lean**2 / upright_freedom))


GRID = 24  # headings 15° apart: costs are smooth over that
TILTED = np.deg2rad(40.0)  # mean lean of trunk, thighs and shanks: too large for walking and standing


@dataclass(frozen=True)
class Candidates:
    """Candidate headings of sensors, and mountings for each of them.

    Attributes:
        headings: ``(S, K)`` radians.
        R_bone_sensor: by sensor ``(K, M, 3, 3)``.
        relative: True if all sensors have the same evenly spaced headings and mountings do not depend on them; only
            differences of headings matter then.
        declared: True if the mountings follow from a declared pose.
    """

    headings: Array
    R_bone_sensor: tuple[Array, ...]
    relative: bool = False
    declared: bool = False

    @classmethod
    def of(cls, starts: Sequence[InitialCalibration]) -> "Candidates":
        """Make candidates from starts, with one mounting for each heading."""
        mountings = np.stack([start.R_bone_sensor for start in starts], axis=1)
        return cls(np.stack([start.headings for start in starts], axis=1), tuple(mountings[:, :, None]))

    def beside(self, *candidates: "Candidates") -> "Candidates":
        """Concatenate these candidates with others, sensor by sensor, without a common grid."""
        every = (self, *candidates)
        mountings = zip(*(member.R_bone_sensor for member in every), strict=True)
        return Candidates(
            np.concatenate([member.headings for member in every], axis=1),
            tuple(np.concatenate(R_sensor) for R_sensor in mountings),
        )


def declared_candidates(usual: InitialCalibration, R_inertial_sensor: Array) -> Candidates:
    """Make a grid of headings with the mountings that follow from a declared pose.

    ``usual`` has the bones in that pose, in which the sensors' orientations are ``(S, 3, 3)``.
    """
    assert usual.R_world_bone is not None
    headings = _around(float(usual.headings[0]))
    mountings = transpose(usual.R_world_bone)[:, None] @ rotation_z(headings) @ R_inertial_sensor[:, None]
    return Candidates(np.tile(headings, (len(mountings), 1)), tuple(mountings[:, :, None]), declared=True)


def placed_candidates(
    R_placed: Array, limbs: Array, up_sensor: Array, first_heading: float = 0.0
) -> tuple[Candidates, tuple[int, ...]]:
    """Make a grid of headings with the placed mountings ``(S, 3, 3)`` and their quarter turns that keep bones upright.

    Also returns the numbers of sensors without an upright quarter turn. These get upright mountings near the placed
    one, rotated about the limb.

    Args:
        limbs: ``(S, 3)`` unit vectors along the bones, in their axes.
        up_sensor: ``(S, 3)``, mean vertical in the sensor's axes for bones that are upright on average; NaN for others.
        first_heading: first heading of the grid, radians.
    """
    turns = 8  # about the limb, of a sensor without an upright quarter turn
    outwards = 0.75  # largest component of the sensor's z axis along the limb
    several, tilted = [], []
    for s, (R, limb, up) in enumerate(zip(R_placed, limbs, up_sensor, strict=True)):
        turned = quarter_turns(R)
        turned = turned[np.abs(turned[:, :, 2] @ limb) < outwards]
        if np.all(np.isfinite(up)):
            lean = _lean(turned, up)
            turned = turned[lean <= TILTED]
            if len(turned):  # quarter turns are rough: refined by the vertical
                as_placed = turned[[np.array_equal(mounting, R) for mounting in turned]]
                turned = np.concatenate([as_placed, np.stack([_turn_upright(mounting, up) for mounting in turned])])
            else:
                tilted.append(s)
                turned = rotation_y(np.arange(turns) * 2 * np.pi / turns) @ _turn_upright(R, up)
        several.append(np.tile(turned, (GRID, 1, 1, 1)))
    return Candidates(np.tile(_around(first_heading), (len(R_placed), 1)), tuple(several), relative=True), tuple(tilted)


def heading_candidates(R_bone_sensor: Array, first_heading: float) -> Candidates:
    """Make a grid of headings from ``first_heading`` radians on, with the given mountings ``(S, 3, 3)``."""
    mountings = np.repeat(R_bone_sensor[:, None, None], GRID, axis=1)
    return Candidates(np.tile(_around(first_heading), (len(R_bone_sensor), 1)), tuple(mountings), relative=True)


def quarter_turns(R_placed: Array) -> Array:
    """Mountings ``(24, 3, 3)`` with permuted axes of the placed one, which comes first."""
    return R_placed @ _quarter_turns()


@cache
def _quarter_turns() -> Array:
    turns = [np.eye(3)]
    about_x, about_y = np.array([[[1, 0, 0], [0, 0, -1], [0, 1, 0]], [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]], float)
    for turn in turns:  # the list grows during the loop
        for further in (about_x @ turn, about_y @ turn):
            if not any(np.array_equal(further, known_turn) for known_turn in turns):
                turns.append(further)
    return np.stack(turns)


def _around(first_heading: float) -> Array:
    return first_heading + np.linspace(0, 2 * np.pi, GRID, endpoint=False)


def _lean(R_bone_sensor: Array, up_sensor: Array) -> Array:
    """Angles ``(...)`` radians between a bone's long axis and the vertical."""
    along = np.sum(R_bone_sensor[..., 1, :] * up_sensor, axis=-1) / np.linalg.norm(up_sensor, axis=-1)
    return np.arccos(np.clip(along, -1.0, 1.0))


def _turn_upright(R_bone_sensor: Array, up_sensor: Array) -> Array:
    """Rotate the mounting along the shortest arc such that the bone's long axis is vertical."""
    up_bone = R_bone_sensor @ (up_sensor / np.linalg.norm(up_sensor))
    axis = np.cross(up_bone, [0.0, 1.0, 0.0])
    length = float(np.linalg.norm(axis))
    if length < 1e-9:
        axis, length = np.array([1.0, 0.0, 0.0]), 1.0
    return exp(float(_lean(R_bone_sensor, up_sensor)) * axis / length) @ R_bone_sensor


KEPT, ADDED = 12, 30  # candidates of each sensor, and rotations added in each round
TURN_SIGMAS = np.deg2rad([25, 25, 20, 20, 15, 15, 15, 10, 10, 10, 7, 7, 5, 5, 3, 3])  # of the rotations, by round
NEAR = np.deg2rad([-20, -15, -10, -5, 5, 10, 15, 20])  # offsets from the best heading, for its uncertainty


def likely_candidates(candidates: Candidates, costs: Sequence[Array]) -> Candidates:
    """Select the likeliest distinct candidates of each sensor, likeliest first, one mounting for each heading.

    ``costs`` by sensor ``(K, M)`` are least costs with each candidate. If there are too few, the first is repeated.
    """
    chosen = [_distinct_candidates(candidates, s, cost) for s, cost in enumerate(costs)]
    return Candidates(
        np.stack([candidates.headings[s, rows[:, 0]] for s, rows in enumerate(chosen)]),
        tuple(candidates.R_bone_sensor[s][rows[:, 0], rows[:, 1]][:, None] for s, rows in enumerate(chosen)),
    )


def _distinct_candidates(candidates: Candidates, s: int, cost: Array) -> np.ndarray:
    slack = 50.0  # nats: less likely candidates are dropped
    decimals = 6  # of nats: makes the choice independent of rounding errors
    distinct = np.deg2rad(59.9)  # nearer candidates converge to the same minimum; just below four steps of the grid
    remaining, chosen = np.round(cost, decimals), list[tuple[int, int]]()
    headings, mountings = candidates.headings[s], candidates.R_bone_sensor[s]
    rows = mountings.reshape(*mountings.shape[:2], 9)
    limit = float(cost.min()) + slack
    while len(chosen) < KEPT and float(remaining.min()) < limit:
        k, m = np.unravel_index(int(remaining.argmin()), remaining.shape)
        # the trace of a rotation is one plus twice its angle's cosine
        alike = rows @ rows[k, m] > 1 + 2 * np.cos(distinct)
        remaining[alike & (np.abs(wrap_angle(headings - headings[k])) < distinct)[:, None]] = np.inf
        chosen.append((int(k), int(m)))
    return np.array([*chosen, *[chosen[0]] * (KEPT - len(chosen))])


def refined_candidates(particles: Candidates, costs: Callable[[Candidates], Sequence[Array]], root: int) -> Candidates:
    """Refine particles over all rounds; ``costs`` returns the least cost with each candidate of each sensor.

    Each round adds rotations about the bone's axes and about the vertical; the heading of the sensor ``root`` is fixed.
    """
    random = np.random.default_rng(0)
    for size in TURN_SIGMAS:
        S, N = particles.headings.shape
        of = np.tile(np.arange(N), -(-ADDED // N))[:ADDED]
        heading_steps = size * random.standard_normal((S, ADDED))
        heading_steps[root] = 0.0
        turns = exp(size * random.standard_normal((S, ADDED, 3)))[:, :, None]
        turned = tuple(turn @ R[of] for turn, R in zip(turns, particles.R_bone_sensor, strict=True))
        several = particles.beside(Candidates(particles.headings[:, of] + heading_steps, turned))
        particles = likely_candidates(several, costs(several))
    return particles


def about_best(particles: Candidates, root: int) -> Candidates:
    """Add headings near the first particle of each sensor, whose costs give its uncertainty.

    They are added with the bone rotating with the heading, and with the mounting compensating it for an upright bone.
    """
    offsets = np.tile(NEAR, (len(particles.headings), 1))
    offsets[root] = 0.0
    headings, mountings = particles.headings[:, :1] + offsets, [R[:1] for R in particles.R_bone_sensor]
    turned = tuple(rotation_y(angles)[:, None] @ R for angles, R in zip(offsets, mountings, strict=True))
    unturned = tuple(np.repeat(R, len(NEAR), axis=0) for R in mountings)
    return particles.beside(Candidates(headings, unturned), Candidates(headings, turned))
