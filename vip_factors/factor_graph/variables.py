"""Each variable of a scene as GTSAM has it: its key, its width, its value out of a state and back into one."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

import gtsam
import numpy as np

from vip_factors.body.hinges import HINGE_VARIABLES
from vip_factors.body.lengths import LENGTHS
from vip_factors.body.pose_prior import POSE_SIZE
from vip_factors.body.skeleton import JOINT_COUNT
from vip_factors.factor_graph import keys
from vip_factors.geometry.rotations import Array
from vip_factors.problem.layout import Layout, Owner, OwnerId
from vip_factors.problem.state import CameraPoses, DetectorState, SceneState, WearerState


class Kind(StrEnum):
    """What is to be found."""

    JOINT = "joint rotation"
    ROOT = "root translation"
    HEADING = "heading"
    MOUNTING = "mounting"
    POSE_MEAN = "mean pose"
    BODY = "body"
    SENSOR_PLACE = "place of a sensor"
    HINGES = "axes of elbows and knees"
    SOLE = "sole"
    KEYPOINT = "offset of a keypoint"
    CAMERA = "camera pose"
    CAMERA_HEADING = "camera heading"
    CAMERA_MOUNTING = "camera mounting"
    CLOCK = "clock offset"
    CLOCK_DRIFT = "clock drift"


WIDTHS = {
    Kind.HEADING: 1,
    Kind.CAMERA_HEADING: 1,
    Kind.CLOCK: 1,
    Kind.CLOCK_DRIFT: 1,
    Kind.SOLE: 1,
    Kind.CAMERA: 6,
    Kind.POSE_MEAN: POSE_SIZE,
    Kind.BODY: len(LENGTHS),
    Kind.HINGES: HINGE_VARIABLES,
}
# The layout's blocks, by the name of each, that a kind is an item of.
BLOCKS = {
    Kind.HEADING: "headings",
    Kind.MOUNTING: "R_bone_sensor",
    Kind.POSE_MEAN: "pose_mean",
    Kind.BODY: "body",
    Kind.HINGES: "hinges",
    Kind.SENSOR_PLACE: "sensor_places",
    Kind.SOLE: "sole",
    Kind.KEYPOINT: "keypoint_offsets",
    Kind.CAMERA: "poses",
    Kind.CAMERA_HEADING: "heading",
    Kind.CAMERA_MOUNTING: "R_camera_imu",
    Kind.CLOCK: "clock",
    Kind.CLOCK_DRIFT: "clock_drift",
}
# One variable each, of all columns of the block, and its letter.
WHOLE = {Kind.POSE_MEAN: "m", Kind.BODY: "s", Kind.HINGES: "e"}
ALONE = {letter: kind for kind, letter in WHOLE.items()} | {
    "f": Kind.SOLE,
    "g": Kind.CAMERA_HEADING,
    "q": Kind.CAMERA_MOUNTING,
    "o": Kind.CLOCK,
    "d": Kind.CLOCK_DRIFT,
}
KINDS = {block: kind for kind, block in BLOCKS.items()}


@dataclass(frozen=True)
class Variable:
    """One variable.

    Attributes:
        kind: of it.
        wearer: whose; 0 of the camera's.
        frame: it belongs to; 0 of what all frames share.
        item: joint or sensor.
        knot: of a heading that walks.
    """

    kind: Kind
    wearer: int = 0
    frame: int = 0
    item: int = 0
    knot: int = 0

    @property
    def key(self) -> int:
        """GTSAM's name."""
        match self.kind:
            case Kind.JOINT:
                return keys.joint_key(self.frame, self.item, self.wearer)
            case Kind.ROOT:
                return keys.root_key(self.frame, self.wearer)
            case Kind.HEADING:
                return keys.heading_key(self.item, self.wearer, self.knot)
            case Kind.MOUNTING:
                return keys.mounting_key(self.item, self.wearer)
            case Kind.SENSOR_PLACE:
                return keys.sensor_place_key(self.item, self.wearer)
            case Kind.POSE_MEAN | Kind.BODY | Kind.HINGES:
                return keys.wearer_key(WHOLE[self.kind], self.wearer)
            case Kind.SOLE:
                return keys.wearer_key("f", self.wearer)
            case Kind.KEYPOINT:
                return keys.keypoint_key(self.item)
            case Kind.CAMERA:
                return keys.camera_key(self.frame)
            case Kind.CAMERA_HEADING:
                return keys.camera_heading_key()
            case Kind.CAMERA_MOUNTING:
                return keys.camera_mounting_key()
            case Kind.CLOCK_DRIFT:
                return keys.clock_drift_key()
        return keys.clock_key()

    @property
    def width(self) -> int:
        """Of its tangent."""
        return WIDTHS.get(self.kind, 3)

    @property
    def is_of_a_frame(self) -> bool:
        """Whether every frame has one."""
        return self.kind in (Kind.JOINT, Kind.ROOT)

    @property
    def is_of_the_camera_path(self) -> bool:
        """Whether every frame has one if the camera moves."""
        return self.kind is Kind.CAMERA


