"""Where the floor is: a camera that was found knows of none, so the world's zero goes under the soles that stand."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.body.kinematics import forward_kinematics
from vip_factors.body.skeleton import contact_points
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array
from vip_factors.problem.state import SceneState, WearerState
from vip_factors.problem.wearer import WearerProblem

STILL = 0.12, 0.25  # m/s, of a sole that stands: the slower where it is enough, for pixels make feet tremble
LEAST_FRAMES = 10  # that tell a height
UNSURE_M = 0.02  # of standard deviation, from which on it is told
STANCE_S = 0.5  # frames of one stance share one error


@dataclass(frozen=True)
class Floor:
    """A level floor: its height in metres, and the standard deviation of that."""

    height: float
    sigma: float


def floor_under(models: Sequence[WearerProblem], states: Sequence[WearerState]) -> Floor | None:
    """The floor under the soles: the median height of the lowest points of all bodies while those points rest.

    None where nothing rests for long enough to tell. Of the steps of stairs it is the middle one.
    """
    heights, speeds, seconds = list[Array](), list[Array](), 0.0
    for model, state in zip(models, states, strict=True):
        body = forward_kinematics(model.skeleton, state.R_parent_child, state.p_world_pelvis)
        soles = contact_points(model.skeleton, model.settings.sole.of(state.sole))
        points = np.stack([body.point(bone, p) for bone, p in soles], axis=1)
        if len(points) < LEAST_FRAMES:
            continue
        lowest = np.arange(len(points)), np.argmin(points[..., 2], axis=1)
        heights.append(points[..., 2][lowest])
        speeds.append(np.linalg.norm(np.gradient(points, model.frames.step, axis=0), axis=2)[lowest])
        seconds += len(points) * model.frames.step
    height, speed = np.concatenate([np.zeros(0), *heights]), np.concatenate([np.zeros(0), *speeds])
    for limit in STILL:
        resting = height[speed < limit]
        if len(resting) >= LEAST_FRAMES:
            middle = float(np.median(resting))
            spread = 1.4826 * float(np.median(np.abs(resting - middle)))
            stances = max(seconds / STANCE_S * len(resting) / len(height), 1.0)
            return Floor(middle, spread / float(np.sqrt(stances)))
    return None


def on_floor(models: Sequence[WearerProblem], state: SceneState) -> tuple[SceneState, tuple[Finding, ...]]:
    """The state of a scene with its floor at z = 0, and what is odd about the floor."""
    floor = floor_under(models, state.wearers)
    if floor is None:
        return state, ()
    shift, poses = np.array([0.0, 0.0, -floor.height]), state.camera.poses
    wearers = tuple(replace(one, p_world_pelvis=one.p_world_pelvis + shift) for one in state.wearers)
    camera = replace(state.camera, poses=replace(poses, p_world_camera=poses.p_world_camera + shift))
    unsure = floor.sigma > UNSURE_M
    findings = (Finding("floor uncertain", numbers={"sigma_cm": 100 * floor.sigma}),) if unsure else ()
    return replace(state, wearers=wearers, camera=camera), findings
