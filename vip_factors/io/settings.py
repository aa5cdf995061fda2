"""Settings of logs, cameras, videos, live streams and exported files; the command line shows them without NumPy."""

from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal

from vip_factors.ranges import MaybeRate, NotNegative, Range, check_ranges


class SentPose(StrEnum):
    """Which pose is sent: that of the newest frame, or the one a lag earlier that changes no more."""

    NEWEST = "newest"
    SMOOTHED = "smoothed"


@dataclass(frozen=True)
class LiveSourceSettings:
    """Limits of a live source."""

    # Two wearers of 13 sensors at 100 Hz send 2,600 a second: a start-up of a second and a half loses nothing.
    queue_limit: int = 4096
    """Samples that wait for the tracker before some are dropped."""
    # Recorders flush several times a second; a minute of slack for the operating system would only delay the end.
    growth_wait: float = 10.0
    """Seconds that a file may take to appear, and without growth after which it counts as finished."""
    next_client_wait: Annotated[float | None, Range(least=0)] = None
    """Seconds that a server waits for another client after its last one has gone; until Ctrl-C if absent."""

    def __post_init__(self) -> None:
        check_ranges(self, "limits.")


DEFAULT = LiveSourceSettings()


@dataclass(frozen=True, kw_only=True)
class LogOptions:
    """What is known of a log and its wearer."""

    columns: Path | None = None
    """Column map (.toml) of a log that is a table, or tables, of no known format: which columns hold what, of which
    sensor, in which unit."""
    rate_hz: float | None = None
    """Samples per second of a table or an Xsens export, if it has no times and states no rate, or wrong ones."""
    stature_m: float | None = None
    """Height of the wearer in metres, without shoes; if absent, an adult's stands for it, and a note says so."""
    mass_kg: float | None = None
    """Mass of the wearer in kilograms; it tells widths, mostly."""
    sex: Literal["male", "female"] | None = None
    """Whose proportions the wearer is likely to have; those of both together if absent."""
    segment_lengths_m: dict[str, float] = field(default_factory=dict)
    """Measured lengths in metres, such as: thigh 0.43 shank 0.42; all others follow."""
    subject: str | None = None
    """Name of the wearer."""
    body: Path | None = None
    """Body file (.toml) that vip-factors body wrote of the wearer before, instead of stature, sex and lengths."""
    initial_pose: Literal["t-pose", "n-pose", "none"] | None = None
    """What the wearer held at the first moment kept."""
    pose_from: str | None = None
    """The initial pose was held in another log of the same sensors, or in one sample (1 is the first) of that log or of
    this one, facing anywhere; it is put before the recording."""
    start_s: float | None = None
    """Seconds of the log to leave out before."""
    end_s: float | None = None
    """Second of the log to end at."""
    format: str | None = None
    """Format of the log; found by its content if absent."""
    then: tuple[Path, ...] = ()
    """Log of the same sensors that follows in time, as a part of the same recording; the pause between them stays. May
    be said several times."""


@dataclass(frozen=True)
class CameraOptions:
    """Camera that filmed a scene: the 2D poses are needed, the rest is optional."""

    detections: Path | None = None
    """2D poses: OpenPose's folder, or the .json file of AlphaPose, MMPose or COCO's results."""
    camera: Path | None = None
    """Camera file (.toml) with the intrinsics; vip-factors calibrate-camera makes one. Of Pose2Sim's calibration:
    Calib.toml:cam_01. Without a file the focal length is estimated."""
    keypoints: str | None = None
    """Keypoints of the 2D poses: coco17, openpose18, body25, body25b, halpe26, blazepose33; by their number if
    absent."""
    video_rate: MaybeRate = None
    """Frames per second of the video, if the video is not given and the 2D poses have no times."""
    first_frame: int | None = None
    """Number of the video's first frame among the 2D poses; the format's usual one if absent."""
    static_camera: bool = False
    """The camera stands still: one pose for the whole recording."""
    known_camera_pose: bool = False
    """Take the static camera's pose over the floor from the camera file."""
    camera_path: Path | None = None
    """Path of a carried camera, from ARKit, ARCore or SLAM (TUM: time x y z qx qy qz qw; seconds of the video)."""
    scale_free_path: bool = False
    """That path has no metric scale, as monocular SLAM has none: the scale is estimated."""
    camera_imu: str | None = None
    """Name of the sensor that is on the camera, among those of the logs."""
    camera_imu_log: Path | None = None
    """Log of the sensor on the camera, if it has one of its own; --camera-imu names the sensor if it has several."""
    camera_imu_columns: Path | None = None
    """Column map (.toml) of that log, if it is a table of no known format."""
    camera_imu_offset_s: float | None = None
    """Seconds to add to that log's times to get the wearers' sensors'; by absolute times if absent."""
    camera_imu_wxyz: tuple[float, float, float, float] | None = None
    """Rough turn of that sensor's axes in the camera's (x right, y down, z forward), as a quaternion (1 0 0 0: its axes
    are the camera's); found from the data if absent."""
    time_offset_s: float = 0.0
    """Seconds to add to the video's times to get the sensors'; vip-factors sync finds them."""
    video: Path | None = None
    """Video, for viewing, for the times of its frames, and for the colours of clothes, which distinguish people."""
    embed_video: bool = False
    """Put small images of the video into the recording, for viewing anywhere."""
    camera_name: str = "camera"
    """Name of the camera in the recording."""


