"""The world's zero is under the soles that stand, or where a camera of known pose says; what is odd of it is told."""

from dataclasses import dataclass, replace
from functools import cache
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from filmed_gestures import FROM_STRAPS, HASTY, camera_of, filmed_gestures

from vip_factors.body.kinematics import Motion, forward_kinematics
from vip_factors.body.skeleton import contact_points
from vip_factors.errors import InputError
from vip_factors.factor_settings import FactorSettings
from vip_factors.geometry.rotations import Array, angle_between, exp
from vip_factors.pipeline import smooth
from vip_factors.problem.state import CameraPoses, CameraState, SceneState
from vip_factors.sensors.scene import Scene
from vip_factors.simulate.gestures import gestures
from vip_factors.stages import scene_solution
from vip_factors.stages.floor import Floor, distance_findings, levelled, with_declared_floor
from vip_factors.stages.floor import _plane as plane

SOLE_M = 0.018
ACROSS = np.array([0.0, 1.0, 0.0])  # of a camera that looks along x


def soles(motion: Motion) -> np.ndarray:
    """``(T, 4, 3)`` heels and balls of both feet."""
    body = forward_kinematics(motion.skeleton, motion.R_parent_child, motion.p_world_pelvis)
    return np.stack([body.point(bone, p) for bone, p in contact_points(motion.skeleton, SOLE_M)], axis=1)


def before_tripod(seconds: float) -> Scene:
    """A scene filmed by a camera that stands, nobody knows where."""
    scene = filmed_gestures("fixed", seconds=seconds)
    return replace(scene, cameras=(replace(camera_of(scene), known_path=None),))


@cache
def standing() -> Motion:
    return smooth(before_tripod(3.0), FROM_STRAPS).wearers[0].motion


def test_soles_stand_at_nought_before_a_camera_whose_pose_is_not_known() -> None:
    lowest = soles(standing())[..., 2].min(axis=1)
    assert abs(np.median(lowest)) < 0.02  # of all frames, those in which nothing rests among them
    assert np.quantile(np.abs(lowest), 0.95) < 0.03


def test_planted_feet_stay_where_they_are() -> None:
    motion = standing()
    points = soles(motion)
    speed = np.linalg.norm(np.gradient(points, 1 / motion.rate, axis=0)[..., :2], axis=2).min(axis=1)
    assert np.median(speed) < 0.02


def test_the_floor_is_left_where_it_is_if_wanted() -> None:
    scene = before_tripod(2.0)
    found, left = (smooth(scene, replace(HASTY, floor=one)).wearers[0].motion for one in ("found", "none"))
    shift = found.p_world_pelvis - left.p_world_pelvis
    np.testing.assert_allclose(shift, np.broadcast_to(shift[0], shift.shape), atol=2e-3)


def filmed_from_a_known_pose(metres: float) -> Scene:
    """A scene whose camera's pose is known, told in a world whose zero is so far under the floor."""
    scene = filmed_gestures("fixed", seconds=2.0)
    assert scene.camera.truth is not None
    path = scene.camera.truth.path
    path = replace(path, p_world_camera=path.p_world_camera + np.array([0.0, 0.0, metres]))
    return replace(scene, cameras=(replace(camera_of(scene), known_path=path),))


def test_a_declared_floor_is_where_zero_is() -> None:
    plain = smooth(filmed_from_a_known_pose(0.0), HASTY)
    board_lay_on_a_table = smooth(filmed_from_a_known_pose(-0.74), replace(HASTY, floor=-0.74))
    for one, other in zip(plain.wearers, board_lay_on_a_table.wearers, strict=True):
        np.testing.assert_allclose(one.motion.p_world_pelvis, other.motion.p_world_pelvis, atol=1e-6)
    assert "floor" not in [finding.kind for finding in plain.findings]


def test_soles_that_stand_beside_the_declared_floor_are_told() -> None:
    metres = -0.1
    estimate = smooth(filmed_from_a_known_pose(metres), FROM_STRAPS)
    (height,) = (finding.numbers["height_cm"] for finding in estimate.findings if finding.kind == "floor")
    assert 0.4 < height / (100 * metres) < 1.1  # bodies and weak contacts give way a little


def test_a_height_needs_a_camera_of_known_pose() -> None:
    with pytest.raises(InputError, match="known pose"):
        with_declared_floor(before_tripod(0.5), 0.3)


def soles_at(heights: Array, seed: int = 0) -> Array:
    """Points ``(N, 3)`` of soles along a way of four metres, a centimetre uneven."""
    noise = np.random.default_rng(seed).normal(0, [0.1, 0.1, 0.01], (len(heights), 3))
    return noise + np.stack([np.linspace(0, 4, len(heights)), np.zeros(len(heights)), heights], axis=1)


def told(floor: Floor, is_declared: bool = False) -> list[str]:
    return [number for finding in floor.findings(is_declared) for number in finding.numbers]


def test_level_floors_are_not_remarked_on_and_slopes_are() -> None:
    way = np.linspace(0, 4, 400)
    assert not any(told(plane(soles_at(0 * way, seed), 20.0)) for seed in range(50))
    ramp = plane(soles_at(np.tan(np.deg2rad(5.0)) * way), 20.0)
    assert np.rad2deg(ramp.slope) == pytest.approx(5.0, abs=1.0)
    assert told(ramp) == ["sigma_cm", "uneven_cm", "slope_deg"]


