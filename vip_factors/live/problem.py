"""The least-squares problem of a stretch of a stream, from its frames' measurements."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from vip_factors.factors.ground_contact import Foot
from vip_factors.geometry.rotations import Array
from vip_factors.live.measurement import FrameMeasurement
from vip_factors.live.settings import LiveSettings
from vip_factors.problem.blocks import scene_layout
from vip_factors.problem.scene import CameraProblem, GroundView, KeypointView, SceneProblem, Viewpoint
from vip_factors.problem.wearer import WearerProblem
from vip_factors.sensors.frames import ImuFrames


@dataclass(frozen=True)
class Sight:
    """What one camera saw of one wearer at one frame.

    Attributes:
        pixels: ``(K, 2)`` of keypoints; zero where not seen.
        sigma: ``(K,)`` pixels; one where not seen.
        seen: ``(K,)``.
        confidence: ``(K,)`` of the detector, times the biweight; zero where not seen. Sigma has it already.
        ground: of the problem's feet, in this single frame; None where none is known to stand.
    """

    pixels: Array
    sigma: Array
    seen: np.ndarray
    confidence: Array
    ground: GroundView | None = None

    @classmethod
    def nothing(cls, keypoints: int) -> "Sight":
        """Of a wearer who is not in the picture."""
        return cls(np.zeros((keypoints, 2)), np.ones(keypoints), np.zeros(keypoints, bool), np.zeros(keypoints))

    @classmethod
    def of(cls, view: KeypointView, t: int) -> "Sight":
        """One frame of a view."""
        ground = None if view.ground is None else view.ground.at_frames(slice(t, t + 1))
        return cls(view.pixels[t], view.sigma[t], view.seen[t], view.confidence[t], ground)


@dataclass
class LagFrame:
    """A frame within the lag.

    Attributes:
        number, time: of the frame, seconds.
        R_inertial_sensor, orientation_valid: ``(S, 3, 3)`` and ``(S,)`` of all carriers' sensors.
        specific_force_inertial, acceleration_valid: ``(S, 3)`` and ``(S,)``; known once the next frame is.
        sights: by camera, then wearer; None where the camera gave no frame.
        contacts: of each wearer ``(C,)``, confidences that the contact points hold until the next frame.
    """

    number: int
    time: float
    R_inertial_sensor: Array
    orientation_valid: np.ndarray
    specific_force_inertial: Array
    acceleration_valid: np.ndarray
    sights: list[tuple[Sight, ...] | None] = field(default_factory=list)
    contacts: list[Array] = field(default_factory=list)

    def take_accelerations(self, after: FrameMeasurement) -> None:
        """What the next frame's measurement brings: the window of accelerations reaches into it."""
        self.specific_force_inertial, self.acceleration_valid = after.specific_force_inertial, after.acceleration_valid


def lag_frame(measured: FrameMeasurement, sights: list[tuple[Sight, ...] | None]) -> LagFrame:
    """The newest frame: its accelerations are measured by the next one."""
    nothing = np.zeros(len(measured.orientation_valid), bool)
    force = np.zeros((len(nothing), 3))
    return LagFrame(
        measured.frame, measured.time, measured.R_inertial_sensor, measured.orientation_valid, force, nothing, sights
    )


