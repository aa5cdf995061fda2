"""The fixed-lag tracker: samples go in one by one, and every frame gets its answer."""

import time as clock
from collections import deque

import numpy as np
from threadpoolctl import ThreadpoolController

from vip_factors.body.kinematics import BodyState, forward_kinematics
from vip_factors.errors import RecordingError, SolveError
from vip_factors.geometry.rotations import Array
from vip_factors.graph.reprojection_batch import reprojections
from vip_factors.initialise.root_path import contact_confidence
from vip_factors.live.answers import Answers
from vip_factors.live.assembly import FrameAssembler
from vip_factors.live.buffered import MeasuredStretch
from vip_factors.live.measurement import FrameMeasurement
from vip_factors.live.predict import predicted
from vip_factors.live.problem import lag_frame
from vip_factors.live.settings import LiveSettings
from vip_factors.live.sight import Onlooker, Scenery
from vip_factors.live.smoother import LagSmoother
from vip_factors.live.start import Known, Started, start
from vip_factors.live.watch import SensorWatch
from vip_factors.live_estimate import LiveEstimate
from vip_factors.sensors.live import LiveSample, LiveSetup, VideoFrame

DEFAULT = LiveSettings()
SOME_VIDEO = 10  # frames with people in them, within the time that tracking begins with
CONTACT_FRAMES = 7  # frames over which a foot is watched to tell whether it stands


