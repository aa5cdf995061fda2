"""Estimates of a wearer or a scene come back from MCAP files as they were; what is no estimate is refused clearly."""

import re
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from mcap_samples import assert_same, calibration, copy_messages, estimates, motion, walk
from scene_samples import filmed_walk, scene_estimates

from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.cli.terminal import terminal_text
from vip_factors.describe.estimates import estimate_tables
from vip_factors.errors import FileFormatError, InputError
from vip_factors.estimate import Estimate, StartChoice, WearerEstimate
from vip_factors.findings import Finding, bare
from vip_factors.io.mcap_estimate import CAMERA, INFO, SCENE_HEAD, SCENE_INFO, WEARER, read_estimate, write_estimate
from vip_factors.io.mcap_messages import MessageWriter
from vip_factors.io.mcap_reader import McapWarning
from vip_factors.io.mcap_recording import read_scene, write_recording
from vip_factors.io.schemas.camera_estimate_pb2 import CameraEstimateInfo
from vip_factors.solve.levenberg_marquardt import SolveReport


def example(T: int = 60) -> WearerEstimate:
    rng = np.random.default_rng(5)
    sensors = ["head", "pelvis"]
    residuals = {"orientation_deg": rng.normal(size=(T, 2)), "acceleration_m_s2": rng.normal(size=(T, 2))}
    return WearerEstimate(
        "walk", "SIP", motion(rng, T), calibration(rng, sensors), residuals=residuals, sensors=tuple(sensors),
        reports=(SolveReport("fusion", (), {"orientation": 3.0}, {"orientation": 1.0}, True, 0.5),),
    )  # fmt: skip


@settings(max_examples=30, deadline=None)
@given(estimates())
def test_round_trip_is_lossless_and_silent(tmp_path_factory: pytest.TempPathFactory, estimate: WearerEstimate) -> None:
    path = tmp_path_factory.mktemp("mcap") / "e.mcap"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        write_estimate(Estimate.of_one(estimate), path)
        assert_same(estimate, read_estimate(path).wearer())


