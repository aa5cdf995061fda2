"""Facts about estimates: results, uncertainty and computation."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from vip_factors.body.joint_priors import HingeEstimate
from vip_factors.body.lengths import stature_of
from vip_factors.body.skeleton import JOINT_NAMES, LIMBS, joint_index
from vip_factors.describe.recordings import clock_rows, image_text, motion_facts, path_text
from vip_factors.estimate import (
    BodyEstimate,
    CameraEstimate,
    DetectorEstimate,
    Estimate,
    SensorPlaceEstimate,
    SolveReport,
    StartChoice,
    WearerEstimate,
)
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import Array, angle_between, wrap_angle
from vip_factors.sensors.calibration import SensorCalibration
from vip_factors.sensors.recording import Recording
from vip_factors.tables import MM, UNKNOWN, Cell, Quantity, Row, Table, bone_words, degrees, facts, joint_words

RESIDUALS = {"orientation_deg": ("orientation", "°"), "acceleration_m_s2": ("acceleration", "m/s²")}
# Joints of the limbs; the spine's joints share one bend and are less certain individually.
LIMB_JOINTS = tuple(
    joint_index(f"{side}_{bone}") for side in ("left", "right") for bone in (*LIMBS["legs"][:3], *LIMBS["arms"][1:4])
)


def figure_table(estimate: Estimate) -> Table:
    """Table of the main figures, each with a remark."""
    wearers = estimate.wearers
    motion, sensors = wearers[0].motion, sum(len(wearer.sensors) for wearer in wearers)
    duration = Quantity(len(motion) / motion.rate, unit="s", decimals=1)
    rows: list[Row] = [
        ("duration", duration, f"{len(motion)} frames at {motion.rate:g} Hz"),
        ("people", str(len(wearers)), f"{sensors} sensors in all"),
    ]
    sigma = limb_sigma(wearers)
    if math.isfinite(sigma):
        remark = (
            "uncertainty of the mountings not included" if mountings_are_held(wearers) else "one standard deviation"
        )
        rows.append(("joint angles", f"± {degrees(sigma)}", f"typical of the limbs; {remark}"))
    residuals = [wearer.residuals.get("orientation_deg", np.zeros(0)).ravel() for wearer in wearers]
    median = finite_quantile(np.concatenate(residuals), 0.5)
    if math.isfinite(median):
        rows.append(("fit to the sensors", Quantity(median, unit="°", decimals=1), "median difference of orientation"))
    for camera in estimate.cameras:
        median = math.nan if camera.residual_px is None else finite_quantile(camera.residual_px, 0.5)
        share = f"{100 * median / camera.model.height:.1f} % of the image's height"
        label = f"fit to the video, {camera.name}" if len(estimate.cameras) > 1 else "fit to the video"
        rows += [(label, Quantity(median, unit="px"), share)] if math.isfinite(median) else []
    if len(wearers) == 1:
        is_fitted = wearers[0].body is not None and len(wearers[0].body.names) > 0
        remark = "lengths fitted to the video" if is_fitted else "lengths not measured here"
        rows.append(("stature of the body", Quantity(stature_of(motion.skeleton), unit="m", decimals=2), remark))
    return Table((), rows, words=3)


def limb_sigma(wearers: Sequence[WearerEstimate]) -> float:
    """Median standard deviation of the measured limbs' joint rotations in radians; NaN without covariances."""
    sigmas = [
        wearer.covariance.joint_sigma[:, measured_limb_joints(wearer)].ravel()
        for wearer in wearers
        if wearer.covariance
    ]
    return finite_quantile(np.concatenate([*sigmas, np.zeros(0)]), 0.5)


def measured_limb_joints(wearer: WearerEstimate) -> list[int]:
    """Joints of the limbs whose bone has a sensor; all limb joints if none has."""
    bones = {sensor.bone for sensor in wearer.calibration.values()}
    return [joint for joint in LIMB_JOINTS if JOINT_NAMES[joint] in bones] or list(LIMB_JOINTS)


