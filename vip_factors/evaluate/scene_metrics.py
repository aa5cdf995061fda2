"""What takes more than one wearer, or the camera: sensors, honesty, labels; is it the same recording?

Precision and recall of labels are as VIP reports them on 3DPW (thesis 4.4.3).
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.errors import InputError
from vip_factors.estimate import Estimate
from vip_factors.evaluate.calibration import (
    CalibrationError,
    calibration_error,
    camera_error,
    consistency_metrics,
    error_metrics,
    heading_nees,
    mounting_nees,
    nees,
    share_sensors,
)
from vip_factors.evaluate.comparison import SceneComparison
from vip_factors.evaluate.table import Metric
from vip_factors.geometry.poses import Alignment
from vip_factors.sensors.camera import anchored_gauge
from vip_factors.sensors.scene import Scene

CAMERA = "camera"  # stands for the IMU on the camera where calibrations go by sensor name


def sensors(estimate: Estimate, scene: Scene, gauge: float | None) -> dict[str, Metric]:
    """Headings and mountings of all wearers' sensors together."""
    return error_metrics([error for _, error in _calibration_errors(estimate, scene, gauge)])


def camera_imu(estimate: Estimate, scene: Scene, gauge: float | None) -> dict[str, Metric]:
    """Heading and mounting of the IMU on the camera, and the clock offset, where estimated and known."""
    if estimate.camera is None or scene.truth is None:
        return {}
    table: dict[str, Metric] = {}
    found, known = estimate.camera.calibration, scene.truth.camera_calibration
    if found is not None and known is not None:
        error = calibration_error({CAMERA: found}, {CAMERA: known}, gauge)
        table["camera_heading_error"] = Metric(float(np.rad2deg(error.heading_magnitude[0])), "deg")
        table["camera_mounting_error"] = Metric(float(np.rad2deg(error.mounting_magnitude[0])), "deg")
    late = estimate.camera.time_offset - scene.truth.time_offset
    return table | {"time_offset_error": Metric(1e3 * late, "ms")}


def honesty(estimate: Estimate, scene: Scene, comparison: SceneComparison) -> dict[str, Metric]:
    """NEES of headings, mountings and camera, in the gauge of the graph's prior (see :func:`anchored_gauge`).

    The anchoring heading itself is left out: the gauge makes its error zero. Empty where the anchor is not known.
    """
    anchor = _anchor(estimate, scene)
    if estimate.camera is None or anchor is None:
        return {}
    wearer, sensor, turn = anchor
    headings, mountings = [], []
    for i, error in _calibration_errors(estimate, scene, turn):
        calibration = estimate.wearers[i].calibration
        free = error.of([name for name in error.heading if (i, name) != (wearer, sensor)])
        if free.heading:
            headings.append(heading_nees(free, calibration))
        mountings.append(mounting_nees(error, calibration))
    table: dict[str, Metric] = {}
    for name, values in (("heading", headings), ("mounting", mountings)):
        if values:
            table |= consistency_metrics(name, np.concatenate(values))
    if comparison.camera is not None and estimate.camera.covariance is not None:
        known = wearer not in comparison.wearers  # where the camera's path was given, and with it the world
        gauge = (
            Alignment(np.eye(3), np.zeros(3), np.ones(()))
            if known
            else anchored_gauge(comparison.wearers[wearer].pair, turn)
        )
        nees_of_camera = nees(
            camera_error(comparison.camera, gauge).tangent, estimate.camera.covariance[comparison.instants]
        )
        table |= consistency_metrics("camera", nees_of_camera)
    return table


def association(estimate: Estimate, scene: Scene) -> dict[str, Metric]:
    """Precision and recall in percent.

    Raises:
        InputError: if the estimate labels other detections than the scene's.
    """
    labels, truth = estimate.wearer_of_detection, scene.truth
    if truth is None or not len(labels):
        return {}
    if len(labels) != len(truth.wearer):
        raise InputError(
            f"the estimate labels {len(labels)} detections, scene '{scene.name}' holds {len(truth.wearer)}: expected "
            "one label each; is it the estimate of this scene?"
        )
    return label_metrics(labels, truth.wearer)


