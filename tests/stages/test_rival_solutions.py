"""A solution that ended far from where it began is compared with one that began with that held; both may stand."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from vip_factors.findings import Finding, sentences
from vip_factors.geometry.rotations import exp
from vip_factors.settings import Settings
from vip_factors.stages import fusion
from vip_factors.stages.fusion import FusionSolution


def solution(turn_deg: float) -> FusionSolution:
    """Of two sensors, the second of which is turned."""
    R = np.stack([np.eye(3), exp(np.deg2rad([0.0, turn_deg, 0.0]))])
    model = SimpleNamespace(name="anna", frames=SimpleNamespace(sensors=("pelvis", "thigh")))
    wearers: Any = SimpleNamespace(wearers=[model]), SimpleNamespace(wearers=[SimpleNamespace(R_bone_sensor=R)])
    return FusionSolution(*wearers, ())


def reconsidered(monkeypatch: pytest.MonkeyPatch, costs: dict[float, float]) -> tuple[float, tuple[Finding, ...]]:
    """By how much the kept solution turns the sensor, and what is told, given both solutions' costs by their turn."""
    turns = list(costs)
    far, near = map(solution, turns)
    held = SimpleNamespace(mounting_sigma=None, free_hinges=True)
    initial: Any = SimpleNamespace(wearers=[SimpleNamespace(model=held)])
    monkeypatch.setattr(fusion, "_with_unlikely_fixed", lambda model, state: held)
    monkeypatch.setattr(fusion, "fuse", lambda *arguments: near)
    of = dict(zip(map(id, (far, near)), costs.values(), strict=True))
    monkeypatch.setattr(fusion, "_cost", lambda one, other: of[id(one)])
    monkeypatch.setattr(fusion, "replace", _with)
    best = fusion._reconsidered(initial, far, (), Settings(), SimpleNamespace())  # type: ignore[arg-type]
    return (turns[0] if best.state is far.state else turns[1]), best.findings


def _with(one: Any, /, **changes: Any) -> Any:
    if isinstance(one, FusionSolution):
        return FusionSolution(one.model, one.state, one.spreads, changes["findings"])
    return SimpleNamespace(**{**vars(one), **changes})


@pytest.mark.parametrize(("costs", "kept"), [({90.0: 100.0, 0.0: 150.0}, 90.0), ({90.0: 150.0, 0.0: 100.0}, 0.0)])
def test_the_likelier_of_two_is_kept_without_a_word(
    monkeypatch: pytest.MonkeyPatch, costs: dict[float, float], kept: float
) -> None:
    assert reconsidered(monkeypatch, costs) == (kept, ())


def test_two_that_both_stand_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    kept, findings = reconsidered(monkeypatch, {90.0: 101.0, 0.0: 100.0})
    assert kept == 0.0
    (told,) = sentences(findings)
    assert "'anna'" in told
    assert "thigh by 90°" in told
    assert "2.7 times" in told
    assert "pelvis" not in told
