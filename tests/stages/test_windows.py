"""Frames and windows: in step with the video, against the whole, what is joined, and the memory that it takes."""

import gc
import itertools
import tracemalloc
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from vip_factors.body.kinematics import Motion
from vip_factors.display import silent
from vip_factors.errors import InputError, RecordingError
from vip_factors.estimate import Estimate, PoseCovariance, WearerEstimate
from vip_factors.estimate_chunks import EstimateChunks
from vip_factors.geometry.rotations import angle_between, exp
from vip_factors.pipeline import smooth, smooth_chunks
from vip_factors.problem.state import WearerState
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.camera import VideoClock
from vip_factors.sensors.frames import in_stretches, resample, resample_streams
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene
from vip_factors.sensors.sources import SceneInMemory, frames_of, without_gaps
from vip_factors.settings import (
    AssignmentSettings,
    CalibrationSettings,
    SensorClockSettings,
    Settings,
    SolveSettings,
    StartSettings,
    WindowSettings,
)
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording
from vip_factors.simulate.scene import Performer, simulate_scene
from vip_factors.simulate.settings import SceneSettings
from vip_factors.simulate.staging import with_initial_pose
from vip_factors.stages.calibrate import Calibration, calibrate
from vip_factors.stages.reporting import calibrated_estimate
from vip_factors.stages.solve_windows import solve_windows
from vip_factors.stages.window_join import SolvedWindow, chunks_of, moved
from vip_factors.stages.windows import WindowPlan, plan_scene

QUICK = Settings(
    frame_rate=10.0,
    covariance=False,
    assignment=AssignmentSettings(check=False),
    calibration=CalibrationSettings(passes=0, start=StartSettings(search=False)),
    solve=SolveSettings(relative_decrease=1e-7),
    windows=WindowSettings(above_s=1.0, window_s=1000.0, overlap_s=2.0),
)


@pytest.fixture(scope="module")
def recording() -> Recording:
    motion = with_initial_pose(gestures(11.0), "n-pose", hold_s=1.0)
    return simulate_recording(motion, preset("totalcapture13", motion.skeleton), seed=4, initial_pose="n-pose")


def in_windows(settings: Settings, window_s: float, overlap_s: float, **more: float) -> Settings:
    return replace(settings, windows=replace(settings.windows, window_s=window_s, overlap_s=overlap_s, **more))


def test_windows_agree_with_one_window_of_all(recording: Recording) -> None:
    """To 0.1 mm and 0.01°, as sure to a thousandth, of converged solves about one calibration; 3 s settle a window."""
    settings, source = replace(QUICK, covariance=True), SceneInMemory(Scene("e", (recording,)))
    plan = WindowPlan.of("e", recording.interval, settings)
    calibration = calibrate(source, plan, settings, silent)
    assert isinstance(calibration, Calibration)
    estimate, solved = calibrated_estimate(calibration, settings), []
    for one in (settings, in_windows(settings, 10.0, 5.0)):
        own = WindowPlan.of("e", recording.interval, one)
        windows = solve_windows(source, calibration, estimate, own, one, map)
        head = estimate.wearer().motion.frames(slice(0, 0))
        solved.append(together(empty(replace(head, rate=own.rate, start=own.start)), windows, own))
    whole, estimate = solved
    assert len(estimate.motion) == len(whole.motion) == plan.frames
    off = np.rad2deg(angle_between(estimate.motion.R_parent_child, whole.motion.R_parent_child))
    assert off.max() < 0.01
    assert np.abs(estimate.motion.p_world_pelvis - whole.motion.p_world_pelvis).max() < 1e-4
    for kind, values in whole.residuals.items():
        np.testing.assert_allclose(estimate.residuals[kind], values, atol=0.02, equal_nan=True)
    assert estimate.covariance is not None
    assert whole.covariance is not None
    for found, expected in (
        (estimate.covariance.joints, whole.covariance.joints),
        (estimate.covariance.root, whole.covariance.root),
    ):
        sigmas = (np.sqrt(np.diagonal(one, axis1=-2, axis2=-1)) for one in (found, expected))
        np.testing.assert_allclose(*sigmas, rtol=1e-3)