def frames_of(variables: Iterable[Variable]) -> range:
    """The frames that variables belong to: those of bodies, or else those of the camera; of none, the first."""
    variables = list(variables)
    seen = [one.frame for one in variables if one.is_of_a_frame]
    seen = seen or [one.frame for one in variables if one.is_of_the_camera_path]
    return range(min(seen), max(seen) + 1) if seen else range(1)


def variables_of(layout: Layout, frames: int, knots: dict[int, int] | None = None) -> Iterator[Variable]:
    """All variables of a layout that move, frame by frame, then what frames share.

    Args:
        layout: of the problem.
        frames: how many there are.
        knots: of each wearer whose headings walk.
    """
    for t in range(frames):
        for part in layout.chains:
            if part.owner.kind is Owner.CAMERA:
                yield Variable(Kind.CAMERA, frame=t)
                continue
            for joint in range(JOINT_COUNT):
                yield Variable(Kind.JOINT, part.owner.number, t, joint)
            yield Variable(Kind.ROOT, part.owner.number, t)
    for owner, block, _ in layout.placed():
        if not block.free:
            continue
        kind, wearer = KINDS[block.name], owner.number if owner.kind is Owner.WEARER else 0
        items = 1 if kind in WHOLE else block.items
        for item in range(items):
            yield Variable(kind, wearer, 0, item)
        if kind is Kind.HEADING:
            for knot in range(1, (knots or {}).get(wearer, 1)):
                for item in range(items):
                    yield Variable(kind, wearer, 0, item, knot)


def variable_of(key: int) -> Variable | None:
    """The variable that has a key; None if none has."""
    letter, index = chr(gtsam.symbolChr(key)), int(gtsam.symbolIndex(key))
    wearer, rest = divmod(index, keys.WEARER)
    match letter:
        case "r":
            frame, joint = divmod(rest, keys.JOINT_SLOTS)
            found = Variable(Kind.JOINT, wearer, frame, joint) if joint < JOINT_COUNT else None
        case "t":
            found = Variable(Kind.ROOT, wearer, rest)
        case "h":
            knot, sensor = divmod(rest, keys.KNOT)
            found = Variable(Kind.HEADING, wearer, 0, sensor, knot)
        case "b":
            found = Variable(Kind.MOUNTING, wearer, 0, rest)
        case "p":
            found = Variable(Kind.SENSOR_PLACE, wearer, 0, rest)
        case "k":
            found = Variable(Kind.KEYPOINT, 0, 0, rest)
        case "c":
            found = Variable(Kind.CAMERA, frame=index)
        case _:
            found = Variable(ALONE[letter], wearer) if letter in ALONE else None
    return found


def values_of(state: SceneState, variables: Iterable[Variable], first: int = 0) -> gtsam.Values:
    """GTSAM's values of variables at a state, whose first frame has the number ``first``."""
    values = gtsam.Values()
    for one in variables:
        _insert(values, one, state, first)
    return values


def _insert(values: gtsam.Values, one: Variable, state: SceneState, first: int) -> None:
    camera, t = state.camera, one.frame - first
    wearer = state.wearers[one.wearer] if one.wearer < len(state.wearers) else None
    match one.kind:
        case Kind.CAMERA:
            at = t if len(camera.poses) > 1 else 0
            R, p = camera.poses.R_world_camera[at], camera.poses.p_world_camera[at]
            values.insert(one.key, gtsam.Pose3(gtsam.Rot3(R), np.asarray(p)))
        case Kind.KEYPOINT:
            values.insert(one.key, np.asarray(state.detector.keypoint_offsets[one.item]))
        case Kind.CAMERA_HEADING:
            values.insert(one.key, float(camera.heading))
        case Kind.CAMERA_MOUNTING:
            values.insert(one.key, gtsam.Rot3(camera.R_camera_imu))
        case Kind.CLOCK:
            values.insert(one.key, float(camera.clock))
        case Kind.CLOCK_DRIFT:
            values.insert(one.key, float(camera.clock_drift))
    if wearer is None:
        return
    match one.kind:
        case Kind.JOINT:
            values.insert(one.key, gtsam.Rot3(wearer.R_parent_child[t, one.item]))
        case Kind.ROOT:
            values.insert(one.key, np.asarray(wearer.p_world_pelvis[t]))
        case Kind.HEADING:
            values.insert(one.key, float(wearer.heading_knots[one.knot, one.item]))
        case Kind.MOUNTING:
            values.insert(one.key, gtsam.Rot3(wearer.R_bone_sensor[one.item]))
        case Kind.SENSOR_PLACE:
            values.insert(one.key, np.asarray(wearer.sensor_places[one.item]))
        case Kind.SOLE:
            values.insert(one.key, float(wearer.sole))
        case Kind.POSE_MEAN | Kind.BODY | Kind.HINGES:
            values.insert(one.key, np.asarray(getattr(wearer, BLOCKS[one.kind])))


