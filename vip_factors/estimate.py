"""What the estimators return: motion, calibration, how sure they are, and how the solve went. Plain data."""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from vip_factors.body.hinges import HingeEstimate
from vip_factors.body.kinematics import Motion
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.calibration import Calibration, SensorCalibration
from vip_factors.sensors.camera_model import CameraModel, VideoClock
from vip_factors.sensors.camera_path import CameraPath


@dataclass(frozen=True)
class Iteration:
    """One step of the optimiser: total cost after it, its damping, whether it was taken, and seconds by part."""

    cost: float
    damping: float
    accepted: bool
    seconds: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class SolveReport:
    """How a solve went.

    Attributes:
        stage: which solve of the pipeline this was.
        iterations: in order.
        initial_cost, final_cost: half the sum of squared whitened residuals (robust losses applied) by factor kind.
        converged: whether the cost stopped falling before the iteration limit.
        seconds: wall time of the whole solve.
    """

    stage: str
    iterations: tuple[Iteration, ...]
    initial_cost: Mapping[str, float]
    final_cost: Mapping[str, float]
    converged: bool
    seconds: float


@dataclass(frozen=True)
class PoseCovariance:
    """Marginal covariance of the joint rotations and of the root, at every frame.

    Attributes:
        joints: ``(T, 24, 3, 3)`` rad², of right perturbations of ``R_parent_child``.
        root: ``(T, 3, 3)`` m², of the root translation.
    """

    joints: Array
    root: Array

    @property
    def joint_sigma(self) -> Array:
        """Root mean square standard deviation of each joint's rotation, ``(T, 24)`` rad."""
        return np.sqrt(np.trace(self.joints, axis1=-2, axis2=-1) / 3)


@dataclass(frozen=True)
class BodyEstimate:
    """The body that was found with the motion, and what was taken for likely beforehand.

    Attributes:
        names: of ``B`` lengths; none where the body was given and only hinges were looked for.
        prior, found: ``(B,)`` metres: limbs, widths, and where joints lie on the bone above (both sides alike).
        prior_covariance, covariance: ``(B, B)`` m²; that of what was found is NaN where the data do not determine
            everything.
        hinges: of elbows and knees, if they were looked for.
        prior_hinges: what was taken for likely of each of them.
    """

    names: tuple[str, ...]
    prior: Array
    found: Array
    prior_covariance: Array
    covariance: Array
    hinges: tuple[HingeEstimate, ...] = ()
    prior_hinges: tuple[HingeEstimate, ...] = ()

    @property
    def prior_sigma(self) -> Array:
        """``(B,)`` metres."""
        return np.sqrt(np.diag(self.prior_covariance))

    @property
    def sigma(self) -> Array:
        """``(B,)`` metres, NaN if not known."""
        return np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True)
class SensorPlaceEstimate:
    """Where on its bone a sensor was found to sit; ``(3,)`` metres each, bone axes.

    Attributes:
        sensor, bone: their names.
        prior: where it was supposed to sit, on the body that was found: along a limb it keeps its share of that.
        found: where it does.
        prior_sigma, sigma: standard deviations about each axis; NaN if not known.
    """

    sensor: str
    bone: str
    prior: Array
    found: Array
    prior_sigma: Array
    sigma: Array


@dataclass(frozen=True)
class DetectorEstimate:
    """Where a detector puts its keypoints, against where the table of its keypoints has them.

    Attributes:
        keypoints: names of ``K``, without a side: both are alike.
        prior, found: ``(K, 3)`` metres, of the left side, bone axes; the right side's have their x turned round.
        prior_sigma, sigma: ``(K, 3)`` standard deviations; NaN if not known.
    """

    keypoints: tuple[str, ...]
    prior: Array
    found: Array
    prior_sigma: Array
    sigma: Array


@dataclass(frozen=True)
class StartChoice:
    """Which start of headings and mountings was chosen.

    Attributes:
        supposition: what it supposes, in words.
        rival: what the likeliest start supposes that turns a sensor by more than 60° against it; empty without one.
        margin: nats by which that is less likely; infinite without one.
        doubtful: names of the sensors that starts turn which are nearly as likely.
    """

    supposition: str
    rival: str = ""
    margin: float = math.inf
    doubtful: tuple[str, ...] = ()


