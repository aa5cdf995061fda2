"""Association of persons in video frames with wearers, as frames arrive; revised while frames are within the lag."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
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
    stack_people,
)
from vip_factors.sensors.camera import CameraModel
from vip_factors.sensors.live import VideoFrame


def best_paths(gain: Array, jump: Array, blink: float) -> np.ndarray:
    """Assign a person ``(F, W)`` to each wearer; −1 for nobody.

    The best path of each wearer is found independently (Viterbi). Where two wearers claim the same person, they choose
    in turn, in the order of least cost.

    Args:
        gain: ``(F, W, N)`` of choosing a person over nobody; very negative where that is not allowed.
        jump: ``(F − 1, N, N)`` cost of a step from one person to one of the next frame.
        blink: cost of a step from a person to nobody or back.
    """
    most_orders = 6  # of wearers to be tried: all orders of three
    F, W, N = gain.shape
    cost = np.concatenate([-gain, np.zeros((F, W, 1))], axis=2)
    step = np.full((F - 1, N + 1, N + 1), blink)  # from a state to one of the next frame; the last is nobody
    step[:, :N, :N] = jump
    step[:, N, N] = 0.0
    path, _ = _viterbi(cost, step)
    ordered = np.sort(path, axis=1)
    if np.any((ordered[:, 1:] == ordered[:, :-1]) & (ordered[:, 1:] < N)):
        orders = islice(permutations(range(W)), most_orders)
        path, _ = min((_in_turn(cost, step, order) for order in orders), key=lambda choice: choice[1])
    return np.where(path < N, path, -1)


def _viterbi(cost: Array, step: Array) -> tuple[np.ndarray, Array]:
    """Cheapest paths ``(F, W)`` through states of cost ``(F, W, S)``, and their costs ``(W,)``."""
    F, W, _ = cost.shape
    total, back = cost[0], []
    for f in range(1, F):
        total_by_step = total[:, :, None] + step[f - 1]
        back.append(total_by_step.argmin(axis=1))
        total = total_by_step.min(axis=1) + cost[f]
    path, rows = np.empty((F, W), int), np.arange(W)
    path[-1] = total.argmin(axis=1)
    for f in range(F - 1, 0, -1):
        path[f - 1] = back[f - 1][rows, path[f]]
    return path, total.min(axis=1)


def _in_turn(cost: Array, step: Array, order: tuple[int, ...]) -> tuple[np.ndarray, float]:
    impossible = 1e6
    free, total = cost.copy(), 0.0
    path = np.empty(cost.shape[:2], int)
    frames = np.arange(len(cost))
    for w in order:
        best_path, price = _viterbi(free[:, w : w + 1], step)
        path[:, w], total = best_path[:, 0], total + float(price[0])
        is_taken = path[:, w] < cost.shape[2] - 1
        free[frames[is_taken], :, path[is_taken, w]] = impossible
    return path, total


NOBODY = -1
NEVER = 1e6


@dataclass(frozen=True)
class Belief:
    """Predicted or estimated state of ``F`` frames.

    Attributes:
        first_number: number of the first frame.
        bodies: bodies of the ``W`` wearers.
        root_covariance: ``(F, W, 3, 3)`` m² of each wearer's position relative to the camera, world axes; without the
            uncertainty of the camera's rotation.
        R_world_camera, p_world_camera: ``(F, 3, 3)`` and ``(F, 3)`` of one camera; empty without one.
    """

    first_number: int
    bodies: Sequence[BodyState]
    root_covariance: Array
    R_world_camera: Array = field(default_factory=lambda: np.zeros((0, 3, 3)))
    p_world_camera: Array = field(default_factory=lambda: np.zeros((0, 3)))

    def at(self, numbers: Sequence[int]) -> "Belief":
        """The belief about some of the frames, in order."""
        index = numbers[0] - self.first_number
        rows = np.array(numbers) - self.first_number if len(numbers) > 1 else slice(index, index + 1)
        bodies = [BodyState(body.R_world_bone[rows], body.p_world_joint[rows]) for body in self.bodies]
        R, p = self.R_world_camera[rows], self.p_world_camera[rows]
        return Belief(numbers[0], bodies, self.root_covariance[rows], R, p)


@dataclass(frozen=True)
class _Odds:
    """Log-odds ``(..., W, N)`` of single frames.

    Attributes:
        appearance, position: for each wearer and person.
        usable: whether enough of the person fits, close enough to the predicted position.
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
class _WearerTrack:
    """State of one wearer's track."""

    track: int = NOBODY  # number of the wearer's last track
    seen_at: float | None = None  # s, time of that
    wide_m: float = 0.0  # uncertainty after a loss
    looks: float = 0.0  # mean log-odds of the appearance since the wearer was last lost


