"""Results of the estimators: motion, calibration, uncertainty and solver reports. Plain data."""

import csv
import io
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from vip_factors.body.joint_angles import JointAngles, joint_angle_sigmas, joint_angles
from vip_factors.body.joint_priors import HingeEstimate
from vip_factors.body.kinematics import Motion
from vip_factors.body.model_errors import FILMED, LENGTH, UNFILMED, ModelErrors, shape_factor
from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.display import Summarised, described
from vip_factors.errors import InputError
from vip_factors.findings import Finding, Verdict, verdict
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.calibration import Calibration, SensorCalibration
from vip_factors.sensors.camera import CameraModel, CameraPath, VideoClock
from vip_factors.sensors.scene import Camera, Scene
from vip_factors.solve.levenberg_marquardt import SolveReport

if TYPE_CHECKING:
    import pandas
    import xarray

TABLES = ("positions", "angles")  # of an estimate as columns
KEPT = 0.8  # of the prior's standard deviation: what is no surer than this was hardly measured


@dataclass(frozen=True, repr=False)
class PoseCovariance(Summarised):
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


@dataclass(frozen=True, repr=False)
class BodyEstimate(Summarised):
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
        """Whether the data hardly determined each length, ``(B,)``."""
        return np.diag(self.covariance) > KEPT**2 * np.diag(self.prior_covariance)


@dataclass(frozen=True)
class SensorPlaceEstimate:
    """Estimated position of a sensor on its bone; ``(3,)`` metres each, bone axes.

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


@dataclass(frozen=True, repr=False)
class DetectorEstimate(Summarised):
    """Offsets of a detector's keypoints from their nominal positions.

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
        hypothesis: what it supposes, in words.
        rival: what the likeliest start supposes that turns a sensor by more than 60° against it; empty without one.
        margin: nats by which that is less likely; infinite without one.
        doubtful: names of the sensors that starts turn which are nearly as likely.
    """

    hypothesis: str
    rival: str = ""
    margin: float = math.inf
    doubtful: tuple[str, ...] = ()


@dataclass(frozen=True, repr=False)
class WearerEstimate(Summarised):
    """Estimate of one wearer.

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
        sensor_positions: of the sensors used; none if they were held.
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
    sensor_positions: tuple[SensorPlaceEstimate, ...] = ()
    findings: tuple[Finding, ...] = ()
    start: StartChoice | None = None

    def summary(self) -> list[str]:
        """Whose motion, how long, and from what."""
        motion = self.motion
        return [
            f"{motion.name}",
            f"motion: {len(motion)} frames at {motion.rate:g} Hz, {len(motion) / motion.rate:.1f} s",
            f"method: {self.method}, from {len(self.sensors)} sensors",
            f"standard deviations: {'none: made with covariance=False' if self.covariance is None else 'in it'}",
        ]

    def joint_angles(self) -> JointAngles:
        """Joint angles in degrees, after the International Society of Biomechanics."""
        return joint_angles(self.motion)

    def positions(self) -> Array:
        """Positions of the joints ``(T, 24, 3)`` in metres in the world (z up), ordered as ``JOINT_NAMES``."""
        return self.motion.state.p_world_joint

    def frames(self, which: slice) -> "WearerEstimate":
        """The estimate of some consecutive frames; what all frames share is as it was."""
        return replace(
            self,
            motion=self.motion.frames(which),
            covariance=None if self.covariance is None else self.covariance.frames(which),
            residuals={kind: values[which] for kind, values in self.residuals.items()},
        )


@dataclass(frozen=True, repr=False)
class CameraEstimate(Summarised):
    """Estimate of one camera.

    Attributes:
        name: of the camera.
        model: its intrinsics.
        path: its poses, at the frames of the motions (one instant if it stood still).
        calibration: heading and mounting (``R_camera_imu``) of the IMU on it, if it has one.
        covariance: ``(T, 6, 6)`` on request, of right perturbations of ``T_world_camera``: rotation, then translation
            in the camera's axes; rad and m.
        residual_px: ``(T, wearers)`` root mean square reprojection error of each wearer in pixels, NaN where unseen.
        clock: what lies between the video's clock and the IMUs'.
        clock_sigma: standard deviations of the offset, in the recording's middle, and of the drift; None where kept.
        focal_sigma: standard deviation of the focal length's logarithm; None of a calibrated lens.
        wearer_of_detection: ``(N,)`` index of the wearer of each detection of the camera, −1 for nobody; empty if
            unknown.
    """

    name: str
    model: CameraModel
    path: CameraPath
    calibration: SensorCalibration | None = None
    covariance: Array | None = None
    residual_px: Array | None = None
    clock: VideoClock = field(default_factory=VideoClock)
    clock_sigma: tuple[float, float] | None = None
    focal_sigma: float | None = None
    wearer_of_detection: np.ndarray = field(default_factory=lambda: np.zeros(0, int))

    def frames(self, which: slice) -> "CameraEstimate":
        """The estimate at some consecutive frames, with all labels; a static camera has its one pose."""
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


