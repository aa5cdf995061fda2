"""Settings of logs, cameras, videos, live streams and exported files; the command line shows them without NumPy."""

from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal

from vip_factors.ranges import MaybeRate, Range, check_ranges


class SentPose(StrEnum):
    """Which pose is sent: that of the newest frame, or the one a lag earlier that changes no more."""

    NEWEST = "newest"
    SMOOTHED = "smoothed"


@dataclass(frozen=True)
class LiveSourceSettings:
    """Limits of a live source."""

    # Two wearers of 13 sensors at 100 Hz send 2,600 a second: a start-up of a second and a half loses nothing.
    queue_limit: int = 4096
    """Maximum number of queued samples; further samples are dropped."""
    # Recorders flush several times a second; a minute of slack for the operating system would only delay the end.
    growth_wait: float = 10.0
    """Seconds to wait for a file to appear, and without growth until it counts as complete."""
    next_client_wait: Annotated[float | None, Range(least=0)] = None
    """Seconds that a server waits for another client after the last one disconnects; default: until Ctrl-C."""

    def __post_init__(self) -> None:
        check_ranges(self, "limits.")


DEFAULT = LiveSourceSettings()


@dataclass(frozen=True, kw_only=True)
class LogOptions:
    """What is known of a log and its wearer."""

    columns: Path | None = None
    """Column map (.toml) of a table of unknown format: the quantity, sensor and unit of each column."""
    rate_hz: float | None = None
    """Samples per second of a table or an Xsens export whose times or rate are missing or wrong."""
    stature_m: float | None = None
    """Height of the wearer in metres, without shoes; default: that of an average adult, with a note."""
    mass_kg: float | None = None
    """Mass of the wearer in kilograms; it mostly affects widths of the body."""
    sex: Literal["male", "female"] | None = None
    """Sex of the wearer, for the proportions of the body; default: the average of both."""
    segment_lengths_m: dict[str, float] = field(default_factory=dict)
    """Measured segment lengths in metres, such as: thigh 0.43 shank 0.42; the others are estimated from these."""
    subject: str | None = None
    """Name of the wearer."""
    body: Path | None = None
    """Body file (.toml) of the wearer from vip-factors body; replaces stature, sex and lengths."""
    initial_pose: Literal["t-pose", "n-pose", "none"] | None = None
    """Pose that the wearer holds at the start of the recording."""
    pose_from: str | None = None
    """Another log of the same sensors, or one sample of a log (1 is the first), in which the initial pose was held. Its
    samples are placed before the recording."""
    start_s: float | None = None
    """Seconds to skip at the start of the log."""
    end_s: float | None = None
    """Second of the log at which the recording ends."""
    format: str | None = None
    """Format of the log; default: detected from the content."""
    then: tuple[Path, ...] = ()
    """Log of the same sensors that continues this one in time; the pause between them remains. Repeatable."""


