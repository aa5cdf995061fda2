"""Long scenes with a camera: windows against the whole, worlds joined, who is who, gaps, and memory."""

import gc
import pickle
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from filmed_gestures import FROM_STRAPS, camera_of, filmed_gestures, without_detections
from scene_sample import estimate_of, scene_sample

from vip_factors.cli.main import main
from vip_factors.display import silent
from vip_factors.estimate import CameraEstimate, Estimate, PoseCovariance
from vip_factors.findings import sentences
from vip_factors.geometry.rotations import angle_between, rotation_z
from vip_factors.io.mcap_estimate import read_estimate
from vip_factors.io.mcap_recording import write_recording
from vip_factors.pipeline import smooth, smooth_chunks
from vip_factors.problem.scene import SceneProblem
from vip_factors.sensors.camera import CameraPath
from vip_factors.sensors.scene import Scene
from vip_factors.sensors.sources import SceneInMemory
from vip_factors.settings import FusionSettings, SolveSettings, WindowSettings
from vip_factors.stages.window_join import Headings, SolvedWindow, chunks_of, moved
from vip_factors.stages.windows import WindowPlan

HASTY = replace(
    FROM_STRAPS,
    frame_rate=10.0,
    fusion=FusionSettings(rounds=1, refits=0),
    solve=SolveSettings(max_iterations=3),
    windows=WindowSettings(
        above_s=2.0, window_s=2.4, overlap_s=1.0, calibration_stretches=1, calibration_stretch_s=3.0
    ),
)
# The same, and half as many frames.
OPTIONS = (
    "--frame-rate", "5", "--no-covariance", "--assignment.no-check", "--calibration.start.no-search",
    "--fusion.rounds", "1", "--fusion.refits", "0", "--solve.max-iterations", "3",
    "--windows.above-s", "2", "--windows.window-s", "2.4", "--windows.overlap-s", "1",
    "--windows.calibration-stretches", "1", "--windows.calibration-stretch-s", "3",
)  # fmt: skip


def test_windows_are_as_the_whole() -> None:
    """The same frames, wearers and detections, and a motion that is as near to the truth."""
    scene = at_10_hz(filmed_gestures("fixed", seconds=4.5))
    settings = replace(HASTY, covariance=True, windows=replace(HASTY.windows, calibration_stretch_s=9.0))
    whole = smooth(scene, replace(settings, windows=replace(HASTY.windows, use=False)))
    chunks = smooth_chunks(SceneInMemory(scene), settings, map_fn=sent)
    estimate = replace(chunks, chunks=watched(chunks.chunks)).whole()
    here = smooth(scene, settings)
    np.testing.assert_array_equal(estimate.wearers[0].motion.p_world_pelvis, here.wearers[0].motion.p_world_pelvis)
    assert [report.stage for report in estimate.reports if report.stage.startswith("video")] == [
        "video-inertial fusion", *(f"video-inertial fusion, window {number}" for number in (1, 2, 3))
    ]  # fmt: skip
    (one,), (other,) = estimate.wearers, whole.wearers
    assert (len(one.motion), one.motion.start, one.motion.rate) == (
        len(other.motion), pytest.approx(other.motion.start), pytest.approx(other.motion.rate)
    )  # fmt: skip
    errors = [np.median(root_relative(each, scene)) for each in (estimate, whole)]
    assert errors[0] < 1.2 * errors[1]
    assert_nothing_leaps(estimate)
    ratio = one.covariance.joint_sigma / other.covariance.joint_sigma
    assert 0.7 < np.median(ratio) < 1.1
    assert scene.camera.truth is not None
    assert estimate.camera.wearer_of_detection.shape == scene.camera.truth.wearer.shape
    assert np.mean(estimate.camera.wearer_of_detection == scene.camera.truth.wearer) > 0.9
    assert estimate.camera is not None
    assert len(estimate.camera.path) == 1
    assert estimate.camera.residual_px.shape == (len(one.motion), 1)