@dataclass(frozen=True)
class WearerEstimate:
    """A reconstructed recording.

    Attributes:
        name: of the recording it was made from.
        method: name of the variant (``"IT"``, ``"SOP"``, ``"SIP"`` …).
        motion: the wearer's motion.
        calibration: heading and mounting of every sensor used.
        covariance: on request.
        residuals: by factor kind, ``(T, sensors)`` norms in the unit named in the key (``orientation_deg``,
            ``acceleration_m_s2``); NaN where a sensor gave nothing. Columns follow ``sensors``.
        sensors: names of the sensors used.
        reports: one per solve, in order.
        settings: the effective settings, flattened to text.
        body: what was found of the body; None if nothing of it was looked for.
        sensor_places: of the sensors used; none if they were taken as told.
        findings: sentences about what is odd or not settled: to be shown to the user.
        start: how the first headings and mountings were chosen; None if they were not looked for.
    """

    name: str
    method: str
    motion: Motion
    calibration: Calibration
    covariance: PoseCovariance | None = None
    residuals: Mapping[str, Array] = field(default_factory=dict)
    sensors: tuple[str, ...] = ()
    reports: tuple[SolveReport, ...] = ()
    settings: Mapping[str, str] = field(default_factory=dict)
    body: BodyEstimate | None = None
    sensor_places: tuple[SensorPlaceEstimate, ...] = ()
    findings: tuple[str, ...] = ()
    start: StartChoice | None = None


@dataclass(frozen=True)
class EstimatePart:
    """Some consecutive frames of an estimate that is made part by part.

    Attributes:
        first: number of the first of them.
        motion, covariance, residuals: as of a :class:`WearerEstimate`.
        reports: of the solves that made them.
    """

    first: int
    motion: Motion
    covariance: PoseCovariance | None = None
    residuals: Mapping[str, Array] = field(default_factory=dict)
    reports: tuple[SolveReport, ...] = ()


@dataclass(frozen=True)
class LongEstimate:
    """An estimate that need not be in memory at once.

    Attributes:
        head: all but the frames: its motion has none, its residuals no rows.
        frames: how many there will be.
        parts: in the order of time, made as they are asked for, once.
    """

    head: WearerEstimate
    frames: int
    parts: Iterator[EstimatePart]

    def whole(self) -> WearerEstimate:
        """All parts together, in memory."""
        parts = list(self.parts)
        R, p = (np.concatenate([getattr(one.motion, name) for one in parts]) for name in _POSES)
        covariances = [one.covariance for one in parts if one.covariance is not None]
        return replace(
            self.head,
            motion=replace(self.head.motion, R_parent_child=R, p_world_pelvis=p),
            covariance=PoseCovariance(
                np.concatenate([one.joints for one in covariances]), np.concatenate([one.root for one in covariances])
            )
            if len(covariances) == len(parts)
            else None,
            residuals={kind: np.concatenate([one.residuals[kind] for one in parts]) for kind in self.head.residuals},
            reports=(*self.head.reports, *(report for one in parts for report in one.reports)),
        )


_POSES = ("R_parent_child", "p_world_pelvis")


@dataclass(frozen=True)
class CameraEstimate:
    """Where the camera was.

    Attributes:
        name: of the camera.
        model: its intrinsics.
        path: its poses, at the frames of the motions (one instant if it stood still).
        calibration: heading and mounting (``R_camera_imu``) of the IMU on it, if it has one.
        covariance: ``(T, 6, 6)`` on request, of right perturbations of ``T_world_camera``: rotation, then translation
            in the camera's axes; rad and m.
        residual_px: ``(T, wearers)`` root mean square reprojection error of each wearer in pixels, NaN where unseen.
        time_offset: seconds added to the video's times to get the IMUs', at the video's time 0.
        time_drift: seconds more for every second of the video.
        clock_sigma: standard deviations of the offset, in the recording's middle, and of the drift; None where kept.
    """

    name: str
    model: CameraModel
    path: CameraPath
    calibration: SensorCalibration | None = None
    covariance: Array | None = None
    residual_px: Array | None = None
    time_offset: float = 0.0
    time_drift: float = 0.0
    clock_sigma: tuple[float, float] | None = None

    @property
    def clock(self) -> VideoClock:
        """What lies between the video's clock and the IMUs'."""
        return VideoClock(self.time_offset, self.time_drift)


