"""Each variable of a scene as GTSAM has it: its key, its width, its value out of a state and back into one."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import gtsam
import numpy as np

from vip_factors.body.skeleton import JOINT_COUNT
from vip_factors.factor_graph import keys
from vip_factors.geometry.rotations import Array
from vip_factors.problem.layout import Layout, Manifold, Owner, OwnerId
from vip_factors.problem.state import CameraPoses, SceneState
from vip_factors.problem.variables import ROWS

JOINT, ROOT, HEADINGS, POSES = "joint", "root", "headings", "poses"
FRAME_TITLES = {JOINT: "joint rotation", ROOT: "root translation"}  # of what a wearer has in every frame
ARRAYS = {JOINT: "R_parent_child", ROOT: "p_world_pelvis"}  # attributes of the wearer's state
BY_LETTER = {row.letter: row for row in ROWS.values()}


@dataclass(frozen=True)
class Variable:
    """One variable.

    Attributes:
        block: its row in the table of variables, or ``joint`` or ``root``.
        wearer: number of the wearer or camera whose it is.
        frame: it belongs to; 0 of what all frames share.
        item: joint, sensor or keypoint.
        step: of a heading that drifts: how many steps are before it.
    """

    block: str
    wearer: int = 0
    frame: int = 0
    item: int = 0
    step: int = 0

    @property
    def kind(self) -> str:
        """What it is, in words."""
        return FRAME_TITLES.get(self.block) or ROWS[self.block].title

    @property
    def key(self) -> int:
        """GTSAM's name."""
        match self.block:
            case "joint":
                return keys.joint_key(self.frame, self.item, self.wearer)
            case "root":
                return keys.root_key(self.frame, self.wearer)
            case "poses":
                return keys.camera_key(self.frame, self.wearer)
        return keys.variable_key(self.block, self.item, self.wearer, self.step)

    @property
    def manifold(self) -> Manifold:
        """How it moves."""
        if self.is_of_a_frame:
            return Manifold.ROTATION if self.block == JOINT else Manifold.POINT
        return ROWS[self.block].manifold

    @property
    def is_one_vector(self) -> bool:
        """Whether it is all items of its block."""
        return not self.is_of_a_frame and ROWS[self.block].one_vector

    @property
    def width(self) -> int:
        """Of its tangent."""
        count = ROWS[self.block].count if self.is_one_vector else None
        return self.manifold.width if count is None else count

    @property
    def is_of_a_frame(self) -> bool:
        """Whether every frame has one."""
        return self.block in FRAME_TITLES

    @property
    def is_of_the_camera_path(self) -> bool:
        """Whether every frame has one if the camera moves."""
        return self.block == POSES

    @property
    def owner(self) -> OwnerId:
        """Whose it is."""
        kind = Owner.WEARER if self.is_of_a_frame else ROWS[self.block].owner
        return OwnerId(kind, self.wearer)


def variables_of(layout: Layout, frames: int, heading_steps: dict[int, int] | None = None) -> Iterator[Variable]:
    """All variables of a layout that move, in so many frames, then what frames share; ``heading_steps`` of each wearer
    whose headings drift.
    """
    for t in range(frames):
        for chain in layout.chains:
            if chain.owner.kind is Owner.CAMERA:
                yield Variable(POSES, chain.owner.number, t)
                continue
            for joint in range(JOINT_COUNT):
                yield Variable(JOINT, chain.owner.number, t, joint)
            yield Variable(ROOT, chain.owner.number, t)
    for owner, block, _ in layout.placed:
        if block.free:
            items = 1 if ROWS[block.name].one_vector else block.items
            steps = (heading_steps or {}).get(owner.number, 0) if block.name == HEADINGS else 0
            for step in range(steps + 1):
                for item in range(items):
                    yield Variable(block.name, owner.number, 0, item, step)


