"""What is set of a filmed scene; apart from sensors and detector, which the command line shows without NumPy."""

from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Literal

import numpy as np

from vip_factors.body.keypoints import keypoint_set
from vip_factors.errors import InputError
from vip_factors.ranges import Range, Rate, check_ranges
from vip_factors.sensors.camera_model import CameraModel
from vip_factors.simulate.settings import DetectorSettings, SimulateSettings

CameraKind = Literal["fixed", "hand-held", "walking"]


@dataclass(frozen=True)
class SceneSettings:
    """Camera, detector and sensors of a simulated scene; by default with the errors that they have in use."""

    camera: CameraKind = "hand-held"  # on a tripod, in the hands of somebody who stands, or of somebody who follows
    video_rate: Rate = 30.0  # Hz: what phones film at, and 3DPW was
    width: int = 1920  # pixels
    height: int = 1080
    fov_deg: Annotated[float, Range(least=5, most=150)] = (
        60.0  # horizontal: a phone's main camera (65–70) less what filming crops
    )
    distortion: tuple[float, ...] = ()  # OpenCV's; phones correct theirs
    azimuth_deg: float | None = None  # direction from the action to the camera, about the vertical; drawn if None
    distance_m: Annotated[float | None, Range(above=0)] = (
        None  # from the action to the camera; as its extent asks for if None
    )
    keypoints: str = "openpose18"  # the thesis's COCO-18
    time_offset_s: float = 0.0  # to add to the video's times to get the sensors'; the scene itself says 0
    camera_imu: bool | None = None  # whether the camera carries one; None: if it moves
    cameras: Annotated[int, Range(least=1)] = (
        1  # in all: further ones stand around the action, evenly spread, and their poses are known
    )
    known_pose: bool | None = None  # whether a fixed first camera's pose is known too; None: if there are further ones
    # What a board on the floor tells of a camera four metres away, each axis: half a metre of board, corners to 0.2 px.
    pose_error_deg: float = 0.1
    pose_error_m: float = 0.005
    camera_mounting_error_deg: float = 5.0  # of the IMU on the camera, each axis: taped along the edges by eye
    imu: SimulateSettings = field(default_factory=SimulateSettings)
    detector: DetectorSettings = field(default_factory=DetectorSettings)

    def __post_init__(self) -> None:
        keypoint_set(self.keypoints)
        if self.camera not in ("fixed", "hand-held", "walking"):
            raise InputError(f"camera '{self.camera}': expected fixed, hand-held or walking")
        check_ranges(self, zero=True)
        if self.known_pose and self.camera != "fixed":
            raise InputError(f"a known pose of a {self.camera} camera: only that of a fixed one can be known")
        self.model  # its own checks  # noqa: B018

    @property
    def model(self) -> CameraModel:
        """Intrinsics with square pixels and the principal point in the middle of the image."""
        focal = self.width / 2 / np.tan(np.deg2rad(self.fov_deg) / 2)
        return CameraModel(
            self.width, self.height, (focal, focal), (self.width / 2, self.height / 2), tuple(self.distortion)
        )

    @property
    def has_camera_imu(self) -> bool:
        """Whether the camera carries an IMU."""
        return self.camera != "fixed" if self.camera_imu is None else self.camera_imu

    @property
    def has_known_pose(self) -> bool:
        """Whether the first camera's pose is known."""
        if self.known_pose is None:
            return self.cameras > 1 and self.camera == "fixed"
        return self.known_pose

    @classmethod
    def noise_free(cls, **changes: Any) -> "SceneSettings":
        """No error of any sensor, of the camera's mounting, or of the detector; the camera moves all the same."""
        perfect = cls(
            camera_mounting_error_deg=0.0, pose_error_deg=0.0, pose_error_m=0.0,
            imu=SimulateSettings.noise_free(), detector=DetectorSettings.noise_free(),
        )  # fmt: skip
        return replace(perfect, **changes)
