"""A real walk with optical reference: Xsens MTw on the lower body against Vicon, and Xsens MVN beside it.

The recording is the NeuRA-Sparse sample: raw MTw exports of the whole session, and from raw packet 1120 on Vicon joint
centres and segment orientations (Helen–Hayes), with MVN's own full-body result as BVH.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tests.studies.study import Fixed, Study, Tell, table
from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import joint_index
from vip_factors.errors import FileFormatError
from vip_factors.evaluate.body import knee_flexion_deg, knee_flexion_of, rmse, rmse_without_offset
from vip_factors.geometry.poses import align_rigid
from vip_factors.geometry.quaternions import Order, matrix_from_quaternion
from vip_factors.geometry.rotations import Array
from vip_factors.io.convert import ImportOptions, import_recording
from vip_factors.io.motions.bvh import read_bvh
from vip_factors.pipeline import smooth
from vip_factors.sensors.recording import Recording
from vip_factors.settings import Settings

SIDES = ("left", "right")
TRIAL = "S02-Trial-Walk-1"
RATE = 100.0  # Hz, of all three systems
FIRST_PACKET = 1120  # of the raw export, at the first row of the Vicon file
MVN_LEAD = 1  # the BVH reader drops MVN's leading rest frame
# Site → sensor. Of the two sensors on each shank the one above the ankle, where there is less muscle.
SENSORS = {
    "pelvis": "00B40B91", "left_thigh_front": "00B40C45", "right_thigh_front": "00B40C3C", "left_ankle": "00B40C44",
    "right_ankle": "00B40C47", "left_foot": "00B40C55", "right_foot": "00B40C48",
}  # fmt: skip
# Our segments by Vicon's joint centres, and Vicon's name of our joints.
SEGMENTS = {"thigh": ("FEP", "FEO"), "shank": ("FEO", "TIO"), "foot": ("TIO", "TOE")}
CENTRES = {f"{side}_{joint}": f"{side[0].upper()}{name}" for joint, name in
           (("hip", "FEP"), ("knee", "FEO"), ("ankle", "TIO")) for side in ("left", "right")}  # fmt: skip
STATURE_M = 1.78  # of the legs that Vicon measured, by Drillis & Contini; arms and head are not compared
# Vicon's segment axes (x forward, y left, z up) as columns of ours (x left, y up, z forward).
R_VICON_BONE = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


@dataclass(frozen=True)
class Vicon:
    """Optical reference: joint centres ``(T, 3)`` in metres and segment rotations ``(T, 3, 3)`` by Vicon's names."""

    centres: Mapping[str, Array]
    R_world_segment: Mapping[str, Array]

    def __len__(self) -> int:
        return len(self.centres["PELV"])

    @property
    def time(self) -> Array:
        """Seconds ``(T,)`` from the first raw packet."""
        return (FIRST_PACKET + np.arange(len(self))) / RATE

    def knee_flexion(self, side: str) -> Array:
        """Degrees ``(T,)``."""
        letter = side[0].upper()
        thigh, shank = self.R_world_segment[f"{letter}TH"], self.R_world_segment[f"{letter}SK"]
        return knee_flexion_deg(thigh @ R_VICON_BONE, shank @ R_VICON_BONE)

    def segment_lengths_m(self) -> dict[str, float]:
        """Mean distances of the joint centres."""
        lengths = {"hip_width": self._distance("LFEP", "RFEP")}
        for side in ("left", "right"):
            for segment, ends in SEGMENTS.items():
                lengths[f"{side}_{segment}"] = self._distance(*(f"{side[0].upper()}{end}" for end in ends))
        return lengths

    def _distance(self, one: str, other: str) -> float:
        return float(np.linalg.norm(self.centres[one] - self.centres[other], axis=1).mean())


def read_vicon(path: Path) -> Vicon:
    """The comma-separated export: ``//`` comments, a header, then joint centres (``NAME_1…3``) and ``qNAME_1…4``."""
    with path.open(encoding="utf-8") as file:
        lines = [line for line in file if not line.startswith("//")]
    names, table = lines[0].strip().split(","), np.loadtxt(lines[1:], delimiter=",")

    def columns(name: str, count: int) -> Array:
        wanted = [f"{name}_{number}" for number in range(1, count + 1)]
        missing = [one for one in wanted if one not in names]
        if missing:
            raise FileFormatError(f"{path}: no column '{missing[0]}'; expected Vicon's joint centres and segments")
        return table[:, [names.index(one) for one in wanted]]

    points = ["PELV", *(f"{side}{name}" for side in "LR" for name in ("FEP", "FEO", "TIO", "TOE"))]
    segments = ["RPV", *(f"{side}{name}" for side in "LR" for name in ("TH", "SK", "FT"))]
    centres = {name: columns(name, 3) for name in points}
    return Vicon(centres, {name: matrix_from_quaternion(columns(f"q{name}", 4), Order.WXYZ) for name in segments})