def test_stairs_have_no_floor_that_is_certain() -> None:
    assert told(plane(soles_at(0.17 * np.repeat(np.arange(4.0), 100)), 12.0)) == ["sigma_cm", "uneven_cm", "slope_deg"]


def test_a_declared_floor_is_believed_within_two_centimetres() -> None:
    for height, kinds in ((0.015, []), (0.04, ["height_cm"]), (-0.04, ["height_cm"])):
        assert told(plane(soles_at(np.full(400, height)), 20.0), is_declared=True) == kinds


@dataclass(frozen=True)
class Posed:
    """Of a wearer's state what tells where soles are."""

    R_parent_child: Array
    p_world_pelvis: Array
    sole: float = 0.0


def two_walkers(raised_m: float, seconds: float = 6.0) -> tuple[list[Any], SceneState]:
    """Two in one place, four metres before a camera two metres high; the first is so far above the floor."""
    motion = gestures(seconds, rate=30.0)
    problem = SimpleNamespace(skeleton=motion.skeleton, settings=FactorSettings(), frames=SimpleNamespace(step=1 / 30))
    own = [
        Posed(motion.R_parent_child, motion.p_world_pelvis + up)
        for up in np.array([[0.0, 0.0, raised_m], [0.0, 0.0, 0.0]])
    ]
    middle = motion.p_world_pelvis.mean(axis=0)
    camera = CameraState(CameraPoses(np.eye(3)[None], np.array([[middle[0] - 4.0, middle[1], 2.0]])))
    problems: list[Any] = [SimpleNamespace(**vars(problem), name=name) for name in ("anna", "ben")]
    return problems, SceneState(cast(Any, tuple(own)), (camera,))


def test_people_on_one_floor_are_not_remarked_on_and_one_too_near_is() -> None:
    assert not list(distance_findings(*two_walkers(0.02)))
    (found,) = distance_findings(*two_walkers(0.2))
    assert (found.wearer, found.subject) == ("anna", "ben")
    assert found.numbers["metres"] == pytest.approx(0.2 * 4 / 2, abs=0.12)
    assert "farther from the camera" in str(found)


def test_a_camera_on_the_floor_does_not_tell_who_is_nearer() -> None:
    problems, state = two_walkers(0.0)
    low = replace(state.cameras[0].poses, p_world_camera=state.cameras[0].poses.p_world_camera * [1, 1, 0])
    (found,) = distance_findings(problems, replace(state, cameras=(replace(state.cameras[0], poses=low),)))
    assert found.numbers["sigma"] > abs(found.numbers["metres"])


def tilted(state: SceneState, degrees: float, axis: Array) -> SceneState:
    """The state with roots and camera turned about an axis through the camera."""
    turn, poses = exp(np.deg2rad(degrees) * axis), state.cameras[0].poses
    about = poses.p_world_camera[0]
    wearers = tuple(
        replace(wearer, p_world_pelvis=about + (wearer.p_world_pelvis - about) @ turn.T) for wearer in state.wearers
    )
    poses = replace(poses, R_world_camera=turn @ poses.R_world_camera)
    return replace(state, wearers=wearers, cameras=(replace(state.cameras[0], poses=poses),))


@pytest.mark.parametrize("degrees", [-2.0, 2.0])
def test_a_world_that_is_tilted_is_turned_until_its_floor_is_level(degrees: float) -> None:
    problems, state = two_walkers(0.0, seconds=12.0)
    again = levelled(problems, tilted(state, degrees, ACROSS))
    assert again is not None
    off = angle_between(again.cameras[0].poses.R_world_camera, state.cameras[0].poses.R_world_camera)
    assert np.rad2deg(off.item()) < 0.3
    for one, true in zip(again.wearers, state.wearers, strict=True):
        np.testing.assert_allclose(one.p_world_pelvis, true.p_world_pelvis, atol=0.03)


def test_neither_level_floors_nor_ramps_turn_the_world() -> None:
    problems, state = two_walkers(0.0, seconds=12.0)
    assert levelled(problems, state) is None
    assert levelled(problems, tilted(state, 8.0, ACROSS)) is None


def test_a_standing_camera_that_was_found_tilted_stands_upright(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, fused, found = before_tripod(10.0), scene_solution.fuse_in_rounds, []

    def found_tilted(*given: Any) -> Any:
        solution, associated = fused(*given)
        across = solution.state.cameras[0].poses.R_world_camera[0][:, 0]
        found.append(tilted(solution.state, 1.5, across))
        return replace(solution, state=found[0]), associated

    monkeypatch.setattr(scene_solution, "fuse_in_rounds", found_tilted)
    estimate = smooth(scene, HASTY)
    assert "level floor" in [report.stage for report in estimate.reports]
    assert scene.camera.truth is not None
    assert estimate.camera is not None
    cameras = scene.camera.truth.path, found[0].cameras[0].poses, estimate.camera.path
    true, before, after = (camera.R_world_camera[0, 2] for camera in cameras)  # where up is in the camera
    assert np.rad2deg(np.arccos(true @ before)) > 1.5
    assert np.rad2deg(np.arccos(true @ after)) < 0.8