class LagProblem:
    """Makes the problem of any stretch of frames.

    Attributes:
        wearers, camera, further: the problems without frames: body, sensors, priors, what is free.
        step: seconds between frames.
        sensors: of each wearer, its columns among all carriers' sensors; of the camera's IMU, last, one or none.
        feet: by camera and wearer, those whose contact with the ground is used; None where it is not.
        layout: of the variables that move.
    """

    def __init__(
        self,
        wearers: Sequence[WearerProblem],
        camera: CameraProblem,
        views: Sequence[KeypointView],
        further: Sequence[Viewpoint],
        sensors: Sequence[np.ndarray],
        step: float,
        settings: LiveSettings,
    ) -> None:
        self.wearers, self.camera, self.further = tuple(wearers), camera, tuple(further)
        self.sensors, self.step = list(sensors), step
        cameras = [tuple(views), *(one.views for one in further)]
        self._points = [[view.points for view in own] for own in cameras]
        self.feet = [[None if view.ground is None else view.ground.feet for view in own] for own in cameras]
        bare = SceneProblem(self.wearers, camera, tuple(views), self.further)
        self.layout = scene_layout(bare, settings.walk, settings.relinearisation.shared_deg)

    @property
    def moving(self) -> bool:
        """Whether the first camera's pose belongs to the frame."""
        return self.camera.moving

    def model(self, frames: Sequence[LagFrame], beginning: bool) -> SceneProblem:
        """The problem of consecutive frames; ``beginning``: they are the first ones."""
        time = frames[0].time + self.step * np.arange(len(frames))
        parts: tuple[Array, ...] = (
            np.stack([frame.R_inertial_sensor for frame in frames]),
            np.stack([frame.orientation_valid for frame in frames]),
            np.stack([frame.specific_force_inertial for frame in frames]),
            np.stack([frame.acceleration_valid for frame in frames]),
        )
        wearers = []
        for number, wearer in enumerate(self.wearers):
            contacts = np.stack([frame.contacts[number] for frame in frames])
            pose = wearer.initial_pose
            if pose is not None:
                pose = replace(pose, passed=frames[0].number)
            wearers.append(
                replace(
                    wearer,
                    frames=_imu_frames(wearer.frames.sensors, time, parts, self.sensors[number]),
                    contact_confidence=contacts,
                    initial_pose=pose,
                    is_beginning=beginning,
                )
            )
        camera = replace(self.camera, is_beginning=beginning)
        if camera.imu is not None:
            camera = replace(camera, imu=_imu_frames(camera.imu.sensors, time, parts, self.sensors[-1]))
        views = [self._views(frames, number) for number in range(len(self._points))]
        further = tuple(replace(one, views=own) for one, own in zip(self.further, views[1:], strict=True))
        return SceneProblem(tuple(wearers), camera, views[0], further)

    @property
    def filmed(self) -> bool:
        """Whether there is a camera that sees anybody."""
        return any(len(points) for camera in self._points for points in camera)

    def _views(self, frames: Sequence[LagFrame], camera: int) -> tuple[KeypointView, ...]:
        views = []
        for wearer, points in enumerate(self._points[camera]):
            nothing = Sight.nothing(len(points))
            sights = [frame.sights[camera] for frame in frames]
            own = [sight[wearer] if sight is not None else nothing for sight in sights]
            pixels, seen = np.stack([one.pixels for one in own]), np.stack([one.seen for one in own])
            sigma, confidence = np.stack([one.sigma for one in own]), np.stack([one.confidence for one in own])
            ground = _grounds(self.feet[camera][wearer], own)
            views.append(KeypointView(points, pixels, sigma, seen, np.zeros_like(pixels), confidence, ground))
        return tuple(views)


def _grounds(feet: tuple[Foot, ...] | None, sights: Sequence[Sight]) -> GroundView | None:
    """The ground contacts of a stretch of sights."""
    if feet is None:
        return None
    T, G = len(sights), len(feet)
    rays, whitening, stands = np.ones((T, G, 3)), np.zeros((T, G, 3, 3)), np.zeros((T, G), bool)
    for t, own in enumerate(one.ground for one in sights):
        if own is not None:
            rays[t], whitening[t], stands[t] = own.rays[0], own.whitening[0], own.stands[0]
    return GroundView(feet, rays, whitening, stands)


def _imu_frames(names: tuple[str, ...], time: np.ndarray, parts: tuple[Array, ...], columns: np.ndarray) -> ImuFrames:
    R, seen, force, whole = (part[:, columns] for part in parts)
    return ImuFrames(names, time, R, seen, force, whole)