@dataclass(frozen=True)
class CameraOptions:
    """Camera that filmed a scene: the 2D poses are needed, the rest is optional."""

    detections: Path | None = None
    """2D poses: folder of OpenPose, or .json file of AlphaPose, MMPose or COCO results."""
    camera: Path | None = None
    """Camera file (.toml) with the intrinsics, from vip-factors calibrate-camera or Pose2Sim (Calib.toml:cam_01).
    Default: the focal length is estimated."""
    keypoints: str | None = None
    """Keypoint set: coco17, openpose18, body25, body25b, halpe26, blazepose33; default: from their number."""
    video_rate: MaybeRate = None
    """Frames per second of the video; required if neither --video nor the 2D poses give times."""
    first_frame: int | None = None
    """Number of the video's first frame in the 2D poses; default: that of the format."""
    static_camera: bool = False
    """The camera stands still: one pose for the whole recording."""
    known_camera_pose: bool = False
    """Take the static camera's pose over the floor from the camera file."""
    camera_path: Path | None = None
    """Path of a carried camera from ARKit, ARCore or SLAM (TUM format: time x y z qx qy qz qw; times in seconds of the
    video)."""
    scale_free_path: bool = False
    """The scale of --camera-path is unknown, as in monocular SLAM, and is estimated."""
    camera_imu: str | None = None
    """Name of the sensor on the camera."""
    camera_imu_log: Path | None = None
    """Separate log of the sensor on the camera; if it holds several sensors, --camera-imu selects one."""
    camera_imu_columns: Path | None = None
    """Column map (.toml) of --camera-imu-log, if it is a table of unknown format."""
    camera_imu_offset_s: float | None = None
    """Seconds to add to the times of --camera-imu-log to match the other sensors; default: from absolute times."""
    camera_imu_wxyz: tuple[float, float, float, float] | None = None
    """Approximate rotation from the axes of the sensor on the camera to the camera's axes (x right, y down, z forward),
    as a quaternion w x y z; default: estimated."""
    time_offset_s: float = 0.0
    """Seconds to add to the video's times to match the sensors; vip-factors sync estimates them."""
    video: Path | None = None
    """Video, for viewing, for the frame times, and for the colours of clothes, which help to identify people."""
    embed_video: bool = False
    """Store small images of the video in the recording, for viewing without the video file."""
    camera_name: str = "camera"
    """Name of the camera in the recording."""


class BoneNames(StrEnum):
    """Naming scheme of an animation's bones."""

    SMPL = "smpl"
    HUMANIK = "humanik"
    MIXAMO = "mixamo"
    UNITY = "unity"
    UNREAL = "unreal"


class UpAxis(StrEnum):
    """Which axis of a file points up."""

    Y = "y"
    Z = "z"


class LengthUnit(StrEnum):
    """Unit of length in a file."""

    METRES = "m"
    CENTIMETRES = "cm"

    @property
    def per_metre(self) -> float:
        """Number of units in a metre."""
        return {LengthUnit.METRES: 1.0, LengthUnit.CENTIMETRES: 100.0}[self]


@dataclass(frozen=True)
class BvhSettings:
    """Axes and unit of a BVH file."""

    up: UpAxis = UpAxis.Y
    """Axis that points up: y is the default of Blender's importer and most programs; z keeps the axes of the estimate
    (in Blender, choose Forward Y and Up Z)."""
    unit: LengthUnit = LengthUnit.METRES
    """Unit of length: Blender expects metres; Maya and MotionBuilder expect centimetres."""


class TimeZero(StrEnum):
    """Zero of the times in a file."""

    RECORDING = "recording"
    LOG = "log"
    ABSOLUTE = "absolute"


@dataclass(frozen=True)
class ExportSettings:
    """Options of writing an estimate in another program's format."""

    wearer: str | None = None
    """Name of the only wearer to export; default: all, in one file each for formats that hold one person."""
    frame_rate: MaybeRate = None
    """Frames per second of the file; default: those of the estimate, without interpolation."""
    zero: TimeZero = TimeZero.RECORDING
    """Zero of the times in .csv, .trc, .mot, .sto and .c3d: the first sample (recording); the zero of the log's time
    column (log), to match a force plate on the same clock; or 1970-01-01 UTC (absolute)."""
    recording: Path | None = None
    """Recording (.mcap) of the estimate, for the 2D poses and video times in .pkl; other formats ignore it."""
    bone_names: BoneNames = BoneNames.SMPL
    """Bone names in .bvh, .glb and .fbx: smpl (pelvis, left_hip, …); humanik (Hips, LeftUpLeg, …), which MotionBuilder
    and retargeting add-ons recognise; mixamo (mixamorig:Hips, …); unity (Humanoid); unreal (mannequin: thigh_l, …).
    They also set the rest pose and bone axes in .glb and .fbx."""
    plant_feet: bool = True
    """Keep standing feet still and on the floor in .bvh, .glb and .fbx, by inverse kinematics; joints move by a few
    centimetres. Off: the joints of the estimate."""
    bvh: BvhSettings = field(default_factory=BvhSettings)