def test_viewers_get_transforms_that_chain_to_every_joint(tmp_path: Path) -> None:
    estimate = replace(example(), motion=replace(motion(np.random.default_rng(1), 8), rate=60.0))
    write_estimate(Estimate.of_one(replace(estimate, residuals={})), tmp_path / "e.mcap")
    with open(tmp_path / "e.mcap", "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        frames = [m for *_, m in reader.iter_decoded_messages("/estimate/tf")]
    assert len(frames) == 4  # thinned to 30 Hz
    for shown, expected in zip(frames, estimate.motion.state.p_world_joint[::2], strict=True):
        for joint, name in enumerate(JOINT_NAMES):
            np.testing.assert_allclose(position(shown, f"me/{name}"), expected[joint], atol=1e-9)


def position(message, frame: str) -> np.ndarray:
    """Origin of a frame in the world, by the rotation formula of a quaternion itself."""
    by_child = {transform.child_frame_id: transform for transform in message.transforms}
    p = np.zeros(3)
    while frame != "world":
        one = by_child[frame]
        v = np.array([one.rotation.x, one.rotation.y, one.rotation.z])
        p = p + 2 * np.cross(v, np.cross(v, p) + one.rotation.w * p)
        p = p + np.array([one.translation.x, one.translation.y, one.translation.z])
        frame = one.parent_frame_id
    return p


@pytest.mark.parametrize("share", [0.6])
def test_of_a_cut_estimate_the_first_frames_are_read(tmp_path: Path, share: float) -> None:
    path, estimate = tmp_path / "e.mcap", example(600)
    write_estimate(Estimate.of_one(estimate), path)
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    with pytest.warns(McapWarning, match="frames are left"):
        read = read_estimate(path).wearer()
    T = len(read.motion)
    assert 0.8 * share * 600 < T < 600
    np.testing.assert_array_equal(read.motion.p_world_pelvis, estimate.motion.p_world_pelvis[:T])
    assert_same(estimate.reports, read.reports)
    assert_same(estimate.calibration, read.calibration, "calibration")
    expected = estimate.residuals["orientation_deg"][: T - 1]  # of the last frame only the pose may be left
    np.testing.assert_array_equal(read.residuals["orientation_deg"][: T - 1], expected)


def test_a_recording_is_no_estimate_and_the_other_way_round(tmp_path: Path) -> None:
    write_recording(walk(5), tmp_path / "r.mcap")
    write_estimate(Estimate.of_one(example(3)), tmp_path / "e.mcap")
    with pytest.raises(FileFormatError, match="is a recording: expected an estimate"):
        read_estimate(tmp_path / "r.mcap")
    with pytest.raises(FileFormatError, match="is an estimate: expected a recording"):
        read_scene(tmp_path / "e.mcap")


@pytest.mark.parametrize("margin", [1.5, np.inf])
def test_findings_and_the_choice_of_the_start_come_back(tmp_path: Path, margin: float) -> None:
    choice = StartChoice("sensors sit as placed", "frames agree" if margin < 2 else "", margin, ("head",))
    estimate = replace(
        example(), findings=(bare("one thing"), Finding("leap", "Ada", words={"times": "2.00"})), start=choice
    )
    write_estimate(Estimate.of_one(estimate), tmp_path / "e.mcap")
    read = read_estimate(tmp_path / "e.mcap").wearer()
    assert_same(replace(estimate, findings=()), replace(read, findings=()))
    assert [(finding.kind, str(finding)) for finding in read.findings] == [
        (finding.kind, str(finding)) for finding in estimate.findings
    ]
    assert [finding.kind for finding in read.findings] == ["text", "leap"]
    told = terminal_text(estimate_tables(Estimate.of_one(read)))
    assert re.search("  doubt: +wearer 'Ada': jumps in the image", told)
    assert re.search("  start: +sensors sit as placed", told)
    assert ("4.5 times less likely" in told) == (margin < 2)


@settings(max_examples=40, deadline=None)
@given(scene_estimates())
def test_the_round_trip_of_a_scene_is_lossless_and_silent(
    tmp_path_factory: pytest.TempPathFactory, estimate: Estimate
) -> None:
    path = tmp_path_factory.mktemp("mcap") / "e.mcap"
    write_estimate(estimate, path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert_same(estimate, read_estimate(path))
        if len(estimate.wearers) == 1:
            assert_same(estimate.wearers[0], read_estimate(path).wearer())


@settings(max_examples=10, deadline=None)
@given(scene_estimates())
def test_an_estimate_in_the_file_of_its_scene(tmp_path_factory: pytest.TempPathFactory, estimate: Estimate) -> None:
    folder = tmp_path_factory.mktemp("mcap")
    scene, parts = filmed_walk(4), (folder / "scene.mcap", folder / "estimate.mcap")
    write_recording(scene, parts[0])
    write_estimate(estimate, parts[1], start_ns=scene.start_ns)
    with (folder / "both.mcap").open("wb") as file, MessageWriter(file) as writer:
        for path in parts:
            copy_messages(path, writer._writer)
    assert_same(scene.wearers[0], read_scene(folder / "both.mcap").wearers[0])
    assert_same(estimate, read_estimate(folder / "both.mcap"))


def sample(T: int = 30, wearers: int = 2) -> Estimate:
    from mcap_samples import motion
    from scene_samples import MODEL, camera_path

    from vip_factors.estimate import CameraEstimate

    rng = np.random.default_rng(0)
    people = tuple(
        WearerEstimate("walk", "VIP", replace(motion(rng, T), rate=30.0, start=0.0), {}) for _ in range(wearers)
    )
    path = replace(camera_path(rng, T), time=np.arange(T) / 30)
    return Estimate("walk", "VIP", people, (CameraEstimate("phone", MODEL, path, residual_px=np.ones((T, wearers))),))


@pytest.mark.parametrize("labels", [[0, -1, 1], [-1, -1]])
def test_labels_of_the_scene_in_older_files_are_those_of_the_first_camera(tmp_path: Path, labels: list[int]) -> None:
    estimate = sample()
    estimate = replace(estimate, cameras=(estimate.camera, replace(estimate.camera, name="left")))
    write_estimate(estimate, tmp_path / "e.mcap")
    topics = [f"{WEARER}{number}" for number in range(2)]
    message = SCENE_HEAD.encode(estimate, wearer_topics=topics, start_ns=0, wearer_of_detection=labels)
    with (tmp_path / "old.mcap").open("wb") as file, MessageWriter(file) as writer:
        copy_messages(tmp_path / "e.mcap", writer._writer, without=(SCENE_INFO,))
        writer.write(SCENE_INFO, message, 0)
    first, second = read_estimate(tmp_path / "old.mcap").cameras
    assert first.wearer_of_detection.tolist() == (labels if max(labels) >= 0 else [])
    assert second.wearer_of_detection.size == 0


def test_an_estimate_of_nobody_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no wearer"):
        write_estimate(Estimate("walk", "VIP", ()), tmp_path / "e.mcap")


@pytest.mark.parametrize("share", [0.5])
def test_of_a_cut_estimate_of_a_scene_the_first_frames_are_read(tmp_path: Path, share: float) -> None:
    whole = sample(200, 1)
    write_estimate(whole, tmp_path / "e.mcap")
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


def test_more_reprojection_errors_than_there_can_be_are_not_made_room_for(tmp_path: Path) -> None:
    write_estimate(sample(), tmp_path / "whole.mcap")
    with (tmp_path / "e.mcap").open("wb") as file, MessageWriter(file) as writer:
        copy_messages(tmp_path / "whole.mcap", writer._writer)
        info = CameraEstimateInfo(name="phone", has_residuals=True, wearers=2, residual_frames=10**9)
        writer.write(CAMERA + INFO, info, 0)
    with pytest.raises(FileFormatError, match=r"e\.mcap: reprojection errors in \d+ frames of \d wearers"):
        read_estimate(tmp_path / "e.mcap")
