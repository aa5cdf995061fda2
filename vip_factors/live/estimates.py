"""From the smoother's state to the estimates that users get, which follow it without jumping."""

import math
import time as clock
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from vip_factors.body.model_errors import FILMED, UNFILMED, ModelErrors
from vip_factors.body.skeleton import JOINT_COUNT, JOINT_NAMES
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array, exp, log, transpose, wrap_angle
from vip_factors.live.problem import FrameState
from vip_factors.live.smoother import LagSmoother
from vip_factors.live.tracking import Tracking
from vip_factors.live_estimate import LiveCameraPose, LiveEstimate, LivePose, LiveWearerEstimate
from vip_factors.problem.layout import FRAME, ROOT, Owner, OwnerId
from vip_factors.problem.state import WearerState
from vip_factors.problem.variables import camera_owner
from vip_factors.sensors.calibration import Calibration, SensorCalibration
from vip_factors.sensors.scene import Scene
from vip_factors.settings import LiveSettings
from vip_factors.stages.reporting import told_calibration


@dataclass
class AnswerFilter:
    """Told frames: each is the one told before, moved as the estimate moves between the two, and drawn towards it.

    A smoother believes something slightly else of the frame before once a frame is added. Told as it is, that reads as
    trembling of some millimetres; it is made up for over ``share`` of what is left with each frame instead.

    Attributes:
        share: of the difference to what is believed that each frame makes up for, in (0, 1]; 1 tells what is believed.
        most: radians of it at most: what a calibration found anew corrects is no leap.
        most_m: the like of positions, metres.
    """

    share: float
    most: float = np.pi
    most_m: float = 1e3
    _last: Sequence[FrameState] = ()

    def filtered(self, before: Sequence[FrameState | None], now: Sequence[FrameState]) -> Sequence[FrameState]:
        """The next frame to tell of each of some sequences of them.

        Args:
            before: what is believed by now of the frame told last of each; None to begin anew.
            now: what is believed of the next one.
        """
        anew = [old is None or not self._last for old in before]
        last = [new if begins else old for begins, new, old in zip(anew, now, self._last or now, strict=True)]
        was = [old or new for new, old in zip(now, before, strict=True)]
        believed, expected, told = _stacked(now), _stacked(was), _stacked(last)
        off = log(transpose(expected[0]) @ told[0])
        R = believed[0] @ exp(off * self._left(off, self.most))
        off = told[1] - expected[1]
        p = believed[1] + off * self._left(off, self.most_m)
        shape = now[0].R_parent_child.shape
        self._last = [FrameState(R[i, :-1].reshape(shape), p[i, :-1], R[i, -1], p[i, -1]) for i in range(len(now))]
        return self._last

    def _left(self, off: Array, most: float) -> Array:
        """What is left of a difference ``(..., 3)`` after a frame, as a share ``(..., 1)``."""
        distance = np.sqrt(np.einsum("...i,...i->...", off, off))[..., None]
        return np.maximum(1 - self.share, 1 - most / np.maximum(distance, most))


def _stacked(states: Sequence[FrameState]) -> tuple[Array, Array]:
    """Rotations and positions of ``n`` frames, ``(n, ..., 3, 3)`` and ``(n, ..., 3)``, the camera's behind the rest."""
    R = [part for one in states for part in (one.R_parent_child.reshape(-1, 3, 3), one.R_world_camera[None])]
    p = [part for one in states for part in (one.p_world_pelvis, one.p_world_camera[None])]
    n = len(states)
    return np.concatenate(R).reshape(n, -1, 3, 3), np.concatenate(p).reshape(n, -1, 3)


# Batch's factors of ± hold for the trunk, hips, shoulders and wrists of a stream too; a quarter of a second averages
# less of what is wrong with flexion. On 16 foreign scenes: knees need 1.2 with a camera, elbows 1.0, ankles 1.7.
HINGES = np.array([name.endswith(("knee", "ankle", "elbow")) for name in JOINT_NAMES])


