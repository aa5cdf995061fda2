"""AMASS files that we write are read as the motion that they are of."""

from pathlib import Path

import numpy as np
import pytest

from vip_factors.errors import InputError
from vip_factors.estimate import Estimate, SceneEstimate
from vip_factors.io.export.files import export
from vip_factors.io.motions.amass import BODY_JOINTS, read_amass
from vip_factors.simulate.gestures import gestures


def _scene(*names: str) -> SceneEstimate:
    motion = gestures(seconds=0.5)
    return SceneEstimate("walk", "VIP", tuple(Estimate(name, "VIP", motion, {}) for name in names))


def test_poses_and_root_come_back(tmp_path: Path) -> None:
    scene = _scene("Ada")
    motion = scene.wearers[0].motion
    (written,) = export(scene, tmp_path / "walk.npz")
    found = read_amass(written)
    body = slice(0, BODY_JOINTS)
    assert np.allclose(found.R_parent_child[:, body], motion.R_parent_child[:, body], atol=1e-9)
    assert np.allclose(found.p_world_pelvis, motion.p_world_pelvis, atol=1e-9)
    assert found.rate == motion.rate


def test_each_wearer_gets_a_file(tmp_path: Path) -> None:
    written = export(_scene("Ada", "Bea"), tmp_path / "walk.npz")
    assert [path.name for path in written] == ["walk.Ada.npz", "walk.Bea.npz"]
    assert all(path.exists() for path in written)


def test_an_unknown_suffix_names_those_that_are_known(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"\.npz"):
        export(_scene("Ada"), tmp_path / "walk.doc")
