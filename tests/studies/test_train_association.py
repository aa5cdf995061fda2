"""Weights of the association, learnt from labelled scenes."""

from pathlib import Path

import numpy as np
import pytest
from associate.association_samples import MODEL, scene

from tests.studies.association_scenes import LabelledScene
from tests.studies.train_association import fit_logistic, save_weights, train_association
from vip_factors.associate.associate import associate
from vip_factors.associate.weights import FEATURES, load_weights
from vip_factors.errors import InputError
from vip_factors.settings import AssociationSettings


def test_logistic_regression_finds_the_weights_that_made_the_labels() -> None:
    random = np.random.default_rng(0)
    x = random.standard_normal((20000, 3)) * [1.0, 10.0, 0.1]
    odds = x @ [1.5, -0.1, 0.0] + 0.5
    fit = fit_logistic(x, random.random(len(x)) < 1 / (1 + np.exp(-odds)))
    np.testing.assert_allclose(fit.weights * [1.0, 10.0, 0.1], [1.5, -1.0, 0.0], atol=0.08)
    assert fit.bias == pytest.approx(0.5, abs=0.08)


def test_training_without_wrong_examples_says_what_is_missing() -> None:
    with pytest.raises(InputError, match="bystanders"):
        fit_logistic(np.ones((3, 1)), np.ones(3, bool))


def test_shipped_weights_say_where_they_come_from_and_survive_a_file(tmp_path: Path) -> None:
    shipped = load_weights()
    assert "scenes" in shipped.provenance
    save_weights(shipped, tmp_path / "weights.json")
    again = load_weights(tmp_path / "weights.json")
    for name in FEATURES:
        np.testing.assert_allclose(again.logistic[name].weights, shipped.logistic[name].weights)


@pytest.fixture(scope="module")
def examples() -> list[LabelledScene]:
    apart, common = scene(seconds=2.0, seed=1), scene(seconds=2.0, seed=2, common_world=True)
    return [
        LabelledScene(apart.detections, MODEL, apart.motions, apart.wearer),
        LabelledScene(common.detections, MODEL, common.motions, common.wearer, common.camera),
    ]


def test_trained_weights_find_the_wearers_of_another_scene(examples: list[LabelledScene], tmp_path) -> None:
    weights = train_association(examples, "two small scenes")
    save_weights(weights, tmp_path / "weights.json")
    other = scene(seconds=2.0, seed=3)
    settings = AssociationSettings(weights=tmp_path / "weights.json", least_confidence=0.5)
    found = associate(other.detections, MODEL, other.motions, settings)
    given = found.wearer >= 0
    assert np.mean(found.wearer[given] == other.wearer[given]) > 0.98
    assert np.mean(found.wearer[other.wearer >= 0] >= 0) > 0.9


def test_scenes_of_both_passes_are_asked_for(examples: list[LabelledScene]) -> None:
    with pytest.raises(InputError, match="with a camera path"):
        train_association(examples[:1], "one pass only")