class EstimateBuilder:
    """Makes the answers, and keeps what is computed now and then only: covariances, findings.

    Standard deviations are told with the models' share, as those of a recording are; the tracker's own are without.
    """

    def __init__(self, head: Scene, settings: LiveSettings, lag: int) -> None:
        self._head, self._settings, self._lag = head, settings, lag
        self._findings: list[Finding] = []
        self._newest: Array | None = None  # covariance of the newest frame
        self._smoothed: Array | None = None
        self._sums: Iterator[Array | None] | None = None  # the next of the smoothed frame, on its way
        self._shared: Array | None = None
        self._next_covariance = 0  # frame
        self._filter = self._fresh_filter()
        self._told: list[Calibration] = []  # by wearer, as last told: standard deviations change with the covariance

    def add_findings(self, *findings: Finding) -> None:
        """Something to tell with the next answer."""
        self._findings += findings

    def root_covariance(self, wearers: int) -> Array:
        """Of where each wearer is, ``(W, 3, 3)`` m², as of late."""
        unknown_root = 0.25 * np.eye(3)  # m², as long as no covariance has been computed
        if self._newest is None:
            return np.stack([unknown_root] * wearers)
        roots = [slice(FRAME * number + ROOT, FRAME * (number + 1)) for number in range(wearers)]
        return np.stack([self._newest[root, root] for root in roots])

    def reset(self) -> None:
        """Another smoother answers from here on: what was computed of the last one is not of its variables."""
        self._newest = self._smoothed = self._shared = None
        self._sums, self._told = None, []

    def initial_estimates(self, tracking: Tracking, begin: float, first: int) -> list[LiveEstimate]:
        """Answers to the frames that tracking began with, from the number ``first`` on."""
        smoother = tracking.smoother
        numbers = smoother.numbers
        self.reset()
        self._measure(smoother, numbers[-1])
        self._filter = self._fresh_filter()
        answers = []
        for number in numbers:
            seconds = clock.perf_counter() - begin if number == numbers[-1] else 0.0
            answers.append(self._estimate(tracking, number, number - self._lag, seconds))
        smoother.marginalise_before(numbers[-1] - self._lag - 1)
        return [answer for answer in answers if answer.frame >= first]

    def of(self, tracking: Tracking, begin: float) -> LiveEstimate:
        """The answer to the newest frame."""
        newest = tracking.smoother.numbers[-1]
        if tracking.solved:
            self._measure(tracking.smoother, newest)
        return self._estimate(tracking, newest, newest - self._lag, clock.perf_counter() - begin)

    def calibrations(self, smoother: LagSmoother) -> dict[str, Calibration]:
        """Of each wearer's sensors, as they are believed now."""
        shared, covariance = smoother.shared, self._shared
        layout = smoother.problem.layout
        sigma = np.full(layout.static_width, np.nan) if covariance is None else np.sqrt(np.diag(covariance))
        found: dict[str, Calibration] = {}
        for number, (wearer, model) in enumerate(zip(self._head.wearers, smoother.problem.wearers, strict=True)):
            owner, own = OwnerId(Owner.WEARER, number), shared.wearers[number]
            headings = layout.columns(owner, "headings")
            mountings = layout.columns(owner, "R_bone_sensor").reshape(-1, 3)
            wrapped = wrap_angle(own.headings).tolist()
            found[wearer.subject.name] = {
                sensor: SensorCalibration(
                    wrapped[s],
                    own.R_bone_sensor[s],
                    float(sigma[headings[s]]) if len(headings) else float("nan"),
                    sigma[mountings[s]] if len(mountings) else np.full(3, np.nan),
                    bone=JOINT_NAMES[model.sensors[s].bone],
                )
                for s, sensor in enumerate(model.frames.sensors)
            }
        return found

    def _measure(self, smoother: LagSmoother, newest: int) -> None:
        """Covariances: of the newest frame each time, of the rest now and then."""
        self._newest = smoother.covariance(newest)
        if self._shared is None or (self._sums is None and newest >= self._next_covariance):
            self._next_covariance, self._told = newest + Tracking.COVARIANCE_EVERY, []
            self._shared = smoother.shared_covariance() if smoother.problem.layout.static_width else np.zeros((0, 0))
            self._sums = smoother.covariance_in_steps(max(smoother.numbers[0], newest - self._lag))
        # A few steps with each update: all at once take as long as the update does.
        frames_per_step = Tracking.COVARIANCE_EVERY / self._settings.solve_every
        steps = None if self._smoothed is None else math.ceil((self._lag + 2) / frames_per_step)
        for found in islice(self._sums or (), steps):
            if found is not None:
                self._smoothed, self._sums = found, None

    def _fresh_filter(self) -> AnswerFilter:
        corrected_m_s = 1.0  # a step a second
        corrected_deg_s = 180.0  # a limb's brisk turn
        rate = self._settings.frame_rate
        share = min(1.0, 1 / (0.1 * rate + 1e-9))  # over 0.1 s; answers would tremble by some millimetres
        return AnswerFilter(share, np.deg2rad(corrected_deg_s) / rate, corrected_m_s / rate)

    def _estimate(self, tracking: Tracking, number: int, back: int, seconds: float) -> LiveEstimate:
        smoother = tracking.smoother
        numbers, time = smoother.numbers, smoother.frame(number).time
        told = number, max(back, numbers[0])  # as long as there is no smoothed frame, the oldest one is not told
        before = [smoother.state(at - 1) if at > numbers[0] else None for at in told]
        newest, smoothed = self._filter.filtered(before, [smoother.state(at) for at in told])
        late = smoother.frame(back).time if back in numbers else None
        errors = FILMED if self._head.cameras and smoother.problem.has_views else UNFILMED
        calibrations = self._told_calibrations(smoother, errors)
        chosen = tracking.observers[0].chosen if tracking.observers and number == numbers[-1] else None
        wearers = tuple(
            LiveWearerEstimate(
                wearer.subject.name,
                _pose(newest, w, time, self._newest, errors),
                None if late is None else _pose(smoothed, w, late, self._smoothed, errors),
                calibrations[w],
                int(chosen[w]) if chosen is not None and chosen[w] >= 0 else None,
                smoother.problem.wearers[w].skeleton,
            )
            for w, wearer in enumerate(self._head.wearers)
        )
        findings, self._findings = tuple(self._findings), []
        camera = self._camera(smoother, newest, time, self._newest)
        late_camera = None if late is None else self._camera(smoother, smoothed, late, self._smoothed)
        return LiveEstimate(number, time, wearers, camera, late_camera, findings, seconds)

    def _told_calibrations(self, smoother: LagSmoother, errors: ModelErrors) -> list[Calibration]:
        """Of each wearer, as they are told."""
        if not self._told:
            found = self.calibrations(smoother).values()
            self._told = [told_calibration(one, errors, self._settings) for one in found]
        else:
            self._told = [_moved(one, own) for one, own in zip(self._told, smoother.shared.wearers, strict=True)]
        return self._told

    def _camera(
        self, smoother: LagSmoother, state: FrameState, time: float, covariance: Array | None
    ) -> LiveCameraPose | None:
        problem = smoother.problem
        if not self._head.cameras or not problem.has_views:
            return None
        if problem.carried is not None:
            free = problem.cameras[problem.carried].free_pose and covariance is not None
            own = covariance[-6:, -6:] if free and covariance is not None else None
            return LiveCameraPose(time, state.R_world_camera, state.p_world_camera, own)
        poses, columns = smoother.shared.cameras[0].poses, problem.layout.columns(camera_owner(0), "poses")
        own = None
        if self._shared is not None and len(columns):
            own = self._shared[np.ix_(columns, columns)]
        return LiveCameraPose(time, poses.R_world_camera[0], poses.p_world_camera[0], own)


