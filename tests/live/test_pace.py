"""How many frames are solved while samples wait."""

import numpy as np
import pytest
from tracked import SETTINGS, filmed, unfilmed

from vip_factors.findings import Finding
from vip_factors.live.pace import SolvePace
from vip_factors.live.settings import PaceSettings
from vip_factors.live.smoother import LagSmoother
from vip_factors.live.tracker import FixedLagTracker
from vip_factors.sensors.live import live_samples, stream_head

RATE, LATE, IN_TIME = 60, 0.2, 0.01


def run(pace: SolvePace, first: float, seconds: float, waits: list[float]) -> tuple[list[int], list[Finding]]:
    """Frames to each update, in each frame, of samples that waited so long in turn; and what was told."""
    widths, told = list[int](), list[Finding]()
    for frame in range(round(seconds * RATE)):
        told += pace.step(first + frame / RATE, waits[frame % len(waits)])
        widths.append(pace.solve_every)
    return widths, told


def fresh() -> SolvePace:
    return SolvePace(2, RATE, PaceSettings())


def test_fewer_frames_are_solved_step_by_step_and_all_again_later() -> None:
    pace = fresh()
    assert set(run(pace, 0.0, 1.0, [IN_TIME])[0]) == {2}
    late, told = run(pace, 1.0, 2.0, [LATE])
    np.testing.assert_array_equal(np.unique(late), [2, 3, 4])
    assert late == sorted(late)
    assert [one.kind for one in told] == ["fewer frames solved"]
    after, told = run(pace, 3.0, 10.1, [IN_TIME])
    assert after == sorted(after, reverse=True)
    assert after[-1] == 2
    assert after[round(4.9 * RATE)] == 4
    (again,) = told
    assert again.numbers["least"] == 15
    assert again.numbers["rate"] == 30


def test_a_burst_is_no_lack_of_time() -> None:
    pace = fresh()
    widths, told = run(pace, 0.0, 5.0, [IN_TIME] * 10 + [LATE] * 10)
    assert set(widths) == {2}
    assert not told


def test_a_start_that_is_late_is_made_up_for_without_a_word() -> None:
    pace = fresh()
    widths, told = run(pace, 0.0, 2.0, [LATE])
    assert widths[-1] == 4
    assert not told
    widths, told = run(pace, 2.0, 11.0, [IN_TIME])
    assert widths[-1] == 2
    assert not told


def test_a_tracker_that_is_never_in_time_says_so() -> None:
    _, told = run(fresh(), 0.0, 20.0, [LATE])
    assert [one.kind for one in told] == ["fewer frames solved"]
    assert told[0].numbers["rate"] == 15


@pytest.mark.parametrize(("real_time", "frames"), [(True, 4), (False, 1)])
def test_every_frame_is_answered_though_fewer_are_solved_and_a_replay_solves_all(
    real_time: bool, frames: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, update, solved, answered = unfilmed(filmed()), LagSmoother.update, list[int](), list[int]()

    def noted(smoother: LagSmoother, first: int | None = None) -> None:
        solved.append(smoother.numbers[-1])
        update(smoother, first)

    monkeypatch.setattr(LagSmoother, "update", noted)
    tracker = FixedLagTracker(stream_head(scene), SETTINGS, real_time=real_time)
    for sample in live_samples(scene):
        if sample.time > 2.6:
            break
        tracker.note_behind(LATE)
        answered += [one.frame for one in tracker.push(sample)]
    assert answered == list(range(answered[-1] + 1))
    assert set(np.diff(solved[-4:]).tolist()) == {frames}
