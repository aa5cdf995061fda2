"""Least-squares problem of a scene: the problems of its wearers and cameras, and the keypoint views."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from vip_factors.body.keypoints import OFFSET_KEYPOINTS, KeypointOffsets, offset_of
from vip_factors.body.kinematics import BodyState
from vip_factors.display import Summarised
from vip_factors.factor_settings import CameraFactorSettings, KeypointOffsetSettings
from vip_factors.geometry.rotations import Array, hat
from vip_factors.problem.layout import Layout
from vip_factors.problem.state import CameraState, SceneState
from vip_factors.problem.wearer import BodyPoint, BodyPoints, WearerProblem, sole_shift
from vip_factors.sensors.camera import CameraModel, Odometry
from vip_factors.sensors.frames import ImuFrames
from vip_factors.solve.slices import Blocks


@dataclass(frozen=True, repr=False)
class CameraProblem(Summarised):
    """Problem of one camera.

    Attributes:
        model: nominal intrinsics.
        moving: True for one pose in each frame, False for a single pose.
        free_pose: False if the poses are constant.
        imu: measurements of the sensor on it (one column), or None.
        p_camera_imu: ``(3,)`` metres, position of that sensor in the camera's frame.
        prior_heading: prior of that sensor's heading, radians.
        prior_R_camera_imu, mounting_sigma: its rough mounting, and standard deviation about each axis, radians.
        free_clock: True if offset and drift of the video's clock are variables.
        clock_middle: instant to which the offset refers, seconds.
        focal_sigma: standard deviation of the logarithm of the focal length; 0 if the lens is constant.
        is_beginning: False for a later stretch of a recording, without priors on static variables.
        settings: settings of the terms.
        learned_offsets: learned prior on the detector's keypoint offsets, if any.
        odometry: motion of the camera by visual odometry, or None.
    """

    model: CameraModel
    moving: bool
    settings: CameraFactorSettings = field(kw_only=True)
    free_pose: bool = True
    imu: ImuFrames | None = None
    p_camera_imu: Array = field(default_factory=lambda: np.zeros(3))
    prior_heading: float = 0.0
    prior_R_camera_imu: Array = field(default_factory=lambda: np.eye(3))
    mounting_sigma: float = 0.2
    free_clock: bool = False
    clock_middle: float = 0.0
    focal_sigma: float = 0.0
    is_beginning: bool = True
    learned_offsets: KeypointOffsets | None = None
    odometry: Odometry | None = None

    @cached_property
    def prior_offsets(self) -> KeypointOffsets:
        """Prior on the offsets of the detector's keypoints."""
        sigmas = keypoint_offset_sigmas(self.settings.keypoint_offset)
        return self.learned_offsets or KeypointOffsets(np.zeros_like(sigmas), sigmas)

    def window(self, frames: slice) -> "CameraProblem":
        """Select consecutive frames; priors belong to the recording's first frame."""
        imu = None if self.imu is None else self.imu.window(frames)
        odometry = None if self.odometry is None else self.odometry.window(frames)
        return replace(self, imu=imu, odometry=odometry, is_beginning=self.is_beginning and frames.start == 0)

    def orientation_weight(self, step: float) -> float:
        """Divisor of the variance of one frame's orientation.

        The sensor of a standing camera repeats the same error in every frame: a second counts as one measurement.
        """
        return 1.0 if self.moving else min(1.0, step)


def keypoint_offset_sigmas(settings: KeypointOffsetSettings) -> Array:
    """Standard deviations ``(K, 3)`` of the prior on each keypoint offset and axis, metres."""
    sigmas = np.full((len(OFFSET_KEYPOINTS), 3), settings.sigma)
    sigmas[OFFSET_KEYPOINTS.index("hip")] = settings.hip_sigma
    for name in ("elbow", "wrist"):
        sigmas[OFFSET_KEYPOINTS.index(name)] = settings.elbow_wrist_sigma
    return sigmas