def test_windows_that_start_from_all_coarse_frames_agree_with_all_frames_at_once(recording: Recording) -> None:
    settings = replace(QUICK, frame_rate=20.0, calibration_rate=10.0, solve=SolveSettings())
    found, whole = (
        smooth(recording, replace(settings, windows=one)).wearer()
        for one in (WindowSettings(window_s=7.0, overlap_s=3.0), WindowSettings(use=False))
    )
    stages = [report.stage for report in found.reports]
    assert stages[-3:] == [f"sparse inertial poser, window {number}" for number in (1, 2, 3)]
    assert stages[:-3] == [report.stage for report in whole.reports][:-1]
    assert len(found.motion) == len(whole.motion)
    assert np.rad2deg(angle_between(found.motion.R_parent_child, whole.motion.R_parent_child)).max() < 0.1
    assert np.abs(found.motion.p_world_pelvis - whole.motion.p_world_pelvis).max() < 0.005
    assert found.calibration.keys() == whole.calibration.keys()


def test_what_is_joined_is_where_it_was_and_as_sure() -> None:
    """Windows of a known path, each in a place of its own and sure of where it begins."""
    random, T = np.random.default_rng(3), 60
    skeleton = gestures(1.0).skeleton
    R = np.cumsum(0.01 * random.standard_normal((T, 24, 3)), axis=0)
    truth = WearerState(
        exp(R), np.cumsum(random.standard_normal((T, 3)), axis=0), np.zeros(1), np.eye(3)[None], R[0, 1:]
    )
    walked, height = np.diag([1.0, 2.0, 0.0]), np.diag([0.0, 0.0, 3.0])
    windows = list[SolvedWindow]()
    for number, span in enumerate((slice(0, 30), slice(20, 50), slice(38, 60))):
        state = truth.window(span)
        state = replace(state, p_world_pelvis=state.p_world_pelvis + number * np.array([5.0, -3.0, 0.0]))
        own = np.arange(span.stop - span.start)[:, None, None]
        covariance = PoseCovariance(np.ones((len(own), 24, 3, 3)), own * walked + height)
        residuals = {"orientation_deg": np.arange(span.start, span.stop, dtype=float)[:, None]}
        motion = Motion(skeleton, state.R_parent_child, state.p_world_pelvis, 10.0, 2.0 + span.start / 10)
        one = SolvedWindow(span, (WearerEstimate("e", "SIP", motion, {}, covariance, residuals),))
        windows.append(moved(one, windows[-1], True) if windows else one)
    motion = Motion(skeleton, np.zeros((0, 24, 3, 3)), np.zeros((0, 3)), 10.0, start=2.0)
    head = WearerEstimate("e", "SIP", motion, {}, residuals={"orientation_deg": np.zeros(0)})
    whole = together(head, iter(windows), WindowPlan.one_window(2.0, 10.0, T, 1))
    np.testing.assert_allclose(whole.motion.R_parent_child, truth.R_parent_child, atol=1e-12)
    np.testing.assert_allclose(whole.motion.p_world_pelvis, truth.p_world_pelvis, atol=1e-12)
    np.testing.assert_array_equal(whole.residuals["orientation_deg"][:, 0], np.arange(T))
    assert whole.covariance is not None
    np.testing.assert_allclose(whole.covariance.root, np.arange(T)[:, None, None] * walked + height, atol=1e-9)


def together(head: WearerEstimate, windows: Iterator[SolvedWindow], plan: WindowPlan) -> WearerEstimate:
    whole = Estimate.of_one(head)
    chunks = [chunk.wearer() for chunk in chunks_of(windows, whole, plan, silent)]
    first = [0, *np.cumsum([len(chunk.motion) for chunk in chunks])[:-1]]
    starts = [head.motion.start + one / head.motion.rate for one in first]
    assert [chunk.motion.start for chunk in chunks] == pytest.approx(starts)
    return EstimateChunks(whole, (0,), map(Estimate.of_one, chunks)).whole().wearer()


def empty(head: Motion) -> WearerEstimate:
    return WearerEstimate(
        "e", "SIP", head, {}, residuals={"orientation_deg": np.zeros(0), "acceleration_m_s2": np.zeros(0)}
    )


def peak_of(recording: Recording, settings: Settings) -> tuple[int, int]:
    """Bytes that Python held at most while the chunks of an estimate were made and dropped, and their frames."""
    gc.collect()
    tracemalloc.start()
    try:
        chunks = smooth_chunks(SceneInMemory(Scene("e", (recording,))), settings).chunks
        frames = sum(len(chunk.wearer().motion) for chunk in chunks)
        return tracemalloc.get_traced_memory()[1], frames
    finally:
        tracemalloc.stop()


