"""Answers of the fixed-lag tracker as JSON: one self-contained object a frame, for programs in any language.

``python data_schemas/generate.py`` generates ``data_schemas/live_answer.schema.json`` from the classes here.
"""

from collections.abc import Collection
from typing import IO, Annotated, Final, Literal

import msgspec
import numpy as np
from msgspec import UNSET, Meta, UnsetType

from vip_factors.body.joint_angles import (
    ANGLE_DEFINITIONS,
    R_WORLD_ISB,
    angles_of_segments,
    bare_segments,
    segment_axes,
)
from vip_factors.body.kinematics import forward_kinematics
from vip_factors.body.skeleton import JOINT_NAMES, PARENTS, Skeleton
from vip_factors.errors import naming_file
from vip_factors.estimate import PoseCovariance
from vip_factors.findings import Finding, Severity, verdict
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import Array, wrap_angle
from vip_factors.live_estimate import LiveCameraEstimate, LiveCameraPose, LiveEstimate, LivePose, LiveWearerEstimate
from vip_factors.sensors.scene import Scene
from vip_factors.tables import bone_words

VERSION: Final = 1  # of the format: keys may be added; a key that goes, or means something else, makes another one
QUATERNION_DIGITS, METRE_DIGITS, DEGREE_DIGITS = 5, 4, 2  # 0.001°, a tenth of a millimetre, 0.01°
TIME_DIGITS, HEADING_DIGITS, UPDATE_DIGITS, PIXEL_DIGITS = 6, 1, 3, 1
ANGLE_NAMES = tuple(angle.name for angle in ANGLE_DEFINITIONS)
ANGLE_WORDS = {angle.name: f"positive: {angle.positive}" for angle in ANGLE_DEFINITIONS}
JOINT_WORDS = {
    name: f"on the bone of {JOINT_NAMES[parent]}" if parent >= 0 else "the root"
    for name, parent in zip(JOINT_NAMES, PARENTS, strict=True)
}


def _keys(words: dict[str, str], schema: dict[str, object]) -> dict[str, object]:
    """JSON Schema of an object with fixed keys."""
    named = {name: schema | {"description": text} for name, text in words.items()}
    return {"properties": named, "required": list(words), "additionalProperties": False}


JOINT_KEYS = _keys(JOINT_WORDS, {"$ref": "#/$defs/JointAnswer"})
ANGLE_KEYS = _keys(ANGLE_WORDS, {"type": ["number", "null"]})

Number = float | None  # what is not finite, or not known, is null
Seconds = Annotated[float, Meta(description="seconds from the start of the stream")]
Position = Annotated[list[Number], Meta(min_length=3, max_length=3, description="x, y, z in metres; world, z up")]
Sigmas = Annotated[list[Number], Meta(min_length=3, max_length=3, description="standard deviations")]
Quaternion = Annotated[list[Number], Meta(min_length=4, max_length=4, description="w, x, y, z")]


class JointAnswer(msgspec.Struct, frozen=True):
    """A joint, and the bone of the same name that it moves."""

    position: Annotated[Position, Meta(description="p_world_joint: x, y, z in metres; world axes, z up")]
    orientation_wxyz: Annotated[
        Quaternion, Meta(description="R_world_bone; axes at rest: x to the wearer's left, y up, z forward")
    ]
    rotation_wxyz: Annotated[
        Quaternion, Meta(description="R_parent_child, against the bone above; of the pelvis R_world_pelvis")
    ]
    sigma_deg: Annotated[
        Number | UnsetType,
        Meta(description="standard deviation of rotation_wxyz in degrees, where it is estimated"),
    ] = UNSET


class PoseAnswer(msgspec.Struct, frozen=True):
    """A wearer at an instant."""

    time: Seconds
    joints: Annotated[
        dict[str, JointAnswer], Meta(description="SMPL's joints, parents first", extra_json_schema=JOINT_KEYS)
    ]
    angles_deg: Annotated[
        dict[str, Number],
        Meta(description="joint angles as the ISB recommends, in degrees within ±180", extra_json_schema=ANGLE_KEYS),
    ]
    root_sigma: Annotated[Sigmas | UnsetType, Meta(description="of the pelvis' x, y, z in metres")] = UNSET


class HeadingAnswer(msgspec.Struct, frozen=True):
    """How far a sensor's own north is turned about the vertical."""

    heading: Annotated[Number, Meta(description="R_world_inertial = rotation_z(heading), in degrees within ±180")]
    sigma: Annotated[Number, Meta(description="standard deviation in degrees")]


