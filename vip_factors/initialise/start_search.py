"""Search for the likeliest initial headings and mountings of all sensors together, under several hypotheses."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from vip_factors.geometry.rotations import Array, angle_between, rotation_z, transpose, wrap_angle
from vip_factors.initialise.calibration import InitialCalibration
from vip_factors.initialise.sensor_tree import Link, LinkCosts, TreeMinimum, least_cost
from vip_factors.initialise.start_candidates import (
    GRID,
    HYPOTHESES,
    SETTLED_NATS,
    Candidates,
    InitialisationHypothesis,
    about_best,
    declared_candidates,
    frame_cost,
    heading_candidates,
    likely_candidates,
    placed_candidates,
    refined_candidates,
    strap_cost,
    upright_cost,
)
from vip_factors.sensors.frames import ImuFrames

FINE_OFFSETS = np.deg2rad([-10.0, -5.0, 0.0, 5.0, 10.0])  # about the grid's best; the solver refines further
STEP_SIGMA = 2 * np.pi / GRID / np.sqrt(12)  # uncertainty of a heading within the grid's step
FACINGS = np.deg2rad([0, 45, -45, 90, -90, 135, -135, 180])


@dataclass(frozen=True)
class SensorPrior:
    """Prior knowledge about the sensors.

    Attributes:
        links: tree of the sensors.
        R_placed: ``(S, 3, 3)`` mountings of the placement.
        sigma: ``(S,)`` standard deviations about each axis, radians.
        limbs: ``(S, 3)`` unit vectors along the bones, in their axes.
        upright: ``(S,)`` mask of sensors on bones that are upright on average.
    """

    links: tuple[Link, ...]
    R_placed: Array
    sigma: Array
    limbs: Array
    upright: np.ndarray


@dataclass(frozen=True)
class Start:
    """Initial headings and mountings with their cost.

    Attributes:
        hypothesis: in words.
        calibration: headings and mountings.
        cost: negative log-likelihood, nats.
    """

    hypothesis: str
    calibration: InitialCalibration
    cost: float


@dataclass(frozen=True)
class Starts:
    """Result of a search.

    Attributes:
        best: likeliest start.
        rival: hypothesis of the likeliest start that turns a sensor by more than 60° relative to the best.
        margin: difference of their costs in nats; infinite without a rival.
        doubtful: numbers of the sensors that starts within ``SETTLED_NATS`` of the best turn.
        tilted: numbers of the sensors whose bones are not upright with the placed mounting or a quarter turn of it.
        rivals: likeliest starts that turn doubtful sensors, at least one for each of these.
    """

    best: Start
    rival: str
    margin: float
    doubtful: tuple[int, ...]
    tilted: tuple[int, ...] = ()
    rivals: tuple[Start, ...] = ()


@dataclass(frozen=True)
class StartSearch:
    """Costs of starts over some frames.

    Attributes:
        frames: evenly spaced.
        prior: of the sensors.
        known_mountings: True if placed mountings are exact; without a declared pose only headings vary then.
        agree_deg: standard deviation of the yaw between inertial frames of sensors that started together, degrees.
    """

    frames: ImuFrames
    prior: SensorPrior
    known_mountings: bool = False
    agree_deg: float = 15.0

    def best(
        self, usual: InitialCalibration, R_inertial_at_pose: Array, competitors: Sequence[InitialCalibration] = ()
    ) -> Starts:
        """Find the likeliest start.

        ``usual`` follows from placement and low-passed motion, with bones in the declared pose, if any; in it sensors
        have the orientations ``(S, 3, 3)``. Without it, ``competitors`` are further starts.
        """
        tilted, is_free = tuple[int, ...](), usual.R_world_bone is None and not self.known_mountings
        if is_free:
            grid, tilted = self._free_candidates(usual, competitors)
        elif usual.R_world_bone is not None:
            grid = declared_candidates(usual, R_inertial_at_pose)
        else:
            grid = heading_candidates(usual.R_bone_sensor, float(usual.headings[self._root]))
        pairs = self._links.of(grid)
        minima = {hypothesis: self._minimum(grid, pairs, (hypothesis,), marginals=is_free) for hypothesis in HYPOTHESES}
        starts = [
            Start(hypothesis.name, _calibration_of(grid, minimum, usual), minimum.cost)
            for hypothesis, minimum in minima.items()
        ]
        if not is_free:
            starts = [self._refine(start) for start in (*starts, self._usual_start(usual))]
        best_start = min(starts, key=lambda start: start.cost)
        named = [hypothesis for hypothesis in HYPOTHESES if hypothesis.name == best_start.hypothesis]
        hypothesis = min(named or HYPOTHESES, key=lambda candidate: minima[candidate].cost)
        minimum = minima[hypothesis] if is_free else self._minimum(grid, pairs, (hypothesis,))
        return replace(self._compare(best_start, starts, grid, pairs, hypothesis, minimum), tilted=tilted)

    def cost(self, calibration: InitialCalibration) -> float:
        """Cost of given headings and mountings in nats, under the likeliest hypothesis."""
        return self._refine(Start("", replace(calibration, R_world_bone=None), 0.0), np.zeros(1)).cost

    def _free_candidates(
        self, usual: InitialCalibration, competitors: Sequence[InitialCalibration]
    ) -> tuple[Candidates, tuple[int, ...]]:
        """Refined candidates without a declared pose, and sensors whose bones no placed mounting keeps upright."""
        root, facing = self._root, float(usual.headings[self._root])
        grid, tilted = placed_candidates(usual.R_bone_sensor, self.prior.limbs, self._up_sensor, facing)
        starts = [
            replace(start, headings=start.headings + facing - start.headings[root]) for start in (usual, *competitors)
        ]
        particles = likely_candidates(grid, self._least(grid)).beside(Candidates.of(starts))
        particles = refined_candidates(particles, self._least, root)
        return about_best(likely_candidates(particles, self._least(particles)), root), tilted

    def _least(self, candidates: Candidates) -> Sequence[Array]:
        """Least cost with each candidate by sensor, ``(K, M)``, over all hypotheses."""
        return self._minimum(candidates, self._links.of(candidates), HYPOTHESES).marginals

    @cached_property
    def _links(self) -> LinkCosts:
        return LinkCosts(self.prior.links, self.frames)

    @cached_property
    def _up_sensor(self) -> Array:
        """Mean vertical ``(S, 3)`` in sensor axes, for bones that are upright on average; NaN for others."""
        frames = self.frames
        up = np.full((len(frames.sensors), 3), np.nan)
        for s in np.flatnonzero(self.prior.upright & frames.orientation_valid.any(axis=0)):
            up[s] = frames.R_inertial_sensor[frames.orientation_valid[:, s], s][:, 2].mean(axis=0)
        return up

    @property
    def _root(self) -> int:
        return self.prior.links[0].parent if self.prior.links else 0

    def _minimum(
        self,
        candidates: Candidates,
        pairs: dict[int, Array],
        hypotheses: Sequence[InitialisationHypothesis],
        constraint: tuple[int, np.ndarray] | None = None,
        marginals: bool = True,
    ) -> TreeMinimum:
        """Find the likeliest choice; ``constraint``: a sensor and the mask ``(K, M)`` of its allowed candidates."""
        at_once = 2**17  # costs that are added together: as many as stay in the cache
        unaries = self._unaries(candidates, hypotheses)
        if constraint is not None:
            sensor, allowed = constraint
            unaries[sensor] = np.where(allowed, unaries[sensor], np.inf)
        chunk = max(at_once // max((cost.size for cost in pairs.values()), default=1), 1)
        minima = [
            least_cost([unary[begin : begin + chunk] for unary in unaries], self.prior.links, pairs, marginals)
            for begin in range(0, len(unaries[0]), chunk)
        ]
        least = tuple(np.min(costs, axis=0) for costs in zip(*(minimum.marginals for minimum in minima), strict=True))
        return replace(min(minima, key=lambda minimum: minimum.cost), marginals=least)

    def _unaries(self, candidates: Candidates, hypotheses: Sequence[InitialisationHypothesis]) -> list[Array]:
        """Unary costs ``(C, K, M)`` of sensors, for hypotheses and common headings of their frames."""
        strange_strap = 0.1  # probability of a mounting unlike the placement
        prior, counts = self.prior, [R.shape[1] for R in candidates.R_bone_sensor]
        of, R = np.repeat(np.arange(len(counts)), counts), np.concatenate(candidates.R_bone_sensor, axis=1)
        free = np.zeros(R.shape[:2]) if candidates.declared else upright_cost(R, self._up_sensor[of])
        if candidates.relative:  # the yaw of the world is arbitrary: one heading fixes it
            free[1:, of == self._root] = np.inf
        placed = free + strap_cost(R, prior.R_placed[of], prior.sigma[of], strange_strap)
        sigma = np.deg2rad(self.agree_deg)
        common = candidates.headings[0, 0] + np.linspace(0, 2 * np.pi, GRID, endpoint=False)[:, None, None]
        agreed = frame_cost(candidates.headings.T, common, sigma, 0.05)
        # of the unknown common heading: the circle over the width of its posterior
        agreed = agreed[..., of] + np.log(max(np.sqrt(2 * np.pi * len(counts)) / sigma, 1.0)) / len(counts)
        straps = [placed if hypothesis.straps else free for hypothesis in hypotheses]
        costs = [
            strap_costs + agreed if hypothesis.frames else strap_costs[None]
            for hypothesis, strap_costs in zip(hypotheses, straps, strict=True)
        ]
        return np.split(np.concatenate(costs), np.cumsum(counts)[:-1], axis=2)

    def _usual_start(self, usual: InitialCalibration) -> Start:
        """The usual start with the best facing of the wearer, and its cost under the likeliest hypothesis."""
        turned = [usual.facing(float(angle)) for angle in (FACINGS if usual.R_world_bone is not None else FACINGS[:1])]
        candidates = replace(Candidates.of(turned), declared=True)
        sensor_costs = np.sum(self._unaries(candidates, HYPOTHESES), axis=0).min(axis=0)[:, 0]
        between = [np.einsum("kmkm->k", pair_costs) for pair_costs in self._links.of(candidates).values()]
        costs = np.sum([sensor_costs, *between], axis=0)
        index = int(np.argmin(costs))
        return Start("straps and slow motion tell", turned[index], float(costs[index]))

    def _refine(self, start: Start, offsets: Array = FINE_OFFSETS) -> Start:
        """Refine a start's headings between those of the grid, under the likeliest hypothesis."""
        calibration = start.calibration
        headings = calibration.headings[:, None] + offsets
        mountings = np.repeat(calibration.R_bone_sensor[:, None], len(offsets), axis=1)
        if calibration.R_world_bone is not None:  # mountings follow from the declared pose
            bones = calibration.R_world_bone[:, None]
            mountings = transpose(bones) @ rotation_z(np.broadcast_to(offsets, headings.shape)) @ bones @ mountings
        candidates = Candidates(headings, tuple(mountings[:, :, None]), declared=True)
        minimum = self._minimum(candidates, self._links.of(candidates), HYPOTHESES, marginals=False)
        return replace(start, calibration=_calibration_of(candidates, minimum, calibration), cost=minimum.cost)

    def _compare(
        self,
        best_start: Start,
        starts: Sequence[Start],
        grid: Candidates,
        pairs: dict[int, Array],
        hypothesis: InitialisationHypothesis,
        minimum: TreeMinimum,
    ) -> Starts:
        """Compare the best start with nearly as likely ones: of other hypotheses, or with a sensor turned."""
        different = np.deg2rad(60.0)  # beyond it a start converges to another minimum
        rival, margin = "", np.inf
        near: list[tuple[Start, set[int]]] = []
        for start in starts:
            turned = set(np.flatnonzero(_differences(best_start.calibration, start.calibration) > different).tolist())
            behind = start.cost - best_start.cost
            if turned:
                near += [(start, turned)] if behind < SETTLED_NATS else []
                rival, margin = (start.hypothesis, behind) if behind < margin else (rival, margin)
        for s, costs in enumerate(minimum.marginals):
            mountings, headings, (k, m) = grid.R_bone_sensor[s], grid.headings[s], minimum.choice[s]
            is_turned = np.abs(wrap_angle(headings - headings[k])) > different
            off = (angle_between(mountings[k, m], mountings) > different) | is_turned[:, None]
            behind = float(np.min(costs[off], initial=np.inf)) - minimum.cost
            if behind < SETTLED_NATS:
                alternative = self._minimum(grid, pairs, (hypothesis,), (s, off), marginals=False)
                calibration = _calibration_of(grid, alternative, best_start.calibration)
                near.append((Start(best_start.hypothesis, calibration, best_start.cost + behind), {s}))
            rival, margin = (best_start.hypothesis, behind) if behind < margin else (rival, margin)
        doubtful, rivals = set[int](), list[Start]()
        for start, turned in sorted(near, key=lambda entry: entry[0].cost):
            rivals += [start] if turned - doubtful else []
            doubtful |= turned
        calibration = replace(best_start.calibration, heading_sigma=_heading_sigma(grid, minimum))
        best_start = replace(best_start, calibration=calibration)
        return Starts(best_start, rival, float(max(margin, 0.0)), tuple(sorted(doubtful)), rivals=tuple(rivals))