@dataclass(frozen=True)
class DetectSettings:
    """Settings of the detection of people in a video: frames, search and models."""

    search_s: NotNegative = 0.5
    """Seconds between searches for new people; each takes as long as several people's frames."""
    tile_levels: Annotated[int, Range(least=0, most=4)] = 2
    """Number of times the search halves its squares. 0 searches the whole image only, where people smaller than a third
    of it are easily missed; each level finds people of half the size, at up to four times the cost."""
    model: Path | None = None
    """ONNX file of a top-down pose model such as RTMPose (SimCC rows or heat maps), for the keypoints of the people
    that BlazePose detects and tracks."""
    keypoints: str | None = None
    """Keypoint set of that model: coco17, halpe26 …; chosen by their number if absent."""
    blazepose: Path | None = None
    """Wheel of mediapipe 0.10.21, or a folder with pose_detection.tflite and pose_landmark_full.tflite; if absent, the
    wheel is fetched with pip, once, and the two files are kept in the user's cache."""
    start_s: float | None = None
    """Second of the video at which to begin."""
    end_s: float | None = None
    """Second of the video at which to end."""
    every: int = 1
    """Process every n-th frame only; the others get no people."""
    threads: int | None = None
    """Number of processor threads; all processors, up to four, if absent."""

    def __post_init__(self) -> None:
        check_ranges(self)


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
    """Axes and unit of a BVH file, which cannot say them itself."""

    up: UpAxis = UpAxis.Y
    """Axis that points up: y is the default of Blender's importer and most programs; with z the numbers are
    those of the estimate's world (in Blender, choose Forward Y and Up Z then)."""
    unit: LengthUnit = LengthUnit.METRES
    """Unit of length: metres come out in true size in Blender; Maya and MotionBuilder expect centimetres."""


class TimeZero(StrEnum):
    """Zero of the times in a file."""

    RECORDING = "recording"
    LOG = "log"
    ABSOLUTE = "absolute"


@dataclass(frozen=True)
class ExportSettings:
    """Options of writing an estimate in another program's format."""

    wearer: str | None = None
    """Export this wearer only, by name; of a format that holds one person, each wearer gets a file of its own."""
    frame_rate: MaybeRate = None
    """Frames a second of the file; those of the estimate if absent, for then no frame is interpolated."""
    zero: TimeZero = TimeZero.RECORDING
    """Zero of the times in .csv, .trc, .mot, .sto and .c3d: the recording's first sample; that of the log's own time
    column (log), to lie beside a force plate on the same clock; or 1970-01-01 UTC (absolute)."""
    recording: Path | None = None
    """Recording (.mcap) that the estimate was made from: a .pkl takes its 2D poses and the times of the video frames
    from it; no other format needs it."""
    bone_names: BoneNames = BoneNames.SMPL
    """Names of the bones in .bvh, .glb and .fbx: smpl (pelvis, left_hip, …), those of all other files of this package;
    humanik (Hips, LeftUpLeg, …), which MotionBuilder and retargeting add-ons map by themselves; mixamo (the same
    after mixamorig:), unity (its Humanoid's), unreal (its mannequins': thigh_l, …). Rest pose and axes of the bones
    in .glb and .fbx are the program's too."""
    plant_feet: bool = True
    """Feet that stand neither slide nor float in .bvh, .glb and .fbx: legs follow them by inverse kinematics, by a few
    centimetres; without it, the files have the joints of the estimate exactly."""
    bvh: BvhSettings = field(default_factory=BvhSettings)
