"""Everything that defines the cost of a filmed scene: the problems of wearers and cameras, and the keypoint views."""

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
from vip_factors.sensors.camera import CameraModel
from vip_factors.sensors.frames import ImuFrames
from vip_factors.sensors.odometry import Odometry
from vip_factors.solve.slices import Blocks


@dataclass(frozen=True, repr=False)
class CameraProblem(Summarised):
    """The camera's share of a scene.

    Attributes:
        model: its intrinsics, as supposed.
        moving: one pose for each frame, or one for all.
        free_pose: False keeps the poses of the state.
        imu: measurements of the sensor on it (one column), or None.
        p_camera_imu: ``(3,)`` metres.
        prior_heading: radians, of that sensor.
        prior_R_camera_imu, mounting_sigma: its rough mounting, and radians about each axis.
        free_clock: whether the offset and the drift of the video's clock move.
        clock_middle: seconds, the instant at which the offset is that.
        focal_sigma: standard deviation of the logarithm of the focal length; 0 keeps the lens of the state.
        is_beginning: False for a stretch of something longer, whose beginning holds the priors.
        settings: of the terms.
        learned_offsets: of the detector's keypoints, where they were learnt.
        odometry: the camera's motion as visual odometry measured it, or None.
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
        """Of the detector's keypoints."""
        sigmas = keypoint_offset_sigmas(self.settings.keypoint_offset)
        return self.learned_offsets or KeypointOffsets(np.zeros_like(sigmas), sigmas)

    def window(self, frames: slice) -> "CameraProblem":
        """The problem of some consecutive frames; its priors are those of the first frame."""
        imu = None if self.imu is None else self.imu.window(frames)
        odometry = None if self.odometry is None else self.odometry.window(frames)
        return replace(self, imu=imu, odometry=odometry, is_beginning=self.is_beginning and frames.start == 0)

    def orientation_weight(self, step: float) -> float:
        """What divides the variance of one frame's orientation.

        A camera that stands still is told the same, errors included, in every frame: a second of it weighs as one.
        """
        return 1.0 if self.moving else min(1.0, step)


def keypoint_offset_sigmas(settings: KeypointOffsetSettings) -> Array:
    """Of each keypoint and axis ``(K, 3)``, metres."""
    sigmas = np.full((len(OFFSET_KEYPOINTS), 3), settings.sigma)
    sigmas[OFFSET_KEYPOINTS.index("hip")] = settings.hip_sigma
    for name in ("elbow", "wrist"):
        sigmas[OFFSET_KEYPOINTS.index(name)] = settings.elbow_wrist_sigma
    return sigmas


@dataclass(frozen=True)
class Foot:
    """One foot.

    Attributes:
        bone: it is on.
        p_bone_ankle: ``(3,)`` metres.
        p_bone_sole: ``(n, 3)``, points of its skin that may touch the ground, or a shoe's sole there.
    """

    bone: int
    p_bone_ankle: Array
    p_bone_sole: Array

    def lowest(self, body: BodyState) -> Array:
        """Which of the sole's points is the lowest, ``(T,)``."""
        down = np.einsum("tk,nk->tn", body.R_world_bone[:, self.bone, 2], self.p_bone_sole)
        return np.argmin(down, axis=1)

    def ankle(self, body: BodyState, sole: float) -> tuple[Array, Array]:
        """World positions ``(T, 3)`` of the ankle, and the height ``(T,)`` that it has where the foot stands.

        ``sole`` is the shoe's thickness in metres.
        """
        height = np.einsum("tk,tk->t", body.R_world_bone[:, self.bone, 2], self._arm(body, sole))
        return body.point(self.bone, self.p_bone_ankle), height

    def height_by_sole(self, body: BodyState) -> Array:
        """Derivative ``(T,)`` of that height by the thickness."""
        return -body.R_world_bone[:, self.bone, 2] @ sole_shift(1.0)

    def _arm(self, body: BodyState, sole: float) -> Array:
        """From what touches the ground to the ankle, ``(T, 3)`` in bone axes."""
        return self.p_bone_ankle - self.p_bone_sole[self.lowest(body)] - sole_shift(sole)

    def height_by_turn(self, body: BodyState, sole: float) -> Array:
        """Derivative ``(T, 3)`` of that height by a turn of the foot in the world: ``−hat(R arm)``, its last row."""
        arm = self._arm(body, sole)
        turned = np.einsum("tij,tj->ti", body.R_world_bone[:, self.bone], arm)
        return -hat(turned)[:, 2]


@dataclass(frozen=True)
class GroundView:
    """Where one camera saw one wearer's ``G`` feet stand.

    Attributes:
        feet: of the body.
        rays: ``(T, G, 3)`` of the ankles' pixels, in the camera's frame.
        whitening: ``(T, G, 3, 3)`` per metre.
        stands: ``(T, G)`` where the factor exists; elsewhere the others mean nothing.
    """

    feet: tuple[Foot, ...]
    rays: Array
    whitening: Array
    stands: np.ndarray

    @classmethod
    def joined(cls, feet: tuple[Foot, ...], views: Sequence["GroundView | None"]) -> "GroundView":
        """Views of single frames, one after the other; None where no foot is known to stand."""
        T, G = len(views), len(feet)
        rays, whitening, stands = np.ones((T, G, 3)), np.zeros((T, G, 3, 3)), np.zeros((T, G), bool)
        for t, view in enumerate(views):
            if view is not None:
                rays[t], whitening[t], stands[t] = view.rays[0], view.whitening[0], view.stands[0]
        return cls(feet, rays, whitening, stands)

    def at_frames(self, frames: slice) -> "GroundView":
        """A stretch of frames."""
        return GroundView(self.feet, self.rays[frames], self.whitening[frames], self.stands[frames])


