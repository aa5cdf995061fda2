"""Reference curves of gait, out of optical recordings of healthy adults."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.studies.gait_truth import geneva_events
from tests.studies.marker_body import SIDES, MarkerBody, posed, read_marker_body
from tests.studies.study import Study, Tell, group, table
from vip_factors.atomic import atomic_open
from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.joint_angles import joint_angles
from vip_factors.body.kinematics import Motion, local_rotations
from vip_factors.errors import InputError
from vip_factors.gait.files import REFERENCE_COLUMNS
from vip_factors.gait.results import CYCLE
from vip_factors.geometry.rotations import Array

ANGLES = ("hip_flexion", "knee_flexion", "ankle_dorsiflexion")
PACES = {"SlowGait": "slow", "Gait": "comfortable", "FastGait": "fast"}
FEWEST_PEOPLE = 3
NOTE = """\
# Joint angles over the gait cycle of healthy adults, by the markers of: Grouvel G., Armand S., Moissenet F.,
# Carcreff L., A dataset of asymptomatic human gait and movements obtained from markers, IMUs, insoles and force
# plates, Sci Data 10:180 (2023), doi 10.1038/s41597-023-02077-3, data doi 10.26037/yareta:xkxgaw6ewjdhfntdhtj7upepxy,
# CC BY 4.0. Changes: computed from 20 of its walks (participants P01, P02, P04, P06), with the angles of vip_factors,
# by python -m tests.studies train-gait; strides of both sides, from foot strike to foot strike. The pelvis is that of
# the iliac spines: hips are bent some 10 degrees more than against a pelvis that is upright when standing.
"""


@dataclass(frozen=True)
class ReferenceStride:
    """Joint angles ``(101,)`` in degrees over one stride of somebody, by their names, and how fast it was."""

    person: str
    pace: str
    speed: float
    angles: dict[str, Array]


@dataclass(frozen=True, kw_only=True)
class TrainGait(Study):
    """Train the reference curves of gait that ship with the package, on the Geneva data set."""

    data: Path
    """Folder with the public recordings, geneva_gait among them."""
    out: Path
    """File (.csv) to write."""

    def rows(self, tell: Tell) -> Iterator[ReferenceStride]:
        trials = sorted(self.data.glob("geneva_gait/P*/optical.csv"))
        if not trials:
            raise InputError(f"{self.data}: no walk of geneva_gait in it")
        found = list[ReferenceStride]()
        for done, path in enumerate(trials):
            tell(path.parent.name, done / len(trials))
            person, pace, _ = path.parent.name.split("_")
            strides = list(_strides(person, PACES[pace], read_marker_body(path), path.parent))
            found += strides
            yield from strides
        with atomic_open(self.out, "w", self.overwrite) as file:
            file.write(NOTE + "\n".join(_lines(found)) + "\n")

    def tables(self, rows: Sequence[ReferenceStride]) -> Iterator[str]:
        lines = []
        for pace, own in group(rows, lambda one: one.pace).items():
            speed = float(np.mean([one.speed for one in own]))
            lines.append([pace, f"{speed:.2f}", len({one.person for one in own}), len(own)])
        yield table(["pace", "m/s", "people", "strides"], lines)


def _strides(person: str, pace: str, body: MarkerBody, folder: Path) -> Iterator[ReferenceStride]:
    skeleton, state = posed(body, skeleton_from_stature(1.75))  # of which no angle depends
    motion = Motion(
        skeleton, local_rotations(state.R_world_bone), state.p_world_joint[:, 0], 1 / np.diff(body.time).mean(),
        float(body.time[0]),
    )  # fmt: skip
    angles, events = joint_angles(motion), geneva_events(folder)
    for side in SIDES:
        strikes = events[side].strike
        for start, end in itertools.pairwise(strikes):
            at = start + CYCLE / 100 * (end - start)
            if at[0] < motion.time[0] or at[-1] > motion.time[-1]:
                continue
            curves = {name: np.interp(at, motion.time, angles.of(f"{side}_{name}")) for name in ANGLES}
            first, last = (
                np.array([np.interp(time, body.time, axis) for axis in body.centres[f"{side}_hip"].T[:2]])
                for time in (start, end)
            )
            yield ReferenceStride(person, pace, float(np.linalg.norm(last - first) / (end - start)), curves)


def _lines(strides: Sequence[ReferenceStride]) -> Iterator[str]:
    yield ",".join(REFERENCE_COLUMNS)
    for pace, own in group(strides, lambda one: one.pace).items():
        people = len({one.person for one in own})
        if people < FEWEST_PEOPLE:
            continue
        speed = np.mean([one.speed for one in own])
        for name in ANGLES:
            curves = np.stack([one.angles[name] for one in own])
            for percent, mean, sd in zip(CYCLE, curves.mean(axis=0), curves.std(axis=0, ddof=1), strict=True):
                yield f"{pace},{speed:.3f},{people},{len(own)},{name},{percent:.0f},{mean:.2f},{sd:.2f}"