@dataclass(frozen=True)
class Foot:
    """Foot of a skeleton.

    Attributes:
        bone: bone of the foot.
        p_bone_ankle: ``(3,)`` metres, the ankle in bone axes.
        p_bone_sole: ``(n, 3)`` metres, points of the skin that may touch the ground or a shoe's sole.
    """

    bone: int
    p_bone_ankle: Array
    p_bone_sole: Array

    def lowest(self, body: BodyState) -> Array:
        """Index ``(T,)`` of the lowest point of the sole."""
        down = np.einsum("tk,nk->tn", body.R_world_bone[:, self.bone, 2], self.p_bone_sole)
        return np.argmin(down, axis=1)

    def ankle(self, body: BodyState, sole: float) -> tuple[Array, Array]:
        """World positions ``(T, 3)`` of the ankle, and its height ``(T,)`` if the foot stands on a ``sole`` (m)."""
        height = np.einsum("tk,tk->t", body.R_world_bone[:, self.bone, 2], self._arm(body, sole))
        return body.point(self.bone, self.p_bone_ankle), height

    def height_by_sole(self, body: BodyState) -> Array:
        """Derivative ``(T,)`` of the standing height by the sole's thickness."""
        return -body.R_world_bone[:, self.bone, 2] @ sole_shift(1.0)

    def _arm(self, body: BodyState, sole: float) -> Array:
        """Vector ``(T, 3)`` from the point that touches the ground to the ankle, bone axes."""
        return self.p_bone_ankle - self.p_bone_sole[self.lowest(body)] - sole_shift(sole)

    def height_by_turn(self, body: BodyState, sole: float) -> Array:
        """Derivative ``(T, 3)`` of the standing height by a turn of the foot: last row of ``−hat(R arm)``."""
        arm = self._arm(body, sole)
        turned = np.einsum("tij,tj->ti", body.R_world_bone[:, self.bone], arm)
        return -hat(turned)[:, 2]


@dataclass(frozen=True)
class GroundView:
    """Standing feet of one wearer in the view of one camera.

    Attributes:
        feet: the ``G`` feet.
        rays: ``(T, G, 3)`` through the ankles' pixels, in the camera's frame.
        whitening: ``(T, G, 3, 3)`` per metre.
        stands: ``(T, G)`` mask of standing feet; only there the other arrays are valid.
    """

    feet: tuple[Foot, ...]
    rays: Array
    whitening: Array
    stands: np.ndarray

    @classmethod
    def joined(cls, feet: tuple[Foot, ...], views: Sequence["GroundView | None"]) -> "GroundView":
        """Concatenate views of single frames; None for a frame without a standing foot."""
        T, G = len(views), len(feet)
        rays, whitening, stands = np.ones((T, G, 3)), np.zeros((T, G, 3, 3)), np.zeros((T, G), bool)
        for t, view in enumerate(views):
            if view is not None:
                rays[t], whitening[t], stands[t] = view.rays[0], view.whitening[0], view.stands[0]
        return cls(feet, rays, whitening, stands)

    def at_frames(self, frames: slice) -> "GroundView":
        """Select consecutive frames."""
        return GroundView(self.feet, self.rays[frames], self.whitening[frames], self.stands[frames])


OF_FRAMES = ("pixels", "sigma", "oks_px", "seen", "pixels_per_second", "confidence")  # arrays of a view along frames


