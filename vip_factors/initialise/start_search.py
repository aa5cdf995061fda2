"""The likeliest start of headings and mountings: every sensor's taken together, under several hypotheses."""

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
    common_cost,
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

FINER = np.deg2rad([-10.0, -5.0, 0.0, 5.0, 10.0])  # about the best of the grid; the solve finds what is left
STEP_SIGMA = 2 * np.pi / GRID / np.sqrt(12)  # of what lies between two headings of the grid
FACINGS = np.deg2rad([0, 45, -45, 90, -90, 135, -135, 180])


@dataclass(frozen=True)
class SensorPrior:
    """What is known of the sensors beforehand.

    Attributes:
        links: the tree that they make.
        R_placed: ``(S, 3, 3)`` as they were placed.
        sigma: ``(S,)`` radians about each axis.
        limbs: ``(S, 3)`` unit vectors along the bones, in their axes.
        upright: ``(S,)`` whether their bones are upright on the whole.
    """

    links: tuple[Link, ...]
    R_placed: Array
    sigma: Array
    limbs: Array
    upright: np.ndarray


@dataclass(frozen=True)
class Start:
    """One start.

    Attributes:
        hypothesis: in words.
        calibration: headings and mountings.
        cost: nats; a start that is less likely by a factor of e costs one more.
    """

    hypothesis: str
    calibration: InitialCalibration
    cost: float


