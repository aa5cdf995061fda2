"""Repetitions of clips with truth: counts beside those made by hand, heights of jumps beside the true motion's."""

from pathlib import Path

import pytest
from exercises import JUMP_M, exercises

import vip_factors as vip
from tests.studies.repetitions_study import RepetitionStudy, RepetitionTrial, trial
from tests.studies.study import markdown
from vip_factors.errors import InputError
from vip_factors.estimate import Estimate, WearerEstimate


def test_an_estimate_is_counted_beside_the_truth() -> None:
    motion = exercises(("jump", "jump"))
    scene = vip.simulate(motion, initial_pose="none")
    found = trial("jumps", Estimate.of_one(WearerEstimate("a", "SIP", motion, {})), {"jump": 3}, scene)
    assert (found.true, found.found) == ({"jump": 3}, {"jump": 2})
    assert len(found.flight_m) == len(found.rise_m) == 2
    assert all(ours == pytest.approx(true, abs=0.01) for ours, true in found.rise_m)
    for ours, true in found.flight_m:
        assert ours == pytest.approx(JUMP_M, abs=0.03)
        assert true == pytest.approx(JUMP_M, abs=0.03)


def test_tables_tell_what_is_wrong_and_how_high() -> None:
    rows = [
        RepetitionTrial("a walk", {}, {}, "good"), RepetitionTrial("a desk", {}, {"curl": 2}, "care"),
        RepetitionTrial("a jump", {"jump": 1}, {"jump": 1}, "good", ((0.32, 0.30),), ((0.35, 0.36),)),
    ]  # fmt: skip
    told = markdown(RepetitionStudy(data=Path()), rows)
    assert "| a desk | none | 2 curls | care |" in told
    assert "| a jump | 1 jump | 1 jump | good |" in told
    assert "| 1 others | none | none |" in told
    assert "| flight | 1 | 2.0 | 2.0 | 2.0 |" in told


def test_a_folder_without_any_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no recording"):
        list(RepetitionStudy(data=tmp_path).rows(lambda stage, fraction: None))
