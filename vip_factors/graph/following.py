"""The camera alone, following wearers whose motion is kept: a chain of six unknowns a frame, solved in no time."""

from collections.abc import Mapping, Sequence

import gtsam

from vip_factors.body.kinematics import forward_kinematics
from vip_factors.graph.camera_batch import CameraObjective
from vip_factors.graph.reprojection_batch import reprojection_cost, reprojection_equations, reprojections
from vip_factors.graph.scene_model import SceneModel
from vip_factors.graph.scene_state import CameraState
from vip_factors.graph.state import GraphState
from vip_factors.graph.system import ChainSystem
from vip_factors.graph.terms import FRAME


class FollowingObjective:
    """Cost, linearisation and retraction of the camera's share of a scene."""

    def __init__(self, model: SceneModel, wearers: Sequence[GraphState]) -> None:
        self.model = model
        self.camera = CameraObjective(model.camera, model.frames, model.step)
        self._bodies = [
            forward_kinematics(one.skeleton, state.R_parent_child, state.p_world_pelvis)
            for one, state in zip(model.wearers, wearers, strict=True)
        ]

    def cost(self, state: CameraState) -> Mapping[str, float]:
        """Half the sum of squared whitened residuals, losses applied, by factor kind."""
        camera, poses = self.model.camera, state.at_frames(slice(0, self.model.frames))
        costs, settings = self.camera.cost(state), camera.settings.reprojection
        costs["reprojection"] = sum(
            reprojection_cost(reprojections(view, camera, poses, state.clock, body)[0], settings)
            for view, body in zip(self.model.views, self._bodies, strict=True)
        )
        return costs

    def linearise(self, state: CameraState) -> ChainSystem:
        """The normal equations at a state."""
        system, everything = self.camera.linearise(state), slice(0, self.model.frames)
        poses = state.at_frames(everything)
        for view, body in zip(self.model.views, self._bodies, strict=True):
            equations = reprojection_equations(view, self.model.camera, poses, state.clock, body)
            system.add_frames(everything, equations.hessian[:, FRAME:, FRAME:], equations.gradient[:, FRAME:])
        return system

    def retract(self, state: CameraState, delta: gtsam.VectorValues) -> CameraState:
        """The state moved by a solution of the linear system."""
        return self.camera.retract(state, delta)