@dataclass(frozen=True)
class Starts:
    """What a search found.

    Attributes:
        best: the likeliest.
        rival: hypothesis of the likeliest start that turns a sensor by more than 60° against it.
        margin: by how many nats it is less likely; infinite where there is none.
        doubtful: numbers of the sensors that starts turn which are less likely by ``SETTLED_NATS`` at most.
        tilted: numbers of the sensors that cannot sit as placed, nor by a quarter turn otherwise: their bones would
            not be upright.
        rivals: the likeliest starts that turn doubtful sensors, so many that each of these is turned by one.
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
        known_mountings: whether sensors sit exactly as placed; where no pose is declared, headings alone vary then.
        agree_deg: standard deviation of the yaw between inertial frames of sensors that were started together, degrees.
            Thirteen of one make lay within −10° to +4°, one of them at −33°.
    """

    frames: ImuFrames
    prior: SensorPrior
    known_mountings: bool = False
    agree_deg: float = 15.0

    def best(
        self, usual: InitialCalibration, R_inertial_at_pose: Array, others: Sequence[InitialCalibration] = ()
    ) -> Starts:
        """The likeliest start.

        Args:
            usual: of straps and low-passed motion, which competes; with bones in the declared pose, if any.
            R_inertial_at_pose: ``(S, 3, 3)`` orientations of the sensors in the declared pose.
            others: starts that compete too, where no pose is declared.
        """
        if usual.R_world_bone is not None:
            grid = declared_candidates(usual, R_inertial_at_pose)
        elif self.known_mountings:
            grid = heading_candidates(usual.R_bone_sensor, float(usual.headings[self._root]))
        else:
            return self._undeclared(usual, others)
        pairs = self._links.of(grid)
        minima = {one: self._minimum(grid, pairs, (one,), marginals=False) for one in HYPOTHESES}
        starts = [Start(one.name, _chosen(grid, found, usual), found.cost) for one, found in minima.items()]
        starts = [self._refined(one) for one in (*starts, self._usual(usual))]
        best = min(starts, key=lambda start: start.cost)
        named = [one for one in HYPOTHESES if one.name == best.hypothesis]
        hypothesis = min(named or HYPOTHESES, key=lambda one: minima[one].cost)
        own = self._minimum(grid, pairs, (hypothesis,))
        return self._compared(best, starts, grid, pairs, hypothesis, own)

    def cost(self, calibration: InitialCalibration) -> float:
        """Nats of headings and mountings as they are, under the hypothesis that suits them best."""
        return self._refined(Start("", replace(calibration, R_world_bone=None), 0.0), np.zeros(1)).cost

    def _undeclared(self, usual: InitialCalibration, others: Sequence[InitialCalibration]) -> Starts:
        root, up = self._root, self._up_sensor
        facing = float(usual.headings[root])
        grid, tilted = placed_candidates(usual.R_bone_sensor, self.prior.limbs, up, facing)
        starts = [replace(one, headings=one.headings + facing - one.headings[root]) for one in (usual, *others)]
        particles = likely_candidates(grid, self._least(grid)).beside(Candidates.of(starts))
        particles = refined_candidates(particles, self._least, root)
        candidates = about_best(likely_candidates(particles, self._least(particles)), root)
        pairs = self._links.of(candidates)
        usual = replace(usual, R_world_bone=None)
        found = {one: self._minimum(candidates, pairs, (one,)) for one in HYPOTHESES}
        hypothesis, own = min(found.items(), key=lambda one: one[1].cost)
        best = Start(hypothesis.name, _chosen(candidates, own, usual), own.cost)
        rivals = [Start(other.name, _chosen(candidates, one, usual), one.cost) for other, one in found.items()]
        return replace(self._compared(best, rivals, candidates, pairs, hypothesis, own), tilted=tilted)

    def _least(self, candidates: Candidates) -> Sequence[Array]:
        """By sensor ``(K, M)``, the least cost with each candidate, whatever is hypothesis."""
        return self._minimum(candidates, self._links.of(candidates), HYPOTHESES).marginals

    @cached_property
    def _links(self) -> LinkCosts:
        return LinkCosts(self.prior.links, self.frames)

    @cached_property
    def _up_sensor(self) -> Array:
        """``(S, 3)`` the mean vertical in axes of the sensors on bones that are upright on the whole; NaN of others."""
        frames = self.frames
        up = np.full((len(frames.sensors), 3), np.nan)
        for s in np.flatnonzero(self.prior.upright & frames.orientation_valid.any(axis=0)):
            up[s] = frames.R_inertial_sensor[frames.orientation_valid[:, s], s][:, 2].mean(axis=0)
        return up

    @property
    def _root(self) -> int:
        return self.prior.links[0].parent if self.prior.links else 0

    def _minimum(
        self, candidates: Candidates, pairs: dict[int, Array], hypotheses: Sequence[InitialisationHypothesis],
        given: tuple[int, np.ndarray] | None = None, marginals: bool = True,
    ) -> TreeMinimum:  # fmt: skip
        """The likeliest choice; ``given`` a sensor of which only some candidates ``(K, M)`` are allowed."""
        # Costs of links under all headings in common that are added together: more would not stay in the cache
        at_once = 2**17
        unaries = self._unaries(candidates, hypotheses)
        if given is not None:
            sensor, allowed = given
            unaries[sensor] = np.where(allowed, unaries[sensor], np.inf)
        some = max(at_once // max((one.size for one in pairs.values()), default=1), 1)
        found = [
            least_cost([one[begin : begin + some] for one in unaries], self.prior.links, pairs, marginals)
            for begin in range(0, len(unaries[0]), some)
        ]
        least = tuple(np.min(costs, axis=0) for costs in zip(*(one.marginals for one in found), strict=True))
        return replace(min(found, key=lambda one: one.cost), marginals=least)

    def _unaries(self, candidates: Candidates, hypotheses: Sequence[InitialisationHypothesis]) -> list[Array]:
        """Costs ``(C, K, M)`` of sensors by themselves, for every heading that their frames may have in common."""
        strange_strap = 0.1  # chance of a strap in any orientation: three of thirteen were
        prior, counts = self.prior, [R.shape[1] for R in candidates.R_bone_sensor]
        of, R = np.repeat(np.arange(len(counts)), counts), np.concatenate(candidates.R_bone_sensor, axis=1)
        free = np.zeros(R.shape[:2]) if candidates.declared else upright_cost(R, self._up_sensor[of])
        if candidates.relative:  # the world may turn as it likes: one heading holds it
            free[1:, of == self._root] = np.inf
        placed = free + strap_cost(R, prior.R_placed[of], prior.sigma[of], strange_strap)
        sigma = np.deg2rad(self.agree_deg)
        common = candidates.headings[0, 0] + np.linspace(0, 2 * np.pi, GRID, endpoint=False)[:, None, None]
        agreed = frame_cost(candidates.headings.T, common, sigma, 0.05)  # one of thirteen was started elsewhere
        agreed = agreed[..., of] + common_cost(len(counts), sigma) / len(counts)
        straps = [placed if one.straps else free for one in hypotheses]
        costs = [own + agreed if one.frames else own[None] for one, own in zip(hypotheses, straps, strict=True)]
        return np.split(np.concatenate(costs), np.cumsum(counts)[:-1], axis=2)

    def _usual(self, usual: InitialCalibration) -> Start:
        """The usual start, whichever way the wearer faced: as likely as under the hypothesis that suits it best."""
        turned = [usual.facing(float(angle)) for angle in (FACINGS if usual.R_world_bone is not None else FACINGS[:1])]
        candidates = replace(Candidates.of(turned), declared=True)
        alone = np.sum(self._unaries(candidates, HYPOTHESES), axis=0).min(axis=0)[:, 0]
        between = [np.einsum("kmkm->k", one) for one in self._links.of(candidates).values()]
        costs = np.sum([alone, *between], axis=0)
        best = int(np.argmin(costs))
        return Start("straps and slow motion tell", turned[best], float(costs[best]))

    def _refined(self, start: Start, offsets: Array = FINER) -> Start:
        """The start with headings better than the grid's, under the hypothesis that suits it best."""
        own = start.calibration
        headings = own.headings[:, None] + offsets
        mountings = np.repeat(own.R_bone_sensor[:, None], len(offsets), axis=1)
        if own.R_world_bone is not None:  # the declared pose stays as it is: mountings follow
            bones = own.R_world_bone[:, None]
            mountings = transpose(bones) @ rotation_z(np.broadcast_to(offsets, headings.shape)) @ bones @ mountings
        candidates = Candidates(headings, tuple(mountings[:, :, None]), declared=True)
        best = self._minimum(candidates, self._links.of(candidates), HYPOTHESES, marginals=False)
        return replace(start, calibration=_chosen(candidates, best, own), cost=best.cost)

    def _compared(
        self, best: Start, starts: Sequence[Start], grid: Candidates, pairs: dict[int, Array],
        hypothesis: InitialisationHypothesis, own: TreeMinimum,
    ) -> Starts:  # fmt: skip
        """The best start and what is nearly as likely: another hypothesis's, or its own with some sensors turned."""
        different = np.deg2rad(60.0)  # a sensor turned by more starts in another valley than the solution's
        rival, margin = "", np.inf
        near: list[tuple[Start, set[int]]] = []
        for other in starts:
            turned = set(np.flatnonzero(_differences(best.calibration, other.calibration) > different).tolist())
            behind = other.cost - best.cost
            if turned:
                near += [(other, turned)] if behind < SETTLED_NATS else []
                rival, margin = (other.hypothesis, behind) if behind < margin else (rival, margin)
        for s, costs in enumerate(own.marginals):
            off = _turned(grid, s, *own.choice[s]) > different
            behind = float(np.min(costs[off], initial=np.inf)) - own.cost
            if behind < SETTLED_NATS:
                found = self._minimum(grid, pairs, (hypothesis,), (s, off), marginals=False)
                other = Start(best.hypothesis, _chosen(grid, found, best.calibration), best.cost + behind)
                near.append((other, {s}))
            rival, margin = (best.hypothesis, behind) if behind < margin else (rival, margin)
        doubtful, rivals = set[int](), list[Start]()
        for other, turned in sorted(near, key=lambda one: one[0].cost):
            rivals += [other] if turned - doubtful else []
            doubtful |= turned
        best = replace(best, calibration=replace(best.calibration, heading_sigma=_heading_sigma(grid, own)))
        return Starts(best, rival, float(max(margin, 0.0)), tuple(sorted(doubtful)), rivals=tuple(rivals))


def _chosen(candidates: Candidates, minimum: TreeMinimum, like: InitialCalibration) -> InitialCalibration:
    headings = np.array([candidates.headings[s, k] for s, (k, _) in enumerate(minimum.choice)])
    mountings = np.stack([candidates.R_bone_sensor[s][k, m] for s, (k, m) in enumerate(minimum.choice)])
    return replace(like, headings=headings, R_bone_sensor=mountings)


def _differences(one: InitialCalibration, other: InitialCalibration) -> Array:
    """``(S,)`` radians by which starts turn sensors: on the bone, or about the vertical against the others."""
    off = wrap_angle(other.headings - one.headings)
    common = np.angle(np.exp(1j * off).mean())
    return np.maximum(angle_between(one.R_bone_sensor, other.R_bone_sensor), np.abs(wrap_angle(off - common)))


def _turned(grid: Candidates, s: int, heading: int, mounting: int) -> Array:
    """``(K, M)`` radians by which candidates turn a sensor against one of them."""
    off = angle_between(grid.R_bone_sensor[s][heading, mounting], grid.R_bone_sensor[s])
    return np.maximum(off, np.abs(wrap_angle(grid.headings[s] - grid.headings[s, heading]))[:, None])


def _heading_sigma(grid: Candidates, minimum: TreeMinimum) -> Array:
    """``(S,)`` radians by which headings scatter, each candidate weighing as it is likely."""
    sigma = np.zeros(len(minimum.choice))
    for s, costs in enumerate(minimum.marginals):
        likely = np.exp(minimum.cost - costs).sum(axis=1)
        off = wrap_angle(grid.headings[s] - grid.headings[s, minimum.choice[s][0]])
        sigma[s] = np.sqrt(np.sum(likely * off**2) / likely.sum() + STEP_SIGMA**2)
    return sigma