class WearerAnswer(msgspec.Struct, frozen=True):
    """One wearer; wearers come in the same order in all answers."""

    name: Annotated[str, Meta(description="the subject's name")]
    newest: Annotated[PoseAnswer, Meta(description="the pose at the answer's time")]
    smoothed: Annotated[
        PoseAnswer | None, Meta(description="the pose one lag earlier, which changes no more; null before the first")
    ]
    headings_deg: Annotated[dict[str, HeadingAnswer], Meta(description="by sensor")]
    guessed_angles: Annotated[
        dict[str, str],
        Meta(description="joints whose angles are a guess, as a segment of theirs has no sensor, and which segment"),
    ]
    detection: Annotated[
        int | None, Meta(description="index of the person in the newest video frame who is the wearer; null: not seen")
    ]


class CameraPoseAnswer(msgspec.Struct, frozen=True):
    """The camera at an instant; its axes: x to the right of the image, y down, z forward."""

    time: Seconds
    position: Annotated[Position, Meta(description="p_world_camera: x, y, z in metres")]
    orientation_wxyz: Annotated[Quaternion, Meta(description="R_world_camera")]
    sigma_deg: Annotated[Sigmas | UnsetType, Meta(description="in degrees about the camera's axes")] = UNSET
    position_sigma: Annotated[Sigmas | UnsetType, Meta(description="in metres along the camera's axes")] = UNSET


class CameraAnswer(msgspec.Struct, frozen=True):
    """A camera that is used."""

    name: Annotated[str, Meta(description="the camera's name")]
    focal_px: Annotated[list[Number], Meta(min_length=2, max_length=2, description="current focal lengths, pixels")]
    newest: Annotated[CameraPoseAnswer, Meta(description="at the answer's time")]
    smoothed: Annotated[CameraPoseAnswer | None, Meta(description="one lag earlier; null before the first")]


class FindingAnswer(msgspec.Struct, frozen=True):
    """Something that was noticed."""

    kind: Annotated[str, Meta(description="a name that all findings of a kind share")]
    severity: Annotated[Severity, Meta(description="how much it bears on the use of the results")]
    text: Annotated[str, Meta(description="a sentence")]


class Answer(msgspec.Struct, frozen=True, kw_only=True):
    """The answer to one frame."""

    version: Annotated[Literal[1], Meta(description="of this format")]
    frame: Annotated[int, Meta(description="number of the frame, from 0")]
    time: Seconds
    wearers: list[WearerAnswer]
    cameras: Annotated[list[CameraAnswer], Meta(description="cameras that show a wearer, in the set-up's order")]
    verdict: Annotated[Severity, Meta(description="by all findings so far")]
    preliminary: Annotated[
        bool, Meta(description="the calibration is still that of the first second: bones may be turned wrong")
    ]
    update_ms: Annotated[Number, Meta(description="what the update took, milliseconds of wall time")]
    findings: Annotated[list[FindingAnswer], Meta(description="of what has happened since the answer before")]


