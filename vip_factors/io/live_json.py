"""A fixed-lag tracker's answers as JSON, for programs in any language: one object a frame, whole in itself.

The classes here say what is in it: what is written is made of them, and ``data_schemas/live_answer.schema.json`` is
generated from them by ``python data_schemas/generate.py``. Beside the type of a key its annotation has the words for
people, how many numbers a list has, which values are allowed, or the keys of an object with words for each.
"""

import json
import re
from collections.abc import Iterator
from typing import IO, Annotated, Any, NotRequired, TypedDict

import numpy as np

from vip_factors.body.joint_angles import ANGLE_DEFINITIONS, R_WORLD_ISB, angles_of_segments, segment_axes
from vip_factors.body.kinematics import forward_kinematics
from vip_factors.body.skeleton import JOINT_NAMES, PARENTS, Skeleton
from vip_factors.errors import naming_file
from vip_factors.estimate import PoseCovariance
from vip_factors.findings import Finding, verdict
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import Array, wrap_angle
from vip_factors.live_estimate import LiveCameraPose, LiveEstimate, LivePose, LiveWearerEstimate
from vip_factors.sensors.scene import Scene

VERSION = 1  # of the format: keys may be added to it; a key that goes, or means something else, makes another one
QUATERNION_DIGITS, METRE_DIGITS, DEGREE_DIGITS = 5, 4, 2  # 0.001°, a tenth of a millimetre, 0.01°
TIME_DIGITS = 6
ANGLE_NAMES = tuple(one.name for one in ANGLE_DEFINITIONS)
ANGLE_WORDS = {one.name: f"positive: {one.positive}" for one in ANGLE_DEFINITIONS}
JOINT_WORDS = {
    name: f"on the bone of {JOINT_NAMES[parent]}" if parent >= 0 else "the root"
    for name, parent in zip(JOINT_NAMES, PARENTS, strict=True)
}

Number = float | None  # what is not finite, or not known, is null
Seconds = Annotated[float, "seconds from the start of the stream"]
Metres = Annotated[list[Number], 3, "x, y, z in metres; world axes, z up"]
Quaternion = Annotated[list[Number], 4, "w, x, y, z"]


class JointAnswer(TypedDict):
    """A joint, and the bone of the same name that it moves."""

    position: Annotated[Metres, "p_world_joint"]
    orientation_wxyz: Annotated[Quaternion, "R_world_bone; axes at rest: x to the wearer's left, y up, z forward"]
    rotation_wxyz: Annotated[Quaternion, "R_parent_child, against the bone above; of the pelvis R_world_pelvis"]
    sigma_deg: NotRequired[Annotated[Number, "standard deviation of rotation_wxyz in degrees, where it is estimated"]]


class PoseAnswer(TypedDict):
    """A wearer at an instant."""

    time: Seconds
    joints: Annotated[dict[str, JointAnswer], JOINT_WORDS, "SMPL's joints, parents first"]
    angles_deg: Annotated[dict[str, Number], ANGLE_WORDS, "joint angles as the ISB recommends, in degrees within ±180"]
    root_sigma: NotRequired[Annotated[list[Number], 3, "standard deviations of the pelvis' x, y, z in metres"]]


class HeadingAnswer(TypedDict):
    """How far a sensor's own north is turned about the vertical."""

    heading: Annotated[Number, "R_world_inertial = rotation_z(heading), in degrees within ±180"]
    sigma: Annotated[Number, "standard deviation in degrees"]


class WearerAnswer(TypedDict):
    """One wearer; wearers come in the same order in all answers."""

    name: Annotated[str, "the subject's name"]
    newest: Annotated[PoseAnswer, "the pose at the answer's time"]
    smoothed: Annotated[PoseAnswer | None, "the pose one lag earlier, which changes no more; null before the first"]
    headings_deg: Annotated[dict[str, HeadingAnswer], "by sensor"]
    detection: Annotated[int | None, "index of the person in the newest video frame who is the wearer; null: not seen"]


class CameraPoseAnswer(TypedDict):
    """The camera at an instant; its axes: x to the right of the image, y down, z forward."""

    time: Seconds
    position: Annotated[Metres, "p_world_camera"]
    orientation_wxyz: Annotated[Quaternion, "R_world_camera"]
    sigma_deg: NotRequired[Annotated[list[Number], 3, "standard deviations in degrees about the camera's axes"]]
    position_sigma: NotRequired[Annotated[list[Number], 3, "standard deviations in metres along the camera's axes"]]


class CameraAnswer(TypedDict):
    """The first camera."""

    newest: Annotated[CameraPoseAnswer | None, "at the answer's time"]
    smoothed: Annotated[CameraPoseAnswer | None, "one lag earlier"]


