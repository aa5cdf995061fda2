"""From the state of the smoother to the estimates for users, which follow it without jumps."""

import math
import time as clock
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice

import numpy as np

from vip_factors.body.model_errors import FILMED, UNFILMED, ModelErrors
from vip_factors.body.skeleton import JOINT_COUNT, JOINT_NAMES
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array, exp, log, transpose, wrap_angle
from vip_factors.live.frames import FrameState
from vip_factors.live.smoother import LagSmoother
from vip_factors.live.tracking import Tracking
from vip_factors.live_estimate import LiveCameraEstimate, LiveCameraPose, LiveEstimate, LivePose, LiveWearerEstimate
from vip_factors.problem.layout import FRAME, ROOT, Owner, OwnerId
from vip_factors.problem.variables import camera_owner
from vip_factors.sensors.calibration import Calibration, SensorCalibration
from vip_factors.sensors.scene import Scene
from vip_factors.settings import LiveSettings
from vip_factors.stages.reporting import calibration_with_model_errors


class AnswerFilter:
    """Filters shown frames: each is the previous one moved by the estimated motion, and drawn towards the estimate.

    Each new frame changes the smoother's estimate of the previous one slightly, which would show as a tremble of some
    millimetres. The filter makes up for a ``share`` of the remaining difference with each frame instead.

    Args:
        share: share of the difference that each frame corrects, in (0, 1]; 1 shows the estimate itself.
        most_rad: largest correction of a frame, radians, so that a new calibration causes no jump.
        most_m: largest correction of positions, metres.
    """

    def __init__(self, share: float, most_rad: float, most_m: float) -> None:
        self.share, self.most_rad, self.most_m = share, most_rad, most_m
        self._filtered: Sequence[FrameState] = ()

    def restart(self) -> None:
        """Start new sequences."""
        self._filtered = ()

    def filter(
        self, previous_states: Sequence[FrameState | None], new_states: Sequence[FrameState]
    ) -> Sequence[FrameState]:
        """The next filtered frame of several sequences.

        Args:
            previous_states: current estimates of the frames shown last; None to start a sequence.
            new_states: current estimates of the next frames.
        """
        shown = zip(previous_states, new_states, self._filtered or new_states, strict=True)
        displayed = _stacked([new if old is None else _with_cameras_of(new, filtered) for old, new, filtered in shown])
        expected = _stacked([old or new for new, old in zip(new_states, previous_states, strict=True)])
        believed = _stacked(new_states)
        off = log(transpose(expected[0]) @ displayed[0])
        R = believed[0] @ exp(off * self._remaining_share(off, self.most_rad))
        off = displayed[1] - expected[1]
        p = believed[1] + off * self._remaining_share(off, self.most_m)
        shape, joints = new_states[0].R_parent_child.shape, new_states[0].R_parent_child[..., 0, 0].size
        rows = zip(R, p, strict=True)
        self._filtered = [
            FrameState(R[:joints].reshape(shape), p[: shape[0]], R[joints:], p[shape[0] :]) for R, p in rows
        ]
        return self._filtered

    def _remaining_share(self, off: Array, limit: float) -> Array:
        """Share ``(..., 1)`` of a difference ``(..., 3)`` that remains after a frame."""
        distance = np.sqrt(np.einsum("...i,...i->...", off, off))[..., None]
        return np.maximum(1 - self.share, 1 - limit / np.maximum(distance, limit))


def _with_cameras_of(state: FrameState, filtered: FrameState) -> FrameState:
    """A filtered state, with the cameras of a new one where other cameras are carried now."""
    if len(filtered.p_world_camera) == len(state.p_world_camera):
        return filtered
    return replace(filtered, R_world_camera=state.R_world_camera, p_world_camera=state.p_world_camera)


def _stacked(states: Sequence[FrameState]) -> tuple[Array, Array]:
    """Rotations and positions of ``n`` frames, ``(n, ..., 3, 3)`` and ``(n, ..., 3)``; cameras come last."""
    R = [np.concatenate([state.R_parent_child.reshape(-1, 3, 3), state.R_world_camera]) for state in states]
    p = [np.concatenate([state.p_world_pelvis, state.p_world_camera]) for state in states]
    return np.stack(R), np.stack(p)


# The factors of standard deviations of recordings hold for trunk, hips, shoulders and wrists of a stream. A quarter of
# a second averages less: on 16 recorded scenes knees need 1.2 with a camera, elbows 1.0, ankles 1.7.
HINGES = np.array([name.endswith(("knee", "ankle", "elbow")) for name in JOINT_NAMES])


