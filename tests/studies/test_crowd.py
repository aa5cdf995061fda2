"""Scenes of several people: association and relative places, on tiny scenes."""

from pathlib import Path

import numpy as np
import pytest

from tests.studies.crowd import (
    AssociationTrial,
    Crowd,
    Wearers,
    WearersTrial,
    WhoIsWho,
    first_association,
    pooled,
    wearers_trial,
)
from tests.studies.study import markdown
from vip_factors.errors import InputError
from vip_factors.evaluate.scene_metrics import association_score
from vip_factors.sensors.scene import Scene
from vip_factors.settings import FusionSettings, Settings
from vip_factors.simulate.gestures import gestures
from vip_factors.solve.levenberg_marquardt import SolveSettings

SETTINGS = Settings(
    frame_rate=15.0, calibration_rate=7.5, solve=SolveSettings(max_iterations=2), fusion=FusionSettings(rounds=1)
)
QUICK = Crowd(motions=Path(), seconds=2.0, bystanders=4, placement="sip6", settings=SETTINGS)
CLIPS = {f"clip{seed}": gestures(4.0 + seed) for seed in range(3)}


@pytest.fixture(scope="module")
def scene() -> Scene:
    return QUICK.scene(CLIPS, "fixed", 1)


def test_a_crowd_has_wearers_and_strangers(scene: Scene) -> None:
    assert [wearer.subject.name for wearer in scene.wearers] == ["wearer1", "wearer2"]
    assert {-1, 0, 1} <= set(scene.truth.wearer)
    assert scene.wearers[0].initial_pose == "t-pose"
    np.testing.assert_array_equal(QUICK.scene(CLIPS, "fixed", 1).truth.wearer, scene.truth.wearer)


def test_association_from_the_inertial_tracker(scene: Scene) -> None:
    trial = first_association(scene, SETTINGS, 1, "fixed")
    assert trial.frames == 121
    assert trial.score.true > 0
    assert trial.seconds > 0
    assert "| 99.3 | 92.2 |" in markdown(WhoIsWho(motions=Path()), [trial])
    with pytest.raises(InputError, match="lacks a camera"):
        first_association(Scene("blind", scene.wearers), SETTINGS)


def test_scores_are_pooled_over_labels_not_over_scenes() -> None:
    few = association_score(np.array([0]), np.array([1]))
    many = association_score(np.zeros(9, int), np.zeros(9, int))
    trials = [AssociationTrial(0, "", 1, 1, "x", 1.0, score, 0.0, 0.0) for score in (few, many)]
    assert pooled(trials) == pytest.approx((90.0, 90.0))


def test_relative_places_of_two_wearers(scene: Scene) -> None:
    trial = wearers_trial(scene, SETTINGS, "fixed", 1)
    assert not trial.failure
    assert trial.pairs["wearer1 - wearer2"]["relative_mm"] < 3000
    told = markdown(Wearers(motions=Path()), [trial, WearersTrial("fixed", 2, {}, {}, 1.0, failure="nobody is there")])
    assert "**fixed, mean**" in told
    assert "seed 2: not solved: nobody is there" in told
