"""Frames count by the time that they stand for: more of them say no more, and what is far off is forgiven as before."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from small_problems import small_scene

from vip_factors.assembly.objective import SceneObjective
from vip_factors.factor_settings import Loss, RobustLoss
from vip_factors.terms.equations import robust_cost, robust_weight


@given(loss=st.sampled_from(Loss), share=st.floats(1e-3, 1.0), norm=st.floats(0.0, 50.0))
def test_a_tempered_loss_is_a_share_of_the_loss(loss: Loss, share: float, norm: float) -> None:
    whole = RobustLoss(loss, 2.0)
    part, norms = whole.tempered(share), np.array(norm)
    shares = np.sqrt(share) * norms
    assert robust_cost(part, shares) == pytest.approx(share * robust_cost(whole, norms), abs=1e-12)
    assert robust_weight(part, shares) == pytest.approx(robust_weight(whole, norms), rel=1e-9)


@pytest.mark.parametrize("rate", [20.0, 30.0, 60.0])
def test_a_second_says_as_much_at_any_rate(rate: float) -> None:
    problem = small_scene("moving")[0].wearers[0]
    frames = replace(problem.frames, period=1 / rate)
    settings = replace(problem.settings, correlation_s=0.4)
    share = replace(problem, frames=frames, settings=settings).frame_share
    assert rate * share == pytest.approx(1 / 0.4)


def test_longer_correlations_scale_what_frames_say_and_no_prior() -> None:
    problem, state = small_scene("moving")
    step = problem.step

    def costs(correlation_s: float) -> dict[str, float]:
        wearers = tuple(
            replace(wearer, settings=replace(wearer.settings, correlation_s=correlation_s))
            for wearer in problem.wearers
        )
        settings = replace(problem.cameras[0].settings, correlation_s=correlation_s)
        camera = replace(problem.cameras[0], settings=settings)
        return dict(SceneObjective(replace(problem, wearers=wearers, cameras=(camera,))).cost(state))

    once, shared = costs(step), costs(4 * step)
    for kind, cost in shared.items():
        every_frame = kind not in (
            "initial pose",
            "pose mean",
            "gauge prior",
            "agreeing headings",
            "heading walk",
            "camera odometry",
        )
        every_frame &= not kind.endswith("prior") or kind == "pose prior"
        assert cost == pytest.approx(once[kind] / (4 if every_frame else 1)), kind
