"""Variables of a scene in GTSAM: keys, dimensions, and conversion of values from and to a state."""

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
FRAME_TITLES = {JOINT: "joint rotation", ROOT: "root translation"}  # of a wearer, in every frame
ARRAYS = {JOINT: "R_parent_child", ROOT: "p_world_pelvis"}  # attributes of the wearer's state
BY_LETTER = {row.letter: row for row in ROWS.values()}


@dataclass(frozen=True)
class Variable:
    """One variable.

    Attributes:
        block: row in the table of variables, or ``joint`` or ``root``.
        wearer: number of the wearer or camera.
        frame: number of the frame; 0 for static variables.
        item: number of the joint, sensor or keypoint.
        step: number of the step of a drifting heading.
    """

    block: str
    wearer: int = 0
    frame: int = 0
    item: int = 0
    step: int = 0

    @property
    def kind(self) -> str:
        """Kind of the variable in words."""
        return FRAME_TITLES.get(self.block) or ROWS[self.block].title

    @property
    def key(self) -> int:
        """GTSAM key of the variable."""
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
        """Manifold of the variable's values."""
        if self.is_of_a_frame:
            return Manifold.ROTATION if self.block == JOINT else Manifold.POINT
        return ROWS[self.block].manifold

    @property
    def is_one_vector(self) -> bool:
        """True if the variable contains all items of its block."""
        return not self.is_of_a_frame and ROWS[self.block].one_vector

    @property
    def width(self) -> int:
        """Dimension of the tangent space."""
        count = ROWS[self.block].count if self.is_one_vector else None
        return self.manifold.width if count is None else count

    @property
    def is_of_a_frame(self) -> bool:
        """True if every frame has such a variable."""
        return self.block in FRAME_TITLES

    @property
    def is_of_the_camera_path(self) -> bool:
        """True if every frame has such a variable for a moving camera."""
        return self.block == POSES

    @property
    def owner(self) -> OwnerId:
        """Owner of the variable."""
        kind = Owner.WEARER if self.is_of_a_frame else ROWS[self.block].owner
        return OwnerId(kind, self.wearer)


def variables_of(layout: Layout, frames: int, heading_steps: dict[int, int] | None = None) -> Iterator[Variable]:
    """Yield all free variables of a layout: frame by frame, then static ones.

    ``heading_steps`` is the number of steps by wearer with drifting headings.
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
            item_count = 1 if ROWS[block.name].one_vector else block.items
            steps = (heading_steps or {}).get(owner.number, 0) if block.name == HEADINGS else 0
            for step in range(steps + 1):
                for index in range(item_count):
                    yield Variable(block.name, owner.number, 0, index, step)


def variable_of(key: int) -> Variable | None:
    """Return the variable of a key; None for other keys."""
    letter, index = chr(gtsam.symbolChr(key)), int(gtsam.symbolIndex(key))
    wearer, local_index = divmod(index, keys.WEARER)
    if letter == "r":
        frame, joint = divmod(local_index, keys.JOINT_SLOTS)
        return Variable(JOINT, wearer, frame, joint) if joint < JOINT_COUNT else None
    if letter == "t":
        return Variable(ROOT, wearer, local_index)
    row = BY_LETTER.get(letter)
    if row is None:
        return None
    if row.name == POSES:
        return Variable(POSES, wearer, local_index)
    if row.name == HEADINGS:
        step, sensor = divmod(local_index, keys.STEP)
        return Variable(HEADINGS, wearer, 0, sensor, step)
    exists = row.count is None or local_index < (1 if row.one_vector else row.count)
    return Variable(row.name, wearer, 0, local_index) if exists else None


def values_of(state: SceneState, variables: Iterable[Variable], first_frame: int = 0) -> gtsam.Values:
    """GTSAM values of variables at a state that begins with frame ``first_frame``."""
    values = gtsam.Values()
    for variable in variables:
        if variable.owner.number < state.count(variable.owner.kind):
            _insert(values, variable, state, first_frame)
    return values


def _insert(values: gtsam.Values, variable: Variable, state: SceneState, first_frame: int) -> None:
    if variable.block == POSES:
        poses = state.cameras[variable.wearer].poses
        t = variable.frame - first_frame if len(poses) > 1 else 0
        R, p = poses.R_world_camera[t], np.asarray(poses.p_world_camera[t])
        values.insert(variable.key, gtsam.Pose3(gtsam.Rot3(R), p))
        return
    array, place = _array(state, variable, first_frame)
    value = np.asarray(array)[place]
    if variable.manifold is Manifold.ROTATION:
        values.insert(variable.key, gtsam.Rot3(value))
    elif variable.is_one_vector or variable.manifold is Manifold.POINT:
        values.insert(variable.key, np.asarray(value))
    else:
        values.insert(variable.key, float(value))


def _array(state: SceneState, variable: Variable, first_frame: int) -> tuple[Any, tuple[int, ...]]:
    """Array of a state that contains a variable, and the index in it."""
    owner_state = state.of(variable.owner)
    if variable.is_of_a_frame:
        t = variable.frame - first_frame
        return getattr(owner_state, ARRAYS[variable.block]), (t, variable.item) if variable.block == JOINT else (t,)
    if variable.block == HEADINGS:
        return state.wearers[variable.wearer].heading_path, (variable.step, variable.item)
    array = getattr(owner_state, variable.block)
    single = variable.is_one_vector or np.ndim(array) == (2 if variable.manifold is Manifold.ROTATION else 0)
    return array, () if single else (variable.item,)


def state_of(
    values: gtsam.Values, state: SceneState, variables: Iterable[Variable], first_frame: int = 0
) -> SceneState:
    """Replace variables of a state, which begins with frame ``first_frame``, by values."""
    written: dict[OwnerId, dict[str, Any]] = {}
    for variable in variables:
        values_of_owner = written.setdefault(variable.owner, {})
        if variable.block == POSES:
            old, pose = state.cameras[variable.wearer].poses, values.atPose3(variable.key)
            poses = values_of_owner.setdefault(POSES, CameraPoses(old.R_world_camera.copy(), old.p_world_camera.copy()))
            t = variable.frame - first_frame if len(old) > 1 else 0
            poses.R_world_camera[t], poses.p_world_camera[t] = pose.rotation().matrix(), pose.translation()
            continue
        name = "heading_path" if variable.block == HEADINGS else ARRAYS.get(variable.block, variable.block)
        array, place = _array(state, variable, first_frame)
        value = _read(values, variable)
        if place:
            if name not in values_of_owner:
                values_of_owner[name] = np.array(array)
            values_of_owner[name][place] = value
        else:
            values_of_owner[name] = value
    changed = {}
    for owner, arrays in written.items():
        path = arrays.pop("heading_path", None)
        if path is not None:
            arrays |= {"headings": path[0], "later_headings": path[1:]}
        changed[owner] = replace(state.of(owner), **arrays)
    return state.replaced(changed)


def _read(values: gtsam.Values, variable: Variable) -> Array | float:
    if variable.manifold is Manifold.ROTATION:
        return values.atRot3(variable.key).matrix()
    if variable.manifold is Manifold.POINT:
        return values.atPoint3(variable.key)
    return values.atVector(variable.key) if variable.is_one_vector else values.atDouble(variable.key)