class FindingAnswer(TypedDict):
    """Something that was noticed."""

    kind: Annotated[str, "a name that all findings of a kind share"]
    severity: Annotated[str, ("note", "care", "doubt"), "how much it bears on the use of the results"]
    text: Annotated[str, "a sentence"]


class Answer(TypedDict):
    """The answer to one frame."""

    version: Annotated[int, (VERSION,), "of this format"]
    frame: Annotated[int, "number of the frame, from 0"]
    time: Seconds
    wearers: list[WearerAnswer]
    camera: NotRequired[Annotated[CameraAnswer, "absent without a camera"]]
    findings: Annotated[list[FindingAnswer], "of what has happened since the answer before"]
    verdict: Annotated[str, ("good", "care", "doubt"), "by all findings so far"]
    preliminary: Annotated[bool, "the calibration is still that of the first second: bones may be turned wrong"]
    update_ms: Annotated[Number, "what the update took, milliseconds of wall time"]


class LiveJsonEncoder:
    """Makes text of answers: keys never change, so that numbers are put into a text that is there.

    Args:
        setup: of the stream.
    """

    def __init__(self, setup: Scene) -> None:
        self._bodies = [_Body(one.subject.body()) for one in setup.wearers]
        self._found: dict[str, Finding] = {}  # the last of each kind

    def encode(self, estimate: LiveEstimate) -> tuple[str, list[FindingAnswer]]:
        """One answer for :func:`as_text`: all but its findings, which come last, and these."""
        self.note(estimate)
        wearers = [self._wearer(number, one) for number, one in enumerate(estimate.wearers)]
        camera = ""
        if estimate.camera is not None or estimate.smoothed_camera is not None:
            newest, smoothed = _cameras(estimate.camera, estimate.smoothed_camera)
            camera = f'"camera":{_dumps(CameraAnswer(newest=newest, smoothed=smoothed))},'
        return (
            f'{{"version":{VERSION},"frame":{estimate.frame},"time":{estimate.time:.{TIME_DIGITS}f},'
            f'"wearers":[{",".join(wearers)}],{camera}"verdict":"{verdict(self._found.values()).severity}",'
            f'"preliminary":{_dumps(estimate.preliminary)},"update_ms":{_dumps(_rounded(1e3 * estimate.seconds, 3))}'
        ), [_finding(one) for one in estimate.findings]

    def note(self, estimate: LiveEstimate) -> None:
        """Take the findings of an answer into the verdict, without making text of it."""
        self._found |= {one.kind: one for one in estimate.findings}

    @property
    def findings(self) -> list[FindingAnswer]:
        """The last finding of each kind so far."""
        return [_finding(one) for one in self._found.values()]

    def _wearer(self, number: int, wearer: LiveWearerEstimate) -> str:
        if wearer.skeleton is not None and wearer.skeleton is not self._bodies[number].skeleton:
            self._bodies[number] = _Body(wearer.skeleton)
        poses = [one for one in (wearer.newest, wearer.smoothed) if one is not None]
        newest, smoothed = [*self._bodies[number].texts(poses), "null"][:2]
        time, calibrations = np.array(wearer.newest.time), wearer.calibration.values()
        numbers = np.array([(one.heading_at(time), one.heading_sigma) for one in calibrations], float).reshape(-1, 2)
        degrees = np.rad2deg(np.stack([wrap_angle(numbers[:, 0]), numbers[:, 1]], axis=1))
        told = {
            sensor: HeadingAnswer(heading=heading, sigma=sigma)
            for sensor, (heading, sigma) in zip(wearer.calibration, _list(degrees, 1), strict=True)
        }
        return (
            f'{{"name":{_dumps(wearer.name)},"newest":{newest},"smoothed":{smoothed},'
            f'"headings_deg":{_dumps(told)},"detection":{_dumps(wearer.detection)}}}'
        )


def _pose_text(sure: bool) -> str:
    """A :class:`PoseAnswer` with places for its numbers, with standard deviations or without."""

    def places(count: int, digits: int) -> str:
        return f"[{','.join([f'%.{digits}f'] * count)}]"

    position, turn = places(3, METRE_DIGITS), places(4, QUATERNION_DIGITS)
    sigma = f',"sigma_deg":%.{DEGREE_DIGITS}f' if sure else ""
    joint = f'{{"position":{position},"orientation_wxyz":{turn},"rotation_wxyz":{turn}{sigma}}}'
    joints = ",".join(f'"{name}":{joint}' for name in JOINT_NAMES)
    angles = ",".join(f'"{name}":%.{DEGREE_DIGITS}f' for name in ANGLE_NAMES)
    root = f',"root_sigma":{places(3, METRE_DIGITS)}' if sure else ""
    return f'{{"time":%.{TIME_DIGITS}f,"joints":{{{joints}}},"angles_deg":{{{angles}}}{root}}}'


