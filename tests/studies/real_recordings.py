"""The public recordings of real people that accuracy is judged on: where each lies in a folder, and what is known."""

import csv
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from tests.studies.gait import (
    FIRST_PACKET,
    TRIAL,
    GaitMotion,
    gait_of,
    marker_motion,
    opensim_angles,
    optical_angles,
    vicon_angles,
    video_motion,
)
from tests.studies.marker_body import MarkerBody, read_marker_body
from vip_factors.io.convert import ImportOptions
from vip_factors.io.log_streams import LEAD_S
from vip_factors.io.motions.files import read_bvh

STATURE_M = 1.75  # nobody says how tall these wearers were
MVN_LEAD = 1  # the reader of BVH drops MVN's leading rest frame
# Site → sensor. Of the two sensors on each shank the one above the ankle, where there is less muscle.
WALK = {
    "pelvis": "00B40B91", "left_thigh_front": "00B40C45", "right_thigh_front": "00B40C3C", "left_ankle": "00B40C44",
    "right_ankle": "00B40C47", "left_foot": "00B40C55", "right_foot": "00B40C48",
}  # fmt: skip
# How OpenSense names the sensors' frames; site → what follows it depends on the recording.
LEGS = {
    "pelvis": "pelvis_imu", "right_shank": "tibia_r_imu", "right_thigh": "femur_r_imu", "left_shank": "tibia_l_imu",
    "left_thigh": "femur_l_imu",
}  # fmt: skip
ARMS = {
    "sternum": "torso_imu", "right_upper_arm": "humerus_r_imu", "left_upper_arm": "humerus_l_imu",
    "right_forearm": "radius_r_imu", "left_forearm": "radius_l_imu",
}  # fmt: skip
TREADMILL = {
    **{site: f"{name}_offset_imu" for site, name in {"sternum": "torso_imu", **LEGS}.items()},
    "right_foot": "toes_r_imu_offset_imu", "left_foot": "toes_l_imu_offset_imu",
}  # fmt: skip
MT = {
    "sternum": "00B42268", "pelvis": "00B42279", "right_shank": "00B4227D", "right_thigh": "00B4227C",
    "left_shank": "00B421ED", "left_thigh": "00B421EE", "right_foot": "00B421EF", "left_foot": "00B421E6",
}  # fmt: skip
DOT = {
    "pelvis": "Pelvis", "right_shank": "RTibia", "right_thigh": "RFemur", "left_shank": "LTibia",
    "left_thigh": "LFemur",
}  # fmt: skip
GENEVA = {
    "left_foot": "LF", "left_shank_side": "LS", "left_thigh": "LT", "right_foot": "RF", "right_shank_side": "RS",
    "right_thigh": "RT", "pelvis": "SA", "sternum": "TR",
}  # fmt: skip


@dataclass(frozen=True)
class RealRecording:
    """One recording.

    Attributes:
        name: of the row.
        log: what is converted, as a path in the folder of all.
        options: what is said beside it.
        angles: reads how legs and trunk moved from the folder of all, if there is a reference.
        columns: column map of a log of no known format, as TOML.
        sites: placement file, as TOML, where there is more to say than options can.
        markers: reads how the whole body moved, on the recording's clock, where markers tell it: a camera can be made.
        video: a joint, and readers of how it bent by somebody else's video, and by OpenSense if it is known.
        other: name and reader of somebody else's result, to be judged by the same reference.
    """

    name: str
    log: str
    options: ImportOptions
    angles: Callable[[Path], GaitMotion] | None = None
    other: tuple[str, Callable[[Path], GaitMotion]] | None = None
    columns: str = ""
    sites: str = ""
    markers: Callable[[Path], MarkerBody] | None = None
    video: tuple[str, Callable[[Path], GaitMotion], Callable[[Path], GaitMotion | None]] | None = None


def real_recordings(folder: Path) -> Iterator[RealRecording]:
    """All that lie in a folder."""
    vidimu = sorted(path.relative_to(folder) for path in folder.glob("vidimu/S*/S??_A??_T??.sto"))
    geneva = sorted(path.relative_to(folder) for path in folder.glob("geneva_gait/P*/imu.csv"))
    for one in (*_KNOWN, *(_walk(path, folder) for path in geneva), *(_activity(path) for path in vidimu)):
        if (folder / one.log).exists():
            yield one


def _activity(path: Path) -> RealRecording:
    """Of VIDIMU: walking and sitting wear sensors on the legs, the rest on the arms.

    The first row of each is an N-pose held before, facing elsewhere, as the maker of the data says.
    """
    name = path.stem
    legs = name[4:7] in ("A01", "A02", "A03", "A04")
    joint = "knee" if legs else "elbow"

    def video(folder: Path) -> GaitMotion:
        return video_motion((folder / path).with_suffix(".csv"), LEAD_S)

    def opensense(folder: Path) -> GaitMotion | None:
        result = folder / path.with_name(f"ik_{name}.mot")
        return opensim_angles(result, LEAD_S, (joint,)) if result.exists() else None

    return RealRecording(
        f"vidimu {name}", str(path), replace(_worn(LEGS if legs else ARMS, "n-pose"), pose_from=f"{path}:1"),
        video=(joint, video, opensense),
    )  # fmt: skip


