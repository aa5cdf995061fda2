"""What the estimators return: motion, calibration, how sure they are, and how the solve went. Plain data."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from vip_factors.body.hinges import HingeEstimate
from vip_factors.body.kinematics import Motion
from vip_factors.body.model_errors import LENGTH
from vip_factors.errors import InputError
from vip_factors.findings import Finding, Verdict, verdict
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.calibration import Calibration, SensorCalibration
from vip_factors.sensors.camera_model import CameraModel, VideoClock
from vip_factors.sensors.camera_path import CameraPath

KEPT = 0.8  # of the prior's standard deviation: what is no surer than this was hardly measured


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

    def frames(self, which: slice | np.ndarray) -> "PoseCovariance":
        """The covariance at some frames."""
        return PoseCovariance(self.joints[which], self.root[which])

    @property
    def joint_sigma(self) -> Array:
        """Root mean square standard deviation of each joint's rotation, ``(T, 24)`` rad."""
        return np.sqrt(np.trace(self.joints, axis1=-2, axis2=-1) / 3)


@dataclass(frozen=True)
class BodyEstimate:
    """The body that was found with the motion, and what was taken for likely beforehand.

    Attributes:
        names: of ``B`` lengths; none where the body was given and only hinges were looked for.
        prior, posterior: ``(B,)`` metres: limbs, widths, and where joints lie on the bone above (both sides alike).
        prior_covariance, covariance: ``(B, B)`` m²; that of what was found is NaN where the data do not determine
            everything.
        hinges: of elbows and knees, if they were looked for.
        prior_hinges: what was taken for likely of each of them.
    """

    names: tuple[str, ...]
    prior: Array
    posterior: Array
    prior_covariance: Array
    covariance: Array
    hinges: tuple[HingeEstimate, ...] = ()
    prior_hinges: tuple[HingeEstimate, ...] = ()

    @property
    def prior_sigma(self) -> Array:
        """Standard deviation of each length beforehand, ``(B,)`` metres, with the models' share."""
        return np.sqrt(np.diag(self.prior_covariance) + LENGTH**2)

    @property
    def sigma(self) -> Array:
        """Standard deviation of each length as found, ``(B,)`` metres, with the models' share; NaN if not known."""
        return np.sqrt(np.diag(self.covariance) + LENGTH**2)

    @property
    def keeps_prior(self) -> np.ndarray:
        """Which lengths the data hardly told, ``(B,)``."""
        return np.diag(self.covariance) > KEPT**2 * np.diag(self.prior_covariance)


@dataclass(frozen=True)
class SensorPlaceEstimate:
    """Where on its bone a sensor was found to sit; ``(3,)`` metres each, bone axes.

    Attributes:
        sensor, bone: their names.
        prior: where it was supposed to sit, on the body that was found: along a limb it keeps its share of that.
        posterior: where it does.
        prior_sigma, sigma: standard deviations about each axis; NaN if not known.
    """

    sensor: str
    bone: str
    prior: Array
    posterior: Array
    prior_sigma: Array
    sigma: Array