class FixedLagTracker:
    """Estimates wearers, camera, headings and mountings while samples arrive.

    Args:
        setup: who wears what, and which cameras film them.
        settings: of all rooms.
    """

    def __init__(self, setup: LiveSetup, settings: LiveSettings = DEFAULT) -> None:
        self.setup, self.settings = setup, settings
        self._columns = _columns(setup)
        self._worn = sum(len(wearer.placement.sites) for wearer in setup.wearers)  # columns; the rest is on cameras
        self._lag = max(1, round(settings.lag_s * settings.frame_rate))
        self._assembler = FrameAssembler(
            self._columns, settings.frame_rate, settings.assembly, setup.cameras, self._lag
        )
        self._start_frames = max(self._lag + 3, round(settings.start_s * settings.frame_rate))
        self._recent: deque[FrameMeasurement] = deque(maxlen=self._start_frames)
        self._video: deque[tuple[int, VideoFrame]] = deque()
        self._paths: deque[tuple[int, Array]] = deque(maxlen=self._start_frames)  # of the pelvises, as smoothed
        self._smoother: LagSmoother | None = None
        self._onlookers: list[Onlooker] = []
        self._watches: list[SensorWatch] = []
        self._look_again, self._patience = 0, settings.camera_retry_s
        self._answers = Answers(setup, settings, self._lag)
        self._threads = ThreadpoolController()  # finding the libraries takes longer than an update: once

    def push(self, sample: LiveSample) -> list[LiveEstimate]:
        """Take one sample; the answers that it allows, in order.

        Bad samples are left out, and the next answer's findings say so.
        """
        return self._answer(self._assembler.push(sample))

    def finish(self) -> list[LiveEstimate]:
        """The end of the stream: answers to the last frames."""
        return self._answer(self._assembler.flush())

    def _answer(self, measurements: list[FrameMeasurement]) -> list[LiveEstimate]:
        answers: list[LiveEstimate] = []
        if not measurements:
            return answers
        with self._threads.limit(limits=1, user_api="blas"):
            for measured in measurements:
                begin = clock.perf_counter()
                self._answers.find(*self._assembler.take_findings())
                answers += self._take(measured, begin)
        return answers

    def _take(self, measured: FrameMeasurement, begin: float) -> list[LiveEstimate]:
        if measured.restart:
            self._smoother = None
            self._recent.clear()
            self._video.clear()
        self._recent.append(measured)
        self._video.extend((one.frame, one.video) for one in measured.video)
        while self._video and self._video[0][0] < self._recent[0].frame:
            self._video.popleft()
        if self._smoother is None:
            return self._begin(begin) if len(self._recent) == self._start_frames else []
        try:
            self._step(self._smoother, measured)
            if self._is_worth_another_start(self._smoother, measured):
                self._start_again(self._smoother)
        except SolveError as error:
            self._answers.find(f"tracking was lost at {measured.time:.1f} s ({error}): starting again")
            self._smoother = None
            self._recent.clear()
            return []
        answer = self._answers.of(self._smoother, self._onlookers, begin)
        if self._smoother.numbers[0] == measured.frame - self._lag:
            self._paths.append(
                (self._smoother.numbers[0], self._smoother.state(self._smoother.numbers[0]).p_world_pelvis)
            )
        return [answer]

    # Beginning

    def _begin(self, begin: float, known: Known | None = None) -> list[LiveEstimate]:
        stretch = MeasuredStretch(self.setup, list(self._recent), list(self._video), self._columns)
        try:
            started = start(stretch, self.settings, known)
        except (RecordingError, SolveError) as error:
            self._answers.find(f"cannot start at {self._recent[-1].time:.1f} s: {error}")
            self._recent.clear()
            return []
        self._smoother = self._started(started)
        return self._answers.of_start(self._smoother, self._onlookers, begin)

    def _is_worth_another_start(self, smoother: LagSmoother, measured: FrameMeasurement) -> bool:
        """Whether a sensor has come, or a camera shows people and no wearer has been found by it yet."""
        if measured.frame < self._look_again or len(self._recent) < self._start_frames:
            return False
        unseen = not smoother.problem.filmed and sum(len(video.pixels) > 0 for _, video in self._video) > SOME_VIDEO
        used = {column for columns in smoother.problem.sensors for column in columns}
        seen = np.stack([one.orientation_valid for one in self._recent]).mean(axis=0)
        come = any(share > 0.9 and column not in used for column, share in enumerate(seen[: self._worn]))
        return unseen or come

    def _start_again(self, smoother: LagSmoother) -> None:
        """Begin anew with the last second, knowing what is known; keep on as before if that brings nothing."""
        newest = self._recent[-1].frame
        self._look_again = newest + round(self._patience * self.settings.frame_rate)
        self._patience *= 2
        paths = dict(self._paths)
        if self._recent[0].frame not in paths:
            return
        known = Known(self._answers.calibrations(smoother), paths[self._recent[0].frame])
        stretch = MeasuredStretch(self.setup, list(self._recent), list(self._video), self._columns)
        try:
            started = start(stretch, self.settings, known)
        except (RecordingError, SolveError):
            return
        more = sum(map(len, started.problem.sensors)) > sum(map(len, smoother.problem.sensors))
        if not (started.filmed and not smoother.problem.filmed) and not more:
            return
        self._smoother = self._started(started)
        self._smoother.forget(newest - self._lag)
        self._answers.find(
            "a wearer was found in the video" if started.filmed else "another sensor is used from here on"
        )

    def _started(self, started: Started) -> LagSmoother:
        smoother = LagSmoother(started.problem, started.shared, self.settings)
        for frame, state in zip(started.frames, started.states, strict=True):
            smoother.append(frame, state)
        for _ in range(self.settings.start_iterations):
            smoother.update(smoother.numbers[0])
        self._onlookers = []
        skeletons = [wearer.skeleton for wearer in started.problem.wearers]
        for shot, spreads in zip(started.shots, started.spreads, strict=True):
            camera = next(one for one in self.setup.cameras if one.name == shot.camera.name)
            onlooker = Onlooker(
                camera, skeletons, spreads, self.settings.online_association, self.settings.camera.reprojection
            )
            video = sorted(
                ((n, one) for n, one in self._video if one.camera == camera.name), key=lambda one: one[1].time
            )
            for index, (number, one) in enumerate(video):
                rows = shot.detections.of_frame(index)
                who = shot.association.wearer[rows]
                chosen = [int(np.flatnonzero(who == w)[0]) if np.any(who == w) else -1 for w in range(len(skeletons))]
                onlooker.remember(number, one, np.array(chosen))
            self._onlookers.append(onlooker)
        rate, begin = self.settings.frame_rate, smoother.numbers[0]
        self._watches = [SensorWatch(one, self.settings.watch, rate, begin) for one in started.problem.wearers]
        return smoother

    # Going on

    def _step(self, smoother: LagSmoother, measured: FrameMeasurement) -> None:
        numbers = smoother.numbers
        last = smoother.frame(numbers[-1])
        last.specific_force_inertial, last.acceleration_valid = (
            measured.specific_force_inertial, measured.acceleration_valid,
        )  # fmt: skip
        cameras = 1 + len(smoother.problem.further)
        frame = lag_frame(measured, [None] * cameras)
        before = [(smoother.frame(n), smoother.state(n)) for n in numbers[-2:]]
        frame.contacts = [np.zeros(len(wearer.contacts)) for wearer in smoother.problem.wearers]
        smoother.append(frame, predicted(smoother.problem, before, frame, smoother.shared))
        self._find_contacts(smoother)
        first = self._see(smoother, measured)
        smoother.update(first)
        smoother.forget(measured.frame - self._lag)
        self._learn(smoother, measured.frame)

    def _learn(self, smoother: LagSmoother, newest: int) -> None:
        """What smoothed frames teach of the detectors and of the sensors."""
        oldest = smoother.numbers[0]
        model, state = smoother.scene(oldest)
        for number, wearer in enumerate(model.wearers):
            own = state.wearers[number]
            body = forward_kinematics(wearer.skeleton, own.R_parent_child, own.p_world_pelvis)
            for sensor in self._watches[number].moved(oldest, wearer, own, body):
                name, settings = wearer.frames.sensors[sensor], self.settings.watch
                smoother.loosen_sensor(number, sensor, settings.heading_sigma_deg, settings.mounting_sigma_deg)
                self._answers.find(
                    f"sensor '{name}' of '{self.setup.wearers[number].name}' no longer sits as it did: its heading and "
                    "mounting are estimated anew"
                )
            for onlooker, one in zip(self._onlookers, model.viewpoints(state.camera), strict=False):
                view = one.views[number]
                if view.seen.any():
                    residual, _ = reprojections(view, one.problem, one.state.at_frames(slice(0, 1)), 0.0, body)
                    onlooker.hear(number, residual[view.seen], self.settings.spread_share)

    def _find_contacts(self, smoother: LagSmoother) -> None:
        """Which feet stand from the last frame to the newest one."""
        newest = smoother.numbers[-1]
        states = smoother.states(newest - CONTACT_FRAMES)
        for number, wearer in enumerate(smoother.problem.wearers):
            if not wearer.contacts:
                continue
            body = forward_kinematics(
                wearer.skeleton,
                np.stack([one.R_parent_child[number] for one in states]),
                np.stack([one.p_world_pelvis[number] for one in states]),
            )
            points = tuple((contact.bone, contact.p_bone_point) for contact in wearer.contacts)
            confidence = contact_confidence(body, points, 1 / self.settings.frame_rate)
            smoother.frame(newest - 1).contacts[number] = confidence[-2]
            smoother.frame(newest).contacts[number] = confidence[-1]

    def _see(self, smoother: LagSmoother, measured: FrameMeasurement) -> int | None:
        """Put in what the cameras saw; the first frame that changes by it."""
        changed: list[int] = []
        for number, onlooker in enumerate(self._onlookers):
            news = [one for one in measured.video if one.video.camera == onlooker.camera.name]
            for one in news:
                if one.frame not in smoother.numbers:
                    continue
                sights = onlooker.look(one.frame, one.video, self._scenery(smoother, number, one.frame))
                smoother.frame(one.frame).sights[number] = sights
                changed.append(one.frame)
            if news:
                again = onlooker.look_again(
                    smoother.numbers[0], lambda n, camera=number: self._scenery(smoother, camera, n)
                )
                for frame, sights in again.items():
                    smoother.frame(frame).sights[number] = sights
                    changed.append(frame)
        return min(changed, default=None)

    def _scenery(self, smoother: LagSmoother, camera: int, number: int) -> Scenery:
        state, problem = smoother.state(number), smoother.problem
        bodies: list[BodyState] = [
            forward_kinematics(wearer.skeleton, R[None], p[None])
            for wearer, R, p in zip(problem.wearers, state.R_parent_child, state.p_world_pelvis, strict=True)
        ]
        if camera:
            poses = problem.further[camera - 1].state.poses
            pose = (poses.R_world_camera[0], poses.p_world_camera[0])
        elif problem.moving:
            pose = (state.R_world_camera, state.p_world_camera)
        else:
            poses = smoother.shared.camera.poses
            pose = (poses.R_world_camera[0], poses.p_world_camera[0])
        return Scenery(bodies, pose, self._answers.root_covariance(len(bodies)))


def _columns(setup: LiveSetup) -> list[tuple[str, str]]:
    columns = [(wearer.name, site.sensor) for wearer in setup.wearers for site in wearer.placement.sites]
    columns += [(camera.name, camera.mount.sensor) for camera in setup.cameras if camera.mount is not None]
    return columns
