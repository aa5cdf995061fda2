"""A fixed-lag tracker's answers as JSON lines: one object a frame, on one line, for programs in any language.

``data_schemas/README.md`` says what the keys mean.
"""

import json
from typing import IO, Any

import numpy as np

from vip_factors.errors import naming_file
from vip_factors.estimate import PoseCovariance
from vip_factors.findings import Finding, sentences, verdict
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import Array
from vip_factors.live_estimate import LiveCameraPose, LiveEstimate, LivePose, LiveWearerEstimate

QUATERNION_DIGITS, METRE_DIGITS, DEGREE_DIGITS = 5, 4, 2  # 0.001°, a tenth of a millimetre, 0.01°
TIME_DIGITS = 6


class LiveJsonSink:
    """Writes a line per frame and flushes it.

    Args:
        stream: open for writing text; it is not closed.
    """

    def __init__(self, stream: IO[str]) -> None:
        self._stream = stream
        self._found: dict[str, Finding] = {}  # the last of each kind
        self._headings: dict[str, dict[str, list[float | None]]] = {}  # as last told, by wearer and sensor

    def write(self, estimate: LiveEstimate) -> None:
        """One line.

        Raises:
            BrokenPipeError: if nobody reads any more.
            OSError: if the lines cannot be written, to a file on a full disk say.
        """
        line = json.dumps(self._object(estimate), separators=(",", ":"), allow_nan=False, ensure_ascii=False)
        with naming_file("standard output"):
            self._stream.write(line + "\n")
            self._stream.flush()

    def close(self) -> None:
        """Nothing is left to write."""

    def _object(self, estimate: LiveEstimate) -> dict[str, Any]:
        told: dict[str, Any] = {
            "frame": estimate.frame,
            "time": round(estimate.time, TIME_DIGITS),
            "wearers": [self._wearer(one) for one in estimate.wearers],
        }
        if estimate.camera is not None or estimate.smoothed_camera is not None:
            told["camera"] = {"newest": _camera(estimate.camera), "smoothed": _camera(estimate.smoothed_camera)}
        if estimate.findings:
            told["findings"] = list(sentences(estimate.findings))
            self._found |= {one.kind: one for one in estimate.findings}
            told["verdict"] = verdict(self._found.values()).severity
        if estimate.preliminary:
            told["preliminary"] = True
        told["update_ms"] = _rounded(1e3 * estimate.seconds, 3)
        return told

    def _wearer(self, wearer: LiveWearerEstimate) -> dict[str, Any]:
        told: dict[str, Any] = {
            "name": wearer.name,
            "newest": _pose(wearer.newest),
            "smoothed": _pose(wearer.smoothed) if wearer.smoothed is not None else None,
        }
        changed = self._changed_headings(wearer)
        if changed:
            told["headings_deg"] = changed
        told["detection"] = wearer.detection
        return told

    def _changed_headings(self, wearer: LiveWearerEstimate) -> dict[str, list[float | None]]:
        """Heading and standard deviation of the sensors whose numbers are no longer those last told."""
        now: dict[str, list[float | None]] = {}
        for sensor, one in wearer.calibration.items():
            heading = float(one.heading_at(np.array([wearer.newest.time]))[0])
            numbers = np.rad2deg([np.angle(np.exp(1j * heading)), one.heading_sigma])
            now[sensor] = [_rounded(float(value), 1) for value in numbers]
        before = self._headings.get(wearer.name, {})
        self._headings[wearer.name] = now
        return {sensor: numbers for sensor, numbers in now.items() if before.get(sensor) != numbers}


def _pose(pose: LivePose) -> dict[str, Any]:
    told: dict[str, Any] = {
        "time": round(pose.time, TIME_DIGITS),
        "rotations": _list(quaternion_from_matrix(pose.R_parent_child, Order.WXYZ), QUATERNION_DIGITS),
        "root": _list(pose.p_world_pelvis, METRE_DIGITS),
    }
    if pose.joint_covariance is not None and pose.root_covariance is not None:
        sigma = PoseCovariance(pose.joint_covariance, pose.root_covariance).joint_sigma
        told["sigma_deg"] = _list(np.rad2deg(sigma), DEGREE_DIGITS)
        told["root_sigma"] = _list(_sigmas(pose.root_covariance), METRE_DIGITS)
    return told


def _camera(pose: LiveCameraPose | None) -> dict[str, Any] | None:
    if pose is None:
        return None
    told: dict[str, Any] = {
        "time": round(pose.time, TIME_DIGITS),
        "rotation": _list(quaternion_from_matrix(pose.R_world_camera, Order.WXYZ), QUATERNION_DIGITS),
        "position": _list(pose.p_world_camera, METRE_DIGITS),
    }
    if pose.covariance is not None:
        sigma = _sigmas(pose.covariance)
        told["sigma_deg"] = _list(np.rad2deg(sigma[:3]), DEGREE_DIGITS)
        told["position_sigma"] = _list(sigma[3:], METRE_DIGITS)
    return told


def _sigmas(covariance: Array) -> Array:
    return np.sqrt(np.maximum(np.diag(covariance), 0.0))


def _list(values: Array, digits: int) -> Any:
    """Rounded numbers as nested lists; what is not finite, which JSON does not know, as null."""
    rounded = np.round(values, digits) + 0.0  # no negative zero
    if np.isfinite(rounded).all():
        return rounded.tolist()
    known = rounded.astype(object)
    known[~np.isfinite(rounded)] = None
    return known.tolist()


def _rounded(value: float, digits: int) -> float | None:
    return round(value, digits) + 0.0 if np.isfinite(value) else None
