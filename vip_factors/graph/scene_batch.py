"""A whole scene as one objective: the wearers' own, the camera's own, and the reprojections between them."""

from collections.abc import Mapping
from dataclasses import replace

import gtsam
import numpy as np

from vip_factors.body.kinematics import BodyState, forward_kinematics
from vip_factors.graph.batch import BatchObjective
from vip_factors.graph.camera_batch import CameraObjective
from vip_factors.graph.ground_batch import ground_cost, ground_equations
from vip_factors.graph.reprojection_batch import (
    ReprojectionEquations,
    reprojection_cost,
    reprojection_equations,
    reprojections,
)
from vip_factors.graph.scene_model import CameraProblem, KeypointView, SceneModel
from vip_factors.graph.scene_state import CameraState, SceneState
from vip_factors.graph.scene_system import SceneSystem
from vip_factors.graph.terms import FRAME

CHUNK = 32  # frames evaluated together: see the wearers' own


class SceneObjective:
    """Cost, linearisation and retraction of a :class:`~vip_factors.graph.scene_model.SceneModel`.

    The factors of :mod:`vip_factors.graph.frame` and :mod:`vip_factors.graph.scene_frame` stay the definition.
    """

    def __init__(self, model: SceneModel) -> None:
        self.model = model
        self.wearers = [BatchObjective(wearer, number) for number, wearer in enumerate(model.wearers)]
        self.camera = CameraObjective(model.camera, model.frames, model.step)

    @property
    def static_keys(self) -> list[int]:
        """Keys of what all frames share, where any of it moves; they are eliminated last, in this order."""
        keys = [objective.static_key for objective in self.wearers if len(objective.static_columns)]
        return [*keys, *[self.camera.static_key][: len(self.camera.columns) - self.camera.frame_width]]

    def cost(self, state: SceneState) -> Mapping[str, float]:
        """Half the sum of squared whitened residuals, losses applied, by factor kind, of all wearers together."""
        costs = self.camera.cost(state.camera)
        bodies = [self._body(state, number) for number in range(len(self.wearers))]
        for objective, wearer, body in zip(self.wearers, state.wearers, bodies, strict=True):
            for kind, cost in objective.cost(wearer, body).items():
                costs[kind] = costs.get(kind, 0.0) + cost
        everything, costs["reprojection"] = slice(0, self.model.frames), 0.0
        for number, body in enumerate(bodies):
            for one in self.model.viewpoints(state.camera):
                view, settings = one.views[number], one.problem.settings
                poses, clock = one.state.at_frames(everything), one.state.clock
                residual, _ = reprojections(view, one.problem, poses, clock, body)
                costs["reprojection"] += reprojection_cost(residual, settings.reprojection)
                if view.ground is not None:
                    cost = ground_cost(view.ground, poses, body, settings.ground_contact)
                    costs["ground contact"] = costs.get("ground contact", 0.0) + cost
        return costs

    def linearise(self, state: SceneState) -> SceneSystem:
        """The normal equations at a state."""
        bodies = [self._body(state, number) for number in range(len(self.wearers))]
        chains = [
            objective.linearise(wearer, body)
            for objective, wearer, body in zip(self.wearers, state.wearers, bodies, strict=True)
        ]
        camera = self.camera.linearise(state.camera)
        couplings, T = [], self.model.frames
        for number, (chain, view) in enumerate(zip(chains, self.model.views, strict=True)):
            body, coupling = bodies[number], np.zeros((T, FRAME, len(camera.columns)))
            for frames in (slice(start, min(start + CHUNK, T)) for start in range(0, T, CHUNK)):
                equations = view_equations(view, frames, self.model.camera, state.camera, body)
                chain.own[frames, :FRAME, :FRAME] += equations.hessian[:, :FRAME, :FRAME]
                chain.gradient[frames, :FRAME] += equations.gradient[:, :FRAME]
                camera.add_frames(frames, equations.hessian[:, FRAME:, FRAME:], equations.gradient[:, FRAME:])
                coupling[frames] = equations.coupling[:, :, camera.columns]
                for known in self.model.further:
                    equations = view_equations(known.views[number], frames, known.problem, known.state, body)
                    chain.own[frames, :FRAME, :FRAME] += equations.hessian[:, :FRAME, :FRAME]
                    chain.gradient[frames, :FRAME] += equations.gradient[:, :FRAME]
            couplings.append(coupling)
        return SceneSystem(chains, camera, couplings, [np.any(view.seen, axis=1) for view in self.model.views])

    def retract(self, state: SceneState, delta: gtsam.VectorValues) -> SceneState:
        """The state moved by a solution of the linear system."""
        wearers = (
            objective.retract(wearer, delta) for objective, wearer in zip(self.wearers, state.wearers, strict=True)
        )
        return SceneState(tuple(wearers), self.camera.retract(state.camera, delta))

    def _body(self, state: SceneState, number: int) -> BodyState:
        wearer = state.wearers[number]
        return forward_kinematics(self.model.wearers[number].skeleton, wearer.R_parent_child, wearer.p_world_pelvis)


def view_equations(
    view: KeypointView, frames: slice, camera: CameraProblem, state: CameraState, body: BodyState
) -> ReprojectionEquations:
    """What one camera saw of one wearer in a stretch of frames: keypoints, and feet on the ground."""
    poses, part = state.at_frames(frames), body.at(frames)
    equations = reprojection_equations(_part(view, frames), camera, poses, state.clock, part)
    if view.ground is None:
        return equations
    ground = ground_equations(view.ground.at_frames(frames), poses, part, camera.settings.ground_contact)
    return ReprojectionEquations(equations.hessian + ground.hessian, equations.gradient + ground.gradient)


def _part(view: KeypointView, frames: slice) -> KeypointView:
    return replace(
        view,
        pixels=view.pixels[frames],
        sigma=view.sigma[frames],
        seen=view.seen[frames],
        pixels_per_second=view.pixels_per_second[frames],
    )
