"""Compiled kernels say what the functions in NumPy say, which are the definition."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from linear import assert_same, dense
from small_problems import KINDS, SILENCES, T, small_scene

from vip_factors.assembly.charts import Charts
from vip_factors.assembly.objective import SceneObjective, joined_slices
from vip_factors.associate import hypothesis
from vip_factors.body import kinematics
from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.compiled import kernels
from vip_factors.geometry import poses, rotations
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.initialise.sensor_tree import Link, bend_cost
from vip_factors.problem.scene import SceneProblem
from vip_factors.problem.state import SceneState
from vip_factors.problem.variables import scene_layout
from vip_factors.solve.slices import Slices

pytestmark = pytest.mark.skipif(kernels is None, reason="no kernels were built")
ANGLES = (0.0, 1e-9, 0.00999, 0.01001, 0.5, 2.0, 2.2, np.pi - 1e-4, np.pi)


def vectors() -> np.ndarray:
    axes = np.random.default_rng(0).standard_normal((50, 3))
    axes[:3] = np.eye(3)
    return np.array(ANGLES)[:, None, None] * axes / np.linalg.norm(axes, axis=1)[:, None]


@pytest.mark.parametrize("name", ["hat", "exp", "right_jacobian", "inverse_right_jacobian"])
def test_of_rotation_vectors(name: str) -> None:
    fast: Callable = getattr(rotations, name)
    np.testing.assert_allclose(fast(vectors()), fast.__wrapped__(vectors()), atol=1e-10)
    np.testing.assert_allclose(fast([0.1, 0.2, 0.3]), fast.__wrapped__([0.1, 0.2, 0.3]), atol=1e-10)
    assert fast(np.zeros((4, 0, 3))).shape == (4, 0, 3, 3)


def test_jacobian_of_poses() -> None:
    steps = np.concatenate([vectors(), np.random.default_rng(1).standard_normal(vectors().shape)], axis=-1)
    expected = poses.pose_right_jacobian.__wrapped__(steps)
    np.testing.assert_allclose(poses.pose_right_jacobian(steps), expected, atol=1e-10)


def test_logarithm() -> None:
    R = rotations.exp(vectors())
    np.testing.assert_allclose(rotations.log(R), rotations.log.__wrapped__(R), atol=1e-10)
    turned = R.swapaxes(-1, -2)  # memory of another order
    np.testing.assert_allclose(rotations.log(turned), rotations.log.__wrapped__(turned), atol=1e-10)


def test_kinematics() -> None:
    random = np.random.default_rng(1)
    R, p = rotations.exp(random.standard_normal((5, 24, 3))), random.standard_normal((5, 3))
    skeleton = skeleton_from_stature(1.8)
    fast = kinematics.forward_kinematics(skeleton, R, p)
    on_bones = np.array([3, 3, 20]), random.standard_normal((3, 3))
    pure = kinematics.forward_kinematics(skeleton, R, p, kernels=None)
    screws = kinematics.joint_screws(pure.R_world_bone, pure.p_world_joint, kernels=None)
    np.testing.assert_allclose(fast.R_world_bone, pure.R_world_bone, atol=1e-10)
    np.testing.assert_allclose(fast.p_world_joint, pure.p_world_joint, atol=1e-10)
    np.testing.assert_allclose(fast.screws, screws, atol=1e-10)
    np.testing.assert_allclose(fast.points(*on_bones), pure.points(*on_bones, kernels=None), atol=1e-10)


def test_cameras_that_are_followed() -> None:
    """Of bodies some of whose keypoints are not seen; steps that lead lower and steps that do not."""
    random, (P, K) = np.random.default_rng(3), (60, 17)
    seen, weight = random.normal(0.0, 0.15, (P, K, 2)), random.uniform(size=(P, K))
    weight[random.uniform(size=(P, K)) < 0.3] = 0.0
    problem = hypothesis._Problem(random.normal(0.0, 0.4, (P, K, 3)), seen, weight, random.uniform(0.05, 0.2, (P, K)))
    for start in problem.starts():
        steps = hypothesis.START_STEPS
        both = zip(problem._descend(*start, steps), problem._descend(*start, steps, kernels=None), strict=True)
        for fast, pure in both:
            np.testing.assert_allclose(fast, pure, atol=1e-10)


def test_costs_of_links() -> None:
    """Candidates of several mountings, bones that are alike among them, and almost half a turn apart."""
    random, S, K, T = np.random.default_rng(4), 3, 5, 35
    R = rotations.exp(random.standard_normal((S, T, 3)))
    R[:, :4] = R[:1, :1]
    mountings = [rotations.exp(random.standard_normal((K, M, 3))) for M in (1, 2, 4)]
    same = mountings[0][0, 0]
    mountings[1][0, 0], mountings[2][0, :2] = same, np.stack([same, rotations.exp([3.14, 0.0, 0.0]) @ same])
    headings = rotations.rotation_z(np.array([0.0, *random.uniform(-4.0, 4.0, K - 1)]))
    of_headings, *of_mountings = (quaternion_from_matrix(one, Order.WXYZ) for one in (headings, *mountings))
    ends = [(of_headings, one, quaternion_from_matrix(R[s], Order.WXYZ)) for s, one in enumerate(of_mountings)]
    limits, whitening = np.sort(random.standard_normal((3, 3)), axis=0), np.triu(random.standard_normal((3, 3)))
    for a, b in ((0, 1), (1, 2)):
        link = Link(a, b, limits[1], limits[0], limits[2], whitening, 1, None, None)
        fast, pure = bend_cost(link, ends[a], ends[b]), bend_cost(link, ends[a], ends[b], kernels=None)
        np.testing.assert_allclose(fast.ravel(), pure.ravel(), rtol=1e-10)


def test_the_solvers_without_kernels(checkout: Path) -> None:
    """What holds chains, lags and slices to GTSAM, in a Python that has no kernels."""
    command = [sys.executable, "-m", "pytest", "-n", "0", "-p", "no:cacheprovider"]
    chains = ["tests/solve/test_band.py", "tests/solve/test_fixed_lag.py"]
    slices = "tests/assembly/test_slices.py::test_slices_add_up_to_the_batch[moving]"
    without = {**os.environ, "VIP_FACTORS_PURE": "1"}
    done = subprocess.run(
        [*command, *chains, slices], cwd=checkout, env=without, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("in_coordinates", [False, True])
def test_slices(kind: str, in_coordinates: bool) -> None:
    assert_same_slices(*small_scene(kind), in_coordinates)


@pytest.mark.parametrize("silent", SILENCES)
def test_slices_where_nothing_was_measured(silent: tuple[int, ...]) -> None:
    assert_same_slices(*small_scene("moving", silent), True)


@pytest.mark.parametrize(
    ("kind", "silent"), [*(("moving", silent) for silent in SILENCES), *((kind, SILENCES[0]) for kind in KINDS[1:])]
)
def test_bands(kind: str, silent: tuple[int, ...]) -> None:
    """Of a frame with itself, and of what all share, what lies on and above the diagonal counts."""
    model, state = small_scene(kind, silent)
    fast = dense(SceneObjective(model, chunk=3), state)
    assert_same(fast, dense(SceneObjective(model, chunk=3, kernels=None), state))


def assert_same_slices(model: SceneProblem, state: SceneState, in_coordinates: bool) -> None:
    layout, random = scene_layout(model), np.random.default_rng(2)
    frames, static = random.standard_normal((T, layout.frame_width)), random.standard_normal(layout.static_width)
    charts = Charts.at(layout, 0.1 * frames, 0.1 * static) if in_coordinates else None

    empty = [Slices(layout.frame_width, layout.static_width, model.frames) for _ in range(2)]
    (fast,) = joined_slices([layout], model, state, empty[:1], charts)
    (pure,) = joined_slices([layout], model, state, empty[1:], charts, kernels=None)
    counts, expected = np.triu(fast.hessian), np.triu(pure.hessian)
    np.testing.assert_allclose(counts, expected, atol=1e-10 * np.abs(expected).max())
    np.testing.assert_allclose(fast.gradient, pure.gradient, atol=1e-10 * np.abs(pure.gradient).max())
