"""Which person in a video frame is which wearer, as frames arrive; decided again while they are within the lag."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice, pairwise, permutations

import numpy as np
from scipy.optimize import linear_sum_assignment

from vip_factors.associate.tracklets import FURTHEST, LONGEST_GAP_S
from vip_factors.body.keypoints import KeypointSet
from vip_factors.body.kinematics import BodyState
from vip_factors.body.skeleton import Skeleton
from vip_factors.geometry.rotations import Array, transpose
from vip_factors.live.association_evidence import (
    STILL_THE_SAME_S,
    BodyFitter,
    People,
    PersonTracks,
    image_gap,
    people_of,
    together,
)
from vip_factors.sensors.camera import CameraModel
from vip_factors.sensors.live import VideoFrame


def best_paths(gain: Array, jump: Array, blink: float) -> np.ndarray:
    """The person ``(F, W)`` who is each wearer, −1 for nobody.

    Every wearer's best path is found on its own (Viterbi). Where two want the same person, they choose in turn, in the
    order that costs least.

    Args:
        gain: ``(F, W, N)`` of taking a person over taking nobody; very negative where that is not allowed.
        jump: ``(F − 1, N, N)`` lost with a step from one person to one of the next frame.
        blink: lost with a step from a person to nobody or back.
    """
    most_orders = 6  # of wearers to be tried where two want the same person: all of three
    F, W, N = gain.shape
    cost = np.concatenate([-gain, np.zeros((F, W, 1))], axis=2)
    step = _steps(jump, blink)
    path, _ = _viterbi(cost, step)
    if not _conflicts(path, N):
        return np.where(path < N, path, -1)
    best, least = path, np.inf
    for order in islice(permutations(range(W)), most_orders):
        tried, total = _in_turn(cost, step, order)
        if total < least:
            best, least = tried, total
    return np.where(best < N, best, -1)


def _steps(jump: Array, blink: float) -> Array:
    """Cost ``(F − 1, N + 1, N + 1)`` of the step from a state to one of the next frame; the last is nobody."""
    steps, N, _ = jump.shape
    step = np.full((steps, N + 1, N + 1), blink)
    step[:, :N, :N] = jump
    step[:, N, N] = 0.0
    return step


def _viterbi(cost: Array, step: Array) -> tuple[np.ndarray, Array]:
    """Cheapest paths ``(F, W)`` through states of cost ``(F, W, S)``, and what each costs ``(W,)``."""
    F, W, _ = cost.shape
    total, back = cost[0], []
    for f in range(1, F):
        way = total[:, :, None] + step[f - 1]
        back.append(way.argmin(axis=1))
        total = way.min(axis=1) + cost[f]
    path, rows = np.empty((F, W), int), np.arange(W)
    path[-1] = total.argmin(axis=1)
    for f in range(F - 1, 0, -1):
        path[f - 1] = back[f - 1][rows, path[f]]
    return path, total.min(axis=1)


def _conflicts(path: np.ndarray, nobody: int) -> bool:
    ordered = np.sort(path, axis=1)
    return bool(np.any((ordered[:, 1:] == ordered[:, :-1]) & (ordered[:, 1:] < nobody)))


def _in_turn(cost: Array, step: Array, order: tuple[int, ...]) -> tuple[np.ndarray, float]:
    impossible = 1e6
    free, total = cost.copy(), 0.0
    path = np.empty(cost.shape[:2], int)
    frames = np.arange(len(cost))
    for w in order:
        one, price = _viterbi(free[:, w : w + 1], step)
        path[:, w], total = one[:, 0], total + float(price[0])
        taken = path[:, w] < cost.shape[2] - 1
        free[frames[taken], :, path[taken, w]] = impossible
    return path, total


NOBODY = -1
NEVER = 1e6


@dataclass(frozen=True)
class Belief:
    """What is believed of ``F`` frames.

    Attributes:
        first: number of the first.
        bodies: of each of ``W`` wearers.
        R_world_camera, p_world_camera: ``(F, 3, 3)`` and ``(F, 3)``.
        root_covariance: ``(F, W, 3, 3)`` m² of where each wearer is before the camera, world axes; the camera's turn
            is not part of it.
    """

    first: int
    bodies: Sequence[BodyState]
    R_world_camera: Array
    p_world_camera: Array
    root_covariance: Array

    def at(self, numbers: Sequence[int]) -> "Belief":
        """Of some of the frames, in order."""
        at = numbers[0] - self.first
        rows = np.array(numbers) - self.first if len(numbers) > 1 else slice(at, at + 1)
        bodies = [BodyState(one.R_world_bone[rows], one.p_world_joint[rows]) for one in self.bodies]
        R, p = self.R_world_camera[rows], self.p_world_camera[rows]
        return Belief(numbers[0], bodies, R, p, self.root_covariance[rows])


@dataclass(frozen=True)
class _Odds:
    """What some frames say on their own, in log-odds ``(..., W, N)``.

    Attributes:
        appearance, position: for each wearer and person.
        usable: whether enough of the person fits, and is near enough to where it should be, to be used.
    """

    appearance: Array
    position: Array
    usable: np.ndarray

    @property
    def both(self) -> Array:
        return self.appearance + self.position

    def frame(self, number: int) -> "_Odds":
        return _Odds(self.appearance[number], self.position[number], self.usable[number])


@dataclass
class _Wearer:
    """What is remembered of one wearer."""

    track: int = NOBODY  # number of the track that it was last
    seen: float | None = None  # when that was
    wide_m: float = 0.0  # uncertainty after a drop
    looks: float = 0.0  # mean log-odds of the appearance of whom it was given, since it was last lost


class OnlineAssociation:
    """Who is who in one camera's video, frame by frame.

    Args:
        keypoints: of the detector.
        model: of the camera.
        skeletons: of the ``W`` wearers.
    """

    # Evidence is in log-odds that a person is the wearer. The first five numbers are logistic regressions on 24 000
    # pairs of simulated scenes with poses 10° off, cameras 2° off and roots known to 5 cm, rounded.
    SHAPE_WEIGHT = 4.5  # lost with each e-fold of the shape's mean squared error in sigmas: 0.4 if right, 2.5 if wrong
    MISFIT_WEIGHT = 0.75  # lost with each major joint that is detected and does not fit
    BIAS = 1.0  # where both are zero: a person taken at random is mostly a wrong one
    NEAR = 1.5  # won by standing exactly where the wearer is predicted
    POSITION_WEIGHT = 3.5  # lost with each e-fold of 1 + a quarter of the position's squared Mahalanobis distance
    LEAST_SHAPE = 0.1  # added to the shape's error: a better fit is luck
    MOST_APPEARANCE = 5.0  # limit of one frame's appearance, either way: detectors err for many frames in a row
    MOST_DISTANCE = 6.0  # limit of what a position costs: after a mistake the prediction is wrong and shape must win
    CAMERA_SIGMA = np.deg2rad(2.0)  # of the predicted camera's rotation: hands shake, orientation filters lag
    DEPTH_SHARE = 0.15  # error of a depth, as a share of it, that wrongly predicted limbs make
    SIDE_M = 0.1  # the same across the view
    KNOWN_M = 0.25  # uncertainty across the view up to which the regressions hold; beyond it a position counts less
    MEMORY_S = 1.0  # over which a track's evidence is averaged: a step and its swing
    MEMORY_WEIGHT = 2.0  # of that evidence against one frame's: a second holds a few independent looks, not thirty
    STAY = 2.0  # for the person who continues, in the image, whom the wearer was before
    GATE = 14.0  # squared Mahalanobis distance, three numbers, beyond which nobody is taken: one in 300
    ENOUGH_JOINTS = 6.0  # major joints that must fit: half of them
    PATIENCE_S = 0.5  # a wearer who is unseen for longer is lost: the prediction has drifted
    DRIFT_M_S = 0.5  # growth of a lost wearer's position uncertainty: a slow walk
    MOST_LOST_M = 4.0  # its limit: the size of a room
    RECOVER = 0.3  # mean appearance over MEMORY_S that a track needs to become a lost wearer; it starts at zero
    RECOVER_MARGIN = 0.5  # by which that must exceed any other free track's
    DROP = -0.5  # mean appearance of the wearer's track below which the wearer is lost
    DROPPED_M = 1.5  # uncertainty of the position after that: the prediction followed the wrong person
    SWITCH = 6.0  # lost, within the lag, with a step from one track to another
    BLINK = 0.5  # lost, within the lag, with a step to nobody or back: detectors blink, but not every other frame

    def __init__(self, keypoints: KeypointSet, model: CameraModel, skeletons: Sequence[Skeleton]) -> None:
        self.model = model
        self._fitter = BodyFitter(keypoints, skeletons, self.DEPTH_SHARE, self.SIDE_M)
        self._wearers = [_Wearer() for _ in skeletons]
        self._tracks = PersonTracks(len(skeletons), len(keypoints), self.MEMORY_S)
        self._time = -np.inf
        self._frames: dict[float, tuple[People, np.ndarray]] = {}  # recent ones, and their persons' tracks

        self._gaps: dict[tuple[float, float], Array] = {}  # between persons of two successive frames

    @property
    def recovering(self) -> np.ndarray:
        """``(W,)`` whether a wearer has been lost, and is looked for, as of the newest frame."""
        patience = self.PATIENCE_S
        return np.array([one.seen is not None and self._time - one.seen > patience for one in self._wearers])

    def choose(self, frame: VideoFrame, belief: Belief) -> np.ndarray:
        """Index ``(W,)`` of the person who is each wearer in the newest video frame, −1 for nobody.

        Args:
            frame: later than all before; one that comes late is decided without being remembered.
            belief: what is predicted of that one frame.
        """
        people = people_of(frame.pixels, frame.confidence, self.model)
        late = frame.time <= self._time
        elapsed = min(frame.time - self._time, self.MEMORY_S) if np.isfinite(self._time) else 0.03
        if not late:
            self._time = frame.time
            self._begin(frame.time)
            self._fitter.count_keypoints(people)
        odds = self._odds(belief, people).frame(0)
        if late:
            return _assign(np.where(odds.usable, odds.both, -NEVER))
        row = self._tracks.link(frame.time, people.rays[0], people.weight[0])
        self._tracks.accumulate(row, odds.appearance, elapsed)
        number = self._tracks.number[row]
        self._keep(frame.time, people, number)
        memory = self._tracks.evidence[..., row]
        own = np.array([one.track for one in self._wearers])[:, None] == number
        chosen = _assign(self._gain(odds, memory, number, self.STAY * own))
        self._take(frame.time, chosen, number)
        self._doubt(odds.appearance, chosen, elapsed)
        return chosen

    def revise(self, frames: Sequence[VideoFrame], belief: Belief) -> list[np.ndarray]:
        """Decide again, jointly, about the video frames that are still within the lag.

        Args:
            frames: one at least, in order of time, that were given to :meth:`choose`.
            belief: what is believed of them now.

        Returns:
            Index ``(W,)`` of the person who is each wearer, for each frame; −1 for nobody.
        """
        known = [self._frames.get(one.time) or self._unknown(one) for one in frames]
        people = together([one for one, _ in known])
        odds = self._odds(belief, people)
        number = np.full(people.there.shape, NOBODY)
        for row, (_, numbers) in zip(number, known, strict=True):
            row[: len(numbers)] = numbers
        memory = self._tracks.evidence_of(number).swapaxes(0, 1)
        gain = np.where(people.there[:, None], self._gain(odds, memory, number), -NEVER)
        paths = best_paths(gain, self._jump([one.time for one in frames], people, number), self.BLINK)
        if frames[-1].time == self._time:
            self._take(frames[-1].time, paths[-1], number[-1])
        return list(paths)

    def remember(self, frame: VideoFrame, chosen: np.ndarray) -> None:
        """Take over who is who in a frame that was decided elsewhere, as at the start; −1 for nobody."""
        if frame.time <= self._time:
            return
        self._time = frame.time
        people = people_of(frame.pixels, frame.confidence, self.model)
        self._fitter.count_keypoints(people)
        row = self._tracks.link(frame.time, people.rays[0], people.weight[0])
        number = self._tracks.number[row]
        self._keep(frame.time, people, number)
        self._begin(frame.time)
        self._take(frame.time, chosen, number)

    def _unknown(self, frame: VideoFrame) -> tuple[People, np.ndarray]:
        return people_of(frame.pixels, frame.confidence, self.model), np.zeros(0, int)

    def _begin(self, time: float) -> None:
        for one in self._wearers:
            one.seen = time if one.seen is None else one.seen

    def _keep(self, time: float, people: People, number: np.ndarray) -> None:
        """Keep a frame, which is later than all before, and how far its persons are from those of the last one."""
        before = next(reversed(self._frames), -np.inf)
        if time - before <= LONGEST_GAP_S:
            self._gaps[before, time] = self._tracks.gap(self._frames[before][1])
        self._frames[time] = people, number
        while (old := next(iter(self._frames))) < time - self.MEMORY_S:
            del self._frames[old]
        while self._gaps and (pair := next(iter(self._gaps)))[0] < time - self.MEMORY_S:
            del self._gaps[pair]

    def _lost_m(self) -> Array:
        """By how much positions are more uncertain than the caller says, ``(W,)``."""
        unseen = [0.0 if one.seen is None else self._time - one.seen for one in self._wearers]
        drift = [self.DRIFT_M_S * max(one - self.PATIENCE_S, 0.0) for one in unseen]
        wide = [math.hypot(one.wide_m, far) for one, far in zip(self._wearers, drift, strict=True)]
        return np.minimum(wide, self.MOST_LOST_M)

    def _odds(self, belief: Belief, people: People) -> _Odds:
        R = belief.R_world_camera
        points = self._fitter.points(belief.bodies, R, belief.p_world_camera)
        depth = self._fitter.middle(points)[..., 2]
        covariance = transpose(R)[:, None] @ belief.root_covariance @ R[:, None]
        variances = np.einsum("...ii->...i", covariance)
        variances += self._lost_m()[:, None] ** 2
        variances[..., :2] += (self.CAMERA_SIGMA * depth[..., None]) ** 2
        fit = self._fitter.fit(points, people, covariance)
        appearance = (
            self.BIAS
            - self.SHAPE_WEIGHT * np.log(fit.shape + self.LEAST_SHAPE)
            - self.MISFIT_WEIGHT * (fit.seen - fit.fitting)
        ) * np.minimum(fit.seen / self.ENOUGH_JOINTS, 1.0)
        across = np.sqrt((variances[..., 0] + variances[..., 1]) / 2)[..., None]
        vague = np.log(np.maximum(across / self.KNOWN_M, 1.0))
        position = np.maximum(
            self.NEAR - self.POSITION_WEIGHT * np.log1p(fit.position / 4) - vague, -self.MOST_DISTANCE
        )
        usable = (fit.fitting > self.ENOUGH_JOINTS) & (fit.position < self.GATE)
        return _Odds(np.clip(appearance, -self.MOST_APPEARANCE, self.MOST_APPEARANCE), position, usable)

    def _gain(self, odds: _Odds, memory: Array, number: np.ndarray, bonus: Array | float = 0.0) -> Array:
        """Log-odds of taking a person for a wearer ``(..., W, N)``, all in all; very negative where not allowed.

        Of a person's past only the appearance counts: positions stay wrong for as long as a second, so that a second
        of them says no more than one frame.
        """
        lost = self.recovering
        score = odds.both + self.MEMORY_WEIGHT * memory + bonus
        allowed = odds.usable
        if lost.any():
            allowed = allowed & (self._recovered(memory, number) | ~lost[:, None])
        return np.where(allowed, score, -NEVER)

    def _recovered(self, appearance: Array, number: np.ndarray) -> np.ndarray:
        """Who never was out of sight, or has long looked like a lost wearer, more than anybody else who is free."""
        taken = [one.track for one, lost in zip(self._wearers, self.recovering, strict=True) if not lost]
        rival = np.where(np.isin(number, taken)[..., None, :], -self.MOST_APPEARANCE, appearance)
        ordered = np.sort(rival, axis=-1)
        second = ordered[..., -2:-1] if ordered.shape[-1] > 1 else -self.MOST_APPEARANCE
        stayed = number[..., None, :] == np.array([one.track for one in self._wearers])[:, None]
        plain = (rival > self.RECOVER) & (rival >= ordered[..., -1:]) & (rival > second + self.RECOVER_MARGIN)
        return plain | stayed & (number[..., None, :] != NOBODY)

    def _doubt(self, appearance: Array, chosen: np.ndarray, elapsed: float) -> None:
        """Wearers who were given somebody who for long has not looked like them are lost."""
        share = 1 - np.exp(-elapsed / self.MEMORY_S)
        for w, one in enumerate(self._wearers):
            if chosen[w] < 0 or one.seen is None:
                continue
            one.looks += share * (appearance[w, chosen[w]] - one.looks)
            if one.looks < self.DROP:
                one.track, one.wide_m, one.looks = NOBODY, self.DROPPED_M, 0.0
                one.seen = self._time - self.PATIENCE_S - STILL_THE_SAME_S

    def _jump(self, time: Sequence[float], people: People, number: np.ndarray) -> Array:
        """What steps from person to person cost, by how far apart they are in the image, ``(F − 1, N, N)``."""
        N = number.shape[1]
        gap = np.full((len(time) - 1, N, N), np.inf)
        for f, (before, now) in enumerate(pairwise(time)):
            if (before, now) not in self._gaps:
                rays, weight = people.rays, people.weight
                self._gaps[before, now] = image_gap(rays[f], rays[f + 1], weight[f], weight[f + 1])
            known = self._gaps[before, now][:N, :N]  # may be padded otherwise
            gap[f, : known.shape[0], : known.shape[1]] = known
        same = (number[:-1, :, None] == number[1:, None]) & (number[:-1, :, None] >= 0)
        return np.where(same, -self.STAY, self.SWITCH * np.minimum((gap / FURTHEST) ** 2, 1.0))

    def _take(self, time: float, chosen: np.ndarray, number: np.ndarray) -> None:
        for one, n in zip(self._wearers, chosen, strict=True):
            if n >= 0:
                if one.seen is None or time - one.seen > self.PATIENCE_S:
                    one.looks = 0.0
                one.track, one.seen, one.wide_m = int(number[n]), time, 0.0


def _assign(gain: Array) -> np.ndarray:
    """The person ``(W,)`` of each wearer, −1 for nobody: with the most gain ``(W, N)`` altogether; nobody gains 0."""
    W, N = gain.shape
    chosen = np.full(W, NOBODY)
    for w, n in zip(*linear_sum_assignment(np.concatenate([-gain, np.zeros((W, W))], axis=1)), strict=True):
        if n < N and gain[w, n] > 0:
            chosen[w] = n
    return chosen