class EstimateBuilder:
    """Makes the answers; holds what is computed only at intervals: covariances and findings.

    Standard deviations of answers include model errors, as those of recordings do; the tracker's own do not.
    """

    def __init__(self, head: Scene, settings: LiveSettings, lag: int) -> None:
        self._head, self._settings, self._lag = head, settings, lag
        self._findings: list[Finding] = []
        self._newest: Array | None = None  # covariance of the newest frame
        self._smoothed: Array | None = None
        self._sums: Iterator[Array | None] | None = None  # of the smoothed frame, while it is computed
        self._shared: Array | None = None
        self._next_covariance = 0  # frame
        corrected_m_s = 1.0  # a step a second
        corrected_deg_s = 180.0  # a limb's brisk turn
        rate = settings.frame_rate
        share = min(1.0, 1 / (0.1 * rate + 1e-9))  # over 0.1 s; answers would tremble by some millimetres
        self._filter = AnswerFilter(share, np.deg2rad(corrected_deg_s) / rate, corrected_m_s / rate)
        self._last_calibrations: list[Calibration] = []  # by wearer; sigmas change only with the covariance

    def add_findings(self, *findings: Finding) -> None:
        """Add findings to the next answer."""
        self._findings += findings

    def root_covariance(self, wearers: int) -> Array:
        """Latest covariance of each wearer's position, ``(W, 3, 3)`` m²."""
        unknown_root = 0.25 * np.eye(3)  # m², before a covariance has been computed
        if self._newest is None:
            return np.stack([unknown_root] * wearers)
        roots = [slice(FRAME * number + ROOT, FRAME * (number + 1)) for number in range(wearers)]
        return np.stack([self._newest[root, root] for root in roots])

    def reset(self) -> None:
        """Drop what was computed from another smoother."""
        self._newest = self._smoothed = self._shared = None
        self._sums, self._last_calibrations = None, []

    def initial_estimates(self, tracking: Tracking, begin: float, first_number: int) -> list[LiveEstimate]:
        """Answers to the frames that tracking started with, from ``first_number`` on."""
        smoother = tracking.smoother
        numbers = smoother.numbers
        self.reset()
        self._measure(smoother, numbers[-1])
        self._filter.restart()
        answers = []
        for number in numbers:
            seconds = clock.perf_counter() - begin if number == numbers[-1] else 0.0
            answers.append(self._estimate(tracking, number, number - self._lag, seconds))
        smoother.marginalise_before(numbers[-1] - self._lag - 1)
        return [answer for answer in answers if answer.frame >= first_number]

    def of(self, tracking: Tracking, begin: float) -> LiveEstimate:
        """The answer to the newest frame."""
        newest = tracking.smoother.numbers[-1]
        if tracking.solved:
            self._measure(tracking.smoother, newest)
        return self._estimate(tracking, newest, newest - self._lag, clock.perf_counter() - begin)

    def calibrations(self, smoother: LagSmoother) -> dict[str, Calibration]:
        """Current calibration of each wearer's sensors."""
        shared, covariance = smoother.shared, self._shared
        layout = smoother.problem.layout
        sigma = np.full(layout.static_width, np.nan) if covariance is None else np.sqrt(np.diag(covariance))
        calibrations: dict[str, Calibration] = {}
        for number, (wearer, model) in enumerate(zip(self._head.wearers, smoother.problem.wearers, strict=True)):
            owner, state = OwnerId(Owner.WEARER, number), shared.wearers[number]
            headings = layout.columns(owner, "headings")
            mountings = layout.columns(owner, "R_bone_sensor").reshape(-1, 3)
            wrapped = wrap_angle(state.headings).tolist()
            calibrations[wearer.subject.name] = {
                sensor: SensorCalibration(
                    wrapped[s],
                    state.R_bone_sensor[s],
                    float(sigma[headings[s]]) if len(headings) else float("nan"),
                    sigma[mountings[s]] if len(mountings) else np.full(3, np.nan),
                    bone=JOINT_NAMES[model.sensors[s].bone],
                )
                for s, sensor in enumerate(model.frames.sensors)
            }
        return calibrations

    def _measure(self, smoother: LagSmoother, newest: int) -> None:
        """Compute covariances: of the newest frame each time, others at intervals."""
        solution = smoother.solution
        self._newest = solution.covariance(newest)
        if self._shared is None or (self._sums is None and newest >= self._next_covariance):
            self._next_covariance, self._last_calibrations = newest + Tracking.COVARIANCE_EVERY, []
            self._shared = solution.shared_covariance() if smoother.problem.layout.static_width else np.zeros((0, 0))
            self._sums = solution.covariance_in_steps(max(smoother.numbers[0], newest - self._lag))
        # A few steps with each update; together they take as long as the update.
        frames_per_step = Tracking.COVARIANCE_EVERY / self._settings.solve_every
        steps = None if self._smoothed is None else math.ceil((self._lag + 2) / frames_per_step)
        for covariance in islice(self._sums or (), steps):
            if covariance is not None:
                self._smoothed, self._sums = covariance, None

    def _estimate(self, tracking: Tracking, number: int, back: int, seconds: float) -> LiveEstimate:
        smoother = tracking.smoother
        numbers, time = smoother.numbers, smoother.frame(number).time
        shown_numbers = number, max(back, numbers[0])  # without a smoothed frame the oldest one is filtered
        previous_states = [smoother.state(shown - 1) if shown > numbers[0] else None for shown in shown_numbers]
        newest, smoothed = self._filter.filter(previous_states, [smoother.state(shown) for shown in shown_numbers])
        late = smoother.frame(back).time if back in numbers else None
        errors = FILMED if self._head.cameras and smoother.problem.has_views else UNFILMED
        calibrations = self._shown_calibrations(smoother, errors)
        observers = {observer.camera.name: observer for observer in tracking.observers}
        first_observer = observers.get(self._head.cameras[0].name) if self._head.cameras else None
        chosen = first_observer.chosen if first_observer is not None and number == numbers[-1] else None
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
        cameras = {}
        for index, observer in enumerate(tracking.observers):
            zoom, model = smoother.shared.cameras[index].zoom, smoother.problem.cameras[index].model
            cameras[observer.camera.name] = LiveCameraEstimate(
                observer.camera.name,
                model.zoomed(zoom),
                self._camera(smoother, index, newest, time, self._newest),
                None if late is None else self._camera(smoother, index, smoothed, late, self._smoothed),
            )
        used = tuple(cameras[camera.name] for camera in self._head.cameras if camera.name in cameras)
        return LiveEstimate(number, time, wearers, used, findings, seconds)

    def _shown_calibrations(self, smoother: LagSmoother, errors: ModelErrors) -> list[Calibration]:
        """Calibration of each wearer as shown."""
        if not self._last_calibrations:
            calibrations = self.calibrations(smoother).values()
            self._last_calibrations = [
                calibration_with_model_errors(calibration, errors) for calibration in calibrations
            ]
        else:
            # Current headings and mountings, with unchanged standard deviations.
            for number, state in enumerate(smoother.shared.wearers):
                sensors = self._last_calibrations[number].items()
                values = zip(sensors, wrap_angle(state.headings).tolist(), state.R_bone_sensor, strict=True)
                self._last_calibrations[number] = {
                    name: replace(sensor, heading=heading, R_bone_sensor=R) for (name, sensor), heading, R in values
                }
        return self._last_calibrations

    def _camera(
        self, smoother: LagSmoother, number: int, state: FrameState, time: float, covariance: Array | None
    ) -> LiveCameraPose:
        """Pose of the camera of a number in the problem."""
        problem = smoother.problem
        if number in problem.carried:
            chain, camera_covariance = problem.layout.chain_of(camera_owner(number)), None
            if chain is not None and covariance is not None:
                pose = problem.layout.chain_columns[chain]
                camera_covariance = covariance[pose, pose]
            index = problem.carried.index(number)
            return LiveCameraPose(time, state.R_world_camera[index], state.p_world_camera[index], camera_covariance)
        poses, columns = smoother.shared.cameras[number].poses, problem.layout.columns(camera_owner(number), "poses")
        camera_covariance = None
        if self._shared is not None and len(columns):
            camera_covariance = self._shared[np.ix_(columns, columns)]
        return LiveCameraPose(time, poses.R_world_camera[0], poses.p_world_camera[0], camera_covariance)


def _pose(state: FrameState, wearer: int, time: float, covariance: Array | None, errors: ModelErrors) -> LivePose:
    hinge_factor = 1.2
    R, p = state.R_parent_child[wearer], state.p_world_pelvis[wearer]
    if covariance is None:
        return LivePose(time, R, p)
    wearer_covariance = covariance[FRAME * wearer : FRAME * (wearer + 1), FRAME * wearer : FRAME * (wearer + 1)]
    joints = wearer_covariance[:ROOT, :ROOT].reshape(JOINT_COUNT, 3, JOINT_COUNT, 3)
    factor = np.where(HINGES, np.maximum(errors.joint, hinge_factor), errors.joint)
    scaled = factor[:, None, None] ** 2 * np.einsum("jajb->jab", joints)
    return LivePose(time, R, p, scaled, errors.root**2 * wearer_covariance[ROOT:, ROOT:])