def test_windows_that_start_from_all_coarse_frames_are_as_the_whole() -> None:
    scene = at_10_hz(filmed_gestures("hand-held", seconds=4.5))
    windows = WindowSettings(window_s=2.6, overlap_s=1.0)
    whole = smooth(scene, replace(HASTY, windows=replace(windows, use=False)))
    estimate = smooth_chunks(SceneInMemory(scene), replace(HASTY, windows=windows), map_fn=sent).whole()
    rates = [report.stage for report in estimate.reports if report.stage.startswith("full rate, anna")]
    assert rates == [f"full rate, anna, window {number}" for number in range(1, len(rates) + 1)]
    assert len(rates) > 1
    errors = [np.median(root_relative(each, scene)) for each in (estimate, whole)]
    assert errors[0] < 1.1 * errors[1]
    assert_nothing_leaps(estimate)
    np.testing.assert_array_equal(estimate.camera.wearer_of_detection, whole.camera.wearer_of_detection)
    assert estimate.camera is not None
    assert len(estimate.camera.path) == len(estimate.wearers[0].motion) == len(whole.wearers[0].motion)


def test_a_carried_camera_that_loses_everybody_from_file_to_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two wearers keep their names over a window without a single detection of them, and nothing leaps."""
    scene = at_10_hz(without_detections(filmed_gestures("walking", seconds=6.4, people=("anna", "ben")), 2.0, 5.0))
    recording, out = tmp_path / "scene.mcap", tmp_path / "estimate.mcap"
    write_recording(scene, recording)
    assert main(["smooth", str(recording), "--out", str(out), *OPTIONS]) == 0
    estimate = read_estimate(out)
    assert f"VIP, anna: {len(estimate.wearers[0].motion)} frames at 5 Hz" in capsys.readouterr().out
    assert [wearer.name for wearer in estimate.wearers] == ["anna", "ben"]
    assert estimate.camera is not None
    assert len(estimate.camera.path) == len(estimate.wearers[0].motion) == len(estimate.camera.residual_px)
    assert_nothing_leaps(estimate)
    for wearer in estimate.wearers:
        assert all(np.all(np.diff(own.heading_time) > 0) for own in wearer.calibration.values())
    assert scene.camera.truth is not None
    surely = estimate.camera.wearer_of_detection >= 0
    assert surely.mean() > 0.5
    assert np.mean(scene.camera.truth.wearer[surely] == estimate.camera.wearer_of_detection[surely]) > 0.9
    assert any("from 2 to" in sentence or "from 3 to" in sentence for sentence in sentences(estimate.findings))


def sent(function: Callable[[Any], Any], tasks: Iterable[Any]) -> Iterator[Any]:
    """As :func:`map`, of what another process would be given."""
    for task in tasks:
        function, task = pickle.loads(pickle.dumps((function, task)))
        yield function(task)


def at_10_hz(scene: Scene) -> Scene:
    """The scene with every third frame of its video, to save time."""
    camera, truth = camera_of(scene), scene.camera.truth
    assert truth is not None
    kept = camera.detections.frame % 3 == 0
    own = camera.detections.select(kept)
    detections = replace(own, time=own.time[::3], frame=own.frame // 3)
    truth = replace(truth, wearer=truth.wearer[kept], pixels=None)
    return replace(scene, cameras=(replace(camera, detections=detections, truth=truth),))


def watched(chunks: Iterator[Estimate]) -> Iterator[Estimate]:
    """Chunks, while which are made no more windows are in memory than a few solutions, and no problem."""
    others = Counter(type(one) for one in gc.get_objects())
    for chunk in chunks:
        kinds = Counter(type(one) for one in gc.get_objects())
        assert kinds[SolvedWindow] <= others[SolvedWindow] + 4
        assert kinds[SceneProblem] <= others[SceneProblem] + 2
        yield chunk


def root_relative(estimate: Estimate, scene: Scene) -> np.ndarray:
    """How far ``(T,)`` the joint that is worst is too near to the pelvis or too far from it, metres."""
    motion, truth = estimate.wearers[0].motion, scene.wearers[0].truth
    assert truth is not None
    at = np.searchsorted(truth.motion.time, motion.time - 1e-6)
    joints = [
        one.state.p_world_joint[which] - one.p_world_pelvis[which][:, None]
        for one, which in ((motion, slice(None)), (truth.motion, at))
    ]
    return np.abs(np.linalg.norm(joints[0], axis=2) - np.linalg.norm(joints[1], axis=2)).max(axis=1)


def assert_nothing_leaps(estimate: Estimate) -> None:
    for wearer in estimate.wearers:
        motion = wearer.motion
        assert np.linalg.norm(np.diff(motion.p_world_pelvis, axis=0), axis=1).max() * motion.rate < 4.0  # m/s
        turned = angle_between(motion.R_parent_child[1:, 0], motion.R_parent_child[:-1, 0])
        assert np.rad2deg(turned.max()) * motion.rate < 500.0  # °/s


def test_worlds_are_joined_exactly() -> None:
    """Windows of a known scene, each turned and shifted: what is joined is where it was."""
    truth = estimate_of(scene_sample(seconds=2.0))
    motions, path = [wearer.motion for wearer in truth.wearers], truth.camera.path.at(truth.wearers[0].motion.time)
    T = len(motions[0])
    windows = list[SolvedWindow]()
    for number, span in enumerate((slice(0, 60), slice(40, 100), slice(80, T))):
        yaw, shift = 0.7 * number, np.array([3.0 * number, -number, 0.0])
        window = window_of(truth, span, path, yaw, shift)
        windows.append(window if not windows else moved(window, windows[-1], True))
    plan = WindowPlan.one_window(motions[0].start, motions[0].rate, T, 1)
    chunks = list(chunks_of(iter(windows), truth, plan, silent))
    first = [0, *np.cumsum([len(chunk.wearers[0].motion) for chunk in chunks])[:-1]]
    for number, motion in enumerate(motions):
        found = [chunk.wearers[number].motion for chunk in chunks]
        for name in ("R_parent_child", "p_world_pelvis"):
            together = np.concatenate([getattr(one, name) for one in found])
            np.testing.assert_allclose(together, getattr(motion, name), atol=1e-9)
        assert [one.start for one in found] == pytest.approx([motion.start + one / motion.rate for one in first])
    cameras = [chunk.camera for chunk in chunks]
    np.testing.assert_allclose(
        np.concatenate([camera.path.p_world_camera for camera in cameras if camera]), path.p_world_camera, atol=1e-9
    )
    for camera, labels in enumerate((np.arange(T) % 3 - 1, (np.arange(T) % 3 - 1)[::2])):
        joined = np.concatenate([chunk.cameras[camera].wearer_of_detection for chunk in chunks])
        np.testing.assert_array_equal(joined, labels)
    root = np.concatenate([chunk.wearers[0].covariance.root[:, 0, 0] for chunk in chunks])
    assert np.all(np.diff(root) >= -1e-12)  # as unsure as the windows before were


def window_of(truth: Estimate, span: slice, path: CameraPath, yaw: float, shift: np.ndarray) -> SolvedWindow:
    turn, wearers, T = rotation_z(yaw), [], span.stop - span.start
    for wearer in truth.wearers:
        motion = wearer.motion.frames(span)
        R = motion.R_parent_child.copy()
        R[:, 0] = turn @ R[:, 0]
        motion = replace(motion, R_parent_child=R, p_world_pelvis=motion.p_world_pelvis @ turn.T + shift)
        covariance = PoseCovariance(np.ones((T, 24, 3, 3)), np.arange(T)[:, None, None] * np.eye(3))
        residuals = {kind: values[span] for kind, values in wearer.residuals.items()}
        wearers.append(replace(wearer, motion=motion, covariance=covariance, residuals=residuals))
    own = CameraPath(path.time[span], turn @ path.R_world_camera[span], path.p_world_camera[span] @ turn.T + shift)
    labels = np.arange(span.start, span.stop) % 3 - 1
    camera = CameraEstimate("phone", truth.camera.model, own, None, None, np.zeros((T, 2)), wearer_of_detection=labels)
    left = replace(camera, name="left", wearer_of_detection=labels[::2])
    headings = tuple(Headings(own.time[[0, -1]], np.zeros((2, 1))) for _ in wearers)
    return SolvedWindow(span, tuple(wearers), (camera, left), headings, (own.time, own.time[::2]))