SURE, UNSURE = _pose_text(True), _pose_text(False)
HALF = np.array([0.5 * 10.0 ** -int(digits) for digits in re.findall(r"%\.(\d)f", SURE)])  # of the last digit
NOT_FINITE = re.compile(r"(?<=[:,\[])-?(?:nan|inf)")


class _Body:
    """What all poses of a skeleton share."""

    def __init__(self, skeleton: Skeleton) -> None:
        self.skeleton = skeleton
        self._R_bone_segment = segment_axes(skeleton)

    def texts(self, poses: list[LivePose]) -> Iterator[str]:
        """All at once: the cost of each is that of its calls."""
        R = np.stack([one.R_parent_child for one in poses])
        state = forward_kinematics(self.skeleton, R, np.stack([one.p_world_pelvis for one in poses]))
        degrees = angles_of_segments(R_WORLD_ISB.T @ state.R_world_bone @ self._R_bone_segment)
        turns = quaternion_from_matrix(np.stack([state.R_world_bone, R]), Order.WXYZ)
        for pose, *own, angles in zip(poses, state.p_world_joint, *turns, degrees, strict=True):
            root: list[Array] = []
            if pose.joint_covariance is not None and pose.root_covariance is not None:
                sigma = PoseCovariance(pose.joint_covariance, pose.root_covariance).joint_sigma
                own, root = [*own, np.rad2deg(sigma)[:, None]], [_sigmas(pose.root_covariance)]
            numbers = np.concatenate([[pose.time], np.concatenate(own, axis=1).ravel(), angles, *root])
            if root:  # no negative zero
                numbers[np.abs(numbers) <= HALF] = 0.0
            text = (SURE if root else UNSURE) % tuple(numbers.tolist())
            yield text if np.isfinite(numbers).all() else NOT_FINITE.sub("null", text)


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
        """One line.

        Raises:
            BrokenPipeError: if nobody reads any more.
            OSError: if the lines cannot be written, to a file on a full disk say.
        """
        line = as_text(*self._encoder.encode(estimate))
        with naming_file("standard output"):
            self._stream.write(line + "\n")
            self._stream.flush()


def as_text(answer: str, findings: list[FindingAnswer]) -> str:
    """An :class:`Answer` on one line, of what :meth:`LiveJsonEncoder.encode` makes of it."""
    return f'{answer},"findings":{_dumps(findings)}}}'


def _dumps(value: object) -> str:
    return json.dumps(value, separators=(",", ":"), allow_nan=False, ensure_ascii=False)


def _finding(finding: Finding) -> FindingAnswer:
    return FindingAnswer(kind=finding.kind, severity=str(finding.severity), text=str(finding))


def _cameras(*poses: LiveCameraPose | None) -> list[CameraPoseAnswer | None]:
    turns = iter(_quaternions(np.stack([one.R_world_camera for one in poses if one is not None])))
    return [None if one is None else _camera(one, next(turns)) for one in poses]


def _camera(pose: LiveCameraPose, turn: list[Number]) -> CameraPoseAnswer:
    told = CameraPoseAnswer(
        time=round(pose.time, TIME_DIGITS), position=_list(pose.p_world_camera, METRE_DIGITS), orientation_wxyz=turn
    )
    if pose.covariance is not None:
        sigma = _sigmas(pose.covariance)
        told["sigma_deg"] = _list(np.rad2deg(sigma[:3]), DEGREE_DIGITS)
        told["position_sigma"] = _list(sigma[3:], METRE_DIGITS)
    return told


def _sigmas(covariance: Array) -> Array:
    return np.sqrt(np.maximum(np.diag(covariance), 0.0))


def _quaternions(R: Array) -> Any:
    return _list(quaternion_from_matrix(R, Order.WXYZ), QUATERNION_DIGITS)


def _list(values: Array, digits: int) -> Any:
    """Rounded numbers as nested lists; what is not finite, which JSON does not know, as null."""
    rounded = np.round(values, digits) + 0.0  # no negative zero
    if np.isfinite(rounded).all():
        return rounded.tolist()
    known = rounded.astype(object)
    known[~np.isfinite(rounded)] = None
    return known.tolist()


def _rounded(value: float, digits: int) -> Number:
    return round(float(value), digits) + 0.0 if np.isfinite(value) else None