@dataclass(frozen=True, repr=False)
class Estimate(Summarised):
    """Estimate of one or several wearers, in one world if a camera saw them.

    Attributes:
        name: of the recording.
        method: name of the variant (``"VIP"``, ``"SIP"`` …).
        wearers: one estimate each, in the recording's order.
        cameras: those that show a wearer, in the recording's order.
        reports: of the solves over all wearers, in order.
        findings: what is odd or not determined: to be shown to the user.
        settings: the effective settings, flattened to text.
        detector: where it puts its keypoints; None if that was not looked for.
        association: sentences about the evidence for identities in the first camera's picture, one of each wearer.
    """

    name: str
    method: str
    wearers: tuple[WearerEstimate, ...]
    cameras: tuple[CameraEstimate, ...] = ()
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
        """Findings of the scene and its wearers, each once, and one if the last stage did not converge."""
        findings = [*self.findings, *(finding for wearer in self.wearers for finding in wearer.findings)]
        # What follows a comma in a stage's name is its window.
        stages = [(report.stage.partition(",")[0], report.converged) for report in self.all_reports]
        if stages and (stages[-1][0], False) in stages:
            findings.append(Finding("not converged", subject=stages[-1][0]))
        return tuple(dict.fromkeys(findings))

    @property
    def all_reports(self) -> tuple[SolveReport, ...]:
        """Solver reports of the wearers, then of the scene."""
        return (*(report for wearer in self.wearers for report in wearer.reports), *self.reports)

    @property
    def verdict(self) -> Verdict:
        """Whether to rely on it."""
        return verdict(self.all_findings)

    @property
    def is_plain(self) -> bool:
        """Whether it says nothing beyond the estimate of its only wearer."""
        if len(self.wearers) != 1 or self.cameras or self.detector is not None:
            return False
        words, plain = (
            (estimate.name, estimate.method, estimate.findings, dict(estimate.settings))
            for estimate in (self, Estimate.of_one(self.wearers[0]))
        )
        return words == plain and not (self.reports or self.association)

    @property
    def camera(self) -> CameraEstimate | None:
        """The first camera, the only one of most estimates; None without any."""
        return self.cameras[0] if self.cameras else None

    def wearer(self, name: str | None = None) -> WearerEstimate:
        """The estimate of the wearer of a name, or of the only one.

        Raises:
            InputError: if there is none of that name, or no name is given and there are several.
        """
        wearers = [wearer for wearer in self.wearers if name is None or wearer.motion.name == name]
        if len(wearers) != 1:
            names = ", ".join(f"'{wearer.motion.name}'" for wearer in self.wearers) or "none"
            asked = "one" if name is None else f"'{name}'"
            raise InputError(f"estimate '{self.name}' has {len(self.wearers)} wearers ({names}): expected {asked}")
        return wearers[0]

    def summary(self) -> list[str]:
        """Verdict and findings, and each wearer in a line."""
        wearers = (f"{wearer.motion.name}: {', '.join(wearer.summary()[1:3])}" for wearer in self.wearers)
        findings = (f"{finding.severity}: {finding}" for finding in self.all_findings)
        return [f"estimate '{self.name}', {self.method}", *wearers, f"verdict: {self.verdict}", *findings]

    def joint_angles(self, wearer: str | None = None) -> JointAngles:
        """Joint angles of a wearer (the only one, without a name) in degrees, after the International Society of
        Biomechanics.
        """
        return self.wearer(wearer).joint_angles()

    def positions(self, wearer: str | None = None) -> Array:
        """Positions of a wearer's joints ``(T, 24, 3)`` in metres in the world (z up), ordered as ``JOINT_NAMES``."""
        return self.wearer(wearer).positions()

    def columns(self, wearer: str | None = None, tables: Collection[str] = TABLES) -> dict[str, Array]:
        """A wearer as columns ``(T,)`` of a table: ``time_s``, positions ``…_x_m`` and joint angles ``…_deg``.

        Standard deviations (``…_sd_m``, ``…_sd_deg``) follow where there are any; ``…_shape_sd_deg`` is what is left of
        an angle's once its mean, where its zero lies, is removed.
        """
        estimate = self.wearer(wearer)
        columns = {"time_s": estimate.motion.time}
        if "positions" in tables:
            columns |= _position_columns(estimate, FILMED if self.cameras else UNFILMED)
        return columns | (_angle_columns(estimate) if "angles" in tables else {})

    def to_dataframe(self, wearer: str | None = None) -> "pandas.DataFrame":
        """The columns of :meth:`columns` as a pandas table over ``time_s``; of several wearers, over ``wearer`` too.

        Raises:
            InputError: without pandas.
        """
        pandas = _package("pandas")
        names = [wearer_estimate.motion.name for wearer_estimate in self.wearers] if wearer is None else [wearer]
        frames = {name: pandas.DataFrame(self.columns(name)).set_index("time_s") for name in names}
        return frames[names[0]] if len(names) == 1 else pandas.concat(frames, names=["wearer"])

    def to_xarray(self) -> "xarray.Dataset":
        """All wearers as a dataset of poses, with the dimensions of ``movement``: time, space, keypoints, individuals.

        ``position`` is in metres, ``confidence`` is not known (NaN), ``joint_angle`` (time, angles, individuals) in
        degrees. Wearers whom no camera saw together have times of their own, at which the others are NaN.

        Raises:
            InputError: without xarray.
        """
        xarray = _package("xarray")
        datasets = []
        for wearer in self.wearers:
            angles, p = wearer.joint_angles(), wearer.positions()
            coordinates = {
                "time": wearer.motion.time,
                "space": list("xyz"),
                "keypoints": list(JOINT_NAMES),
                "individuals": [wearer.motion.name],
                "angles": list(angles.names),
            }
            variables = {
                "position": (("time", "space", "keypoints", "individuals"), p.swapaxes(1, 2)[..., None]),
                "confidence": (("time", "keypoints", "individuals"), np.full((*p.shape[:2], 1), np.nan)),
                "joint_angle": (("time", "angles", "individuals"), angles.degrees[..., None]),
            }
            datasets.append(xarray.Dataset(variables, coordinates))
        dataset = xarray.concat(datasets, "individuals", join="outer")
        fps = self.wearers[0].motion.rate
        return dataset.assign_attrs(fps=fps, time_unit="seconds", source_software="vip_factors", ds_type="poses")