def test_memory_does_not_grow_with_the_recording() -> None:
    settings = replace(
        in_windows(QUICK, 2.0, 0.6, calibration_stretches=2, calibration_stretch_s=1.0),
        frame_rate=8.0, solve=SolveSettings(max_iterations=1), sensor_clocks=SensorClockSettings(check=False),
    )  # fmt: skip
    motion = gestures(8.4)
    recording = simulate_recording(motion, preset("sip6", motion.skeleton))
    half = replace(recording, imus={name: stream.cut(0.0, 4.0) for name, stream in recording.imus.items()})
    (short, few), (long, many) = (peak_of(one, settings) for one in (half, recording))
    assert many > 2 * few
    assert long < 1.1 * short


def test_the_plan_covers_every_frame() -> None:
    for seconds in (12.0, 61.3, 1000.0, 3600.7):
        settings = in_windows(Settings(), 40.0, 6.0, above_s=1.0)
        plan = WindowPlan.of("e", (2.5, 2.5 + seconds), settings)
        windows = plan.windows()
        assert windows[0].start == 0
        assert windows[-1].stop == plan.frames == int(seconds * 60 + 1e-6) + 1
        assert all(window.start % 4 == 0 for window in windows)
        assert all(one.stop - after.start >= 6 * 60 for one, after in itertools.pairwise(windows))
        assert max(window.stop - window.start for window in windows) <= 40 * 60 + 4
        assert plan.time(windows[-1])[-1] <= 2.5 + seconds + 1e-9
        stretches = plan.calibration_stretches()
        assert sum(stretch.stop - stretch.start for stretch in stretches) <= 8 * 25 * 15
        assert stretches[-1].stop == -(-plan.frames // 4)


def test_windows_that_cannot_be() -> None:
    with pytest.raises(InputError, match="overlap_s"):
        WindowSettings(window_s=5.0, overlap_s=3.0)
    with pytest.raises(InputError, match=r"windows\.above_s"):
        WindowSettings(above_s=-1.0)
    with pytest.raises(RecordingError, match="frames or more"):
        WindowPlan.of("e", (0.0, 0.01), Settings())


def test_frames_of_stretches_know_where_they_leap(recording: Recording) -> None:
    frames = resample(recording, 15.0)
    together = in_stretches([frames.window(slice(0, 10)), frames.window(slice(30, 40)), frames.window(slice(60, 65))])
    np.testing.assert_array_equal(together.beginnings, [0, 10, 20])
    assert not together.follows[[9, 19]].any()
    assert together.follows.sum() == 22
    assert not together.acceleration_valid[[9, 10, 19, 20]].any()
    inner = [8, 11, 18, 21]
    np.testing.assert_array_equal(together.acceleration_valid[inner], frames.acceleration_valid[[8, 31, 38, 61]])


def test_a_silent_sensor_keeps_its_column(recording: Recording) -> None:
    streams = dict(recording.imus)
    time = np.arange(4.0, 5.0, 0.1)
    whole = resample_streams(list(streams.values()), time)
    del streams["pelvis"]
    frames, column = frames_of(streams, whole.sensors, time), whole.sensors.index("pelvis")
    assert frames.sensors == whole.sensors
    assert not frames.orientation_valid[:, column].any()
    others = [s for s in range(len(whole.sensors)) if s != column]
    np.testing.assert_array_equal(frames.specific_force_inertial[:, others], whole.specific_force_inertial[:, others])


def test_stretches_are_without_gaps(recording: Recording) -> None:
    times = [np.arange(2.0, 4.0, 0.1), np.arange(9.0, 11.0, 0.1)]
    together = without_gaps(replace(recording, imus={}), [recording.imus, recording.imus], times)
    stream = together.imus["pelvis"]
    assert stream.time[0] == pytest.approx(2.0, abs=0.3)  # with what was lost
    assert stream.time[-1] == pytest.approx(6.0, abs=0.3)
    assert np.diff(stream.time).max() < 0.5
    original = recording.imus["pelvis"].cut(9.0, 9.2)
    at = np.argmin(np.abs(stream.time - (original.time[3] - 5.0)))
    np.testing.assert_array_equal(stream.specific_force[at], original.specific_force[3])


def test_a_pause_of_all_sensors_and_headings_that_drift() -> None:
    """Windows in which nobody measured keep the wearer where the one before had him; headings step in any of them."""
    settings = replace(
        in_windows(QUICK, 3.0, 1.0, calibration_stretches=2, calibration_stretch_s=2.0),
        frame_rate=8.0, solve=SolveSettings(max_iterations=2), covariance=True,
        calibration=replace(QUICK.calibration, passes=1, heading_drift_from_s=3.0),
    )  # fmt: skip
    motion = gestures(14.0)
    recording = simulate_recording(motion, preset("sip6", motion.skeleton))
    imus = {name: _without(stream, 4.0, 10.5) for name, stream in recording.imus.items()}
    estimate = smooth(replace(recording, imus=imus), settings).wearer()
    assert np.all(np.isfinite(estimate.motion.R_parent_child))
    assert np.linalg.norm(np.diff(estimate.motion.p_world_pelvis, axis=0), axis=1).max() < 0.5
    silent = np.isnan(estimate.residuals["orientation_deg"]).all(axis=1)
    assert silent.sum() == pytest.approx(6.5 * 8, abs=3)
    assert estimate.covariance is not None
    assert np.all(np.isfinite(estimate.covariance.root))
    assert estimate.covariance.root[-1, 0, 0] > estimate.covariance.root[8, 0, 0] + 1.0  # m²
    assert all(
        len(calibration.heading_time) == 2 for calibration in estimate.calibration.values()
    )  # one for each stretch


def _without(stream: ImuStream, start: float, end: float) -> ImuStream:
    kept = (stream.time < start) | (stream.time > end)
    assert stream.R_inertial_sensor is not None
    assert stream.specific_force is not None
    return ImuStream(stream.name, stream.time[kept], stream.specific_force[kept], stream.R_inertial_sensor[kept])


@pytest.fixture(scope="module")
def filmed_scene() -> Scene:
    motion = gestures(2.0)
    return simulate_scene([Performer("anna", motion, preset("sip6", motion.skeleton))], SceneSettings.noise_free())


@pytest.mark.parametrize(("wanted", "given"), [(60.0, 60.0), (50.0, 60.0), (15.0, 15.0), (20.0, 15.0)])
def test_a_whole_number_of_frames_goes_to_each_video_frame(filmed_scene: Scene, wanted: float, given: float) -> None:
    plan = plan_scene(SceneInMemory(filmed_scene), replace(Settings(), frame_rate=wanted, calibration_rate=wanted))
    assert plan.rate == pytest.approx(given)


@pytest.mark.parametrize("offset", [0.0, 0.0123, -0.4])
def test_coarse_frames_meet_video_frames(filmed_scene: Scene, offset: float) -> None:
    assert filmed_scene.camera is not None
    shifted = replace(filmed_scene, cameras=(replace(filmed_scene.camera, clock=VideoClock(offset)),))
    coarse = plan_scene(SceneInMemory(shifted), Settings()).all_coarse_time
    video = filmed_scene.camera.detections.time + offset
    nearest = np.abs(coarse[:, None] - video).min(axis=1)
    inside = (coarse >= video[0]) & (coarse <= video[-1])
    assert nearest[inside].max() < 1e-6


@pytest.mark.parametrize(
    "frames_of",
    [
        lambda scene: plan_scene(SceneInMemory(scene), Settings()),
        lambda scene: WindowPlan.of("walk", scene.wearers[0].interval, Settings()),
    ],
)
def test_a_sample_years_later_is_refused(filmed_scene: Scene, frames_of: Callable[[Scene], object]) -> None:
    wearer = filmed_scene.wearers[0]
    name, stream = next(iter(wearer.imus.items()))
    late = replace(stream, time=np.append(stream.time[:-1], 1e9))
    wearers = [replace(one, imus={**one.imus, name: late}) for one in (wearer, *filmed_scene.wearers[1:])]
    damaged = replace(filmed_scene, wearers=tuple(wearers))
    with pytest.raises(RecordingError, match=r"to 1e\+09 s: expected at most a day; .*'vip-factors info' shows"):
        frames_of(damaged)


def test_wearers_without_common_time_are_refused(filmed_scene: Scene) -> None:
    wearer = filmed_scene.wearers[0]
    late = {name: replace(stream, time=stream.time + 60.0) for name, stream in wearer.imus.items()}
    other = replace(wearer, imus=late, subject=replace(wearer.subject, name="bob"))
    with pytest.raises(RecordingError, match=r"all wearers have 0\.00 s in common"):
        plan_scene(SceneInMemory(replace(filmed_scene, wearers=(wearer, other))), Settings())
