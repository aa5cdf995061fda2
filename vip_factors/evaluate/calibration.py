"""Errors of headings, mountings, lengths, knees and the camera, and whether reported covariances are honest.

Nobody publishes errors of headings and mountings: the definitions are ours.

Honesty is the normalised estimation error squared (NEES), over its dimension: 1 is honest, below it the estimator is
too modest, above it too sure of itself. Bar-Shalom, Li, Kirubarajan, "Estimation with Applications to Tracking and
Navigation", section 5.4.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.body.lengths import LENGTHS, LIMB_ENDS, WIDTHS, lengths_of, width
from vip_factors.body.skeleton import Skeleton, joint_index
from vip_factors.errors import InputError
from vip_factors.estimate import BodyEstimate, PoseCovariance
from vip_factors.evaluate.metrics import EVERYTHING, MM, TIME_TOLERANCE, Compared, Metric
from vip_factors.geometry.poses import Alignment
from vip_factors.geometry.rotations import Array, log, transpose, wrap_angle
from vip_factors.sensors.calibration import Calibration
from vip_factors.sensors.camera import CameraPath, PathPair, move_path


@dataclass(frozen=True)
class CalibrationError:
    """Per sensor, estimate minus truth.

    Attributes:
        heading: radians, wrapped, the common yaw of all sensors removed.
        mounting: ``(3,)`` rad by sensor: ``R_true = R_estimated Exp(error)``, so about the sensor's axes.
    """

    heading: Mapping[str, float]
    mounting: Mapping[str, Array]

    @property
    def heading_magnitude(self) -> Array:
        """Absolute heading errors ``(S,)`` in radians."""
        return np.abs(np.array(list(self.heading.values())))

    @property
    def mounting_magnitude(self) -> Array:
        """Geodesic mounting errors ``(S,)`` in radians."""
        return np.linalg.norm(np.array(list(self.mounting.values())), axis=-1)


CalibrationPair = tuple[CalibrationError, Calibration]
"""Errors, and the estimate that they are of."""


def calibration_error(estimate: Calibration, truth: Calibration, gauge: float | None = None) -> CalibrationError:
    """Errors of the sensors that both know.

    Where the estimate's world is turned by a yaw g against the true one, every heading is g larger and no
    measurement can tell; g is ``gauge`` if given (that of a whole scene), else the circular mean of the differences.

    Raises:
        InputError: if they share no sensor.
    """
    sensors = [name for name in estimate if name in truth]
    if not sensors:
        raise InputError(f"calibrations share no sensor: estimated {sorted(estimate)}, true {sorted(truth)}")
    difference = np.array([estimate[name].heading - truth[name].heading for name in sensors])
    gauge = float(np.angle(np.exp(1j * difference).sum())) if gauge is None else gauge
    heading = wrap_angle(difference - gauge)
    R_estimated, R_true = (np.stack([side[name].R_bone_sensor for name in sensors]) for side in (estimate, truth))
    mounting = log(transpose(R_estimated) @ R_true)
    return CalibrationError(
        dict(zip(sensors, heading.tolist(), strict=True)), dict(zip(sensors, mounting, strict=True))
    )


def nees(error: Array, covariance: Array) -> Array:
    """``eᵀ P⁻¹ e / d`` of errors ``(..., d)`` under ``(..., d, d)``; NaN where the covariance is not positive."""
    shape, d = error.shape[:-1], error.shape[-1]
    e, P = error.reshape(-1, d), covariance.reshape(-1, d, d)
    result = np.full(len(e), np.nan)
    usable = np.all(np.isfinite(P), axis=(1, 2)) & np.all(np.isfinite(e), axis=1)
    usable[usable] = np.linalg.eigvalsh(P[usable])[:, 0] > 0
    solved = np.linalg.solve(P[usable], e[usable][..., None])[..., 0]
    result[usable] = np.sum(e[usable] * solved, axis=-1) / d
    return result.reshape(shape)


def joint_nees(estimate: Motion, truth: Motion, covariance: PoseCovariance) -> Array:
    """NEES of every joint rotation, ``(T, 24)``: ``R_true = R_estimated Exp(e)``, ``e ~ N(0, P)``."""
    if len(covariance.joints) != len(estimate):
        raise InputError(
            f"covariance of {len(covariance.joints)} frames for a motion of {len(estimate)}: expected one each"
        )
    return nees(log(transpose(estimate.R_parent_child) @ truth.R_parent_child), covariance.joints)


def surest_heading(pairs: Mapping[int, CalibrationPair]) -> tuple[int, str] | None:
    """Whose sensor is surest of its heading: the one that carries the gauge prior, which is far tighter
    than any measurement. None if no sigma is known.
    """
    sigmas = {
        (index, name): calibration[name].heading_sigma
        for index, (error, calibration) in pairs.items()
        for name in error.heading
        if np.isfinite(calibration[name].heading_sigma)
    }
    return min(sigmas, key=lambda key: sigmas[key]) if sigmas else None


def sensor_consistency(pairs: Mapping[int, CalibrationPair], anchor: tuple[int, str] | None) -> dict[str, Metric]:
    """NEES of headings and mountings of some wearers together.

    Headings are judged against that of the anchor (:func:`surest_heading`), which defines the estimate's world and is
    left out; as they are if it is None. The three axes of a mounting are taken as independent.
    """
    shift = 0.0 if anchor is None else pairs[anchor[0]][0].heading[anchor[1]]
    headings, mountings = [np.zeros(0)], [np.zeros(0)]
    for index, (error, calibration) in pairs.items():
        names = [name for name in error.heading if (index, name) != anchor]
        heading = wrap_angle(np.array([error.heading[name] for name in names]) - shift)
        heading_sigma = np.array([calibration[name].heading_sigma for name in names])
        headings.append(nees(heading[:, None], (heading_sigma**2)[:, None, None]))
        sigma = np.stack([np.broadcast_to(calibration[name].mounting_sigma, 3) for name in error.mounting])
        mountings.append(nees(np.stack(list(error.mounting.values())), (sigma**2)[..., None] * np.eye(3)))
    table = consistency_metrics("heading", np.concatenate(headings))
    return table | consistency_metrics("mounting", np.concatenate(mountings))


def error_metrics(errors: list[CalibrationError]) -> dict[str, Metric]:
    """Headings and mountings of all sensors in several calibrations together; empty if there is none."""
    errors = [error for error in errors if error.heading]
    if not errors:
        return {}
    table: dict[str, Metric] = {}
    for name, values in (
        ("heading_error", np.concatenate([error.heading_magnitude for error in errors])),
        ("mounting_error", np.concatenate([error.mounting_magnitude for error in errors])),
    ):
        degrees = np.rad2deg(values)
        table[name] = Metric(float(degrees.mean()), "deg")
        table[f"{name}_95th"] = Metric(float(np.quantile(degrees, 0.95)), "deg")
    return table


def consistency_metrics(name: str, values: Array) -> dict[str, Metric]:
    """Mean of those NEES values that are known; empty if none is."""
    finite = values[np.isfinite(values)]
    return {f"nees_{name}": Metric(float(finite.mean()), "")} if len(finite) else {}


def common_instants(estimate: CameraPath, truth: CameraPath) -> tuple[CameraPath, CameraPath, np.ndarray]:
    """Both paths at the instants of the coarser one, as far as they overlap, so that least is interpolated.

    Returns:
        The estimate, the truth, and which instants of the estimate (the nearest ones) those are.

    Raises:
        InputError: if they share no time.
    """
    time = truth.time if _spacing(truth) > _spacing(estimate) else estimate.time
    for path in (estimate, truth):
        if len(path) > 1:  # one instant stands for all times
            time = time[(time >= path.time[0] - TIME_TOLERANCE) & (time <= path.time[-1] + TIME_TOLERANCE)]
    if not len(time):
        raise InputError(
            f"camera path ({estimate.time[0]:.3f} to {estimate.time[-1]:.3f} s) and its truth ({truth.time[0]:.3f} to "
            f"{truth.time[-1]:.3f} s) share no time: check that both use the recording's clock"
        )
    next_instant = np.clip(np.searchsorted(estimate.time, time), 1, max(len(estimate) - 1, 1))
    nearest = next_instant - (
        time - estimate.time[next_instant - 1] < estimate.time[next_instant % len(estimate)] - time
    )
    return estimate.at(time), truth.at(time), nearest if len(estimate) > 1 else np.zeros(len(time), int)


def _spacing(path: CameraPath) -> float:
    """Seconds between instants (median); −1 for a camera that stands still, whose instant is no sample in time."""
    return float(np.median(np.diff(path.time))) if len(path) > 1 else -1.0


def camera_error(pair: PathPair, gauge: Alignment) -> Array:
    """Errors ``(T, 6)`` of an estimated path, moved into the true world by the gauge, against the true one.

    ``T_true = T_estimated Exp(e)`` to first order: rotation (rad), then translation (m), both in the estimated camera's
    axes.
    """
    moved, truth = move_path(pair[0], gauge), pair[1]
    R_camera_world = transpose(moved.R_world_camera)
    rotation = log(R_camera_world @ truth.R_world_camera)
    translation = np.einsum("tij,tj->ti", R_camera_world, truth.p_world_camera - moved.p_world_camera)
    return np.concatenate([rotation, translation], axis=1)


LIMBS = {name: end for name, end in LIMB_ENDS.items() if name != "foot"}
UNSURE = ("hand",)  # reported, but not in the mean: skeletons end hands where they like
_ENDS = {name: (f"left_{end}", f"right_{end}") for name, end in (LIMBS | WIDTHS).items()} | {"trunk": ("neck",)}


def compared_lengths(skeleton: Skeleton) -> dict[str, float]:
    """Metres by name: limbs as the mean of both sides, widths between joints, trunk from mid hip to neck."""
    p_rest = skeleton.p_pelvis_joint
    hips = (p_rest[joint_index("left_hip")] + p_rest[joint_index("right_hip")]) / 2
    limbs = {
        name: (skeleton.bone_length(f"left_{end}") + skeleton.bone_length(f"right_{end}")) / 2
        for name, end in LIMBS.items()
    }
    widths = {name: width(skeleton, joint) for name, joint in WIDTHS.items()}
    return {**limbs, **widths, "trunk": float(np.linalg.norm(p_rest[joint_index("neck")] - hips))}


def length_table(skeleton: Skeleton, truth: Skeleton, compared: Compared = EVERYTHING) -> dict[str, dict[str, float]]:
    """Per length: ``estimate_mm``, ``truth_mm`` and ``error_mm`` (positive: found too long).

    A truth that does not know how a limb moved has its length from a table, and it is left out.
    """
    estimated, true = compared_lengths(skeleton), compared_lengths(truth)
    return {
        name: {
            "estimate_mm": MM * estimated[name],
            "truth_mm": MM * true[name],
            "error_mm": MM * (estimated[name] - true[name]),
        }
        for name in true
        if compared.positions(_ENDS[name])
    }


def body_metrics(
    lengths: Mapping[str, Mapping[str, float]],
    body: BodyEstimate | None,
    truth: Skeleton,
) -> dict[str, Metric]:
    """Mean error of lengths (of :func:`length_table`), and whether an estimated body is honest."""
    off = [abs(row["error_mm"]) for name, row in lengths.items() if name not in UNSURE]
    table = {"length_error": Metric(float(np.mean(off)), "mm")}
    if body is None:
        return table
    true = dict(zip(LENGTHS, lengths_of(truth), strict=True))
    names = [name for name in (*LIMBS, *WIDTHS) if name in lengths and name not in UNSURE and name in body.names]
    places = [body.names.index(name) for name in names]
    error = np.array([true[name] for name in names]) - body.posterior[places]
    return table | consistency_metrics("lengths", nees(error[:, None], body.sigma[places, None, None] ** 2))
