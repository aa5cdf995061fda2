"""Named configurations: what they are made of, and that a command and a file can name them."""

from pathlib import Path

import numpy as np
import pytest

from vip_factors.cli.settings_file import read_settings
from vip_factors.configurations import Configuration, cauchy_of, named_settings
from vip_factors.errors import InputError
from vip_factors.settings import Settings


def test_the_papers_weights_become_sigmas_and_losses() -> None:
    sigma_o, weight, unit = np.deg2rad(4.0), 5e-3, 0.01
    sigma, loss = cauchy_of(weight, unit, sigma_o)
    error = np.array([0.001, 0.05, 2.0])
    theirs = weight * np.log1p((error / unit) ** 2)
    np.testing.assert_allclose(loss.cost(error / sigma), theirs / (4 * sigma_o**2), rtol=1e-9)


def test_each_leaves_out_what_its_name_says() -> None:
    used = {}
    for name in list(Configuration)[1:]:
        one = named_settings(name)
        used[name.value] = (one.fusion.use_camera, one.camera.ground_contact.use, one.camera.reprojection.biweight.use)
        assert not one.acceleration
        assert not one.calibration.estimate_headings
        assert not one.calibration.estimate_mountings
    assert used["kaichi-full"] == (True, True, True)
    assert used["kaichi-unweighted"] == (True, True, False)
    assert used["kaichi-no-contact"] == (True, False, True)
    assert not used["kaichi-imu"][0]
    assert named_settings("own") == Settings()


def test_a_settings_file_may_name_one_and_change_it(tmp_path: Path) -> None:
    path = tmp_path / "s.toml"
    path.write_text('configuration = "kaichi-full"\nframe_rate = 30\n')
    found = read_settings(path, Settings(), named_settings)
    assert found.frame_rate == 30
    assert found.factors == named_settings("kaichi-full").factors
    path.write_text('configuration = "kaichi"\n')
    with pytest.raises(InputError, match="configuration"):
        read_settings(path, Settings(), named_settings)