def mountings_are_held(wearers: Sequence[WearerEstimate]) -> bool:
    """True if the uncertainties of the poses assume exact mountings."""
    sigmas = [sensor.heading_sigma for wearer in wearers for sensor in wearer.calibration.values()]
    return bool(sigmas) and not np.isfinite(sigmas).any()


def finite_quantile(values: Array, share: float) -> float:
    """Quantile of the finite values; NaN without any."""
    finite = values[np.isfinite(values)]
    return float(np.quantile(finite, share)) if len(finite) else math.nan


def wearer_facts(wearer: WearerEstimate) -> Table:
    """Table of a wearer's motion, body, start of the reconstruction and residuals."""
    rows: list[Row] = [*motion_facts(wearer.motion).rows, *_start_rows(wearer.start)]
    rows.append(("standard deviations", "yes" if wearer.covariance is not None else "no"))
    for kind, values in wearer.residuals.items():
        name, unit = RESIDUALS.get(kind, (kind, ""))
        half, p95 = (Quantity(finite_quantile(values, share), unit=unit, decimals=2) for share in (0.5, 0.95))
        rows.append((f"difference of {name}", f"{half} (median), 95 % below {p95}"))
    return facts(f"wearer '{wearer.motion.name or wearer.name}'", *rows)


def _start_rows(start: StartChoice | None) -> list[Row]:
    """Rows of the chosen start and its most likely alternative."""
    if start is None:
        return []
    rows: list[Row] = [("start", start.hypothesis)]
    if start.rival:
        largest = 7.0  # nats: a thousand times
        times = f"{math.exp(start.margin):.1f}" if start.margin < largest else f"{math.exp(largest):.0f} or more"
        rows.append(("another start", f"{start.rival}: {times} times less likely, turns a sensor by more than 60°"))
    if start.doubtful:
        rows.append(("not settled", ", ".join(start.doubtful)))
    return rows


def length_table(body: BodyEstimate | None) -> Table:
    """Table of prior and estimated lengths of the body."""
    rows: list[Row] = []
    if body is not None:
        values = (MM * array for array in (body.prior, body.prior_sigma, body.posterior, body.sigma))
        for name, keeps, prior, prior_sigma, length, sigma in zip(body.names, body.keeps_prior, *values, strict=True):
            word = "keeps what was likely" if keeps else "measured"
            rows.append((name, Quantity(prior, prior_sigma), Quantity(length, sigma), Quantity(length - prior), word))
    return Table(("length, mm", "likely before", "found", "change", ""), rows)


def hinge_table(body: BodyEstimate | None) -> Table:
    """Table of prior and estimated carrying angles of elbows and knees."""

    def carrying(hinge: HingeEstimate | None) -> Cell:
        return UNKNOWN if hinge is None else degrees(hinge.carrying_angle, hinge.carrying_sigma)

    prior = {} if body is None else {hinge.joint: hinge for hinge in body.prior_hinges}
    hinges = () if body is None else body.hinges
    rows = [(joint_words(hinge.joint), carrying(prior.get(hinge.joint)), carrying(hinge)) for hinge in hinges]
    return Table(("carrying angle", "likely before", "found"), rows)


def calibration_table(wearer: WearerEstimate, recording: Recording | None = None) -> Table:
    """Table of headings and mountings; mountings are relative to the sites if the recording is given, else absolute."""
    sites = {} if recording is None else {site.sensor: site for site in recording.placement.sites}
    bones = {place.sensor: place.bone for place in wearer.sensor_positions}  # older files
    rows = []
    for name, sensor in wearer.calibration.items():
        site, bone = sites.get(name), sensor.bone or bones.get(name, "")
        mounting = quaternion_text(sensor.R_bone_sensor)
        if recording is not None:
            turn = math.nan if site is None else float(angle_between(site.R_bone_sensor, sensor.R_bone_sensor))
            mounting = str(degrees(turn))
        where = bone_words(bone if site is None else site.bone) or UNKNOWN
        path = np.rad2deg(sensor.heading_path)
        drift = f"{path[-1] - path[0]:+z.1f}°" if len(path) else UNKNOWN
        rows.append((name, where, heading_text(sensor), drift, mounting, _mounting_sigma_text(sensor)))
    turned = "mounting, wxyz" if recording is None else "turned against its site"
    return Table(("sensor", "on", "heading", "drift to the end", turned, "known to"), rows, words=2)