def _calibration_of(candidates: Candidates, minimum: TreeMinimum, like: InitialCalibration) -> InitialCalibration:
    headings = np.array([candidates.headings[s, k] for s, (k, _) in enumerate(minimum.choice)])
    mountings = np.stack([candidates.R_bone_sensor[s][k, m] for s, (k, m) in enumerate(minimum.choice)])
    return replace(like, headings=headings, R_bone_sensor=mountings)


def _differences(calibration_a: InitialCalibration, calibration_b: InitialCalibration) -> Array:
    """Differences ``(S,)`` of two starts in radians: of mountings, or of headings without the common yaw."""
    off = wrap_angle(calibration_b.headings - calibration_a.headings)
    common = np.angle(np.exp(1j * off).mean())
    turns = angle_between(calibration_a.R_bone_sensor, calibration_b.R_bone_sensor)
    return np.maximum(turns, np.abs(wrap_angle(off - common)))


def _heading_sigma(grid: Candidates, minimum: TreeMinimum) -> Array:
    """Standard deviations ``(S,)`` of headings in radians, with candidates weighted by likelihood."""
    sigma = np.zeros(len(minimum.choice))
    for s, costs in enumerate(minimum.marginals):
        likely = np.exp(minimum.cost - costs).sum(axis=1)
        off = wrap_angle(grid.headings[s] - grid.headings[s, minimum.choice[s][0]])
        sigma[s] = np.sqrt(np.sum(likely * off**2) / likely.sum() + STEP_SIGMA**2)
    return sigma
