"""Answers of the fixed-lag tracker as JSON: one self-contained object a frame, for programs in any language.

``data_schemas/live_answer.schema.json`` declares the keys with their units and frames. What is not finite, or not
known, is null.
"""

from collections.abc import Collection
from typing import IO, Any, Final

import msgspec
import numpy as np

from vip_factors.body.joint_angles import (
    ANGLE_DEFINITIONS,
    R_WORLD_ISB,
    angles_of_segments,
    bare_segments,
    segment_axes,
)
from vip_factors.body.kinematics import forward_kinematics
from vip_factors.body.skeleton import JOINT_NAMES, Skeleton
from vip_factors.errors import naming_file
from vip_factors.estimate import PoseCovariance
from vip_factors.findings import Finding, verdict
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import Array, wrap_angle
from vip_factors.live_estimate import LiveCameraEstimate, LiveCameraPose, LiveEstimate, LivePose, LiveWearerEstimate
from vip_factors.sensors.scene import Scene
from vip_factors.tables import bone_words

VERSION: Final = 1  # of the format: keys may be added; a key that goes, or means something else, makes another one
QUATERNION_DIGITS, METRE_DIGITS, DEGREE_DIGITS = 5, 4, 2  # 0.001°, a tenth of a millimetre, 0.01°
TIME_DIGITS, HEADING_DIGITS, UPDATE_DIGITS, PIXEL_DIGITS = 6, 1, 3, 1
ANGLE_NAMES = tuple(angle.name for angle in ANGLE_DEFINITIONS)
JOINT_KEYS = ("position", "orientation_wxyz", "rotation_wxyz", "sigma_deg")  # the last where it is estimated

JsonObject = dict[str, Any]
"""Part of an answer."""


class LiveJsonEncoder:
    """Converts estimates to answers.

    Args:
        setup: of the stream.
    """

    def __init__(self, setup: Scene) -> None:
        self._bodies = [_Body(wearer.subject.body()) for wearer in setup.wearers]
        self._guessed = [guessed_angles({site.bone for site in wearer.placement.sites}) for wearer in setup.wearers]
        self._findings: dict[str, Finding] = {}  # the last of each kind

    def answer(self, estimate: LiveEstimate) -> JsonObject:
        """Make the answer to one frame."""
        self.note(estimate)
        return {
            "version": VERSION,
            "frame": estimate.frame,
            "time": round(estimate.time, TIME_DIGITS),
            "wearers": [self._wearer(number, wearer) for number, wearer in enumerate(estimate.wearers)],
            "cameras": [_camera(camera) for camera in estimate.cameras],
            "verdict": verdict(self._findings.values()).severity,
            "preliminary": estimate.preliminary,
            "update_ms": round(1e3 * estimate.seconds, UPDATE_DIGITS),
            "findings": [_finding(finding) for finding in estimate.findings],
        }

    def note(self, estimate: LiveEstimate) -> None:
        """Add the findings of a frame to the verdict, without making an answer."""
        self._findings |= {finding.kind: finding for finding in estimate.findings}

    @property
    def findings(self) -> list[JsonObject]:
        """The last finding of each kind so far."""
        return [_finding(finding) for finding in self._findings.values()]

    def _wearer(self, number: int, wearer: LiveWearerEstimate) -> JsonObject:
        if wearer.skeleton is not None and wearer.skeleton is not self._bodies[number].skeleton:
            self._bodies[number] = _Body(wearer.skeleton)
        poses = [pose for pose in (wearer.newest, wearer.smoothed) if pose is not None]
        newest, *smoothed = self._bodies[number].pose_answers(poses)
        time, calibrations = np.array(wearer.newest.time), wearer.calibration.values()
        turns = np.array([(sensor.heading_at(time), sensor.heading_sigma) for sensor in calibrations], float)
        turns = turns.reshape(-1, 2)
        turns[:, 0] = wrap_angle(turns[:, 0])
        rows = _list(np.rad2deg(turns), HEADING_DIGITS)
        return {
            "name": wearer.name,
            "newest": newest,
            "smoothed": smoothed[0] if smoothed else None,
            "headings_deg": {
                sensor: {"heading": heading, "sigma": sigma}
                for sensor, (heading, sigma) in zip(wearer.calibration, rows, strict=True)
            },
            "guessed_angles": self._guessed[number],
            "detection": wearer.detection,
        }