def quaternion_text(R: Array) -> str:
    """Format a rotation ``(3, 3)`` as quaternion w, x, y, z."""
    return " ".join(f"{value:z.3f}" for value in quaternion_from_matrix(R, Order.WXYZ))


def heading_text(sensor: SensorCalibration) -> str:
    """Format the heading of a sensor, within half a turn."""
    gauge_sigma = np.deg2rad(0.15)  # only a heading with a gauge prior is as certain
    heading = float(wrap_angle(sensor.heading))
    if math.isfinite(sensor.heading_sigma) and sensor.heading_sigma <= gauge_sigma:
        return f"{degrees(heading)}, by convention"
    return str(degrees(heading, sensor.heading_sigma))


def _mounting_sigma_text(sensor: SensorCalibration) -> str:
    sigma = np.rad2deg(sensor.mounting_sigma)
    return f"± {sigma.max():.1f}°" if np.isfinite(sigma).all() else "unknown"


LEFT, UP, FORWARD = 0, 1, 2  # bone axes


def place_table(wearer: WearerEstimate) -> Table:
    """Table of estimated and prior positions of the sensors on their bones."""
    rows: list[Row] = []
    for position in wearer.sensor_positions:
        coordinates = [_with_prior(position, axis) for axis in (LEFT, UP, FORWARD)]
        rows.append((position.sensor, bone_words(position.bone), *coordinates))
    title = "sensors' places on their bones, mm from the joint (supposed)"
    return Table(("sensor", "on", "left", "up", "forward"), rows, title, words=2, is_detail=True)


def detector_table(detector: DetectorEstimate | None) -> Table:
    """Table of a detector's keypoint offsets of the left side."""
    rows: list[Row] = []
    if detector is not None:
        for number, name in enumerate(detector.keypoints):
            rows.append((name, *(_with_prior(detector, (number, axis)) for axis in (FORWARD, UP, LEFT))))
    title = "keypoints' offsets from the joint centres, mm (supposed)"
    return Table(("keypoint", "forward", "up", "outward"), rows, title, is_detail=True)


def _with_prior(estimate: SensorPlaceEstimate | DetectorEstimate, index: int | tuple[int, int]) -> str:
    """Format one coordinate, with its prior in brackets."""
    value, sigma, prior, prior_sigma = (
        MM * float(array[index]) for array in (estimate.posterior, estimate.sigma, estimate.prior, estimate.prior_sigma)
    )
    return f"{Quantity(value, sigma)} ({Quantity(prior, prior_sigma)})"


def residual_table(wearer: WearerEstimate) -> Table:
    """Table of residuals by sensor."""
    residuals = [wearer.residuals.get(kind, np.zeros((0, len(wearer.sensors)))) for kind in RESIDUALS]
    rows: list[Row] = []
    for column, sensor in enumerate(wearer.sensors if any(values.size for values in residuals) else ()):
        cells: list[Cell] = [sensor]
        for values in residuals:
            shares = (finite_quantile(values[:, column], share) for share in (0.5, 0.95, 1.0))
            cells += [Quantity(value, decimals=decimals) for value, decimals in zip(shares, (2, 2, 1), strict=True)]
        rows.append(cells)
    head = ["sensor"]
    for name, unit in RESIDUALS.values():
        head += [f"{name}, {unit}: median", "95 % below", "largest"]
    return Table(head, rows)


def camera_estimate_facts(camera: CameraEstimate) -> Table:
    """Table of a camera's path, IMU and clock."""
    rows: list[Row] = [("path", path_text(camera.path.p_world_camera))]
    if camera.focal_sigma is not None:
        rows.append(("image", image_text(camera.model, camera.focal_sigma)))
    if camera.covariance is not None:
        variance = np.diagonal(camera.covariance, axis1=1, axis2=2)
        turn = np.sqrt(np.median(variance[:, :3].max(axis=1)))
        shift = Quantity(100 * np.sqrt(np.median(variance[:, 3:].max(axis=1))), unit="cm", decimals=1)
        rows.append(("known to", f"± {degrees(turn)} and ± {shift} (median, worst axis)"))
    if camera.calibration is not None:
        sensor = camera.calibration
        mounting = f"wxyz {quaternion_text(sensor.R_bone_sensor)}, {_mounting_sigma_text(sensor)} (worst axis)"
        rows += [("heading of its sensor", heading_text(sensor)), ("mounting of its sensor", mounting)]
    return facts(f"camera '{camera.name}'", *rows, *clock_rows(camera.clock, camera.clock_sigma))