@dataclass(frozen=True)
class Estimate:
    """A reconstructed scene: all wearers in one world.

    Attributes:
        name: of the scene.
        method: name of the variant (``"VIP"``, ``"SIP"`` …).
        wearers: one estimate each, in the scene's order.
        camera: if the scene had one.
        wearer_of_detection: ``(N,)`` index of the wearer that each detection was given to, −1 for nobody.
        reports: of the solves over all wearers, in order.
        findings: sentences about what is odd or not determined: to be shown to the user.
        settings: the effective settings, flattened to text.
        detector: where it puts its keypoints; None if that was not looked for.
        association: sentences about what told who is who in the first camera's picture, one of each wearer.
    """

    name: str
    method: str
    wearers: tuple[WearerEstimate, ...]
    camera: CameraEstimate | None = None
    wearer_of_detection: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    reports: tuple[SolveReport, ...] = ()
    findings: tuple[str, ...] = ()
    settings: Mapping[str, str] = field(default_factory=dict)
    detector: DetectorEstimate | None = None
    association: tuple[str, ...] = ()


@dataclass(frozen=True)
class ScenePart:
    """Some consecutive frames of a scene's estimate that is made part by part.

    Attributes:
        first: number of the first of them.
        wearers: of each, in the scene's order.
        camera: at these frames; of one that stands still, with its one pose. None if it is nowhere.
        wearer_of_detection: ``(N,)`` of the detections that follow those of the part before.
        reports: of the solves that made them.
    """

    first: int
    wearers: tuple[EstimatePart, ...]
    camera: CameraEstimate | None
    wearer_of_detection: np.ndarray
    reports: tuple[SolveReport, ...] = ()


@dataclass(frozen=True)
class LongSceneEstimate:
    """The estimate of a filmed scene that need not be in memory at once.

    Attributes:
        head: all but the frames: its wearers' motions have none, and its camera's path is the first pose.
        camera_moves: whether the camera has a pose for each frame.
        frames: how many there will be.
        parts: in the order of time, made as they are asked for, once.
        closed: the head, with what is known of the whole once all parts were made: findings, headings over time, who is
            who.
    """

    head: Estimate
    camera_moves: bool
    frames: int
    parts: Iterator[ScenePart]
    closed: Callable[[], Estimate]

    def whole(self) -> Estimate:
        """All parts together, in memory."""
        parts = list(self.parts)
        head = self.closed()
        wearers = tuple(
            LongEstimate(one, self.frames, iter([part.wearers[number] for part in parts])).whole()
            for number, one in enumerate(head.wearers)
        )
        reports = (*head.reports, *(report for part in parts for report in part.reports))
        cameras = [part.camera for part in parts if part.camera is not None]
        camera = _whole_camera(cameras) if len(cameras) == len(parts) else None
        return replace(head, wearers=wearers, camera=camera, reports=reports)


def _whole_camera(parts: list[CameraEstimate]) -> CameraEstimate:
    first = parts[0]
    paths, covariances = [one.path for one in parts], [one.covariance for one in parts if one.covariance is not None]
    moves = any(len(one) > 1 for one in paths)
    residuals = [one.residual_px for one in parts if one.residual_px is not None]
    return replace(
        first,
        path=CameraPath(
            *(np.concatenate([getattr(one, name) for one in paths]) for name in vars(first.path))
        ) if moves else first.path,
        covariance=np.concatenate(covariances) if moves and len(covariances) == len(parts) else first.covariance,
        residual_px=np.concatenate(residuals) if len(residuals) == len(parts) else None,
    )  # fmt: skip
