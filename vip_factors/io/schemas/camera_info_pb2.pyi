from vip_factors.io.schemas import geometry_pb2 as _geometry_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class CameraInfo(_message.Message):
    __slots__ = ("name", "moving", "time_offset_s", "mount", "known_poses", "video", "keypoint_set", "keypoints", "frames", "time_drift", "has_true_pixels", "focal_sigma", "scale_free_odometry")
    class Mount(_message.Message):
        __slots__ = ("imu", "mounting_wxyz", "p_camera_imu", "mounting_sigma_rad")
        IMU_FIELD_NUMBER: _ClassVar[int]
        MOUNTING_WXYZ_FIELD_NUMBER: _ClassVar[int]
        P_CAMERA_IMU_FIELD_NUMBER: _ClassVar[int]
        MOUNTING_SIGMA_RAD_FIELD_NUMBER: _ClassVar[int]
        imu: str
        mounting_wxyz: _geometry_pb2.QuaternionWxyz
        p_camera_imu: _geometry_pb2.Vector3
        mounting_sigma_rad: float
        def __init__(self, imu: _Optional[str] = ..., mounting_wxyz: _Optional[_Union[_geometry_pb2.QuaternionWxyz, _Mapping]] = ..., p_camera_imu: _Optional[_Union[_geometry_pb2.Vector3, _Mapping]] = ..., mounting_sigma_rad: _Optional[float] = ...) -> None: ...
    class Video(_message.Message):
        __slots__ = ("path", "image_frames")
        PATH_FIELD_NUMBER: _ClassVar[int]
        IMAGE_FRAMES_FIELD_NUMBER: _ClassVar[int]
        path: str
        image_frames: _containers.RepeatedScalarFieldContainer[int]
        def __init__(self, path: _Optional[str] = ..., image_frames: _Optional[_Iterable[int]] = ...) -> None: ...
    NAME_FIELD_NUMBER: _ClassVar[int]
    MOVING_FIELD_NUMBER: _ClassVar[int]
    TIME_OFFSET_S_FIELD_NUMBER: _ClassVar[int]
    MOUNT_FIELD_NUMBER: _ClassVar[int]
    KNOWN_POSES_FIELD_NUMBER: _ClassVar[int]
    VIDEO_FIELD_NUMBER: _ClassVar[int]
    KEYPOINT_SET_FIELD_NUMBER: _ClassVar[int]
    KEYPOINTS_FIELD_NUMBER: _ClassVar[int]
    FRAMES_FIELD_NUMBER: _ClassVar[int]
    TIME_DRIFT_FIELD_NUMBER: _ClassVar[int]
    HAS_TRUE_PIXELS_FIELD_NUMBER: _ClassVar[int]
    FOCAL_SIGMA_FIELD_NUMBER: _ClassVar[int]
    SCALE_FREE_ODOMETRY_FIELD_NUMBER: _ClassVar[int]
    name: str
    moving: bool
    time_offset_s: float
    mount: CameraInfo.Mount
    known_poses: int
    video: CameraInfo.Video
    keypoint_set: str
    keypoints: _containers.RepeatedScalarFieldContainer[str]
    frames: int
    time_drift: float
    has_true_pixels: bool
    focal_sigma: float
    scale_free_odometry: bool
    def __init__(self, name: _Optional[str] = ..., moving: bool = ..., time_offset_s: _Optional[float] = ..., mount: _Optional[_Union[CameraInfo.Mount, _Mapping]] = ..., known_poses: _Optional[int] = ..., video: _Optional[_Union[CameraInfo.Video, _Mapping]] = ..., keypoint_set: _Optional[str] = ..., keypoints: _Optional[_Iterable[str]] = ..., frames: _Optional[int] = ..., time_drift: _Optional[float] = ..., has_true_pixels: bool = ..., focal_sigma: _Optional[float] = ..., scale_free_odometry: bool = ...) -> None: ...