def reprojection_table(estimate: Estimate, names: Sequence[str]) -> Table:
    """Table of reprojection residuals by wearer and camera."""
    rows = []
    for camera in estimate.cameras:
        residuals = np.zeros((0, 0)) if camera.residual_px is None else camera.residual_px
        for name, values in zip(names, residuals.T, strict=False):
            half, p95 = (Quantity(finite_quantile(values, share), decimals=1) for share in (0.5, 0.95))
            label = f"{name}, {camera.name}" if len(estimate.cameras) > 1 else name
            rows.append((label, str(int(np.isfinite(values).sum())), half, p95))
    return Table(("seen by the camera", "frames", "median, px", "95 % below, px"), rows)


def detection_table(estimate: Estimate, names: Sequence[str]) -> Table:
    """Table of detections by wearer and camera."""
    rows, people = [], [*enumerate(names), (-1, "nobody (strangers, false detections)")]
    for camera in estimate.cameras:
        labels, place = camera.wearer_of_detection, f", {camera.name}" if len(estimate.cameras) > 1 else ""
        for index, name in people if len(labels) else ():
            is_given = labels == index
            rows.append((name + place, str(int(is_given.sum())), f"{100 * float(is_given.mean()):.1f} %"))
    return Table(("detections given to", "count", "share"), rows)


def solve_table(reports: Sequence[SolveReport], with_cost: bool = False) -> Table:
    """Table of the solver's stages."""
    rows = []
    for report in reports:
        initial_cost, final_cost = sum(report.initial_cost.values()), sum(report.final_cost.values())
        cost = [str(len(report.iterations)), f"{initial_cost:.4g} → {final_cost:.4g}"] if with_cost else []
        rows.append((report.stage, "yes" if report.converged else "no", f"{report.seconds:.1f} s", *cost))
    head = ("part", "settled", "time", *(["steps", "cost"] if with_cost else []))
    return Table(head, rows, "how the computation went", words=2, is_detail=True)


def setting_table(estimate: Estimate) -> Table:
    """Table of the estimate's settings, by name."""
    settings = estimate.settings or estimate.wearers[0].settings
    return Table(("setting", "value"), sorted(settings.items()), "settings", words=2, is_detail=True)


def estimate_tables(estimate: Estimate, verbose: bool = False) -> Iterator[Table]:
    """Yield all tables of an estimate: verdict, cameras, then wearers; solver stages if verbose."""
    names, reports = [wearer.motion.name for wearer in estimate.wearers], estimate.all_reports
    rows: list[Row] = [("verdict", str(estimate.verdict))]
    rows += [(str(finding.severity), str(finding)) for finding in estimate.all_findings]
    if reports:
        unsettled = dict.fromkeys(report.stage for report in reports if not report.converged)
        stopped = f"; stopped before it settled: {', '.join(unsettled)}" if unsettled else ""
        rows.append(("computed in", f"{sum(report.seconds for report in reports):.1f} s{stopped}"))
    rows += [("who is who", sentence) for sentence in estimate.association]
    yield facts(f"estimate '{estimate.name}', method {estimate.method}", *rows)
    yield from map(camera_estimate_facts, estimate.cameras)
    yield reprojection_table(estimate, names)
    yield detection_table(estimate, names)
    yield detector_table(estimate.detector)
    yield solve_table(reports if verbose else (), with_cost=True)
    for wearer in estimate.wearers:
        yield wearer_facts(wearer)
        yield length_table(wearer.body)
        yield hinge_table(wearer.body)
        yield place_table(wearer)
        yield calibration_table(wearer)
