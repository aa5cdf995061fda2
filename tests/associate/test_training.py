import numpy as np
import pytest
from association_samples import MODEL, scene

from tests.studies.association_scenes import LabelledScene
from tests.studies.train_association import save_weights, train_association
from vip_factors.associate.associate import associate
from vip_factors.associate.settings import AssociationSettings
from vip_factors.errors import InputError


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