@dataclass(frozen=True)
class AngleError:
    """Degrees: RMSE, and RMSE once the mean difference is removed."""

    rmse: float
    without_offset: float


@dataclass(frozen=True)
class WalkResult:
    """Knees of ours and MVN's against Vicon by side, and our joint centres (each frame aligned rigidly) in mm."""

    ours: Mapping[str, AngleError]
    mvn: Mapping[str, AngleError]
    centres_mm: Mapping[str, float]
    seconds: float


@dataclass(frozen=True, kw_only=True)
class Walk(Study):
    """Seven real sensors on a walk with optical reference, beside Xsens MVN."""

    folder: Path
    """The folder xsens_vicon_walk, with raw_mtw, vicon and mvn in it."""
    settings: Fixed[Settings] = field(default_factory=Settings)

    def rows(self, tell: Tell) -> Iterator[WalkResult]:
        vicon = read_vicon(self.folder / "vicon" / f"{TRIAL}.csv")
        estimate = smooth(walk_recording(self.folder, vicon), self.settings, tell).only_wearer
        mvn = read_bvh(self.folder / "mvn" / f"{TRIAL}.bvh").frames(slice(FIRST_PACKET - MVN_LEAD, None))
        ours = {side: _knee(vicon, estimate.motion, side, vicon.time) for side in SIDES}
        theirs = {side: _knee(vicon, mvn, side, mvn.time[: len(vicon)]) for side in SIDES}
        seconds = sum(report.seconds for report in estimate.reports)
        yield WalkResult(ours, theirs, _centres_mm(vicon, estimate.motion), seconds)

    def tables(self, rows: Sequence[WalkResult]) -> Iterator[str]:
        (one,) = rows
        lines = []
        for name, errors in (("vip_factors", one.ours), ("Xsens MVN", one.mvn)):
            numbers = {side: (error.rmse, error.without_offset) for side, error in errors.items()}
            numbers["mean"] = tuple(np.mean(list(numbers.values()), axis=0))
            lines += [[f"{name}, {side}", *(f"{value:.2f}" for value in pair)] for side, pair in numbers.items()]
        yield table(["knee flexion against Vicon", "RMSE °", "without offset °"], lines)
        centres = [*one.centres_mm.items(), ("**mean**", np.mean(list(one.centres_mm.values())))]
        yield table(["joint centre", "mm"], centres)
        yield f"{one.seconds:.1f} s of solving"


def walk_recording(folder: Path, vicon: Vicon) -> Recording:
    """The seven sensors from the raw logs, on a body with the segment lengths that Vicon measured."""
    options = ImportOptions(
        placement=SENSORS, stature_m=STATURE_M, segment_lengths_m=vicon.segment_lengths_m(), initial_pose="n-pose",
        name=TRIAL,
    )  # fmt: skip
    return import_recording(folder / "raw_mtw", options)


def _knee(vicon: Vicon, motion: Motion, side: str, time: Array) -> AngleError:
    ours, reference = np.interp(time, motion.time, knee_flexion_of(motion, side)), vicon.knee_flexion(side)
    return AngleError(rmse(ours, reference), rmse_without_offset(ours, reference))


def _centres_mm(vicon: Vicon, motion: Motion) -> dict[str, float]:
    joints = motion.state.p_world_joint[:, [joint_index(name) for name in CENTRES]]
    ours = np.stack([np.interp(vicon.time, motion.time, series) for series in joints.reshape(len(joints), -1).T])
    ours = ours.T.reshape(len(vicon), len(CENTRES), 3)
    reference = np.stack([vicon.centres[name] for name in CENTRES.values()], axis=1)
    error = 1000 * np.linalg.norm(align_rigid(ours, reference).apply(ours) - reference, axis=-1)
    return dict(zip(CENTRES, error.mean(axis=0), strict=True))
