import numpy as np
import pytest

from vip_factors.associate import assignment
from vip_factors.associate.assignment import AssignmentProblem, solve, solve_in_windows


def problem(
    seed: int, frames: int, people: int, wearers: int, spread: float = 0.7, reach: int = 99, share: float = 0.6
) -> AssignmentProblem:
    """Random costs; edges of random pairs of one wearer, or of two wearers in a frame."""
    random = np.random.default_rng(seed)
    frame, wearer, detection = np.array(
        [(f, w, f * people + d) for f in range(frames) for w in range(wearers) for d in range(people)]
    ).T
    i, j = np.triu_indices(len(frame), 1)
    near = (frame[i] != frame[j]) & (wearer[i] == wearer[j]) & (np.abs(frame[i] - frame[j]) <= reach)
    beside = (frame[i] == frame[j]) & (wearer[i] != wearer[j]) & (detection[i] != detection[j])
    kept = (near | beside) & (random.random(len(i)) < share)
    edges = np.stack([i[kept], j[kept]], axis=1)
    return AssignmentProblem(
        frame, wearer, detection, random.normal(0, 1, len(frame)), edges, random.normal(0, spread, len(edges))
    )


def allowed(one: AssignmentProblem, chosen: np.ndarray) -> bool:
    by_wearer = one.frame * 10 + one.wearer
    return all(len(np.unique(key[chosen])) == chosen.sum() for key in (by_wearer, one.detection))


def best_of_all(one: AssignmentProblem) -> float:
    H = len(one.cost)
    choices = ((np.arange(1 << H)[:, None] >> np.arange(H)) & 1).astype(bool)
    return min(one.value(chosen) for chosen in choices if allowed(one, chosen))


@pytest.mark.parametrize("looks", [0, assignment.LOOKS], ids=["by HiGHS", "by a bound"])
@pytest.mark.parametrize("seed", range(8))
def test_small_programmes_are_solved_as_trying_all_choices_would(
    seed: int, looks: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(assignment, "LOOKS", looks)
    one = problem(seed, frames=3, people=2, wearers=2)
    chosen = solve(one)
    assert allowed(one, chosen)
    assert one.value(chosen) == pytest.approx(best_of_all(one))


@pytest.mark.parametrize("seed", range(3))
def test_one_window_over_everything_is_the_full_programme(seed: int) -> None:
    one = problem(seed, frames=8, people=3, wearers=2, reach=3)
    assert one.value(solve_in_windows(one, 8, 2)) == pytest.approx(one.value(solve(one)))


@pytest.mark.parametrize("seed", range(3))
def test_windows_come_to_what_the_full_programme_finds(seed: int) -> None:
    one = problem(seed, frames=30, people=2, wearers=2, spread=0.2, reach=3, share=0.8)
    full, windows = solve(one), solve_in_windows(one, 16, 8)
    assert allowed(one, windows)
    assert one.value(windows) == pytest.approx(one.value(full))


@pytest.mark.parametrize("seed", range(4))
def test_three_wearers_are_told_apart_without_highs(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    one = problem(seed, frames=12, people=4, wearers=3, spread=0.05, reach=3)
    monkeypatch.setattr(assignment, "LOOKS", 0)
    by_highs = solve(one)
    monkeypatch.undo()
    monkeypatch.delattr(assignment, "milp")
    np.testing.assert_array_equal(solve(one), by_highs)


def test_unconnected_frames_are_decided_each_on_its_own() -> None:
    one = problem(0, frames=50, people=4, wearers=1, share=0.0)
    chosen = solve(one)
    least = one.cost.reshape(50, 4).min(axis=1)
    assert one.value(chosen) == pytest.approx(np.minimum(least, 0).sum())


def test_nothing_to_choose_from() -> None:
    empty = np.zeros(0, int)
    one = AssignmentProblem(empty, empty, empty, np.zeros(0), np.zeros((0, 2), int), np.zeros(0))
    assert solve(one).shape == solve_in_windows(one, 10, 3).shape == (0,)


def test_progress_ends_at_one() -> None:
    told: list[float] = []
    solve_in_windows(problem(0, frames=30, people=2, wearers=1, reach=2), 10, 3, told.append)
    assert told == sorted(told)
    assert told[-1] == 1.0
