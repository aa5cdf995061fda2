"""The terms on what a camera saw of a wearer."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from vip_factors.assembly.equations import BoneEquations, Part
from vip_factors.assembly.evaluation import ViewEvaluation
from vip_factors.assembly.registry import Term
from vip_factors.body.kinematics import BodyState
from vip_factors.geometry.rotations import Array
from vip_factors.problem.points import BodyPoints
from vip_factors.problem.scene import GroundView
from vip_factors.terms.camera_pose import CameraPoses
from vip_factors.terms.ground_contact import Foot, ground_contact_jacobians, ground_contact_residual
from vip_factors.terms.reprojection import reprojection_jacobians, reprojection_residual


def reprojection(at: ViewEvaluation, first: slice) -> Iterator[BoneEquations]:
    """One factor for each keypoint that was seen."""
    view, lens, settings = at.view, at.camera.model, at.camera.settings.reprojection
    if not view.points:
        return
    body, poses, points = at.wearer.body.at(first), at.state.at_frames(first), view.body_points
    p, sigma, speed = at.points_on(points).on(body), view.sigma[first, :, None], view.pixels_per_second[first]
    residual, p_camera = reprojection_residual(p, poses, lens, view.pixels[first])
    seen = view.seen[first]
    late = at.seconds_late(first)[:, None, None]
    whitened = np.where(seen[..., None], (residual + late * speed) / sigma, 0.0)

    def derivatives() -> tuple[Array, tuple[Part, ...]]:
        by_point, by_camera = reprojection_jacobians(p_camera, poses, lens)
        by_twist = (by_point @ body.point_twists(p)) / sigma[..., None]
        return by_twist, (
            Part(at.owner, "poses", by_camera / sigma[..., None]),
            *_clock_parts(at, first, speed / sigma),
            *at.wearer.body_parts(body, points, by_point / sigma[..., None]),
            *at.offset_parts(body, by_point / sigma[..., None]),
        )

    yield BoneEquations(
        "reprojection", first.start, whitened, seen, settings.loss, at.wearer.owner, points.bones, derivatives
    )


def _clock_parts(at: ViewEvaluation, first: slice, speed: Array) -> tuple[Part, ...]:
    """Derivatives of what moves at whitened speeds ``(t, n, 2)``, if the clock is a variable."""
    if not at.camera.free_clock:
        return ()
    by_drift = at.since_middle(first)[:, None, None] * speed
    return Part(at.owner, "clock", speed[..., None]), Part(at.owner, "clock_drift", by_drift[..., None])


def reprojection_residuals(at: ViewEvaluation) -> Array:
    """Whitened residuals ``(T, K, 2)`` in all frames, zero where nothing was seen."""
    everything = slice(0, at.frames)
    return next((one.residual for one in reprojection(at, everything)), np.zeros((at.frames, 0, 2)))


def ground_contact(at: ViewEvaluation, first: slice) -> Iterator[BoneEquations]:
    """One factor for each foot that was seen to stand."""
    ground, loss = at.view.ground, at.camera.settings.ground_contact.loss
    if ground is None or not ground.stands[first].any():
        return
    stands, bones = ground.stands[first], tuple(foot.bone for foot in ground.feet)
    feet = [_StandingFoot.of(at, g, np.flatnonzero(stands[:, g]), first) for g in range(len(bones))]
    residual = np.zeros((*stands.shape, 3))
    for g, foot in enumerate(feet):
        residual[foot.frames, g] = foot.residual

    def derivatives() -> tuple[Array, tuple[Part, ...]]:
        by_twist, by_camera = np.zeros((2, *stands.shape, 3, 6))
        by_sole = np.zeros((*stands.shape, 3, 1))
        for g, foot in enumerate(feet):
            by_twist[foot.frames, g], by_camera[foot.frames, g], by_sole[foot.frames, g] = foot.derivatives()
        ankles = BodyPoints(bones, np.stack([foot.p_bone_ankle for foot in ground.feet]))
        of_body = at.wearer.body_parts(at.wearer.body.at(first), ankles, _whitening(ground, first))
        of_sole = (Part(at.wearer.owner, "sole", by_sole),) if at.wearer.problem.free_sole else ()
        return by_twist, (Part(at.owner, "poses", by_camera), *of_body, *of_sole)

    yield BoneEquations("ground contact", first.start, residual, stands, loss, at.wearer.owner, bones, derivatives)


def _whitening(ground: GroundView, first: slice) -> Array:
    """Derivative ``(t, G, 3, 3)`` by the ankles where they stand; the height of a standing one is its foot's alone."""
    return np.where(ground.stands[first, :, None, None], ground.whitening[first], 0.0)


@dataclass(frozen=True)
class _StandingFoot:
    """One foot in the ``n`` frames in which it stands, by their number in the stretch."""

    frames: np.ndarray
    foot: Foot
    sole: float
    ray: Array
    whitening: Array
    body: BodyState
    camera: CameraPoses
    p_world_ankle: Array
    height: Array

    @classmethod
    def of(cls, at: ViewEvaluation, number: int, frames: np.ndarray, first: slice) -> "_StandingFoot":
        assert at.view.ground is not None
        foot, all_frames, poses = at.view.ground.feet[number], first.start + frames, at.state.at_frames(first)
        body = BodyState(at.wearer.body.R_world_bone[all_frames], at.wearer.body.p_world_joint[all_frames])
        camera = CameraPoses(poses.R_world_camera[frames], poses.p_world_camera[frames])
        ray, whitening = at.view.ground.rays[all_frames, number], at.view.ground.whitening[all_frames, number]
        sole = at.wearer.sole
        return cls(frames, foot, sole, ray, whitening, body, camera, *foot.ankle(body, sole))

    @property
    def residual(self) -> Array:
        """``(n, 3)``, whitened."""
        residual = ground_contact_residual(self.p_world_ankle, self.height, self.camera, self.ray)
        return np.asarray((self.whitening @ residual[..., None])[..., 0])

    def derivatives(self) -> tuple[Array, Array, Array]:
        """By the twist of the foot, the camera's pose, both ``(n, 3, 6)``, and the sole ``(n, 3, 1)``, whitened."""
        by_height, by_camera = ground_contact_jacobians(self.height, self.camera, self.ray)
        by_twist = self.body.point_twists(self.p_world_ankle[:, None])[:, 0]
        by_twist[:, :, :3] += by_height[:, :, None] * self.foot.height_by_turn(self.body, self.sole)[:, None]
        by_sole = by_height * (self.sole * self.foot.height_by_sole(self.body))[:, None]
        return self.whitening @ by_twist, self.whitening @ by_camera, self.whitening @ by_sole[..., None]


VIEW_TERMS: tuple[Term[ViewEvaluation], ...] = (
    Term("reprojection", 0, reprojection),
    Term("ground contact", 0, ground_contact),
)
