"""Going on from frame to frame: predict, see, smooth, learn."""

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
from vip_factors.live.measurement import LiveFrame
from vip_factors.live.prediction import predicted
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

PATIENCE = 2  # frames: of two updates with video, what moved is linearised anew in one
CONTACT_FRAMES = 8  # frames over which a foot is watched to tell whether it stands


class Tracking:
    """A smoother at work, with those who look on.

    Attributes:
        smoother: where all variables stand.
        observers: one for each camera that is of use.
        solved: whether the newest frame is more than predicted.
        moved: columns of the sensors that were found to have moved in the last step.
    """

    COVARIANCE_EVERY = 12  # frames between covariances of the smoothed pose, which cost 4 ms
    SETTLE_S = 2.0  # after a start no sensor is judged: mountings are still being found
    SPREAD_SHARE = 0.02  # weight of one video frame in the scatter of detections: two seconds of them count
    START_ITERATIONS = 2  # over the first frames, from where the batch stages put them

    def __init__(
        self,
        head: Scene,
        settings: LiveSettings,
        start: TrackingStart,
        extra: ExtraFactors | None = None,
        unseen: Sequence[VideoFrame] = (),
        learnt_s: float = 0.0,
    ) -> None:
        """Begin.

        Args:
            head: of the stream.
            settings: of all rooms.
            start: where tracking begins.
            extra: makes GTSAM factors of a user's own.
            unseen: video of the frames that tracking begins with in which nobody has looked for wearers yet.
            learnt_s: seconds of data that the calibration was found from.

        Raises:
            SolveError: if the frames do not determine all variables, or a standing camera shows no wearer in
                those that tracking goes on from.
        """
        self._head, self._settings = head, settings
        self.smoother = LagSmoother(start.problem, start.shared, settings, extra, start.information)
        for frame, state in zip(start.frames, start.states, strict=True):
            self.smoother.append(frame, state)
        self.observers = self._gathered(start)
        self._look(unseen)
        is_continued, standing = start.information is not None, bool(self.observers) and not start.problem.moving
        if is_continued and standing and not self._is_anybody_seen():
            raise SolveError("no camera shows a wearer in the frames that tracking goes on from")
        rate, begin = settings.frame_rate, self.smoother.numbers[0]
        for _ in range(1 if is_continued else self.START_ITERATIONS):
            self.smoother.update(begin)
        anew = settings.recalibration
        if anew.use and not is_continued:  # a start of a second is too rough to judge sensors by
            begin += round((anew.first_s + anew.delay_s) * rate)
        judged = begin + round(self.SETTLE_S * rate)
        self._watches = [KnockDetector(len(wearer.sensors), rate, judged) for wearer in start.problem.wearers]
        self._sensors = [(w, s) for w, one in enumerate(start.problem.wearers) for s in range(len(one.sensors))]
        self._slips = None if anew.use and learnt_s < SlipTest.LEARNT_S else self._slip_test(begin)
        # Frames; apart, as long as a frame is solved each time.
        self._next_lesson, self._next_test = 0, self.smoother.numbers[-1] + 2 * PATIENCE
        self._measured = start.frames[-1].orientation_valid  # which sensors were, in the last frame
        self.solved, self.moved = True, list[int]()
        self._unsolved = 0  # frames that are predicted only, so far
        # Frames with something new since the last update. Of those that tracking goes on from, the second iteration is
        # left to the next frame's: no update takes as long as both.
        self._changed = [begin] if is_continued else list[int]()
        self._was_seen = True  # whether the last update had something new of a camera

    def _slip_test(self, begin: int) -> SlipTest | None:
        """Of all wearers' sensors, one wearer after the other; None where calibrations are kept."""
        calibration = 4  # columns of a sensor's heading and mounting
        layout, blocks = self.smoother.problem.layout, ("headings", "R_bone_sensor")
        columns = [
            np.concatenate([layout.item_columns(OwnerId(Owner.WEARER, wearer), block, sensor) for block in blocks])
            for wearer, sensor in self._sensors
        ]
        if any(len(own) < calibration for own in columns):
            return None
        wander = layout.per_column("process_noise")[columns[0]]
        return SlipTest(np.stack(columns), wander, self._settings.frame_rate, begin)

    def _gathered(self, start: TrackingStart) -> list[CameraObserver]:
        """The observers, told who is who in the frames of the start."""
        skeletons, observers = [wearer.skeleton for wearer in start.problem.wearers], []
        for each, spreads in zip(start.associated, start.spreads, strict=True):
            camera = start.with_lens(next(one for one in self._head.cameras if one.name == each.camera.name))
            settings = self._settings
            soles = [settings.factors.sole.of(one.sole) for one in start.shared.wearers]
            observer = CameraObserver(camera, skeletons, soles, spreads, settings.camera)
            filmed = [frame for frame in start.video if frame.camera == camera.name]
            for frame in sorted(filmed, key=lambda frame: frame.time):
                index = int(np.searchsorted(each.detections.time, frame.time))
                who = each.association.wearer[each.detections.of_frame(index)]
                chosen = [int(np.flatnonzero(who == w)[0]) if np.any(who == w) else -1 for w in range(len(skeletons))]
                observer.remember(frame, np.array(chosen))
            observers.append(observer)
        return observers

    def _look(self, video: Sequence[VideoFrame]) -> None:
        """Look for the wearers in the video of frames that are there already."""
        sure_root = 0.04 * np.eye(3)  # m², of where a wearer is when tracking goes on from a calibration found anew
        surely = np.stack([sure_root] * len(self.smoother.problem.wearers))
        belief = self._belief(self.smoother.numbers[0], surely)
        for camera, observer in enumerate(self.observers):
            self._see(camera, observer, video, belief, again=False)

    def _is_anybody_seen(self) -> bool:
        frames = [self.smoother.frame(number) for number in self.smoother.numbers]
        return any(view.seen.any() for frame in frames for views in frame.views if views is not None for view in views)

    def step(self, measured: LiveFrame, lag: int, root_covariance: Array, solve_every: int) -> list[Finding]:
        """One frame more.

        Args:
            measured: in the new frame.
            lag: frames to keep behind it.
            root_covariance: ``(W, 3, 3)`` m² of where each wearer is, as of late.
            solve_every: frames to each update.

        Returns:
            What is odd in it.

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
        before = [(smoother.frame(n), smoother.state(n)) for n in numbers[-2:]]
        knocked = self._notice_jumps(smoother.frame(numbers[-1]), frame)
        smoother.append(frame, predicted(problem, before, frame, smoother.shared, knocked))
        news = [video for video in measured.video if video.frame in smoother.numbers]
        belief = self._belief(smoother.numbers[0] if news else measured.number - CONTACT_FRAMES, root_covariance)
        self._find_contacts(belief)
        changed = [
            frame
            for number, observer in enumerate(self.observers)
            for frame in self._see(number, observer, news, belief)
        ]
        self._changed += changed
        self._unsolved += 1
        in_step = bool(changed and not self._was_seen)  # with the video: an update sooner
        self.solved = self._unsolved + in_step >= solve_every
        if self.solved:
            smoother.update(min(self._changed, default=None))
            self._learn()
            findings = self._notice_slips()
            self._changed, self._unsolved, self._was_seen = [], 0, bool(changed)
        smoother.marginalise_before(measured.number - lag - 1)  # the frame told last stays for its successor to follow
        return findings

    def _notice_jumps(self, last: LiveFrame, frame: LiveFrame) -> list[int]:
        """Columns of sensors not to be listened to: they turn on their bone just now, or have done so."""
        knocked = list[int]()
        measured = frame.orientation_valid.copy()
        for number, columns in enumerate(self.smoother.problem.sensors[: len(self._watches)]):
            both = self._measured[columns] & measured[columns]
            R_before, R_now = last.R_inertial_sensor[columns], frame.R_inertial_sensor[columns]
            knocks = self._watches[number].knocked(frame.number, R_before, R_now, both)
            frame.orientation_valid[columns[knocks.ringing]] = False
            knocked += columns[knocks.ringing].tolist()
            for sensor in knocks.moved.tolist():
                self._estimate_sensor_anew(number, sensor)
                knocked.append(int(columns[sensor]))
                if self._slips is not None:
                    self._slips.suspect(self._sensors.index((number, sensor)), frame.number)
        self._measured = measured
        return knocked

    def _estimate_sensor_anew(self, wearer: int, sensor: int) -> None:
        """Let a sensor sit anew behind the newest frame."""
        newest, heading_sigma_deg, mounting_sigma_deg = self.smoother.numbers[-1], 40.0, 30.0  # straps slip so far
        self.smoother.inflate_sensor_sigmas(wearer, sensor, heading_sigma_deg, mounting_sigma_deg)
        if self._slips is not None:
            self._slips.restart([self._sensors.index((wearer, sensor))], newest)

    def let_go(self, columns: Sequence[int]) -> None:
        """Estimate the sensors of these columns anew: they have moved since the calibration was found."""
        for wearer, sensor in self._sensors:
            if self.smoother.problem.sensors[wearer][sensor] in columns:
                self._estimate_sensor_anew(wearer, sensor)

    def _moved_finding(self, wearer: int, sensor: int) -> Finding:
        """A sensor has moved: what to say."""
        problem = self.smoother.problem
        self.moved.append(int(problem.sensors[wearer][sensor]))
        name = problem.wearers[wearer].frames.sensors[sensor]
        return Finding("sensor moved", self._head.wearers[wearer].subject.name, subject=name)

    def _belief(self, first: int, root_covariance: Array) -> Belief:
        """What is believed of the frames from one on."""
        smoother = self.smoother
        first = max(first, smoother.numbers[0])
        states = smoother.states(first)
        bodies = tuple(
            forward_kinematics(
                wearer.skeleton,
                np.array([one.R_parent_child[number] for one in states]),
                np.array([one.p_world_pelvis[number] for one in states]),
            )
            for number, wearer in enumerate(smoother.problem.wearers)
        )
        R = np.array([one.R_world_camera for one in states])
        p = np.array([one.p_world_camera for one in states])
        return Belief(first, bodies, R, p, np.broadcast_to(root_covariance, (len(R), *root_covariance.shape)))

    def _find_contacts(self, belief: Belief) -> None:
        """Which feet stand from the last frame to the newest one."""
        smoother, newest = self.smoother, self.smoother.numbers[-1]
        count = newest + 1 - belief.first
        recent = slice(max(0, count - CONTACT_FRAMES), count)
        for number, (wearer, body) in enumerate(zip(smoother.problem.wearers, belief.bodies, strict=True)):
            if not wearer.contacts:
                continue
            points = tuple((contact.bone, contact.p_bone_point) for contact in wearer.contacts)
            confidence = contact_confidence(body.at(recent), points, 1 / self._settings.frame_rate)
            smoother.frame(newest - 1).contacts[number] = confidence[-2]
            smoother.frame(newest).contacts[number] = confidence[-1]

    def _see(
        self, camera: int, observer: CameraObserver, video: Sequence[VideoFrame], belief: Belief,
        again: bool = True,
    ) -> list[int]:  # fmt: skip
        """Put in what one camera saw, and decide ``again`` who is who in earlier frames; those that change by it.

        They are decided again when the smoother waits, or the longest updates would be longer.
        """
        numbers, name = self.smoother.numbers, observer.camera.name
        news = [frame for frame in video if frame.camera == name and frame.frame in numbers]
        if not news:
            return []
        pose = self._fixed_pose(camera)
        if pose is not None:
            R, p = (np.broadcast_to(one, (len(belief.R_world_camera), *one.shape)) for one in pose)
            belief = replace(belief, R_world_camera=R, p_world_camera=p)

        def feet(number: int) -> list[Array | None]:
            return self._stance_confidence(camera, belief, number)

        seen = [(frame.frame, observer.observe(frame, belief, feet)) for frame in news]
        seen += (observer.revise(belief, feet) if again and not self.smoother.waited else {}).items()
        for number, views in seen:
            self.smoother.frame(number).views[camera] = views
        return [number for number, _ in seen]

    def _stance_confidence(self, camera: int, belief: Belief, number: int) -> list[Array | None]:
        """How surely each wearer's feet stand in a frame; None of wearers whose feet this camera has nothing to do."""
        problem, at = self.smoother.problem, number - belief.first
        if not any(problem.feet[camera]):
            return [None] * len(problem.wearers)
        recent = slice(max(0, at + 1 - CONTACT_FRAMES), at + CONTACT_FRAMES)
        frames = [
            self.smoother.frame(n) for n in self.smoother.numbers[belief.first - self.smoother.numbers[0] :][recent]
        ]
        settings, foot_contacts = self._settings.camera.ground_contact, list[Array | None]()
        for wearer, columns, feet, body in zip(
            problem.wearers, problem.sensors, problem.feet[camera], belief.bodies, strict=False
        ):  # the camera's own sensors are the last
            recently = at - recent.start
            foot_contacts.append(
                None
                if feet is None
                else standing_feet(wearer, columns, feet, body.at(recent), frames, recently, settings)
            )
        return foot_contacts

    def _fixed_pose(self, camera: int) -> tuple[Array, Array] | None:
        """Where a camera that stands still is; None of one whose pose belongs to the frames."""
        problem = self.smoother.problem
        if camera == problem.carried:
            return None
        poses = self.smoother.shared.cameras[camera].poses
        return poses.R_world_camera[0], poses.p_world_camera[0]

    def _notice_slips(self) -> list[Finding]:
        """Sensors that sit as they did no longer, by the last seconds."""
        smoother, newest = self.smoother, self.smoother.numbers[-1]
        if self._slips is None or newest < self._next_test + self._patience:
            return []
        self._next_test = newest + self.COVARIANCE_EVERY
        estimate = newest, smoother.shared_coordinates, smoother.shared_covariance()
        found = [self._sensors[at] for at in self._slips.confirmed(*estimate)]
        slipped = self._slips.slipped(*estimate)
        if slipped is not None:
            wearer, sensor = self._sensors[slipped]
            self._slips.restart([at for at, (owner, _) in enumerate(self._sensors) if owner == wearer], newest)
            self._estimate_sensor_anew(wearer, sensor)  # and what it taught of the others may be wrong as well
        return [self._moved_finding(*one) for one in found]

    @property
    def _patience(self) -> int:
        """Frames for which what is due can wait: for an update in which what moved is not linearised anew."""
        return PATIENCE if self.observers and not self.smoother.waited else 0

    def _learn(self) -> None:
        """What the smoothed frames teach of the detectors: those of the first third of the lag, each but once."""
        smoother = self.smoother
        numbers = smoother.numbers[: max(1, len(smoother.numbers) // 3)]
        if not self.observers or numbers[0] < self._next_lesson + self._patience:
            return
        self._next_lesson = numbers.stop
        model, state = smoother.scene(numbers)
        for number, (wearer, own) in enumerate(zip(model.wearers, state.wearers, strict=True)):
            body = forward_kinematics(wearer.skeleton, own.R_parent_child, own.p_world_pelvis)
            for observer, one in zip(self.observers, model.viewpoints(state), strict=False):
                view = one.views[number]
                count = np.count_nonzero(view.seen.any(axis=1))
                if count:
                    at = WearerEvaluation(number, wearer, own, body)
                    residual = whitened_reprojections(ViewEvaluation(at, camera_owner(0), one.problem, one.state, view))
                    observer.learn_spread(number, residual, view, 1 - (1 - self.SPREAD_SHARE) ** count)
