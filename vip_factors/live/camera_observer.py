"""One camera of a stream: association of its persons, keypoint measurements of each wearer, and standing feet."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.body.kinematics import BodyState
from vip_factors.body.lengths import stature_of
from vip_factors.body.skeleton import Skeleton, joint_index
from vip_factors.factor_settings import CameraFactorSettings, ContactFrom, GroundContactSettings
from vip_factors.geometry.rotations import Array
from vip_factors.live.association import NOBODY, Belief, OnlineAssociation
from vip_factors.live.association_evidence import NEAREST_M
from vip_factors.live.frames import LiveFrame
from vip_factors.problem.scene import Foot, KeypointView
from vip_factors.problem.state import CameraPoses
from vip_factors.problem.wearer import BodyPoint, BodyPoints, WearerProblem
from vip_factors.sensors.live import VideoFrame
from vip_factors.sensors.scene import Camera
from vip_factors.stages.floor import (
    foot_acceleration_confidence,
    free_accelerations,
    ground_view,
    joint_state_confidence,
    seen_feet,
)
from vip_factors.stages.views import AREA_OF_HEIGHT, pixel_sigma, points_on_body, scatter
from vip_factors.terms.reprojection import adaptive_biweight


def standing_feet(
    wearer: WearerProblem,
    sensors: np.ndarray,
    feet: tuple[Foot, ...],
    body: BodyState,
    frames: Sequence[LiveFrame],
    index: int,
    settings: GroundContactSettings,
) -> Array:
    """Confidence that each foot stands, ``(G,)``, as in :func:`~vip_factors.stages.floor.standing_confidence`.

    Args:
        wearer: the wearer's problem.
        sensors: its columns among all carriers' sensors.
        feet: the feet.
        body: the body over a few frames.
        frames: measurements of these frames.
        index: index of the frame in question.
        settings: settings of the factor.
    """
    acceleration_frames = 3  # the newest acceleration is not measured yet: the last one of these is used
    if settings.contact_from is ContactFrom.JOINT_STATE:
        return joint_state_confidence(wearer.skeleton, body, feet, wearer.frames.step)[index]
    following = frames[max(0, index + 1 - acceleration_frames) + 1 : index + 2]
    force = np.array([frame.specific_force_before[sensors] for frame in following]).reshape(-1, len(sensors), 3)
    valid = np.array([frame.acceleration_valid_before[sensors] for frame in following], bool).reshape(-1, len(sensors))
    newest = np.full(len(feet), np.nan)
    for free in free_accelerations(wearer.sensors, feet, force, valid):
        newest = np.where(np.isnan(free), newest, free)
    return foot_acceleration_confidence(body.at(slice(index, index + 1)), feet, newest[None], settings)[0]


MIDDLE = joint_index("spine2")  # of the body


# Confidence that each foot of each wearer stands in a frame (by number), ``(G,)``; None where it is not used.
FootContacts = Callable[[int], Sequence[Array | None]]


@dataclass(frozen=True)
class _Wearer:
    """Keypoints of one wearer: indices, points on the body and names; feet, and the columns of their keypoints."""

    used: np.ndarray
    points: tuple[BodyPoint, ...]
    on_body: BodyPoints
    names: tuple[str, ...]
    feet: tuple[Foot, ...]
    columns: list[int]
    stature: float
    sole: float  # m


@dataclass
class _Decision:
    video: VideoFrame
    chosen: np.ndarray


class CameraObserver:
    """Observes the wearers in the video of one camera.

    Args:
        camera: the camera.
        skeletons: skeletons of the wearers.
        soles: thickness of their soles, metres.
        spreads: scatter of the detections of each wearer, in OKS sigmas; adapted to the residuals.
        settings: settings of the camera's factors.
    """

    def __init__(
        self,
        camera: Camera,
        skeletons: Sequence[Skeleton],
        soles: Sequence[float],
        spreads: Sequence[float],
        settings: CameraFactorSettings,
    ) -> None:
        self.camera, self.spreads, self._settings = camera, list(spreads), settings.reprojection
        self._ground = settings.ground_contact
        self._keypoints = keypoints = camera.keypoints
        self._association = OnlineAssociation(keypoints, camera.model, skeletons)
        self._wearers = list[_Wearer]()
        for skeleton, sole in zip(skeletons, soles, strict=True):
            used, points = points_on_body(keypoints, skeleton)
            names = tuple(keypoints.keypoints[k] for k in used)
            feet, stature = seen_feet(keypoints, skeleton), stature_of(skeleton)
            self._wearers.append(_Wearer(used, points, BodyPoints.of(points), names, *feet, stature, sole))
        self._decisions: list[_Decision] = []
        self.chosen = np.full(len(skeletons), NOBODY)  # in the newest video frame

    def remember(self, video: VideoFrame, chosen: np.ndarray) -> None:
        """Take over a video frame that was associated at the start."""
        self._association.remember(video, chosen)
        self._decisions.append(_Decision(video, chosen))
        self.chosen = chosen

    def observe(self, video: VideoFrame, belief: Belief, feet: FootContacts) -> tuple[KeypointView, ...]:
        """Associate a video frame, and measure the keypoints of each wearer in it."""
        belief = belief.at([video.frame])
        chosen = self._association.choose(video, belief)
        self._decisions.append(_Decision(video, chosen))
        self._decisions.sort(key=lambda decision: decision.video.time)
        self.chosen = self._decisions[-1].chosen
        return self._views(video, chosen, belief, feet(video.frame))

    def revise(self, belief: Belief, feet: FootContacts) -> dict[int, tuple[KeypointView, ...]]:
        """Associate recent video frames again; the measurements of those that changed, by frame number."""
        self._decisions = [decision for decision in self._decisions if decision.video.frame >= belief.first_number]
        if len(self._decisions) < 2:
            return {}
        videos, changed = [decision.video for decision in self._decisions], {}
        choices = self._association.revise(videos, belief.at([video.frame for video in videos]))
        for decision, video, chosen in zip(self._decisions, videos, choices, strict=True):
            if np.any(chosen != decision.chosen):
                decision.chosen, number = chosen, video.frame
                changed[number] = self._views(video, chosen, belief.at([number]), feet(number))
        self.chosen = self._decisions[-1].chosen
        return changed

    def adapt_spread(self, wearer: int, residual: Array, view: KeypointView, share: float) -> None:
        """Adapt the scatter of detections to whitened residuals ``(T, K, 2)``, by a ``share`` in (0, 1]."""
        if self._settings.adaptive:
            spread = self.spreads[wearer]
            measured = max(scatter(residual, view, spread), 1e-3)
            self.spreads[wearer] = float(np.exp((1 - share) * np.log(spread) + share * np.log(measured)))

    def _views(
        self, video: VideoFrame, chosen: np.ndarray, belief: Belief, feet: Sequence[Array | None]
    ) -> tuple[KeypointView, ...]:
        people = enumerate(chosen.tolist())
        return tuple(self._view(video, person, number, belief, feet[number]) for number, person in people)

    def _view(
        self, video: VideoFrame, person: int, wearer: int, belief: Belief, foot_contacts: Array | None
    ) -> KeypointView:
        tracked = self._wearers[wearer]
        if person == NOBODY:
            return KeypointView.unseen(tracked.points)
        lens, settings, body = self.camera.model, self._settings, belief.bodies[wearer]
        pixels, confidence = video.pixels[person, tracked.used], video.confidence[person, tracked.used]
        visible = (confidence >= settings.least_confidence) & np.all(np.isfinite(pixels), axis=1)
        R, p = belief.R_world_camera[0], belief.p_world_camera[0]
        depth = R[:, 2] @ (body.p_world_joint[0, MIDDLE] - p)
        height = lens.focal[1] * tracked.stature / max(depth, NEAREST_M)
        oks, scale = self._keypoints.sigmas[tracked.used], np.asarray(AREA_OF_HEIGHT * height)
        if settings.biweight.use:
            predicted = lens.project((tracked.on_body.on(body)[0] - p) @ R)
            weight = adaptive_biweight(pixels, predicted, oks, scale, lens.width, settings.biweight)
            visible, confidence = visible & (weight > 0), confidence * weight
        metre = lens.focal[1] / max(depth, NEAREST_M)
        sigma, oks_px = pixel_sigma(oks * scale, confidence, visible, self.spreads[wearer], metre, settings)
        confidence = np.where(visible, np.minimum(confidence, 1.0), 0.0)
        pixels = np.where(visible[:, None], pixels, 0.0)
        errors = sigma[None], oks_px[None], visible[None], np.zeros_like(pixels)[None]
        view = KeypointView(tracked.points, pixels[None], *errors, confidence[None], names=tracked.names)
        if foot_contacts is None:
            return view
        feet = tracked.feet, tracked.columns, foot_contacts[None]
        pose = CameraPoses(R[None], p[None])
        return replace(view, ground=ground_view(view, *feet, body, tracked.sole, pose, lens, self._ground))