def camera_pairs(scene: Scene, estimate: Estimate) -> list[tuple[Camera, CameraEstimate]]:
    """Each camera that shows a wearer and its estimate, by name; where both have one camera, it whatever its names."""
    if len(scene.cameras) == len(estimate.cameras) == 1:
        return [(scene.cameras[0], estimate.cameras[0])]
    estimates = {camera.name: camera for camera in estimate.cameras}
    return [(camera, estimates[camera.name]) for camera in scene.cameras if camera.name in estimates]


Moved = Motion | WearerEstimate | Estimate
"""What moves: an estimate, that of one wearer, or a motion by itself."""


def as_estimate(moved: Moved) -> Estimate:
    """The estimate itself, or that of one wearer or of a motion.

    Raises:
        InputError: for anything else.
    """
    if isinstance(moved, Motion):
        moved = WearerEstimate(moved.name, "motion", moved, {})
    if not isinstance(moved, WearerEstimate | Estimate):
        raise InputError(f"{described(moved)}: expected an estimate, as vip.smooth makes, or vip.read_estimate reads")
    return moved if isinstance(moved, Estimate) else Estimate.of_one(moved)


def dataframe(rows: Iterable[Sequence[object]]) -> "pandas.DataFrame":
    """A pandas table of a CSV file's rows, the first the columns' names; an :class:`InputError` without pandas."""
    pandas, file = _package("pandas"), io.StringIO()
    csv.writer(file).writerows(rows)
    file.seek(0)
    return pandas.read_csv(file, keep_default_na=False, na_values=[""])


def _package(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError as error:
        raise InputError(f"{name} is not installed: pip install 'vip-factors[tables]'") from error


def _position_columns(wearer: WearerEstimate, errors: ModelErrors) -> dict[str, Array]:
    p, places = wearer.positions(), list(np.ndindex(len(JOINT_NAMES), 3))
    columns = {f"{JOINT_NAMES[j]}_{'xyz'[k]}_m": p[:, j, k] for j, k in places}
    if wearer.covariance is not None:
        root = np.diagonal(wearer.covariance.root, axis1=1, axis2=2)[:, None]
        bones = {calibration.bone for calibration in wearer.calibration.values()}
        sigma = np.sqrt(root + errors.positions(bones)[:, None] ** 2)
        columns |= {f"{JOINT_NAMES[j]}_{'xyz'[k]}_sd_m": sigma[:, j, k] for j, k in places}
    return columns


def _angle_columns(wearer: WearerEstimate) -> dict[str, Array]:
    angles = wearer.joint_angles()
    columns = {f"{name}_deg": values for name, values in zip(angles.names, angles.degrees.T, strict=True)}
    if wearer.covariance is not None:
        sigmas = joint_angle_sigmas(wearer.motion, wearer.covariance.joints).T
        for angle, values in zip(angles.definitions, sigmas, strict=True):
            if np.isfinite(values).all():
                shape = shape_factor(angle.joint) * values
                columns |= {f"{angle.name}_sd_deg": values, f"{angle.name}_shape_sd_deg": shape}
    return columns