@dataclass(frozen=True, repr=False)
class KeypointView(Summarised):
    """Keypoints of one wearer in the view of one camera.

    Attributes:
        points: positions of the ``K`` keypoints on the body.
        pixels: ``(T, K, 2)``; zero where not seen.
        sigma: ``(T, K)`` pixels; one where not seen.
        oks_px: ``(T, K)`` pixels, one OKS sigma over the root of the confidence: unit of the scatter of detections.
        seen: ``(T, K)`` mask of detected keypoints.
        pixels_per_second: ``(T, K, 2)`` velocity of the detections, for the video's clock.
        confidence: ``(T, K)`` of the detector, times the biweight; zero where not seen. It is included in ``sigma``.
        ground: standing feet, if their contact with the ground is used.
        names: names of the keypoints, if the detector's offsets apply.
        clock: offset and drift of the video's clock with which the pixels were resampled.
        frames_apart: frames between two video frames, at least 1.
    """

    points: tuple[BodyPoint, ...]
    pixels: Array
    sigma: Array
    oks_px: Array
    seen: np.ndarray
    pixels_per_second: Array
    confidence: Array = field(default_factory=lambda: np.zeros((0, 0)))
    ground: GroundView | None = None
    names: tuple[str, ...] = ()
    clock: tuple[float, float] = (0.0, 0.0)
    frames_apart: float = 1.0

    @cached_property
    def offsets(self) -> tuple[np.ndarray, Array]:
        """Index ``(K,)`` of each point's keypoint offset, −1 for none, and the signs ``(K, 3)`` of its axes."""
        offsets = [offset_of(name) for name in self.names] or [(-1, 1)] * len(self.points)
        index = np.array([number for number, _ in offsets], dtype=int)
        signs = np.ones((len(offsets), 3))
        signs[:, 0] = [sign for _, sign in offsets]
        return index, signs

    @classmethod
    def unseen(cls, points: tuple[BodyPoint, ...], frames: int = 1) -> "KeypointView":
        """Make a view without any detection."""
        none, pixels = np.zeros((frames, len(points))), np.zeros((frames, len(points), 2))
        return cls(points, pixels, none + 1.0, none + 1.0, none.astype(bool), pixels, none)

    @classmethod
    def joined(
        cls, points: tuple[BodyPoint, ...], views: Sequence["KeypointView | None"], feet: tuple[Foot, ...] | None
    ) -> "KeypointView":
        """Concatenate views of single frames; None for a frame without a video frame."""
        unseen = cls.unseen(points)
        frame_views = [unseen if view is None else view for view in views]

        def join(name: str) -> Array:
            return np.concatenate([getattr(view, name) for view in frame_views])

        return cls(
            points,
            pixels=join("pixels"),
            sigma=join("sigma"),
            oks_px=join("oks_px"),
            seen=join("seen"),
            pixels_per_second=join("pixels_per_second"),
            confidence=join("confidence"),
            ground=None if feet is None else GroundView.joined(feet, [view.ground for view in frame_views]),
            names=next((view.names for view in frame_views if view.names), ()),
            frames_apart=max(view.frames_apart for view in frame_views),
        )

    @cached_property
    def body_points(self) -> BodyPoints:
        """Positions of the keypoints on the body, as arrays."""
        return BodyPoints.of(self.points)

    def at_frames(self, frames: slice) -> "KeypointView":
        """Select consecutive frames."""
        arrays = {name: getattr(self, name)[frames] for name in OF_FRAMES}
        return replace(self, ground=None if self.ground is None else self.ground.at_frames(frames), **arrays)


@dataclass(frozen=True)
class Viewpoint:
    """Camera at a state: its problem, its state and its view of each wearer."""

    problem: CameraProblem
    state: CameraState
    views: tuple[KeypointView, ...]

    @property
    def lens(self) -> CameraModel:
        """Intrinsics at the state."""
        return self.problem.model.zoomed(self.state.zoom)


class LinearTerms(Protocol):
    """Normal equations of a user's terms."""

    @property
    def multipliers(self) -> int:
        """Number of columns after the static ones, for rows that connect distant frames."""
        ...

    def add_to(self, blocks: Blocks, begin: int) -> None:
        """Add the factors whose first frame is in the stretch of ``blocks``, from the frame ``begin`` on."""
        ...


class ExtraTerms(Protocol):
    """A user's terms on the variables of a scene."""

    def cost(self, problem: "SceneProblem", state: "SceneState") -> float:
        """Half the sum of squared whitened residuals, with robust losses."""
        ...

    def linearised(self, problem: "SceneProblem", layout: Layout, state: "SceneState") -> "LinearTerms":
        """Linearise the terms at a state."""
        ...


@dataclass(frozen=True, repr=False)
class SceneProblem(Summarised):
    """Least-squares problem of a scene; all wearers have the same frames.

    Attributes:
        wearers, cameras: their problems.
        views: keypoints by camera, then wearer.
        extra: a user's terms, if any.
        free_keypoints: True if the detector's keypoint offsets are variables.
    """

    wearers: tuple[WearerProblem, ...]
    cameras: tuple[CameraProblem, ...]
    views: tuple[tuple[KeypointView, ...], ...]
    extra: ExtraTerms | None = None
    free_keypoints: bool = False

    def viewpoints(self, state: SceneState) -> tuple[Viewpoint, ...]:
        """Combine each camera with its state and views."""
        return tuple(map(Viewpoint, self.cameras, state.cameras, self.views))

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.wearers[0].frames)

    @property
    def step(self) -> float:
        """Seconds between frames."""
        return self.wearers[0].frames.step

    def window(self, frames: slice) -> "SceneProblem":
        """Select consecutive frames, without a user's terms."""
        return SceneProblem(
            tuple(wearer.window(frames) for wearer in self.wearers),
            tuple(camera.window(frames) for camera in self.cameras),
            tuple(tuple(view.at_frames(frames) for view in views) for views in self.views),
            free_keypoints=self.free_keypoints,
        )