def _walk(path: Path, folder: Path) -> RealRecording:
    """Of geneva_gait: raw samples at 29–47 Hz, begun in quiet standing; the participants' heights are known."""
    with (folder / "geneva_gait" / "participants.csv").open(encoding="utf-8") as file:
        height_mm = {row["participant"]: float(row["height_mm"]) for row in csv.DictReader(file)}
    with (folder / path).open(encoding="utf-8") as file:
        begins = float(next(csv.DictReader(file))["time_s"])
    trial = path.parent.name
    options = ImportOptions(placement=GENEVA, stature_m=height_mm[trial[:3]] / 1000, initial_pose="n-pose")
    return RealRecording(
        f"geneva_gait {trial}", str(path), options, columns=_geneva_columns(),
        angles=lambda folder: marker_motion(read_marker_body(folder / path.parent / "optical.csv", begins)),
        markers=lambda folder: read_marker_body(folder / path.parent / "optical.csv", begins),
    )  # fmt: skip


def _geneva_columns() -> str:
    lines = ['time = "time_s"', 'time_unit = "s"']
    for name in GENEVA.values():
        for quantity, column, unit in (("acceleration", "acc", "g"), ("angular_rate", "gyr", "deg/s")):
            lines += [] if quantity != "acceleration" else [f'[sensors."{name}"]', 'file = "imu.csv"']
            lines += [f"{quantity} = {[f'{name}_{column}_{axis}' for axis in 'xyz']}", f'{quantity}_unit = "{unit}"']
    return "\n".join(lines) + "\n"


def _worn(
    placement: Mapping[str, str] | None, pose: Literal["n-pose", "none"] = "none", start_s: float | None = None
) -> ImportOptions:
    return ImportOptions(placement=placement, stature_m=STATURE_M, initial_pose=pose, start_s=start_s)


def _treadmill(pose: Literal["n-pose", "none"], log: str = "Orientations.sto", said: str = "") -> RealRecording:
    """With another log its accelerometers too, two of which are mis-scaled."""
    where = "xsens_treadmill_optical"

    def optical(folder: Path) -> GaitMotion:
        return optical_angles(folder / where / "optical_joint_centres.csv")

    def opensense(folder: Path) -> GaitMotion:
        return opensim_angles(folder / where / "ik_OpenSim_Sub02_CSBaseline_Orientations.mot")

    return RealRecording(
        f"{where}, pose {'declared' if pose != 'none' else 'not declared'}{said}",
        f"{where}/OpenSim_Sub02_CSBaseline_{log}", _worn(TREADMILL, pose), angles=optical,
        other=("OpenSense", opensense),
    )  # fmt: skip


def _mvn(folder: Path) -> GaitMotion:
    """MVN's own full-body result, on the frames of Vicon."""
    walk = folder / "xsens_vicon_walk"
    mvn = read_bvh(walk / "mvn" / f"{TRIAL}.bvh").frames(slice(FIRST_PACKET - MVN_LEAD, None))
    return gait_of(replace(mvn, start=float(vicon_angles(walk).time[0])))


# gaitmap's own axes of a foot (x forward, y left, z up) in ours (x left, y up, z forward); the rate is its makers'.
_GAITMAP = {"left": "left_sensor", "right": "right_sensor"}
_GAITMAP_COLUMNS = "rate_hz = 204.8\n" + "".join(
    f'[sensors."{name}"]\nacceleration = {[f"{name}_acc_{axis}" for axis in "xyz"]}\nacceleration_unit = "m/s2"\n'
    f'angular_rate = {[f"{name}_gyr_{axis}" for axis in "xyz"]}\nangular_rate_unit = "deg/s"\n'
    for name in _GAITMAP.values()
)
_GAITMAP_SITES = "[sensors]\n" + "".join(
    f'{name} = {{ site = "{side}_foot", mounting_wxyz = [0.5, -0.5, -0.5, -0.5], sigma_deg = 15 }}\n'
    for side, name in _GAITMAP.items()
)
_KNOWN = (
    RealRecording(
        "xsens_vicon_walk", "xsens_vicon_walk/raw_mtw", _worn(WALK, "n-pose"),
        angles=lambda folder: vicon_angles(folder / "xsens_vicon_walk"), other=("Xsens MVN", _mvn),
    ),
    _treadmill("n-pose"),
    _treadmill("none"),
    _treadmill("n-pose", "Accel.trc", ", with accelerometers"),
    RealRecording("opensense MT_009", "opensense/example_MT_009-001/IMUData", _worn(MT)),
    RealRecording(
        "opensense S07", "opensense/S07/S07_IMU/imu_walking_25s.sto",
        _worn({"sternum": "torso_imu", **LEGS, "right_foot": "calcn_r_imu", "left_foot": "calcn_l_imu"}),
    ),
    RealRecording("xsens_dot", "xsens_dot/Original_XsensDot_Data_Realtime", _worn(DOT)),
    RealRecording(
        "gaitmap_feet", "gaitmap_feet/imu_sample.csv", _worn(None), columns=_GAITMAP_COLUMNS, sites=_GAITMAP_SITES,
    ),
    RealRecording("mvnx upper body", "mvnx/upper_body_60hz_v4.mvnx", _worn(None)),
)  # fmt: skip
