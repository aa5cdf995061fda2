"""Tracking from frame to frame: predict, associate, smooth, adapt."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vip_factors.body.kinematics import forward_kinematics
from vip_factors.errors import SolveError
from vip_factors.factor_graph.extra import ExtraFactors
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array
from vip_factors.initialise.calibration import contact_confidence
from vip_factors.live.association import Belief
from vip_factors.live.camera_observer import CameraObserver, standing_feet
from vip_factors.live.frames import LiveFrame, stacked
from vip_factors.live.prediction import predict_frame
from vip_factors.live.sensor_slips import KnockDetector, SlipTest
from vip_factors.live.smoother import LagSmoother
from vip_factors.live.start import TrackingStart
from vip_factors.problem.layout import Owner, OwnerId
from vip_factors.problem.variables import camera_owner
from vip_factors.sensors.live import VideoFrame
from vip_factors.sensors.scene import Scene
from vip_factors.settings import LiveSettings
from vip_factors.terms.evaluation import ViewEvaluation, WearerEvaluation
from vip_factors.terms.reprojection import whitened_reprojections

PATIENCE = 2  # frames: if two updates have video, moved frames are relinearised in only one
CONTACT_FRAMES = 8  # frames from which the stance of a foot is determined


class Tracking:
    """A smoother with its observers.

    Attributes:
        smoother: the state of all variables.
        observers: one for each camera that is used.
        solved: whether the newest frame was solved, not only predicted.
        moved: columns of sensors found to have moved in the last step.
    """

    COVARIANCE_EVERY = 12  # frames between covariances of the smoothed pose, which cost 4 ms
    SETTLE_S = 2.0  # after a start, before sensors are tested: mountings are still converging
    SPREAD_SHARE = 0.02  # weight of one video frame in the scatter of detections: two seconds of them count
    START_ITERATIONS = 2  # over the first frames, from the result of the batch stages

    def __init__(
        self,
        head: Scene,
        settings: LiveSettings,
        start: TrackingStart,
        extra: ExtraFactors | None = None,
        unseen: Sequence[VideoFrame] = (),
        learnt_s: float = 0.0,
    ) -> None:
        """Start tracking.

        Args:
            head: the set-up of the stream.
            settings: settings of a stream.
            start: problem, state and frames of the start.
            extra: makes a user's GTSAM factors.
            unseen: video of the first frames in which no wearers have been sought yet.
            learnt_s: seconds of data in the calibration.

        Raises:
            SolveError: if the frames do not determine all variables, or a standing camera shows no wearer in
                those that tracking goes on from.
        """
        self._head, self._settings = head, settings
        self.smoother = LagSmoother(start.problem, start.shared, settings, extra, start.information)
        for frame, state in zip(start.frames, start.states, strict=True):
            self.smoother.append(frame, state)
        self.observers = self._start_observers(start)
        sure_root = 0.04 * np.eye(3)  # m², of a wearer's position when tracking continues with a new calibration
        belief = self._belief(self.smoother.numbers[0], np.stack([sure_root] * len(start.problem.wearers)))
        for camera, observer in enumerate(self.observers):
            self._observe(camera, observer, unseen, belief, revise=False)
        is_continued, standing = start.information is not None, bool(self.observers) and not start.problem.carried
        if is_continued and standing:
            views = [
                row for frame in start.frames for row in self.smoother.frame(frame.number).views if row is not None
            ]
            if not any(view.seen.any() for row in views for view in row):
                raise SolveError("no camera shows a wearer in the frames that tracking goes on from")
        rate, begin = settings.frame_rate, self.smoother.numbers[0]
        for _ in range(1 if is_continued else self.START_ITERATIONS):
            self.smoother.update(begin)
        anew = settings.recalibration
        if anew.use and not is_continued:  # a start of a second is too rough to test sensors by
            begin += round((anew.first_s + anew.delay_s) * rate)
        tested_from = begin + round(self.SETTLE_S * rate)
        counts = [len(wearer.sensors) for wearer in start.problem.wearers]
        self._knock_detectors = [KnockDetector(count, rate, tested_from) for count in counts]
        self._sensors = [(wearer, sensor) for wearer, count in enumerate(counts) for sensor in range(count)]
        self._slips = None if anew.use and learnt_s < SlipTest.LEARNT_S else self._slip_test(begin)
        # Frame numbers of the next updates of the scatter and of the slip test, apart from each other.
        self._next_spread, self._next_test = 0, self.smoother.numbers[-1] + 2 * PATIENCE
        self._measured = start.frames[-1].orientation_valid  # in the last frame
        self.solved, self.moved = True, list[int]()
        self._unsolved = 0  # frames that are predicted only, so far
        # Frames with new data since the last update. When tracking continues, their second iteration is left to the
        # next update: no update takes as long as both.
        self._changed = [begin] if is_continued else list[int]()
        self._was_seen = True  # whether the last update had new video

    def _slip_test(self, begin: int) -> SlipTest | None:
        """Slip test of all wearers' sensors; None if calibrations are fixed."""
        calibration = 4  # columns of a sensor's heading and mounting
        layout, blocks = self.smoother.problem.layout, ("headings", "R_bone_sensor")
        columns = [
            np.concatenate([layout.item_columns(OwnerId(Owner.WEARER, wearer), block, sensor) for block in blocks])
            for wearer, sensor in self._sensors
        ]
        if any(len(columns_of_sensor) < calibration for columns_of_sensor in columns):
            return None
        wander = layout.per_column("process_noise")[columns[0]]
        return SlipTest(np.stack(columns), wander, self._settings.frame_rate, begin)

    def _start_observers(self, start: TrackingStart) -> list[CameraObserver]:
        """Observers with the association of the frames of the start."""
        skeletons, observers = [wearer.skeleton for wearer in start.problem.wearers], []
        cameras = {camera.name: camera for camera in self._head.cameras}
        for associated, spreads in zip(start.associated, start.spreads, strict=True):
            camera = start.with_lens(cameras[associated.camera.name])
            settings = self._settings
            soles = [settings.factors.sole.of(wearer.sole) for wearer in start.shared.wearers]
            observer = CameraObserver(camera, skeletons, soles, spreads, settings.camera)
            filmed = [frame for frame in start.video if frame.camera == camera.name]
            for frame in sorted(filmed, key=lambda frame: frame.time):
                index = int(np.searchsorted(associated.detections.time, frame.time))
                who = associated.association.wearer[associated.detections.of_frame(index)]
                chosen = [int(np.flatnonzero(who == w)[0]) if np.any(who == w) else -1 for w in range(len(skeletons))]
                observer.remember(frame, np.array(chosen))
            observers.append(observer)
        return observers

    def step(self, measured: LiveFrame, lag: int, root_covariance: Array, solve_every: int) -> list[Finding]:
        """Append a frame.

        Args:
            measured: measurements of the new frame.
            lag: number of frames before it that stay in the lag.
            root_covariance: ``(W, 3, 3)`` m², latest covariance of each wearer's position.
            solve_every: frames to each update.

        Returns:
            Findings about the frame.

        Raises:
            SolveError: if the frames do not determine all variables.
        """
        smoother, problem = self.smoother, self.smoother.problem
        numbers, findings, self.moved = smoother.numbers, list[Finding](), []
        frame = replace(
            measured,
            orientation_valid=measured.orientation_valid.copy(),
            views=[None] * len(problem.cameras),
            contacts=[np.zeros(len(wearer.contacts)) for wearer in problem.wearers],
        )
        previous_frames = [(smoother.frame(n), smoother.state(n)) for n in numbers[-2:]]
        knocked = self._notice_jumps(smoother.frame(numbers[-1]), frame)
        smoother.append(frame, predict_frame(problem, previous_frames, frame, smoother.shared, knocked))
        news = [video for video in measured.video if video.frame in smoother.numbers]
        belief = self._belief(smoother.numbers[0] if news else measured.number - CONTACT_FRAMES, root_covariance)
        self._find_contacts(belief)
        changed = list[int]()
        for number, observer in enumerate(self.observers):
            changed += self._observe(number, observer, news, belief)
        self._changed += changed
        self._unsolved += 1
        in_step = bool(changed and not self._was_seen)  # an update sooner, in step with the video
        self.solved = self._unsolved + in_step >= solve_every
        if self.solved:
            smoother.update(min(self._changed, default=None))
            self._update_spreads()
            findings = self._notice_slips()
            self._changed, self._unsolved, self._was_seen = [], 0, bool(changed)
        smoother.marginalise_before(measured.number - lag - 1)  # the frame shown last stays for the filter
        return findings

    def _notice_jumps(self, last_frame: LiveFrame, frame: LiveFrame) -> list[int]:
        """Columns of sensors to be ignored, because they turn on their bone now or have done so."""
        knocked = list[int]()
        measured = frame.orientation_valid.copy()
        for number, columns in enumerate(self.smoother.problem.sensors[: len(self._knock_detectors)]):
            both_measured = self._measured[columns] & measured[columns]
            R_before, R_now = last_frame.R_inertial_sensor[columns], frame.R_inertial_sensor[columns]
            knocks = self._knock_detectors[number].knocked(frame.number, R_before, R_now, both_measured)
            frame.orientation_valid[columns[knocks.ringing]] = False
            knocked += columns[knocks.ringing].tolist()
            for sensor in knocks.moved.tolist():
                self._free_sensor(number, sensor)
                knocked.append(int(columns[sensor]))
                if self._slips is not None:
                    self._slips.suspect(self._sensors.index((number, sensor)), frame.number)
        self._measured = measured
        return knocked

    def _free_sensor(self, wearer: int, sensor: int) -> None:
        """Free the calibration of a sensor after the newest frame."""
        self.smoother.free_sensor(wearer, sensor)
        if self._slips is not None:
            self._slips.restart([self._sensors.index((wearer, sensor))], self.smoother.numbers[-1])

    def free_sensors(self, columns: Sequence[int]) -> None:
        """Free the calibration of sensors (columns) that have moved since it was estimated."""
        for wearer, sensor in self._sensors:
            if self.smoother.problem.sensors[wearer][sensor] in columns:
                self._free_sensor(wearer, sensor)

    def _belief(self, first_number: int, root_covariance: Array) -> Belief:
        """Current belief about the frames from a number on."""
        smoother = self.smoother
        first_number = max(first_number, smoother.numbers[0])
        states = smoother.states(first_number)
        bodies = tuple(
            forward_kinematics(
                wearer.skeleton,
                np.array([state.R_parent_child[number] for state in states]),
                np.array([state.p_world_pelvis[number] for state in states]),
            )
            for number, wearer in enumerate(smoother.problem.wearers)
        )
        return Belief(first_number, bodies, np.broadcast_to(root_covariance, (len(states), *root_covariance.shape)))

    def _find_contacts(self, belief: Belief) -> None:
        """Determine which feet stand from the last frame to the newest one."""
        smoother, newest = self.smoother, self.smoother.numbers[-1]
        count = newest + 1 - belief.first_number
        recent = slice(max(0, count - CONTACT_FRAMES), count)
        for number, (wearer, body) in enumerate(zip(smoother.problem.wearers, belief.bodies, strict=True)):
            if not wearer.contacts:
                continue
            points = tuple((contact.bone, contact.p_bone_point) for contact in wearer.contacts)
            confidence = contact_confidence(body.at(recent), points, 1 / self._settings.frame_rate)
            smoother.frame(newest - 1).contacts[number] = confidence[-2]
            smoother.frame(newest).contacts[number] = confidence[-1]

    def _observe(
        self, camera: int, observer: CameraObserver, video: Sequence[VideoFrame], belief: Belief, revise: bool = True
    ) -> list[int]:
        """Add one camera's observations, and ``revise`` the association of earlier frames; returns the changed frames.

        Frames are not revised in an update that also relinearises: this bounds the longest update.
        """
        numbers, name = self.smoother.numbers, observer.camera.name
        news = [frame for frame in video if frame.camera == name and frame.frame in numbers]
        if not news:
            return []
        path = stacked(self.smoother.states(belief.first_number), self.smoother.shared).cameras[camera]
        poses = path.at_frames(slice(0, len(belief.root_covariance)))
        belief = replace(belief, R_world_camera=poses.R_world_camera, p_world_camera=poses.p_world_camera)

        def feet(number: int) -> list[Array | None]:
            return self._stance_confidence(camera, belief, number)

        observed = [(frame.frame, observer.observe(frame, belief, feet)) for frame in news]
        observed += (observer.revise(belief, feet) if revise and not self.smoother.waited else {}).items()
        for number, views in observed:
            self.smoother.frame(number).views[camera] = views
        return [number for number, _ in observed]

    def _stance_confidence(self, camera: int, belief: Belief, number: int) -> list[Array | None]:
        """Confidence that each wearer's feet stand in a frame; None for wearers whose feet the camera does not use."""
        smoother, problem = self.smoother, self.smoother.problem
        if not any(problem.feet[camera]):
            return [None] * len(problem.wearers)
        first_number = max(belief.first_number, number + 1 - CONTACT_FRAMES)
        recent = range(first_number, min(number + CONTACT_FRAMES, smoother.numbers.stop))
        frames, index = [smoother.frame(n) for n in recent], number - first_number
        rows = slice(recent.start - belief.first_number, recent.stop - belief.first_number)
        settings, foot_contacts = self._settings.camera.ground_contact, list[Array | None]()
        for w, (wearer, feet) in enumerate(zip(problem.wearers, problem.feet[camera], strict=True)):
            body, columns = belief.bodies[w].at(rows), problem.sensors[w]
            contacts = None if feet is None else standing_feet(wearer, columns, feet, body, frames, index, settings)
            foot_contacts.append(contacts)
        return foot_contacts

    def _notice_slips(self) -> list[Finding]:
        """Findings about sensors that have slipped in the last seconds."""
        smoother, newest, problem = self.smoother, self.smoother.numbers[-1], self.smoother.problem
        if self._slips is None or newest < self._next_test + self._patience:
            return []
        self._next_test, findings = newest + self.COVARIANCE_EVERY, list[Finding]()
        estimate = newest, smoother.shared_coordinates, smoother.solution.shared_covariance()
        for moved in self._slips.confirmed(*estimate):
            wearer, sensor = self._sensors[moved]
            self.moved.append(int(problem.sensors[wearer][sensor]))
            name, sensor_name = self._head.wearers[wearer].subject.name, problem.wearers[wearer].frames.sensors[sensor]
            findings.append(Finding("sensor moved", name, subject=sensor_name))
        slipped = self._slips.slipped(*estimate)
        if slipped is not None:
            wearer, sensor = self._sensors[slipped]
            sensors_of_wearer = [index for index, (owner, _) in enumerate(self._sensors) if owner == wearer]
            self._slips.restart(sensors_of_wearer, newest)
            self._free_sensor(wearer, sensor)  # its data may have misled the other sensors of the wearer
        return findings

    @property
    def _patience(self) -> int:
        """Frames for which tests can wait for an update without relinearisation."""
        return PATIENCE if self.observers and not self.smoother.waited else 0

    def _update_spreads(self) -> None:
        """Update the scatter of detections from the first third of the lag, each frame once."""
        smoother = self.smoother
        numbers = smoother.numbers[: max(1, len(smoother.numbers) // 3)]
        if not self.observers or numbers[0] < self._next_spread + self._patience:
            return
        self._next_spread = numbers.stop
        model, state = smoother.scene(numbers)
        for number, (wearer, wearer_state) in enumerate(zip(model.wearers, state.wearers, strict=True)):
            body = forward_kinematics(wearer.skeleton, wearer_state.R_parent_child, wearer_state.p_world_pelvis)
            for observer, viewpoint in zip(self.observers, model.viewpoints(state), strict=False):
                view = viewpoint.views[number]
                count = np.count_nonzero(view.seen.any(axis=1))
                if count:
                    evaluation = WearerEvaluation(number, wearer, wearer_state, body)
                    seen_from = camera_owner(0), viewpoint.problem, viewpoint.state
                    residual = whitened_reprojections(ViewEvaluation(evaluation, *seen_from, view))
                    observer.adapt_spread(number, residual, view, 1 - (1 - self.SPREAD_SHARE) ** count)