class LiveJsonEncoder:
    """Converts estimates to answers.

    Args:
        setup: of the stream.
    """

    def __init__(self, setup: Scene) -> None:
        self._bodies = [_Body(wearer.subject.body()) for wearer in setup.wearers]
        self._guessed = [guessed_angles({site.bone for site in wearer.placement.sites}) for wearer in setup.wearers]
        self._findings: dict[str, Finding] = {}  # the last of each kind

    def answer(self, estimate: LiveEstimate) -> Answer:
        """Make the answer to one frame."""
        self.note(estimate)
        return Answer(
            version=VERSION,
            frame=estimate.frame,
            time=round(estimate.time, TIME_DIGITS),
            wearers=[self._wearer(number, wearer) for number, wearer in enumerate(estimate.wearers)],
            cameras=[_camera(camera) for camera in estimate.cameras],
            verdict=verdict(self._findings.values()).severity,
            preliminary=estimate.preliminary,
            update_ms=round(1e3 * estimate.seconds, UPDATE_DIGITS),
            findings=[_finding(finding) for finding in estimate.findings],
        )

    def note(self, estimate: LiveEstimate) -> None:
        """Add the findings of a frame to the verdict, without making an answer."""
        self._findings |= {finding.kind: finding for finding in estimate.findings}

    @property
    def findings(self) -> list[FindingAnswer]:
        """The last finding of each kind so far."""
        return [_finding(finding) for finding in self._findings.values()]

    def _wearer(self, number: int, wearer: LiveWearerEstimate) -> WearerAnswer:
        if wearer.skeleton is not None and wearer.skeleton is not self._bodies[number].skeleton:
            self._bodies[number] = _Body(wearer.skeleton)
        poses = [pose for pose in (wearer.newest, wearer.smoothed) if pose is not None]
        newest, *smoothed = self._bodies[number].pose_answers(poses)
        time, calibrations = np.array(wearer.newest.time), wearer.calibration.values()
        turns = np.array([(sensor.heading_at(time), sensor.heading_sigma) for sensor in calibrations], float)
        degrees = np.rad2deg(turns.reshape(-1, 2))
        degrees[:, 0] = np.rad2deg(wrap_angle(turns.reshape(-1, 2)[:, 0]))
        rows = _list(degrees, HEADING_DIGITS)
        return WearerAnswer(
            name=wearer.name,
            newest=newest,
            smoothed=smoothed[0] if smoothed else None,
            headings_deg={
                sensor: HeadingAnswer(heading, sigma)
                for sensor, (heading, sigma) in zip(wearer.calibration, rows, strict=True)
            },
            guessed_angles=self._guessed[number],
            detection=wearer.detection,
        )


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

    def pose_answers(self, poses: list[LivePose]) -> list[PoseAnswer]:
        """Convert poses, all at once."""
        R = np.stack([pose.R_parent_child for pose in poses])
        state = forward_kinematics(self.skeleton, R, np.stack([pose.p_world_pelvis for pose in poses]))
        degrees = angles_of_segments(R_WORLD_ISB.T @ state.R_world_bone @ self._R_bone_segment)
        bones, turns = quaternion_from_matrix(np.stack([state.R_world_bone, R]), Order.WXYZ)
        positions, angles_deg = _list(state.p_world_joint, METRE_DIGITS), _list(degrees, DEGREE_DIGITS)
        quaternions = _list(bones, QUATERNION_DIGITS), _list(turns, QUATERNION_DIGITS)
        rows = zip(poses, positions, *quaternions, angles_deg, strict=True)
        answers = []
        for pose, *columns, angles in rows:
            root: list[Number] | UnsetType = UNSET
            if pose.joint_covariance is not None and pose.root_covariance is not None:
                sigma = PoseCovariance(pose.joint_covariance, pose.root_covariance).joint_sigma
                columns.append(_list(np.rad2deg(sigma), DEGREE_DIGITS))
                root = _list(_sigmas(pose.root_covariance), METRE_DIGITS)
            joints = map(JointAnswer, *columns)
            answers.append(
                PoseAnswer(
                    time=round(pose.time, TIME_DIGITS),
                    joints=dict(zip(JOINT_NAMES, joints, strict=True)),
                    angles_deg=dict(zip(ANGLE_NAMES, angles, strict=True)),
                    root_sigma=root,
                )
            )
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


def _finding(finding: Finding) -> FindingAnswer:
    return FindingAnswer(finding.kind, finding.severity, str(finding))


def _camera(camera: LiveCameraEstimate) -> CameraAnswer:
    smoothed = None if camera.smoothed is None else _camera_pose(camera.smoothed)
    return CameraAnswer(
        camera.name, _list(np.array(camera.model.focal), PIXEL_DIGITS), _camera_pose(camera.newest), smoothed
    )


def _camera_pose(pose: LiveCameraPose) -> CameraPoseAnswer:
    sigmas: tuple[list[Number], ...] = ()
    if pose.covariance is not None:
        sigma = _sigmas(pose.covariance)
        sigmas = _list(np.rad2deg(sigma[:3]), DEGREE_DIGITS), _list(sigma[3:], METRE_DIGITS)
    turn = _list(quaternion_from_matrix(pose.R_world_camera, Order.WXYZ), QUATERNION_DIGITS)
    return CameraPoseAnswer(round(pose.time, TIME_DIGITS), _list(pose.p_world_camera, METRE_DIGITS), turn, *sigmas)


def _sigmas(covariance: Array) -> Array:
    return np.sqrt(np.maximum(np.diag(covariance), 0.0))


def _list(values: Array, digits: int) -> list:
    """Rounded numbers as nested lists; what is not finite becomes null when it is encoded."""
    return (np.round(values, digits) + 0.0).tolist()  # no negative zero
