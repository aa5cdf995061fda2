"""How many frames are solved while samples wait, on machines that have time for all of them, or not."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tracked import SETTINGS, filmed, unfilmed

from vip_factors.findings import Finding
from vip_factors.live.smoother import LagSmoother
from vip_factors.live.tracker import FixedLagTracker, SolvePace
from vip_factors.sensors.live import live_samples, stream_head

RATE = 60
FRAME_S = 1 / RATE


@dataclass(frozen=True)
class Machine:
    """Seconds that a frame takes that is solved, and one that is predicted; ``busy(time)`` times as long."""

    solved_s: float
    predicted_s: float
    busy: Callable[[float], float] = lambda time: 1.0
    begins_s: float = 0.0  # when the first frame is begun
    stalls: Callable[[float], float] = lambda time: 0.0  # seconds that it stands still, when a frame is begun

    def run(self, seconds: float, usual: int = 1) -> tuple[np.ndarray, np.ndarray, list[Finding]]:
        """Of each frame the age of its answer and whether it was solved; and what was told."""
        pace, free, unsolved, ages, solved, told = SolvePace(usual, RATE), self.begins_s, 0, [], [], []
        for time in FRAME_S * np.arange(round(seconds * RATE)):
            begin = max(free, time)
            told += pace.step(time, begin - time, not solved or solved[-1])
            unsolved += 1
            solved.append(unsolved >= pace.solve_every)
            unsolved = 0 if solved[-1] else unsolved
            took = self.solved_s if solved[-1] else self.predicted_s
            free = begin + took * self.busy(begin) + self.stalls(begin)
            ages.append(free - time)
        return np.array(ages), np.array(solved), told


def kinds(told: list[Finding]) -> list[str]:
    return [one.kind for one in told]


@given(load=st.floats(0.01, 0.8), share=st.floats(0.02, 1.0), begins_s=st.floats(0.0, 2.0))
def test_answers_are_in_time_wherever_ten_updates_a_second_and_their_predictions_fit(
    load: float, share: float, begins_s: float
) -> None:
    solved_s = load * FRAME_S * SolvePace.WIDEST / (1 + (SolvePace.WIDEST - 1) * share)
    ages, solved, _ = Machine(solved_s, share * solved_s, begins_s=begins_s).run(20.0)
    assert ages[round(12.0 * RATE) :].max() < 0.25
    assert np.diff(np.flatnonzero(solved)).max() <= SolvePace.WIDEST


def test_all_frames_are_solved_where_there_is_time_for_all() -> None:
    ages, solved, told = Machine(0.9 * FRAME_S, 0.3 * FRAME_S).run(20.0)
    assert solved.all()
    assert not told
    assert ages.max() < FRAME_S


def test_a_machine_that_is_busy_for_a_while_solves_what_it_can_and_all_again_behind_that() -> None:
    ages, solved, told = Machine(0.7 * FRAME_S, 0.2 * FRAME_S, lambda time: 2.0 if 5 <= time < 20 else 1.0).run(30.0)
    assert ages.max() < 0.1
    busy = solved[7 * RATE : 20 * RATE]
    assert 0.5 < busy.mean() < 0.7  # 0.6 of them fill the time: 1.4 for each, and 0.4 for the others
    assert solved[21 * RATE :].all()
    assert kinds(told) == ["fewer frames solved"]
    assert 5 < told[0].numbers["begin"] < 8


def test_a_hiccup_is_caught_up_with_and_no_word_is_lost() -> None:
    def stalls(time: float) -> float:
        return 0.2 if 10.0 <= time < 10.0 + FRAME_S else 0.0

    ages, solved, told = Machine(0.5 * FRAME_S, 0.2 * FRAME_S, stalls=stalls).run(20.0)
    assert not told
    assert ages[round(10.5 * RATE) :].max() < 2 * FRAME_S
    assert not solved.all()


def test_a_start_that_is_late_is_made_up_for_without_a_word() -> None:
    ages, _, told = Machine(0.5 * FRAME_S, 0.2 * FRAME_S, begins_s=1.5).run(20.0)
    assert not told
    assert ages[3 * RATE :].max() < 2 * FRAME_S


def test_a_tracker_that_is_never_in_time_says_so() -> None:
    _, _, told = Machine(2.5 * FRAME_S, 1.2 * FRAME_S, begins_s=1.0).run(20.0)
    assert kinds(told) == ["fewer frames solved"]
    assert told[0].numbers["rate"] == pytest.approx(RATE / SolvePace.WIDEST, abs=1)


@pytest.mark.parametrize(("real_time", "frames"), [(True, 6), (False, 1)])
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
        tracker.note_behind(0.2)
        answered += [answer.frame for answer in tracker.push(sample)]
    assert answered == list(range(answered[-1] + 1))
    assert set(np.diff(solved[-3:]).tolist()) == {frames}
