"""GTSAM's own smoother says of a filmed wearer what the tracker's says."""

from dataclasses import replace

import numpy as np
import pytest

from tests.studies.gtsam_smoothers import LagOfGtsam, RecordedWindow, feed, recorded_window, without_walk
from tests.studies.long_stream import LongStream, LongStreamTrials, stream_scene
from vip_factors.assembly.objective import SceneObjective
from vip_factors.factor_graph.keys import joint_key, root_key
from vip_factors.geometry.rotations import angle_between
from vip_factors.live.frames import FrameState, stacked
from vip_factors.live.smoother import LagSmoother
from vip_factors.settings import LiveSettings, SolveSettings
from vip_factors.solve.levenberg_marquardt import levenberg_marquardt

SHORT_LAG, WINDOW, ITERATIONS, ALL = 3, 9, 6, 100
# The same factors have the same minimum, but for where GTSAM's iterations stop.
SAME_MM, SAME_DEG = 0.02, 0.05
# What is marginalised keeps its linearisation, robust weights included, and no two policies keep the same one. Ours is
# the nearer to the problem without marginalisation: 0.2 mm and 0.15 degrees, against 0.4 and 0.6.
OURS_MM, OURS_DEG = 0.4, 0.3
ALIKE_MM, ALIKE_DEG = 1.0, 1.0

Answers = list[tuple[np.ndarray, np.ndarray]]  # joint rotations and root position of each newest frame


@pytest.mark.slow
def test_the_smoother_says_what_gtsams_batch_smoother_says_of_a_filmed_wearer() -> None:
    trials = LongStreamTrials(seconds=6.0, scene_s=8.0, placement="sip6")
    settings = without_walk(LiveSettings())
    window = recorded_window(stream := LongStream(stream_scene(trials), trials), stream.setup, settings, WINDOW)
    window = _at_the_minimum(_well_known(window))
    whole, lagging = (_ours(window, settings, lag) for lag in (ALL, SHORT_LAG))
    assert _is_near(_gtsams(window, ALL), whole, SAME_MM, SAME_DEG)
    assert _is_near(lagging, whole, OURS_MM, OURS_DEG)
    assert _is_near(_gtsams(window, SHORT_LAG), lagging, ALIKE_MM, ALIKE_DEG)


def _ours(window: RecordedWindow, settings: LiveSettings, lag: int) -> Answers:
    """With all frames of the lag linearised anew until nothing moves."""
    # What is eliminated anew needs the frame before it: one more than the lag is kept.
    everything = replace(settings.relinearisation, angle_deg=1e-9, length_m=1e-12, shared_deg=1e-9, most=lag + 2)
    smoother = LagSmoother(window.problem, window.shared, replace(settings, relinearisation=everything))
    answers = []
    for newest in range(SHORT_LAG, WINDOW):
        for number in range(0 if newest == SHORT_LAG else newest, newest + 1):
            smoother.append(window.frames[number], window.states[number])
        for _ in range(ITERATIONS):
            smoother.update()
        state = smoother.state(newest)
        answers.append((state.R_parent_child[0], state.p_world_pelvis[0]))
        smoother.marginalise_before(newest - lag - 1)
    return answers


def _gtsams(window: RecordedWindow, lag: int) -> Answers:
    reference, answers = LagOfGtsam(lag), []
    for one in feed(window, SHORT_LAG):
        values = reference.update(one.newest, one.factors, one.values, one.frames, one.shared)
        R = np.stack([values.atRot3(joint_key(one.newest, joint)).matrix() for joint in range(24)])
        answers.append((R, values.atPoint3(root_key(one.newest))))
    return answers


def _is_near(answers: Answers, others: Answers, mm: float, degrees: float) -> bool:
    apart = [1e3 * np.linalg.norm(p - other) for (_, p), (_, other) in zip(answers, others, strict=True)]
    turned = [np.rad2deg(angle_between(R, other)).max() for (R, _), (other, _) in zip(answers, others, strict=True)]
    return bool(max(apart) < mm and max(turned) < degrees)


def _well_known(window: RecordedWindow) -> RecordedWindow:
    """With headings and mountings that some frames cannot move far: no matter of where they are linearised."""
    problem = window.problem
    problem.wearers = tuple(
        replace(one, heading_sigma=np.full(len(one.sensors), 0.02), mounting_sigma=np.full(len(one.sensors), 0.02))
        for one in problem.wearers
    )
    return window


def _at_the_minimum(window: RecordedWindow) -> RecordedWindow:
    """Where the whole window has its minimum: what the first frames say alone is not far from there."""
    problem = window.problem
    state = stacked(window.states, window.shared)
    solved, _ = levenberg_marquardt(
        SceneObjective(problem.model(window.frames, beginning=True)), state, SolveSettings(max_iterations=30)
    )
    states = tuple(FrameState.of(solved, t) for t in range(len(window.frames)))
    return replace(window, states=states, shared=solved.window(slice(0, 0)))
