"""What was measured in one frame of a stream, and in consecutive ones: these as a scene for the batch stages."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vip_factors.geometry.rotations import Array, transpose
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.frames import ImuFrames
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.live import LiveCamera, LiveSetup, VideoFrame
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Camera, CameraMount, Scene


@dataclass(frozen=True)
class PlacedVideoFrame:
    """A video frame and the number of the frame nearest to it in time (half a frame off at most)."""

    frame: int
    video: VideoFrame


@dataclass(frozen=True)
class FrameMeasurement:
    """Measurements of ``S`` sensors in one frame: what :class:`~vip_factors.sensors.frames.ImuFrames` has in a row.

    Attributes:
        frame: number, from 0, without holes.
        time: seconds from the start of the stream; evenly spaced, but for restarts.
        R_inertial_sensor: ``(S, 3, 3)``; identity where not valid.
        orientation_valid: ``(S,)`` whether the orientation was measured here.
        specific_force_inertial: ``(S, 3)`` m/s² of the frame *before* this one, in each sensor's inertial frame
            (gravity included): its triangular window, of half-width one frame, ends only here. Zero where not valid.
        acceleration_valid: ``(S,)`` whether all of that window was measured.
        video: what has become available since the frame before; each with its own frame, this one or an earlier one
            within the lag. A frame may get several, of several cameras or of a fast one.
        restart: whether frames have been left out before this one: track anew from here.
    """

    frame: int
    time: float
    R_inertial_sensor: Array
    orientation_valid: np.ndarray
    specific_force_inertial: Array
    acceleration_valid: np.ndarray
    video: tuple[PlacedVideoFrame, ...] = ()
    restart: bool = False


MEASURES = 0.3  # of the frames: a third of its packets is enough to start with a sensor

LATELY_S = 2.0  # of a long stretch: a sensor that came late, or has moved, is of use as well


class MeasuredStretch:
    """Consecutive frames of a stream.

    Attributes:
        setup: what the stream is about.
        measurements: of the frames.
        video: frames of all cameras in that time, each with the number of its frame.
        columns: carrier and name of each sensor in the measurements.
    """

    def __init__(
        self,
        setup: LiveSetup,
        measurements: Sequence[FrameMeasurement],
        video: Sequence[tuple[int, VideoFrame]],
        columns: Sequence[tuple[str, str]],
    ) -> None:
        self.setup, self.measurements, self.video, self.columns = setup, list(measurements), list(video), list(columns)
        self.time = np.array([one.time for one in self.measurements])

    @property
    def first(self) -> int:
        """Number of its first frame."""
        return self.measurements[0].frame

    def tail(self, frames: int) -> "MeasuredStretch":
        """The last ``frames`` of it."""
        measurements = self.measurements[-frames:]
        video = [(number, one) for number, one in self.video if number >= measurements[0].frame]
        return MeasuredStretch(self.setup, measurements, video, self.columns)

    def alive(self, carrier: str) -> list[str]:
        """Names of a carrier's sensors that measured orientations throughout, or of late, or nearly so."""
        seen = np.stack([one.orientation_valid for one in self.measurements])
        lately = seen[self.time > self.time[-1] - LATELY_S]
        share = np.maximum(seen.mean(axis=0), lately.mean(axis=0))
        return [
            sensor
            for (who, sensor), part in zip(self.columns, share, strict=True)
            if who == carrier and part > MEASURES
        ]

    def column(self, carrier: str, sensor: str) -> int:
        """Where a sensor's measurements are."""
        return self.columns.index((carrier, sensor))

    def frames(self, carrier: str, sensors: Sequence[str]) -> ImuFrames:
        """Some of a carrier's sensors at all frames."""
        columns = np.array([self.column(carrier, sensor) for sensor in sensors], dtype=int)
        some = self.measurements
        force = np.stack([one.specific_force_inertial[columns] for one in some])
        whole = np.stack([one.acceleration_valid[columns] for one in some])
        return ImuFrames(
            tuple(sensors),
            self.time,
            np.stack([one.R_inertial_sensor[columns] for one in some]),
            np.stack([one.orientation_valid[columns] for one in some]),
            np.concatenate([force[1:], np.zeros_like(force[:1])]),  # a measurement holds the frame before it
            np.concatenate([whole[1:], np.zeros_like(whole[:1])]),
        )

    def scene(self) -> Scene:
        """As a scene."""
        wearers = []
        for wearer in self.setup.wearers:
            names = [name for name in self.alive(wearer.name) if name in {one.sensor for one in wearer.placement.sites}]
            streams = {name: _stream(self.frames(wearer.name, [name])) for name in names}
            wearers.append(
                Recording(self.setup.name, wearer.subject, streams, wearer.placement, self._pose(wearer.initial_pose))
            )
        cameras = [self._camera(camera) for camera in self.setup.cameras]
        first, further = (cameras[0], tuple(cameras[1:])) if cameras else (None, ())
        return Scene(self.setup.name, tuple(wearers), first, further_cameras=further)

    def _pose(self, declared: str) -> str:
        """The declared pose was held at the start of the stream, not whenever tracking starts again."""
        return declared if self.first == 0 else "none"

    def _camera(self, camera: LiveCamera) -> Camera:
        video = sorted((one for _, one in self.video if one.camera == camera.name), key=lambda one: one.time)
        K = len(camera.keypoints)
        frame = np.repeat(np.arange(len(video)), [len(one.pixels) for one in video])
        pixels = np.concatenate([np.zeros((0, K, 2)), *[one.pixels for one in video]])
        confidence = np.concatenate([np.zeros((0, K)), *[one.confidence for one in video]])
        detections = Detections(camera.keypoints, np.array([one.time for one in video]), frame, pixels, confidence)
        mount = None
        if camera.mount is not None and camera.mount.sensor in self.alive(camera.name):
            stream = _stream(self.frames(camera.name, [camera.mount.sensor]))
            own = camera.mount
            mount = CameraMount(stream, own.R_camera_imu, own.p_camera_imu, own.mounting_sigma)
        return Camera(camera.name, camera.model, detections, camera.moving, mount, camera.known_path)


def _stream(frames: ImuFrames) -> ImuStream:
    """One sensor's frames as if they were its samples."""
    seen = frames.orientation_valid[:, 0]
    R = frames.R_inertial_sensor[seen, 0]
    force: Array = (transpose(R) @ frames.specific_force_inertial[seen, 0, :, None])[..., 0]
    return ImuStream(frames.sensors[0], frames.time[seen], force, R)
