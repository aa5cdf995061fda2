"""Lengths of strides, beside those that optical markers on the heels told."""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.studies.marker_body import SIDES, marker_columns
from vip_factors.body.motion import Motion
from vip_factors.body.skeleton import joint_index
from vip_factors.errors import FileFormatError
from vip_factors.geometry.rotations import Array

SENSOR_HZ, MARKER_HZ = 204.8, 100.0  # of gaitmap's sample; both clocks begin together


@dataclass(frozen=True)
class Strides:
    """``S`` strides of one foot, each from one moment of rest on the floor to the next.

    Attributes:
        start, end: ``(S,)`` seconds.
        length: ``(S,)`` metres, along the floor.
    """

    start: Array
    end: Array
    length: Array


@dataclass(frozen=True)
class StrideErrors:
    """Of all strides of both feet, metres: the true mean length, and mean and standard deviation of ours less it."""

    count: int
    length: float
    error_mean: float
    error_sd: float


def read_strides(folder: Path) -> dict[str, Strides]:
    """Of ``gaitmap_feet``, by side: when each foot rested, and where its heel's marker was then."""
    events, markers = folder / "stride_events_sample.csv", folder / "mocap_sample.csv"
    with markers.open(encoding="utf-8") as file:
        names = [f"{one}_{axis}" for one, axis in zip(*(next(csv.reader(file)) for _ in range(2)), strict=True)]
        table = np.genfromtxt(file, delimiter=",", names=names)
    time = np.arange(len(table)) / MARKER_HZ
    moments: dict[str, list[tuple[float, float]]] = {side: [] for side in SIDES}
    with events.open(encoding="utf-8") as file:
        for line, row in enumerate(csv.DictReader(file), start=2):
            if row.get("foot") not in moments or not {"start", "end"} <= set(row):
                raise FileFormatError(
                    f"{events}, line {line}: expected a foot (left, right), start and end of a stride"
                )
            moments[row["foot"]].append((float(row["start"]) / SENSOR_HZ, float(row["end"]) / SENSOR_HZ))
    found = {}
    for side, rests in moments.items():
        heel = marker_columns(table, [f"{side[0].upper()}_FCC_{axis}" for axis in "xyz"], markers) / 1000
        start, end = np.array(rests).reshape(-1, 2).T
        found[side] = Strides(start, end, _lengths(time, heel, start, end))
    return found


def stride_errors(motion: Motion, reference: dict[str, Strides]) -> StrideErrors:
    """How far the ankles of a motion went, beside how far the heels did; strides that it does not last to are left out.

    A foot that rests does not turn: any point of it goes as far as another.
    """
    true, off = list[float](), list[float]()
    for side, strides in reference.items():
        there = (strides.start >= motion.time[0]) & (strides.end <= motion.time[-1])
        ankle = motion.state.p_world_joint[:, joint_index(f"{side}_ankle")]
        own = _lengths(motion.time, ankle, strides.start[there], strides.end[there])
        true += [*strides.length[there]]
        off += [*(own - strides.length[there])]
    return StrideErrors(len(off), float(np.mean(true)), float(np.mean(off)), float(np.std(off)))


def _lengths(time: Array, p_world: Array, start: Array, end: Array) -> Array:
    first, last = (np.stack([np.interp(at, time, axis) for axis in p_world[:, :2].T], axis=1) for at in (start, end))
    return np.linalg.norm(last - first, axis=1)