def _calibration_errors(
    estimate: Estimate, scene: Scene, gauge: float | None
) -> Iterator[tuple[int, CalibrationError]]:
    for index, (one, wearer) in enumerate(zip(estimate.wearers, scene.wearers, strict=True)):
        if wearer.truth is None or wearer.truth.calibration is None:
            continue
        if share_sensors(one.calibration, wearer.truth.calibration):
            yield index, calibration_error(one.calibration, wearer.truth.calibration, gauge)


def _anchor(estimate: Estimate, scene: Scene) -> tuple[int, str, float] | None:
    """Wearer, sensor and raw heading error of what carries the gauge prior; None if that cannot be told.

    It is the sensor that is surest of its heading: the prior is far tighter than any measurement. Where the camera's
    path was given, the world is: wearer −1, no sensor, no error.
    """
    if scene.camera is not None and scene.camera.known_path is not None:
        return -1, "", 0.0
    sigmas = [
        (estimate.wearers[index].calibration[name].heading_sigma, index, name, value)
        for index, error in _calibration_errors(estimate, scene, 0.0)
        for name, value in error.heading.items()
    ]
    sigmas = [one for one in sigmas if np.isfinite(one[0])]
    return min(sigmas)[1:] if sigmas else None


def label_metrics(labels: np.ndarray, truth: np.ndarray) -> dict[str, Metric]:
    """How right labels ``(N,)`` of detections are against the true ones: index of the wearer, −1 for nobody.

    Precision: correct labels over labels given; recall: over detections that are a wearer's; NaN where there are none.
    """
    nobody = -1
    correct = ((truth != nobody) & (labels == truth)).sum()
    counts = {"precision": (labels != nobody).sum(), "recall": (truth != nobody).sum()}
    return {
        f"association_{name}": Metric(100 * float(correct / count) if count else float("nan"), "%")
        for name, count in counts.items()
    }


def doubts(estimate: Estimate, scene: Scene, start_ns: int = 0) -> str:
    """What speaks against it, as one sentence; empty if nothing does. ``start_ns``: of the estimate's t = 0, 0 if not
    known.
    """
    found, begins = [], scene.wearers[0].start_ns
    if not {scene.name, *(one.name for one in scene.wearers)} & {
        estimate.name,
        *(one.name for one in estimate.wearers),
    }:
        found.append(f"the estimate is of '{estimate.name}', the truth of '{scene.name}'")
    same_start_s = 60.0  # clocks of computers that record together differ by less
    if start_ns and begins and (apart := abs(start_ns - begins) / 1e9) > same_start_s:
        found.append(f"they begin {apart:.0f} s apart")
    little = 0.9  # of the estimate's time: a truth that begins late or ends early has more
    for one, wearer in zip(estimate.wearers, scene.wearers, strict=False):
        who = f" of {wearer.subject.name}" if len(scene.wearers) > 1 else ""
        strange = sorted(set(one.sensors) - set(wearer.imus)) if wearer.imus else []
        if strange:
            found.append(
                f"{len(strange)} of the {len(one.sensors)} sensors{who} are none of the other's: {strange[0]} …"
            )
        if wearer.truth is not None and len(one.motion) and len(wearer.truth.motion):
            time, truth = one.motion.time, wearer.truth.motion.time
            common, whole = min(time[-1], truth[-1]) - max(time[0], truth[0]), time[-1] - time[0]
            if common < little * whole:
                found.append(f"of {whole:.1f} s of the estimate the truth covers {max(common, 0.0):.1f} s")
    return f"is this the truth of the same recording? {'; '.join(found)}" if found else ""
