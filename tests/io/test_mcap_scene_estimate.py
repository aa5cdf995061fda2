"""Estimates of scenes come back from MCAP files as they were; one wearer's is a plain estimate too."""

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from mcap_samples import assert_same, estimates
from scene_samples import filmed_walk, scene_estimates

from vip_factors.errors import FileFormatError, InputError
from vip_factors.estimate import Estimate, WearerEstimate
from vip_factors.io.mcap_estimate import CAMERA_POSE, read_estimate
from vip_factors.io.mcap_estimate_writer import write_estimate
from vip_factors.io.mcap_reader import McapWarning, read_contents
from vip_factors.io.mcap_recording import read_scene, write_scene
from vip_factors.io.mcap_writer import MessageWriter


@settings(max_examples=40, deadline=None)
@given(scene_estimates())
def test_round_trip_is_lossless_and_silent(tmp_path_factory: pytest.TempPathFactory, estimate: Estimate) -> None:
    path = tmp_path_factory.mktemp("mcap") / "e.mcap"
    write_estimate(estimate, path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert_same(estimate, read_estimate(path))
        if len(estimate.wearers) == 1:
            assert_same(estimate.wearers[0], read_estimate(path).only_wearer)


@settings(max_examples=10, deadline=None)
@given(estimates())
def test_a_plain_estimate_is_that_of_a_scene_with_one_wearer(
    tmp_path_factory: pytest.TempPathFactory, estimate: WearerEstimate
) -> None:
    path = tmp_path_factory.mktemp("mcap") / "e.mcap"
    write_estimate(Estimate.of_one(estimate), path)
    assert_same(Estimate.of_one(estimate), read_estimate(path))


@settings(max_examples=10, deadline=None)
@given(scene_estimates())
def test_an_estimate_in_the_file_of_its_scene(tmp_path_factory: pytest.TempPathFactory, estimate: Estimate) -> None:
    folder = tmp_path_factory.mktemp("mcap")
    write_scene(filmed_walk(4), folder / "s.mcap")
    for _ in range(2):  # the second in place of the first
        write_estimate(estimate, folder / "s.mcap", overwrite=True, append_to=folder / "s.mcap")
    assert_same(filmed_walk(4).wearers[0], read_scene(folder / "s.mcap").wearers[0])
    assert_same(estimate, read_estimate(folder / "s.mcap"))
    contents = read_contents(folder / "s.mcap")
    assert contents.last_log_time is not None
    assert contents.last_log_time > filmed_walk(4).wearers[0].start_ns - 10**10, "on the recording's clock"


def sample(T: int = 30, wearers: int = 2) -> Estimate:
    from mcap_samples import motion
    from scene_samples import MODEL, camera_path

    from vip_factors.estimate import CameraEstimate

    rng = np.random.default_rng(0)
    people = tuple(
        WearerEstimate("walk", "VIP", replace(motion(rng, T), rate=30.0, start=0.0), {}) for _ in range(wearers)
    )
    path = replace(camera_path(rng, T), time=np.arange(T) / 30)
    return Estimate("walk", "VIP", people, CameraEstimate("phone", MODEL, path, residual_px=np.ones((T, wearers))))


def test_several_wearers_are_no_plain_estimate(tmp_path: Path) -> None:
    write_estimate(sample(), tmp_path / "e.mcap")
    with pytest.raises(InputError, match=r"has 2 wearers.*expected one"):
        assert read_estimate(tmp_path / "e.mcap").only_wearer


def test_an_estimate_of_nobody_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no wearer"):
        write_estimate(Estimate("walk", "VIP", ()), tmp_path / "e.mcap")


@pytest.mark.parametrize("share", [0.2, 0.5, 0.8])
def test_of_a_cut_estimate_the_first_frames_are_read(tmp_path: Path, share: float) -> None:
    whole = sample(200, 1)
    write_estimate(whole, tmp_path / "e.mcap", scene=False)
    data = (tmp_path / "e.mcap").read_bytes()
    (tmp_path / "e.mcap").write_bytes(data[: int(share * len(data))])
    with pytest.warns(McapWarning, match="of 200 poses are left"):
        read = read_estimate(tmp_path / "e.mcap")
    assert read.camera is not None
    assert whole.camera is not None
    frames = len(read.camera.path)
    assert 0 < frames < 200
    assert abs(frames - len(read.wearers[0].motion)) <= 1
    np.testing.assert_array_equal(read.camera.path.time, whole.camera.path.time[:frames])
    assert read.camera.residual_px is not None
    assert np.isnan(read.camera.residual_px[frames + 1 :]).all()


def test_a_camera_without_poses_is_left_out(tmp_path: Path) -> None:
    write_estimate(sample(), tmp_path / "whole.mcap")
    with open(tmp_path / "e.mcap", "wb") as file, MessageWriter(file) as writer:
        writer.copy(read_contents(tmp_path / "whole.mcap"), (CAMERA_POSE,))
    with pytest.warns(McapWarning, match=f"camera 'phone' is left out: nothing on {CAMERA_POSE}"):
        assert read_estimate(tmp_path / "e.mcap").camera is None


def test_more_reprojection_errors_than_there_can_be_are_not_made_room_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_estimate(sample(), tmp_path / "e.mcap")
    monkeypatch.setattr("vip_factors.io.mcap_frames.MOST_RESIDUALS", 3)
    with pytest.raises(FileFormatError, match=r"e\.mcap: tells of reprojection errors in \d+ frames of \d wearers"):
        read_estimate(tmp_path / "e.mcap")