class OnlineAssociation:
    """Associates persons in one camera's video, frame by frame.

    Args:
        keypoints: keypoint set of the detector.
        model: model of the camera.
        skeletons: skeletons of the ``W`` wearers.
    """

    # Evidence is in log-odds that a person is the wearer. The first five numbers are rounded logistic regressions on 24
    # 000 pairs of simulated scenes with poses 10° off, cameras 2° off and roots known to 5 cm, rounded.
    SHAPE_WEIGHT = 4.5  # for each e-fold of the shape's mean squared error in sigmas: 0.4 if right, 2.5 if wrong
    MISFIT_WEIGHT = 0.75  # for each major joint that is detected and does not fit
    BIAS = 1.0  # prior: a random person is mostly a wrong one
    NEAR = 1.5  # gain at the predicted position
    POSITION_WEIGHT = 3.5  # for each e-fold of 1 + a quarter of the position's squared Mahalanobis distance
    LEAST_SHAPE = 0.1  # added to the shape's error, below which a better fit is chance
    MOST_APPEARANCE = 5.0  # limit of one frame's appearance; detectors err for many frames in a row
    MOST_DISTANCE = 6.0  # limit of a position's cost; after a mistake the prediction is wrong and shape must prevail
    CAMERA_SIGMA = np.deg2rad(2.0)  # of the predicted camera rotation: hands shake, orientation filters lag
    DEPTH_SHARE = 0.15  # error of a depth due to wrongly predicted limbs, as a share of it
    SIDE_M = 0.1  # the same across the view
    KNOWN_M = 0.25  # uncertainty across the view for which the regressions hold; beyond it a position counts less
    MEMORY_S = 1.0  # time constant of a track's mean evidence: a step and its swing
    MEMORY_WEIGHT = 2.0  # of that evidence against one frame's: a second holds a few independent observations
    STAY = 2.0  # gain of the person who continues the wearer's track in the image
    GATE = 14.0  # squared Mahalanobis distance (three degrees of freedom) beyond which no person is chosen: one in 300
    ENOUGH_JOINTS = 6.0  # major joints that must fit: half of them
    PATIENCE_S = 0.5  # unseen time after which a wearer is lost: the prediction has drifted
    DRIFT_M_S = 0.5  # growth of a lost wearer's position uncertainty: a slow walk
    MOST_LOST_M = 4.0  # its limit: the size of a room
    RECOVER = 0.3  # mean appearance over MEMORY_S with which a track becomes a lost wearer; it starts at zero
    RECOVER_MARGIN = 0.5  # by which that must exceed all other free tracks
    DROP = -0.5  # mean appearance below which a wearer is lost
    DROPPED_M = 1.5  # uncertainty of the position after that: the prediction followed the wrong person
    SWITCH = 6.0  # cost, within the lag, of a step from one track to another
    BLINK = 0.5  # cost, within the lag, of a step to nobody or back

    def __init__(self, keypoints: KeypointSet, model: CameraModel, skeletons: Sequence[Skeleton]) -> None:
        self.model = model
        self._fitter = BodyFitter(keypoints, skeletons, self.DEPTH_SHARE, self.SIDE_M)
        self._wearers = [_WearerTrack() for _ in skeletons]
        self._tracks = PersonTracks(len(skeletons), len(keypoints), self.MEMORY_S)
        self._time = -np.inf
        self._frames: dict[float, tuple[People, np.ndarray]] = {}  # recent frames, and the tracks of their persons

        self._gaps: dict[tuple[float, float], Array] = {}  # between persons of two successive frames

    @property
    def recovering(self) -> np.ndarray:
        """``(W,)`` whether each wearer is lost as of the newest frame."""
        patience = self.PATIENCE_S
        return np.array(
            [wearer.seen_at is not None and self._time - wearer.seen_at > patience for wearer in self._wearers]
        )

    def choose(self, frame: VideoFrame, belief: Belief) -> np.ndarray:
        """Choose the person who is each wearer in the newest video frame: index ``(W,)``, −1 for nobody.

        Args:
            frame: later than all before; a late one is associated without being remembered.
            belief: the predicted state of that frame.
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
        row, number = self._linked(frame.time, people)
        self._tracks.accumulate(row, odds.appearance, elapsed)
        memory = self._tracks.evidence[..., row]
        is_own_track = np.array([wearer.track for wearer in self._wearers])[:, None] == number
        chosen = _assign(self._gain(odds, memory, number, self.STAY * is_own_track))
        self._set_tracks(frame.time, chosen, number)
        self._drop_doubtful(odds.appearance, chosen, elapsed)
        return chosen

    def revise(self, frames: Sequence[VideoFrame], belief: Belief) -> list[np.ndarray]:
        """Associate the video frames that are still within the lag again, jointly.

        Args:
            frames: at least one, in order of time, that were given to :meth:`choose`.
            belief: their current estimates.

        Returns:
            Index ``(W,)`` of the person who is each wearer, for each frame; −1 for nobody.
        """
        numbers, people_of_frames = list[np.ndarray](), list[People]()
        for frame in frames:
            unknown = people_of(frame.pixels, frame.confidence, self.model), np.zeros(0, int)
            known_people, known_numbers = self._frames.get(frame.time, unknown)
            people_of_frames.append(known_people)
            numbers.append(known_numbers)
        people = stack_people(people_of_frames)
        odds = self._odds(belief, people)
        number = np.full(people.is_person.shape, NOBODY)
        for row, numbers_of_frame in zip(number, numbers, strict=True):
            row[: len(numbers_of_frame)] = numbers_of_frame
        memory = self._tracks.evidence_of(number).swapaxes(0, 1)
        gain = np.where(people.is_person[:, None], self._gain(odds, memory, number), -NEVER)
        paths = best_paths(gain, self._jump([frame.time for frame in frames], people, number), self.BLINK)
        if frames[-1].time == self._time:
            self._set_tracks(frames[-1].time, paths[-1], number[-1])
        return list(paths)

    def remember(self, frame: VideoFrame, chosen: np.ndarray) -> None:
        """Take over the association of a frame from elsewhere, as at the start; −1 for nobody."""
        if frame.time <= self._time:
            return
        self._time = frame.time
        people = people_of(frame.pixels, frame.confidence, self.model)
        self._fitter.count_keypoints(people)
        _, number = self._linked(frame.time, people)
        self._begin(frame.time)
        self._set_tracks(frame.time, chosen, number)

    def _begin(self, time: float) -> None:
        for wearer in self._wearers:
            wearer.seen_at = time if wearer.seen_at is None else wearer.seen_at

    def _linked(self, time: float, people: People) -> tuple[np.ndarray, np.ndarray]:
        """Rows and numbers of the tracks of a frame's persons, which is remembered and later than all before.

        The distances of its persons from those of the last frame are remembered as well.
        """
        row = self._tracks.link(time, people.rays[0], people.weight[0])
        number = self._tracks.number[row]
        previous_time = next(reversed(self._frames), -np.inf)
        if time - previous_time <= LONGEST_GAP_S:
            self._gaps[previous_time, time] = self._tracks.gap(self._frames[previous_time][1])
        self._frames[time] = people, number
        while (old := next(iter(self._frames))) < time - self.MEMORY_S:
            del self._frames[old]
        while self._gaps and (pair := next(iter(self._gaps)))[0] < time - self.MEMORY_S:
            del self._gaps[pair]
        return row, number

    def _odds(self, belief: Belief, people: People) -> _Odds:
        R = belief.R_world_camera
        points = self._fitter.points(belief.bodies, R, belief.p_world_camera)
        depth = self._fitter.middle(points)[..., 2]
        covariance = transpose(R)[:, None] @ belief.root_covariance @ R[:, None]
        variances = np.einsum("...ii->...i", covariance)
        unseen = [0.0 if wearer.seen_at is None else self._time - wearer.seen_at for wearer in self._wearers]
        drift = [self.DRIFT_M_S * max(seconds - self.PATIENCE_S, 0.0) for seconds in unseen]
        lost_m = [math.hypot(wearer.wide_m, far) for wearer, far in zip(self._wearers, drift, strict=True)]
        variances += np.minimum(lost_m, self.MOST_LOST_M)[:, None] ** 2
        variances[..., :2] += (self.CAMERA_SIGMA * depth[..., None]) ** 2
        fit = self._fitter.fit(points, people, covariance)
        appearance = (
            self.BIAS
            - self.SHAPE_WEIGHT * np.log(fit.shape + self.LEAST_SHAPE)
            - self.MISFIT_WEIGHT * (fit.visible - fit.fitting)
        ) * np.minimum(fit.visible / self.ENOUGH_JOINTS, 1.0)
        across = np.sqrt((variances[..., 0] + variances[..., 1]) / 2)[..., None]
        vague = np.log(np.maximum(across / self.KNOWN_M, 1.0))
        position = np.maximum(
            self.NEAR - self.POSITION_WEIGHT * np.log1p(fit.position / 4) - vague, -self.MOST_DISTANCE
        )
        usable = (fit.fitting > self.ENOUGH_JOINTS) & (fit.position < self.GATE)
        return _Odds(np.clip(appearance, -self.MOST_APPEARANCE, self.MOST_APPEARANCE), position, usable)

    def _gain(self, odds: _Odds, memory: Array, number: np.ndarray, bonus: Array | float = 0.0) -> Array:
        """Log-odds ``(..., W, N)`` of choosing a person for a wearer; very negative where not allowed.

        From the track only the appearance counts: position errors persist for up to a second, so that a second of them
        contains no more information than one frame.
        """
        lost = self.recovering
        score = odds.both + self.MEMORY_WEIGHT * memory + bonus
        allowed = odds.usable
        if lost.any():
            allowed = allowed & (self._recovered(memory, number) | ~lost[:, None])
        return np.where(allowed, score, -NEVER)

    def _recovered(self, appearance: Array, number: np.ndarray) -> np.ndarray:
        """Whether a track continues a wearer, or has long looked like a lost wearer, more than any other free track."""
        other_tracks = [wearer.track for wearer, lost in zip(self._wearers, self.recovering, strict=True) if not lost]
        rival = np.where(np.isin(number, other_tracks)[..., None, :], -self.MOST_APPEARANCE, appearance)
        ordered = np.sort(rival, axis=-1)
        second = ordered[..., -2:-1] if ordered.shape[-1] > 1 else -self.MOST_APPEARANCE
        stayed = number[..., None, :] == np.array([wearer.track for wearer in self._wearers])[:, None]
        plain = (rival > self.RECOVER) & (rival >= ordered[..., -1:]) & (rival > second + self.RECOVER_MARGIN)
        return plain | stayed & (number[..., None, :] != NOBODY)

    def _drop_doubtful(self, appearance: Array, chosen: np.ndarray, elapsed: float) -> None:
        """Mark wearers as lost whose person has long not looked like them."""
        share = 1 - np.exp(-elapsed / self.MEMORY_S)
        for w, wearer in enumerate(self._wearers):
            if chosen[w] < 0 or wearer.seen_at is None:
                continue
            wearer.looks += share * (appearance[w, chosen[w]] - wearer.looks)
            if wearer.looks < self.DROP:
                wearer.track, wearer.wide_m, wearer.looks = NOBODY, self.DROPPED_M, 0.0
                wearer.seen_at = self._time - self.PATIENCE_S - STILL_THE_SAME_S

    def _jump(self, time: Sequence[float], people: People, number: np.ndarray) -> Array:
        """Cost of steps from person to person by their distance in the image, ``(F − 1, N, N)``."""
        N = number.shape[1]
        gap = np.full((len(time) - 1, N, N), np.inf)
        for f, (previous_time, new_time) in enumerate(pairwise(time)):
            if (previous_time, new_time) not in self._gaps:
                rays, weight = people.rays, people.weight
                self._gaps[previous_time, new_time] = image_gap(rays[f], rays[f + 1], weight[f], weight[f + 1])
            known_gap = self._gaps[previous_time, new_time][:N, :N]  # may be padded differently
            gap[f, : known_gap.shape[0], : known_gap.shape[1]] = known_gap
        same = (number[:-1, :, None] == number[1:, None]) & (number[:-1, :, None] >= 0)
        return np.where(same, -self.STAY, self.SWITCH * np.minimum((gap / FURTHEST) ** 2, 1.0))

    def _set_tracks(self, time: float, chosen: np.ndarray, number: np.ndarray) -> None:
        for wearer, n in zip(self._wearers, chosen, strict=True):
            if n >= 0:
                if wearer.seen_at is None or time - wearer.seen_at > self.PATIENCE_S:
                    wearer.looks = 0.0
                wearer.track, wearer.seen_at, wearer.wide_m = int(number[n]), time, 0.0


def _assign(gain: Array) -> np.ndarray:
    """The person ``(W,)`` of each wearer with the most gain ``(W, N)`` in total, −1 for nobody, who gains 0."""
    W, N = gain.shape
    chosen = np.full(W, NOBODY)
    for w, n in zip(*linear_sum_assignment(np.concatenate([-gain, np.zeros((W, W))], axis=1)), strict=True):
        if n < N and gain[w, n] > 0:
            chosen[w] = n
    return chosen