OF_FRAMES = ("pixels", "sigma", "oks_px", "seen", "pixels_per_second", "confidence")  # of a view, frame by frame


@dataclass(frozen=True, repr=False)
class KeypointView(Summarised):
    """Where one wearer's ``K`` keypoints were seen in the ``T`` frames.

    Attributes:
        points: on the body.
        pixels: ``(T, K, 2)``; zero where not seen.
        sigma: ``(T, K)`` pixels; one where not seen.
        oks_px: ``(T, K)`` pixels, one OKS sigma over the root of the confidence: how detections scatter is told in it.
        seen: ``(T, K)``.
        pixels_per_second: ``(T, K, 2)`` how fast the detections move, for the clock.
        confidence: ``(T, K)`` of the detector, times the biweight; zero where not seen. Sigma has it already.
        ground: of the feet among them, if their contact with the ground is used.
        names: of the keypoints, where the detector's own way of placing them is of interest.
        clock: offset and drift of the video's clock with which the pixels were put onto the frames.
        frames_apart: from one frame that the camera saw to the next: a video may be slower than the frames.
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
        """Which of the detector's offsets each point has ``(K,)``, −1 for none, and its axes' signs ``(K, 3)``."""
        offsets = [offset_of(name) for name in self.names] or [(-1, 1)] * len(self.points)
        index = np.array([number for number, _ in offsets], dtype=int)
        signs = np.ones((len(offsets), 3))
        signs[:, 0] = [sign for _, sign in offsets]
        return index, signs

    @classmethod
    def unseen(cls, points: tuple[BodyPoint, ...], frames: int = 1) -> "KeypointView":
        """Of somebody who is not in the picture."""
        none, pixels = np.zeros((frames, len(points))), np.zeros((frames, len(points), 2))
        return cls(points, pixels, none + 1.0, none + 1.0, none.astype(bool), pixels, none)

    @classmethod
    def joined(
        cls, points: tuple[BodyPoint, ...], views: Sequence["KeypointView | None"], feet: tuple[Foot, ...] | None
    ) -> "KeypointView":
        """Views of single frames, one after the other; None of a frame that the camera did not take."""
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
        """The points, as arrays."""
        return BodyPoints.of(self.points)

    def at_frames(self, frames: slice) -> "KeypointView":
        """A stretch of frames."""
        arrays = {name: getattr(self, name)[frames] for name in OF_FRAMES}
        return replace(self, ground=None if self.ground is None else self.ground.at_frames(frames), **arrays)


@dataclass(frozen=True)
class Viewpoint:
    """Where one camera is, and what it saw.

    Attributes:
        problem: the camera's.
        state: its poses.
        views: of each wearer.
    """

    problem: CameraProblem
    state: CameraState
    views: tuple[KeypointView, ...]

    @property
    def lens(self) -> CameraModel:
        """The intrinsics at the state."""
        return self.problem.model.zoomed(self.state.zoom)


class LinearTerms(Protocol):
    """Normal equations of a user's own terms."""

    @property
    def multipliers(self) -> int:
        """Number of columns, behind those of what all frames share, of rows that tie frames further apart."""
        ...

    def add_to(self, blocks: Blocks, begin: int) -> None:
        """Add the factors whose first frame is in the stretch of ``blocks``, from the frame ``begin`` on."""
        ...


class ExtraTerms(Protocol):
    """Terms of a user's own, on the variables of a scene."""

    def cost(self, problem: "SceneProblem", state: "SceneState") -> float:
        """Half the sum of their squared whitened residuals, losses applied."""
        ...

    def linearised(self, problem: "SceneProblem", layout: Layout, state: "SceneState") -> "LinearTerms":
        """Their normal equations at a state."""
        ...


@dataclass(frozen=True, repr=False)
class SceneProblem(Summarised):
    """The least-squares problem of a scene; all wearers have the same frames.

    Attributes:
        wearers: their own problems.
        cameras: their own problems.
        views: of each camera, of each wearer.
        extra: terms of a user's own.
        free_keypoints: whether the detector's keypoint offsets are variables.
    """

    wearers: tuple[WearerProblem, ...]
    cameras: tuple[CameraProblem, ...]
    views: tuple[tuple[KeypointView, ...], ...]
    extra: ExtraTerms | None = None
    free_keypoints: bool = False

    def viewpoints(self, state: SceneState) -> tuple[Viewpoint, ...]:
        """All cameras at a state."""
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
        """The problem of some consecutive frames, without a user's own terms."""
        return SceneProblem(
            tuple(wearer.window(frames) for wearer in self.wearers),
            tuple(camera.window(frames) for camera in self.cameras),
            tuple(tuple(view.at_frames(frames) for view in views) for views in self.views),
            free_keypoints=self.free_keypoints,
        )