def variable_of(key: int) -> Variable | None:
    """The variable that has a key; None if none has."""
    letter, index = chr(gtsam.symbolChr(key)), int(gtsam.symbolIndex(key))
    wearer, rest = divmod(index, keys.WEARER)
    if letter == "r":
        frame, joint = divmod(rest, keys.JOINT_SLOTS)
        return Variable(JOINT, wearer, frame, joint) if joint < JOINT_COUNT else None
    if letter == "t":
        return Variable(ROOT, wearer, rest)
    row = BY_LETTER.get(letter)
    if row is None:
        return None
    if row.name == POSES:
        return Variable(POSES, wearer, rest)
    if row.name == HEADINGS:
        step, sensor = divmod(rest, keys.STEP)
        return Variable(HEADINGS, wearer, 0, sensor, step)
    exists = row.count is None or rest < (1 if row.one_vector else row.count)
    return Variable(row.name, wearer, 0, rest) if exists else None


def values_of(state: SceneState, variables: Iterable[Variable], first: int = 0) -> gtsam.Values:
    """GTSAM's values of variables at a state, whose first frame has the number ``first``."""
    values = gtsam.Values()
    for one in variables:
        if one.owner.number < state.count(one.owner.kind):
            _insert(values, one, state, first)
    return values


def _insert(values: gtsam.Values, one: Variable, state: SceneState, first: int) -> None:
    if one.block == POSES:
        poses = state.cameras[one.wearer].poses
        t = one.frame - first if len(poses) > 1 else 0
        R, p = poses.R_world_camera[t], np.asarray(poses.p_world_camera[t])
        values.insert(one.key, gtsam.Pose3(gtsam.Rot3(R), p))
        return
    array, place = _array(state, one, first)
    value = np.asarray(array)[place]
    if one.manifold is Manifold.ROTATION:
        values.insert(one.key, gtsam.Rot3(value))
    elif one.is_one_vector or one.manifold is Manifold.POINT:
        values.insert(one.key, np.asarray(value))
    else:
        values.insert(one.key, float(value))


def _array(state: SceneState, one: Variable, first: int) -> tuple[Any, tuple[int, ...]]:
    """The array of a state that holds a variable, and where in it."""
    own = state.of(one.owner)
    if one.is_of_a_frame:
        t = one.frame - first
        return getattr(own, ARRAYS[one.block]), (t, one.item) if one.block == JOINT else (t,)
    if one.block == HEADINGS:
        return state.wearers[one.wearer].heading_path, (one.step, one.item)
    array = getattr(own, one.block)
    single = one.is_one_vector or np.ndim(array) == (2 if one.manifold is Manifold.ROTATION else 0)
    return array, () if single else (one.item,)


def state_of(values: gtsam.Values, state: SceneState, variables: Iterable[Variable], first: int = 0) -> SceneState:
    """A state of a stretch of frames, of which ``first`` is the first one's number, with the values of some variables
    put in.
    """
    written: dict[OwnerId, dict[str, Any]] = {}
    for one in variables:
        own = written.setdefault(one.owner, {})
        if one.block == POSES:
            old, pose = state.cameras[one.wearer].poses, values.atPose3(one.key)
            poses = own.setdefault(POSES, CameraPoses(old.R_world_camera.copy(), old.p_world_camera.copy()))
            t = one.frame - first if len(old) > 1 else 0
            poses.R_world_camera[t], poses.p_world_camera[t] = pose.rotation().matrix(), pose.translation()
            continue
        name = "heading_path" if one.block == HEADINGS else ARRAYS.get(one.block, one.block)
        array, place = _array(state, one, first)
        value = _read(values, one)
        if place:
            if name not in own:
                own[name] = np.array(array)
            own[name][place] = value
        else:
            own[name] = value
    changed = {}
    for owner, arrays in written.items():
        path = arrays.pop("heading_path", None)
        if path is not None:
            arrays |= {"headings": path[0], "later_headings": path[1:]}
        changed[owner] = replace(state.of(owner), **arrays)
    return state.replaced(changed)


def _read(values: gtsam.Values, one: Variable) -> Array | float:
    if one.manifold is Manifold.ROTATION:
        return values.atRot3(one.key).matrix()
    if one.manifold is Manifold.POINT:
        return values.atPoint3(one.key)
    return values.atVector(one.key) if one.is_one_vector else values.atDouble(one.key)