@dataclass(frozen=True)
class DetectorEstimate:
    """Where a detector puts its keypoints, against where the table of its keypoints has them.

    Attributes:
        keypoints: names of ``K``, without a side: both are alike.
        prior, posterior: ``(K, 3)`` metres, of the left side, bone axes; the right side's have their x turned round.
        prior_sigma, sigma: ``(K, 3)`` standard deviations; NaN if not known.
    """

    keypoints: tuple[str, ...]
    prior: Array
    posterior: Array
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
    """What was reconstructed of one wearer.

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
        findings: what is odd or not settled: to be shown to the user.
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
    findings: tuple[Finding, ...] = ()
    start: StartChoice | None = None

    def frames(self, which: slice) -> "WearerEstimate":
        """The estimate of some consecutive frames; what all frames share is as it was."""
        return replace(
            self,
            motion=self.motion.frames(which),
            covariance=None if self.covariance is None else self.covariance.frames(which),
            residuals={kind: values[which] for kind, values in self.residuals.items()},
        )


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

    def frames(self, which: slice) -> "CameraEstimate":
        """The estimate at some consecutive frames; a camera that stands still has its one pose."""
        path, covariance, residual = self.path, self.covariance, self.residual_px
        moves = len(path) > 1
        return replace(
            self,
            path=path.frames(which) if moves else path,
            covariance=covariance[which] if moves and covariance is not None else covariance,
            residual_px=None if residual is None else residual[which],
        )

    @property
    def start(self) -> "CameraEstimate":
        """The estimate without its frames: the path's first pose."""
        residual = self.residual_px
        none = None if residual is None else residual[:0]
        return replace(self, path=self.path.frames(slice(0, 1)), covariance=None, residual_px=none)

    @property
    def clock(self) -> VideoClock:
        """What lies between the video's clock and the IMUs'."""
        return VideoClock(self.time_offset, self.time_drift)


