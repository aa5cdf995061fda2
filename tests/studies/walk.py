"""A real walk with optical reference: Xsens MTw on the lower body against Vicon, and Xsens MVN beside it.

The recording is the NeuRA-Sparse sample: raw MTw exports of the whole session, and from raw packet 1120 on Vicon joint
centres and segment orientations (Helen–Hayes), with MVN's own full-body result as BVH.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from tests.studies.gait import (
    FIRST_PACKET,
    TRIAL,
    AngleError,
    Vicon,
    angle_errors,
    centres_error_mm,
    gait_of,
    read_vicon,
    vicon_angles,
)
from tests.studies.marker_body import SIDES
from tests.studies.study import Fixed, Study, Tell, table
from vip_factors.io.convert import ImportOptions, import_recording
from vip_factors.io.motions.bvh import read_bvh
from vip_factors.pipeline import smooth
from vip_factors.sensors.recording import Recording
from vip_factors.settings import Settings

MVN_LEAD = 1  # the BVH reader drops MVN's leading rest frame
# Site → sensor. Of the two sensors on each shank the one above the ankle, where there is less muscle.
SENSORS = {
    "pelvis": "00B40B91", "left_thigh_front": "00B40C45", "right_thigh_front": "00B40C3C", "left_ankle": "00B40C44",
    "right_ankle": "00B40C47", "left_foot": "00B40C55", "right_foot": "00B40C48",
}  # fmt: skip
STATURE_M = 1.78  # of the legs that Vicon measured, by Drillis & Contini; arms and head are not compared


@dataclass(frozen=True)
class WalkResult:
    """Knees of ours and MVN's against Vicon by side, and our joint centres (each frame aligned rigidly) in mm."""

    ours: Mapping[str, AngleError]
    mvn: Mapping[str, AngleError]
    centres_mm: float
    seconds: float


@dataclass(frozen=True, kw_only=True)
class Walk(Study):
    """Seven real sensors on a walk with optical reference, beside Xsens MVN."""

    folder: Path
    """The folder xsens_vicon_walk, with raw_mtw, vicon and mvn in it."""
    settings: Fixed[Settings] = field(default_factory=Settings)

    def rows(self, tell: Tell) -> Iterator[WalkResult]:
        vicon, reference = read_vicon(self.folder / "vicon" / f"{TRIAL}.csv"), vicon_angles(self.folder)
        estimate = smooth(walk_recording(self.folder, vicon), self.settings, tell).only_wearer
        mvn = read_bvh(self.folder / "mvn" / f"{TRIAL}.bvh").frames(slice(FIRST_PACKET - MVN_LEAD, None))
        ours, theirs = (gait_of(one) for one in (estimate.motion, replace(mvn, start=float(reference.time[0]))))
        knees, mvns = (
            {side: errors[f"{side}_knee"] for side in SIDES}
            for errors in (angle_errors(one, reference) for one in (ours, theirs))
        )
        seconds = sum(report.seconds for report in estimate.reports)
        yield WalkResult(knees, mvns, centres_error_mm(ours, reference), seconds)

    def tables(self, rows: Sequence[WalkResult]) -> Iterator[str]:
        (one,) = rows
        lines = []
        for name, errors in (("vip_factors", one.ours), ("Xsens MVN", one.mvn)):
            numbers = {side: (error.rmse, error.without_offset) for side, error in errors.items()}
            numbers["mean"] = tuple(np.mean(list(numbers.values()), axis=0))
            lines += [[f"{name}, {side}", *(f"{value:.2f}" for value in pair)] for side, pair in numbers.items()]
        yield table(["knee flexion against Vicon", "RMSE °", "without offset °"], lines)
        yield f"Joint centres {one.centres_mm:.1f} mm off; {one.seconds:.1f} s of solving"


def walk_recording(folder: Path, vicon: Vicon) -> Recording:
    """The seven sensors from the raw logs, on a body with the segment lengths that Vicon measured."""
    options = ImportOptions(
        placement=SENSORS, stature_m=STATURE_M, segment_lengths_m=vicon.segment_lengths_m(), initial_pose="n-pose",
        name=TRIAL,
    )  # fmt: skip
    return import_recording(folder / "raw_mtw", options)