def guessed_angles(bones: Collection[str]) -> dict[str, str]:
    """Reasons, by joint, why angles are a guess with sensors only on ``bones``: ``no sensor on left thigh``."""
    joints = {angle.joint: bare_segments(bones, angle.name) for angle in ANGLE_DEFINITIONS}
    words = {
        joint: [" or ".join(map(bone_words, choices[:3])) for choices in segments] for joint, segments in joints.items()
    }
    return {joint: f"no sensor on {', '.join(segments)}" for joint, segments in words.items() if segments}


class _Body:
    """A skeleton with the segment axes of its joint angles."""

    def __init__(self, skeleton: Skeleton) -> None:
        self.skeleton = skeleton
        self._R_bone_segment = segment_axes(skeleton)

    def pose_answers(self, poses: list[LivePose]) -> list[JsonObject]:
        """Convert poses, all at once."""
        R = np.stack([pose.R_parent_child for pose in poses])
        state = forward_kinematics(self.skeleton, R, np.stack([pose.p_world_pelvis for pose in poses]))
        degrees = angles_of_segments(R_WORLD_ISB.T @ state.R_world_bone @ self._R_bone_segment)
        bones, turns = quaternion_from_matrix(np.stack([state.R_world_bone, R]), Order.WXYZ)
        positions, angles_deg = _list(state.p_world_joint, METRE_DIGITS), _list(degrees, DEGREE_DIGITS)
        quaternions = _list(bones, QUATERNION_DIGITS), _list(turns, QUATERNION_DIGITS)
        answers = []
        for pose, *columns, angles in zip(poses, positions, *quaternions, angles_deg, strict=True):
            answer: JsonObject = {"time": round(pose.time, TIME_DIGITS), "joints": {}}
            answer["angles_deg"] = dict(zip(ANGLE_NAMES, angles, strict=True))
            if pose.joint_covariance is not None and pose.root_covariance is not None:
                sigma = PoseCovariance(pose.joint_covariance, pose.root_covariance).joint_sigma
                columns.append(_list(np.rad2deg(sigma), DEGREE_DIGITS))
                answer["root_sigma"] = _list(_sigmas(pose.root_covariance), METRE_DIGITS)
            for joint, *values in zip(JOINT_NAMES, *columns, strict=True):
                answer["joints"][joint] = dict(zip(JOINT_KEYS, values, strict=False))
            answers.append(answer)
        return answers


class LiveJsonSink:
    """Writes a line per frame and flushes it.

    Args:
        stream: open for writing text; it is not closed.
        setup: of the stream.
    """

    def __init__(self, stream: IO[str], setup: Scene) -> None:
        self._stream = stream
        self._encoder = LiveJsonEncoder(setup)

    def write(self, estimate: LiveEstimate) -> None:
        """Write one line.

        Raises:
            BrokenPipeError: if nobody reads any more.
            OSError: if the lines cannot be written, to a file on a full disk say.
        """
        line = msgspec.json.encode(self._encoder.answer(estimate)).decode()
        with naming_file("standard output"):
            self._stream.write(line + "\n")
            self._stream.flush()


def _finding(finding: Finding) -> JsonObject:
    return {"kind": finding.kind, "severity": finding.severity, "text": str(finding)}


def _camera(camera: LiveCameraEstimate) -> JsonObject:
    return {
        "name": camera.name,
        "focal_px": _list(np.array(camera.model.focal), PIXEL_DIGITS),
        "newest": _camera_pose(camera.newest),
        "smoothed": None if camera.smoothed is None else _camera_pose(camera.smoothed),
    }


def _camera_pose(pose: LiveCameraPose) -> JsonObject:
    answer: JsonObject = {
        "time": round(pose.time, TIME_DIGITS),
        "position": _list(pose.p_world_camera, METRE_DIGITS),
        "orientation_wxyz": _list(quaternion_from_matrix(pose.R_world_camera, Order.WXYZ), QUATERNION_DIGITS),
    }
    if pose.covariance is not None:
        sigma = _sigmas(pose.covariance)
        answer["sigma_deg"] = _list(np.rad2deg(sigma[:3]), DEGREE_DIGITS)
        answer["position_sigma"] = _list(sigma[3:], METRE_DIGITS)
    return answer


def _sigmas(covariance: Array) -> Array:
    return np.sqrt(np.maximum(np.diag(covariance), 0.0))


def _list(values: Array, digits: int) -> list:
    """Rounded numbers as nested lists; what is not finite becomes null when it is encoded."""
    return (np.round(values, digits) + 0.0).tolist()  # no negative zero