@dataclass(frozen=True)
class Estimate:
    """What was reconstructed of one wearer or several, in one world if a camera saw them.

    Attributes:
        name: of the recording.
        method: name of the variant (``"VIP"``, ``"SIP"`` …).
        wearers: one estimate each, in the recording's order.
        camera: if there was one.
        wearer_of_detection: ``(N,)`` index of the wearer that each detection was given to, −1 for nobody.
        reports: of the solves over all wearers, in order.
        findings: what is odd or not determined: to be shown to the user.
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
    findings: tuple[Finding, ...] = ()
    settings: Mapping[str, str] = field(default_factory=dict)
    detector: DetectorEstimate | None = None
    association: tuple[str, ...] = ()

    @classmethod
    def of_one(cls, wearer: WearerEstimate) -> "Estimate":
        """The estimate of one wearer whom no camera saw."""
        return cls(wearer.name, wearer.method, (wearer,), findings=wearer.findings, settings=wearer.settings)

    @property
    def all_findings(self) -> tuple[Finding, ...]:
        """What is odd about the whole and its wearers, each once; that the last stage did not settle, too."""
        found = [*self.findings, *(finding for one in self.wearers for finding in one.findings)]
        stages = [(one.stage.partition(",")[0], one.converged) for one in self.all_reports]  # behind a comma: windows
        if stages and (stages[-1][0], False) in stages:
            found.append(Finding("not converged", subject=stages[-1][0]))
        return tuple(dict.fromkeys(found))

    @property
    def all_reports(self) -> tuple[SolveReport, ...]:
        """Those of its wearers, then its own."""
        return (*(report for one in self.wearers for report in one.reports), *self.reports)

    @property
    def verdict(self) -> Verdict:
        """Whether to rely on it."""
        return verdict(self.all_findings)

    @property
    def is_plain(self) -> bool:
        """Whether it says nothing beyond the estimate of its only wearer."""
        if len(self.wearers) != 1 or self.camera is not None or self.detector is not None:
            return False
        own, plain = (
            (one.name, one.method, one.findings, dict(one.settings)) for one in (self, Estimate.of_one(self.wearers[0]))
        )
        return own == plain and not (self.reports or self.association or len(self.wearer_of_detection))

    @property
    def only_wearer(self) -> WearerEstimate:
        """The wearer's estimate.

        Raises:
            InputError: if there are several.
        """
        if len(self.wearers) != 1:
            names = ", ".join(f"'{one.motion.name}'" for one in self.wearers) or "none"
            raise InputError(f"estimate '{self.name}' has {len(self.wearers)} wearers ({names}): expected one")
        return self.wearers[0]


@dataclass(frozen=True)
class EstimateChunks:
    """An estimate of any length, which need not be in memory at once.

    Attributes:
        head: all but the frames: its wearers' motions have none, and its camera's path is the first pose.
        frames: how many each wearer will have.
        camera_poses: how many the camera will have: one if it stands still.
        chunks: estimates of consecutive frames in the order of time, made as they are asked for, once. Their reports
            are of the solves that made them; their detections follow those of the chunk before.
        closed: makes the head with what is known of the whole once all chunks were made (findings, headings over time,
            who is who); None if the head has that already.
    """

    head: Estimate
    frames: tuple[int, ...]
    chunks: Iterator[Estimate]
    camera_poses: int = 1
    closed: Callable[[], Estimate] | None = None

    @classmethod
    def of(cls, estimate: Estimate) -> "EstimateChunks":
        """A whole estimate as one chunk."""
        wearers, camera, none = estimate.wearers, estimate.camera, slice(0, 0)
        without = tuple(replace(one, reports=()) for one in wearers)
        return cls(
            replace(
                estimate,
                wearers=tuple(one.frames(none) for one in wearers),
                camera=None if camera is None else camera.start,
            ),
            tuple(len(one.motion) for one in wearers),
            iter([replace(estimate, wearers=without, reports=())]),
            1 if camera is None else len(camera.path),
        )

    def with_findings(self, findings: tuple[Finding, ...]) -> "EstimateChunks":
        """The same, with findings of the whole before its own."""
        return self._changed(lambda one: replace(one, findings=(*findings, *one.findings)))

    def changed(self, change: Callable[[Estimate], Estimate]) -> "EstimateChunks":
        """The same with a change of the head and of every chunk."""
        return replace(self._changed(change), chunks=map(change, self.chunks))

    def _changed(self, change: Callable[[Estimate], Estimate]) -> "EstimateChunks":
        closed = self.closed
        return replace(self, head=change(self.head), closed=None if closed is None else lambda: change(closed()))

    def whole(self) -> Estimate:
        """All chunks together, in memory."""
        chunks = list(self.chunks)
        head = self.closed() if self.closed is not None else self.head
        cameras = [one.camera for one in chunks if one.camera is not None]
        return replace(
            head,
            wearers=tuple(
                _joined_wearer(*own) for own in zip(head.wearers, *(one.wearers for one in chunks), strict=True)
            ),
            camera=None if head.camera is None else _joined_camera(head.camera, cameras),
            reports=(*head.reports, *(report for one in chunks for report in one.reports)),
        )


def _joined_wearer(head: WearerEstimate, *chunks: WearerEstimate) -> WearerEstimate:
    R, p = (
        np.concatenate([getattr(one.motion, name) for one in chunks]) for name in ("R_parent_child", "p_world_pelvis")
    )
    covariances = [one.covariance for one in chunks if one.covariance is not None]
    known = len(covariances) == len(chunks)
    joints, root = ([getattr(one, name) for one in covariances] for name in ("joints", "root"))
    return replace(
        head,
        motion=replace(head.motion, R_parent_child=R, p_world_pelvis=p),
        covariance=PoseCovariance(np.concatenate(joints), np.concatenate(root)) if known else None,
        residuals={kind: np.concatenate([one.residuals[kind] for one in chunks]) for kind in head.residuals},
        reports=(*head.reports, *(report for one in chunks for report in one.reports)),
    )


def _joined_camera(head: CameraEstimate, chunks: Sequence[CameraEstimate]) -> CameraEstimate:
    paths = [one.path for one in chunks]
    covariances = [one.covariance for one in chunks if one.covariance is not None]
    residuals = [one.residual_px for one in chunks if one.residual_px is not None]
    moves = any(len(one) > 1 for one in paths)
    together = [np.concatenate([getattr(one, name) for one in paths]) for name in vars(head.path)]
    return replace(
        head,
        path=CameraPath(*together) if moves else paths[0],
        covariance=np.concatenate(covariances) if moves and len(covariances) == len(chunks) else chunks[0].covariance,
        residual_px=np.concatenate(residuals) if len(residuals) == len(chunks) else None,
    )