def _moved(told: Calibration, own: WearerState) -> Calibration:
    """The same sensors with today's headings and mountings, as sure as they were."""
    values = zip(told.items(), wrap_angle(own.headings).tolist(), own.R_bone_sensor, strict=True)
    return {
        sensor: SensorCalibration(
            heading, R, one.heading_sigma, one.mounting_sigma, one.heading_time, one.heading_path, one.bone
        )
        for (sensor, one), heading, R in values
    }


def _pose(
    state: FrameState, wearer: int, time: float, covariance: Array | None, errors: ModelErrors
) -> LivePose:  # fmt: skip
    hinge_factor = 1.2
    R, p = state.R_parent_child[wearer], state.p_world_pelvis[wearer]
    if covariance is None:
        return LivePose(time, R, p)
    own = covariance[FRAME * wearer : FRAME * (wearer + 1), FRAME * wearer : FRAME * (wearer + 1)]
    joints = own[:ROOT, :ROOT].reshape(JOINT_COUNT, 3, JOINT_COUNT, 3)
    factor = np.where(HINGES, np.maximum(errors.joint, hinge_factor), errors.joint)
    told = factor[:, None, None] ** 2 * np.einsum("jajb->jab", joints)
    return LivePose(time, R, p, told, errors.root**2 * own[ROOT:, ROOT:])
