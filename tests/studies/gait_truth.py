"""When feet struck and left the ground, and how far they came, as others measured it: optically, by force, by hand."""

import csv
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.studies.gait import optical_angles
from tests.studies.marker_body import SIDES, marker_columns, read_marker_body
from vip_factors.errors import FileFormatError
from vip_factors.geometry.rotations import Array

SENSOR_HZ, MARKER_HZ = 204.8, 100.0  # of gaitmap's sample; both clocks begin together
LOADED_N = 30.0  # a foot on a belt's force plate
BELT_S = 0.06  # before and after rest, over which a foot goes with the belt
Track = Callable[[float], Array]
"""Where a foot is on the floor, or on the belt, at a time."""


@dataclass(frozen=True)
class TrueEvents:
    """Of a foot: seconds of strikes and toe-offs."""

    strike: Array
    off: Array


@dataclass(frozen=True)
class TrueGait:
    """Reference of a walk, on the recording's clock.

    Attributes:
        events: by side.
        length: how far a foot came between two times at rest, by side; NaN where that was not measured.
        late_s: by sensor name, how late its clock is.
    """

    events: Mapping[str, TrueEvents]
    length: Callable[[str, float, float], float]
    late_s: Mapping[str, float]


def gaitmap_truth(folder: Path) -> TrueGait:
    """Of ``gaitmap_feet``: events by markers of the shoes, lengths by the heel's."""
    moments: dict[str, tuple[set[float], set[float]]] = {side: (set(), set()) for side in SIDES}
    with (folder / "stride_events_sample.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            strikes, offs = moments[row["foot"]]
            strikes.update(float(row[name]) / SENSOR_HZ for name in ("pre_ic", "ic"))
            offs.add(float(row["tc"]) / SENSOR_HZ)
    markers = folder / "mocap_sample.csv"
    with markers.open(encoding="utf-8") as file:
        names = [f"{one}_{axis}" for one, axis in zip(*(next(csv.reader(file)) for _ in range(2)), strict=True)]
        table = np.genfromtxt(file, delimiter=",", names=names)
    time = np.arange(len(table)) / MARKER_HZ
    heels = {
        side: marker_columns(table, [f"{side[0].upper()}_FCC_{x}" for x in "xy"], markers) / 1000 for side in SIDES
    }
    return TrueGait(_sorted(moments), lambda side, first, last: _distance(time, heels[side], first, last), {})


def geneva_truth(folder: Path) -> TrueGait:
    """Of a walk of ``geneva_gait``: events by markers, checked by hand, lengths by the ankle's centre."""
    with (folder / "imu.csv").open(encoding="utf-8") as file:
        begins = float(next(csv.DictReader(file))["time_s"])
    with (folder.parent / "sensors.csv").open(encoding="utf-8") as file:
        late = {
            row["sensor"]: float(row["skew_s"]) for row in csv.DictReader(file) if row["participant"] == folder.name[:3]
        }
    body = read_marker_body(folder / "optical.csv", begins)

    def length(side: str, first: float, last: float) -> float:
        return _distance(body.time, body.centres[f"{side}_ankle"][:, :2], first, last)

    return TrueGait(geneva_events(folder, begins), length, late)


def geneva_events(folder: Path, begins: float = 0.0) -> dict[str, TrueEvents]:
    """Of a walk of ``geneva_gait``, on the markers' clock or one that begins at a second of it."""
    moments: dict[str, tuple[set[float], set[float]]] = {side: (set(), set()) for side in SIDES}
    with (folder / "events.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            moments[row["side"].lower()]["Off" in row["event"]].add(float(row["time_s"]) - begins)
    return _sorted(moments)


def treadmill_truth(folder: Path) -> TrueGait:
    """Of ``xsens_treadmill_optical``: events by the belts' forces, lengths by ankle and belt."""
    path = folder / "OpenSim_Sub02_CSBaseline_GRF.mot"
    lines = path.read_text(encoding="utf-8").splitlines()
    header = lines.index("endheader")
    names, table = lines[header + 1].split(), np.loadtxt(lines[header + 2 :])
    time, moments = table[:, 0], {}
    for side in SIDES:
        if (name := f"{side[0]}Fy") not in names:
            raise FileFormatError(f"{path}: no column '{name}'; expected forces of two belts")
        force = table[:, names.index(name)]
        steps = np.flatnonzero(np.diff(force > LOADED_N))
        at = time[steps] + (LOADED_N - force[steps]) / (force[steps + 1] - force[steps]) * np.diff(time)[steps]
        lands = force[steps + 1] > LOADED_N
        moments[side] = set(at[lands].tolist()), set(at[~lands].tolist())
    optical = optical_angles(folder / "optical_joint_centres.csv")

    def length(side: str, first: float, last: float) -> float:
        ankle = optical.p_world_joint[f"{side}_ankle"][:, :1]  # x is along the belt
        if first - BELT_S < optical.time[0] or last + BELT_S > optical.time[-1]:
            return np.nan
        gone = np.interp([first, last], optical.time, ankle[:, 0])
        near = (np.abs(optical.time - at) < BELT_S for at in (first, last))
        belt = np.mean([-np.polyfit(optical.time[one], ankle[one, 0], 1)[0] for one in near])
        return float(gone[1] - gone[0] + belt * (last - first))

    # By the angular speed of the toes, optical against measured.
    return TrueGait(_sorted(moments), length, {"toes_r_imu_offset_imu": 0.013, "toes_l_imu_offset_imu": 0.008})


def _sorted(moments: Mapping[str, tuple[set[float], set[float]]]) -> dict[str, TrueEvents]:
    return {side: TrueEvents(*(np.array(sorted(one)) for one in both)) for side, both in moments.items()}


def _distance(time: Array, p: Array, first: float, last: float) -> float:
    if first < time[0] or last > time[-1]:
        return np.nan
    start, end = (np.array([np.interp(at, time, axis) for axis in p.T]) for at in (first, last))
    return float(np.linalg.norm(end - start))
