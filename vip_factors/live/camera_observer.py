"""One camera of a stream: who is who in its video frames, what each wearer's keypoints are worth, which feet stand."""

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
from vip_factors.live.measurement import LiveFrame
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
    wearer: WearerProblem, sensors: np.ndarray, feet: tuple[Foot, ...], body: BodyState, frames: Sequence[LiveFrame],
    at: int, settings: GroundContactSettings,
) -> Array:  # fmt: skip
    """How surely each foot stands, ``(G,)``, as :func:`~vip_factors.stages.floor.standing_confidence` has it.

    Args:
        wearer: the problem.
        sensors: its columns among all carriers' sensors.
        feet: to tell of.
        body: over a few frames.
        frames: measured in them.
        at: which of them is meant.
        settings: of the factor.
    """
    acceleration_holds = 3  # frames: that of the newest frame is measured by the next one, so the last known one counts
    if settings.contact_from is ContactFrom.JOINT_STATE:
        return joint_state_confidence(wearer.skeleton, body, feet, wearer.frames.step)[at]
    following = frames[max(0, at + 1 - acceleration_holds) + 1 : at + 2]
    force = np.array([frame.specific_force_before[sensors] for frame in following]).reshape(-1, len(sensors), 3)
    valid = np.array([frame.acceleration_valid_before[sensors] for frame in following], bool).reshape(-1, len(sensors))
    newest = np.full(len(feet), np.nan)
    for free in free_accelerations(wearer.sensors, feet, force, valid):
        newest = np.where(np.isnan(free), newest, free)
    return foot_acceleration_confidence(body.at(slice(at, at + 1)), feet, newest[None], settings)[0]


MIDDLE = joint_index("spine2")  # of the body


# Of a frame by number: how surely each foot of each wearer stands, ``(G,)``, that is used; None where none is.
FootContacts = Callable[[int], Sequence[Array | None]]


@dataclass(frozen=True)
class _Wearer:
    """Of one wearer: the keypoints that are used, which they are and where on the body; feet, and those' columns."""

    used: np.ndarray
    points: tuple[BodyPoint, ...]
    on_body: BodyPoints
    names: tuple[str, ...]
    feet: tuple[Foot, ...]
    columns: list[int]
    stature: float
    sole: float  # m


@dataclass
class _Decided:
    video: VideoFrame
    chosen: np.ndarray


class CameraObserver:
    """Follows the wearers through the video of one camera.

    Args:
        camera: which.
        skeletons: of the wearers.
        soles: of their shoes, how thick, metres.
        spreads: scatter of the detections of each wearer, in OKS sigmas; follows what is seen.
        settings: of the factors of cameras.
    """

    def __init__(
        self, camera: Camera, skeletons: Sequence[Skeleton], soles: Sequence[float], spreads: Sequence[float],
        settings: CameraFactorSettings,
    ) -> None:  # fmt: skip
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
        self._decided: list[_Decided] = []
        self.chosen = np.full(len(skeletons), NOBODY)  # in the newest video frame

    def remember(self, video: VideoFrame, chosen: np.ndarray) -> None:
        """A video frame that was decided at the start."""
        self._association.remember(video, chosen)
        self._decided.append(_Decided(video, chosen))
        self.chosen = chosen

    def observe(self, video: VideoFrame, belief: Belief, feet: FootContacts) -> tuple[KeypointView, ...]:
        """What is seen of each wearer in a video frame of one of the frames of which something is believed."""
        belief = belief.at([video.frame])
        chosen = self._association.choose(video, belief)
        self._decided.append(_Decided(video, chosen))
        self._decided.sort(key=lambda one: one.video.time)
        self.chosen = self._decided[-1].chosen
        return self._views(video, chosen, belief, feet(video.frame))

    def revise(self, belief: Belief, feet: FootContacts) -> dict[int, tuple[KeypointView, ...]]:
        """Frames in which somebody else is the wearer than was thought, and what is seen in them."""
        self._decided = [decided for decided in self._decided if decided.video.frame >= belief.first]
        if len(self._decided) < 2:
            return {}
        videos, changed = [decided.video for decided in self._decided], {}
        choices = self._association.revise(videos, belief.at([video.frame for video in videos]))
        for decided, video, chosen in zip(self._decided, videos, choices, strict=True):
            if np.any(chosen != decided.chosen):
                decided.chosen, number = chosen, video.frame
                changed[number] = self._views(video, chosen, belief.at([number]), feet(number))
        self.chosen = self._decided[-1].chosen
        return changed

    def learn_spread(self, wearer: int, residual: Array, view: KeypointView, share: float) -> None:
        """Learn how detections scatter from whitened residuals ``(T, K, 2)``; ``share`` in (0, 1] is how fast."""
        if not self._settings.adaptive:
            return
        measured = scatter(residual, view, self.spreads[wearer])
        self.spreads[wearer] = float(
            np.exp((1 - share) * np.log(self.spreads[wearer]) + share * np.log(max(measured, 1e-3)))
        )

    def _views(
        self, video: VideoFrame, chosen: np.ndarray, belief: Belief, feet: Sequence[Array | None]
    ) -> tuple[KeypointView, ...]:
        return tuple(
            KeypointView.unseen(wearer.points) if person == NOBODY else self._view(video, person, number, belief, own)
            for number, (person, wearer, own) in enumerate(zip(chosen.tolist(), self._wearers, feet, strict=True))
        )

    def _view(
        self, video: VideoFrame, person: int, wearer: int, belief: Belief, foot_contacts: Array | None
    ) -> KeypointView:
        own = self._wearers[wearer]
        lens, settings, body = self.camera.model, self._settings, belief.bodies[wearer]
        pixels, confidence = video.pixels[person, own.used], video.confidence[person, own.used]
        seen = (confidence >= settings.least_confidence) & np.all(np.isfinite(pixels), axis=1)
        R, p = belief.R_world_camera[0], belief.p_world_camera[0]
        depth = R[:, 2] @ (body.p_world_joint[0, MIDDLE] - p)
        height = lens.focal[1] * own.stature / max(depth, NEAREST_M)
        oks, scale = self._keypoints.sigmas[own.used], np.asarray(AREA_OF_HEIGHT * height)
        if settings.biweight.use:
            predicted = lens.project((own.on_body.on(body)[0] - p) @ R)
            weight = adaptive_biweight(pixels, predicted, oks, scale, lens.width, settings.biweight)
            seen, confidence = seen & (weight > 0), confidence * weight
        metre = lens.focal[1] / max(depth, NEAREST_M)
        sigma, oks_px = pixel_sigma(oks * scale, confidence, seen, self.spreads[wearer], metre, settings)
        confidence = np.where(seen, np.minimum(confidence, 1.0), 0.0)
        pixels = np.where(seen[:, None], pixels, 0.0)
        view = KeypointView(
            own.points, pixels[None], sigma[None], oks_px[None], seen[None], np.zeros_like(pixels)[None],
            confidence[None], names=own.names,
        )  # fmt: skip
        if foot_contacts is None:
            return view
        pose = CameraPoses(R[None], p[None])
        ground = ground_view(view, own.feet, own.columns, foot_contacts[None], body, own.sole, pose, lens, self._ground)
        return replace(view, ground=ground)
