"""One way to move: by a solution of the linear system, by a stream's coordinates, and as GTSAM moves its values."""

import gtsam
import numpy as np
import pytest
from small_problems import drifting_scene, small_scene

from vip_factors.assembly.objective import SceneObjective
from vip_factors.assembly.system import Steps
from vip_factors.factor_graph.graph import factor_graph_of
from vip_factors.live.frames import FrameState, LagProblem
from vip_factors.problem.state import SceneState
from vip_factors.problem.variables import scene_layout
from vip_factors.settings import LiveSettings

NEAR, FAR = 0.01, np.deg2rad(40.0)  # rad and m of one sigma


def assert_same(one: SceneState, other: SceneState) -> None:
    for ours, theirs in zip(one.wearers, other.wearers, strict=True):
        frames = ("R_parent_child", "p_world_pelvis")
        for name in (
            *frames,
            "headings",
            "R_bone_sensor",
            "pose_mean",
            "heading_path",
            "body",
            "sensor_positions",
            "hinges",
            "sole",
        ):
            np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), atol=1e-12, err_msg=name)
    np.testing.assert_allclose(one.cameras[0].poses.R_world_camera, other.cameras[0].poses.R_world_camera, atol=1e-12)
    np.testing.assert_allclose(one.cameras[0].poses.p_world_camera, other.cameras[0].poses.p_world_camera, atol=1e-12)
    np.testing.assert_allclose(one.cameras[0].R_camera_imu, other.cameras[0].R_camera_imu, atol=1e-12)
    np.testing.assert_allclose(one.detector.keypoint_offsets, other.detector.keypoint_offsets, atol=1e-12)
    assert one.cameras[0].heading == pytest.approx(other.cameras[0].heading)
    assert one.cameras[0].clock == pytest.approx(other.cameras[0].clock)
    assert one.cameras[0].clock_drift == pytest.approx(other.cameras[0].clock_drift)


@pytest.mark.parametrize("far", [NEAR, FAR])
@pytest.mark.parametrize("kind", ["moving", "standing", "drifting"])
def test_a_solution_moves_the_state_as_gtsam_moves_its_values(kind: str, far: float) -> None:
    problem, state = drifting_scene("moving") if kind == "drifting" else small_scene(kind)
    whole, random = factor_graph_of(problem, state), np.random.default_rng(1)
    by_variable = {variable: far * random.standard_normal(variable.width) for variable in whole.variables}
    by_key, objective = gtsam.VectorValues(), SceneObjective(problem)
    for one, step in by_variable.items():
        by_key.insert(one.key, step)

    def of(blocks: tuple[str, ...], **where: int) -> np.ndarray:
        found = [
            step
            for one, step in by_variable.items()
            if one.block in blocks and all(getattr(one, name) == value for name, value in where.items())
        ]
        return np.concatenate([np.zeros(0), *found])

    layout = objective.layout
    frames = np.zeros((problem.frames, layout.frame_width))
    for chain, columns in zip(layout.chains, layout.chain_columns, strict=True):
        kinds = ("joint", "root") if chain.owner.kind == "wearer" else ("poses",)
        for t in range(problem.frames):
            frames[t, columns] = of(kinds, frame=t, wearer=chain.owner.number)
    blocks = [of((block.name,), wearer=owner.number, step=0) for owner, block, _ in layout.placed if block.free]
    later = {
        number: np.array([of(("headings",), wearer=number, step=step) for step in range(1, len(wearer.heading_times))])
        for number, wearer in enumerate(problem.wearers)
        if wearer.headings_drift
    }
    delta = Steps(frames, np.concatenate(blocks), later)
    moved = whole.state_at(whole.values.retract(by_key))
    assert_same(objective.retract(state, delta), moved)


@pytest.mark.parametrize("far", [NEAR, FAR])
@pytest.mark.parametrize("kind", ["moving", "standing"])
def test_a_stream_moves_by_coordinates_as_batch_moves_by_steps(kind: str, far: float) -> None:
    problem, state = small_scene(kind)
    layout, random = scene_layout(problem), np.random.default_rng(2)
    steps = far * random.standard_normal((problem.frames, layout.frame_width))
    static = far * random.standard_normal(layout.static_width)
    origins = [FrameState.of(state, t) for t in range(problem.frames)]
    lag = LagProblem(problem.wearers, problem.cameras, problem.views, (), problem.step, LiveSettings())
    live = lag.moved_frames(origins, steps)
    batch = state.retract_frames(layout, steps).retract_static(layout, static)
    for t, one in enumerate(live):
        for number, wearer in enumerate(batch.wearers):
            np.testing.assert_allclose(one.R_parent_child[number], wearer.R_parent_child[t], atol=1e-12)
            np.testing.assert_allclose(one.p_world_pelvis[number], wearer.p_world_pelvis[t], atol=1e-12)
        if kind == "moving":
            np.testing.assert_allclose(one.R_world_camera[0], batch.cameras[0].poses.R_world_camera[t], atol=1e-12)
            np.testing.assert_allclose(one.p_world_camera[0], batch.cameras[0].poses.p_world_camera[t], atol=1e-12)
    shared, expected = state.window(slice(0, 0)).retract_static(layout, static), batch.window(slice(0, 0))
    assert_same(shared, expected)