def state_of(values: gtsam.Values, state: SceneState, variables: Iterable[Variable], first: int = 0) -> SceneState:
    """A state with the values of some variables put in.

    Args:
        values: of GTSAM.
        state: of a stretch of frames; what is not among the variables is kept.
        variables: to be read.
        first: number of the stretch's first frame.
    """
    wearers = [_Written(one) for one in state.wearers]
    camera = state.camera
    R_camera, p_camera = camera.poses.R_world_camera.copy(), camera.poses.p_world_camera.copy()
    offsets = state.detector.keypoint_offsets.copy()
    shared: dict[str, Any] = {}
    for one in variables:
        match one.kind:
            case Kind.CAMERA:
                pose, t = values.atPose3(one.key), one.frame - first if len(R_camera) > 1 else 0
                R_camera[t], p_camera[t] = pose.rotation().matrix(), pose.translation()
            case Kind.KEYPOINT:
                offsets[one.item] = values.atPoint3(one.key)
            case Kind.CAMERA_HEADING | Kind.CLOCK | Kind.CLOCK_DRIFT:
                shared[BLOCKS[one.kind]] = values.atDouble(one.key)
            case Kind.CAMERA_MOUNTING:
                shared["R_camera_imu"] = values.atRot3(one.key).matrix()
            case _:
                wearers[one.wearer].read(values, one, first)
    poses = CameraPoses(R_camera, p_camera)
    moved = replace(camera, poses=poses, **shared)
    return SceneState(tuple(one.state for one in wearers), moved, DetectorState(offsets))


class _Written:
    """A wearer's values, of which some are written to: these are copied first."""

    def __init__(self, state: WearerState) -> None:
        self._state, self._arrays = state, dict[str, Any]()

    @property
    def state(self) -> WearerState:
        knots = self._arrays.pop("heading_knots", None)
        if knots is not None:
            self._arrays |= {"headings": knots[0], "later_headings": knots[1:]}
        return replace(self._state, **self._arrays) if self._arrays else self._state

    def read(self, values: gtsam.Values, one: Variable, first: int) -> None:
        match one.kind:
            case Kind.JOINT:
                self._own("R_parent_child")[one.frame - first, one.item] = values.atRot3(one.key).matrix()
            case Kind.ROOT:
                self._own("p_world_pelvis")[one.frame - first] = values.atPoint3(one.key)
            case Kind.HEADING:
                self._own("heading_knots")[one.knot, one.item] = values.atDouble(one.key)
            case Kind.MOUNTING:
                self._own("R_bone_sensor")[one.item] = values.atRot3(one.key).matrix()
            case Kind.SENSOR_PLACE:
                self._own("sensor_places")[one.item] = values.atPoint3(one.key)
            case Kind.SOLE:
                self._arrays["sole"] = values.atDouble(one.key)
            case Kind.POSE_MEAN | Kind.BODY | Kind.HINGES:
                self._arrays[BLOCKS[one.kind]] = values.atVector(one.key)

    def _own(self, name: str) -> Array:
        if name not in self._arrays:
            self._arrays[name] = np.array(getattr(self._state, name))
        return self._arrays[name]


def owner_of(one: Variable) -> OwnerId:
    """Whose variable it is."""
    own = (Kind.JOINT, Kind.ROOT, Kind.HEADING, Kind.MOUNTING, Kind.SENSOR_PLACE, Kind.SOLE, *WHOLE)
    if one.kind is Kind.KEYPOINT:
        return OwnerId(Owner.DETECTOR)
    return OwnerId(Owner.WEARER, one.wearer) if one.kind in own else OwnerId(Owner.CAMERA)
