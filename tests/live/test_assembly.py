"""Frames as they are made from a stream: the same as the batch's, and as early as can be."""

from dataclasses import replace

import numpy as np
import pytest
from assembly_stream import CAMERA, COLUMNS, RATE, assemble, findings_of, in_time, sample, stream, video

from vip_factors.errors import InputError
from vip_factors.live.assembly import FrameAssembler
from vip_factors.live.sensor_samples import triangular_average_of_samples
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.frames import resample_streams, triangular_average
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.live import live_samples, stream_head
from vip_factors.sensors.scene import Scene
from vip_factors.settings import AssemblySettings
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.scene import Performer, simulate_scene
from vip_factors.simulate.settings import SceneSettings, SimulateSettings

# Longer than any gap of a simulated stream: then both ends of the gap are known when its first frame is made.
PATIENT = AssemblySettings(patience=0.3)


def simulated(imu_rate: float, packet_loss: float, jitter: float = 0.0) -> tuple[Scene, list[ImuStream]]:
    motion = gestures(4.0)
    settings = SceneSettings(imu=SimulateSettings(imu_rate=imu_rate, packet_loss=packet_loss))
    scene = simulate_scene([Performer("anna", motion, preset("sip6", motion.skeleton))], settings, seed=3)
    random = np.random.default_rng(5)

    def jittered(one: ImuStream) -> ImuStream:
        return replace(one, time=one.time + jitter / imu_rate * random.uniform(-1, 1, len(one)))

    wearer, camera = scene.wearers[0], scene.camera
    assert camera is not None
    assert camera.mount is not None
    mount = replace(camera.mount, imu=jittered(camera.mount.imu))
    wearer = replace(wearer, imus={name: jittered(one) for name, one in wearer.imus.items()})
    scene = replace(scene, wearers=(wearer,), cameras=(replace(camera, mount=mount),))
    return scene, [*wearer.imus.values(), mount.imu]


@pytest.mark.parametrize(
    ("imu_rate", "loss", "jitter"), [(60.0, 0.0, 0.0), (100.0, 0.002, 0.0), (100.0, 0.3, 0.15), (40.0, 0.05, 0.2)]
)
def test_frames_equal_the_batch(imu_rate: float, loss: float, jitter: float) -> None:
    scene, streams = simulated(imu_rate, loss, jitter)
    columns = [("anna", stream.name) for stream in streams[:-1]] + [("camera", streams[-1].name)]
    assembler = FrameAssembler(columns, RATE, PATIENT, stream_head(scene).cameras)
    frames = assemble(live_samples(scene), assembler)

    batch = resample_streams(streams, np.array([frame.time for frame in frames]))
    seen = np.array([frame.orientation_valid for frame in frames])
    whole = np.array([frame.acceleration_valid_before for frame in frames])[1:]
    # A period that jitters is known to a percent or two: a frame at the very edge of a gap may fall on either side.
    odd = 0.005 if jitter else 0.0
    assert np.mean(seen != batch.orientation_valid) <= odd
    assert np.mean(whole != batch.acceleration_valid[:-1]) <= odd
    assert 0.6 < seen.mean() <= 1.0
    both = seen & batch.orientation_valid
    R = np.array([frame.R_inertial_sensor for frame in frames])
    np.testing.assert_allclose(R[both], batch.R_inertial_sensor[both], atol=1e-9)
    both = whole & batch.acceleration_valid[:-1]
    force = np.array([frame.specific_force_before for frame in frames])[1:]
    np.testing.assert_allclose(force[both], batch.specific_force_inertial[:-1][both], atol=1e-6)
    assert np.all(force[~whole] == 0)
    assert np.all(R[~seen] == np.eye(3))


def test_each_video_frame_is_handed_out_once_with_its_frame() -> None:
    scene, streams = simulated(60.0, 0.0)
    columns = [("anna", stream.name) for stream in streams[:-1]] + [("camera", streams[-1].name)]
    frames = assemble(live_samples(scene), FrameAssembler(columns, RATE, cameras=stream_head(scene).cameras))
    assert scene.camera is not None
    handed = [(video.frame, video.time) for frame in frames for video in frame.video]
    times = scene.camera.detections.time
    assert [time for _, time in handed] == [time for time in times if frames[0].time <= time <= frames[-1].time + 1e-9]
    for number, time in handed:
        assert frames[number].time == pytest.approx(time, abs=1e-9), "the grid is in step with the video"


@pytest.mark.parametrize("seed", range(5))
def test_triangular_average_is_that_of_the_batch(seed: int) -> None:
    random = np.random.default_rng(seed)
    time = np.cumsum(random.uniform(0.001, 0.03, 12))
    values = random.normal(size=(12, 3))
    middle, half = random.uniform(time[3], time[8]), random.uniform(0.01, 0.06)  # beyond the ends, at times
    ours = triangular_average_of_samples((time - middle)[None], values[None], half)[0]
    np.testing.assert_allclose(ours, triangular_average(time, values, np.array([middle]), half)[0], atol=1e-9)


def test_frames_come_without_delay_when_sensors_are_in_step() -> None:
    assembler = FrameAssembler(COLUMNS, RATE)
    assemble(stream(0.0, 1.0), assembler, flush=False)
    for period in range(60, 70):
        frames = [frame for one in stream(period / RATE, (period + 1) / RATE) for frame in assembler.push(one)]
        assert [frame.number for frame in frames] == [period]
        assert frames[0].time == pytest.approx(period / RATE)
        assert np.all(frames[0].orientation_valid)
        assert np.all(frames[0].acceleration_valid_before)


def test_a_late_sensor_is_waited_for_as_long_as_patience_lasts() -> None:
    assembler = FrameAssembler(COLUMNS, RATE)
    assemble(stream(0.0, 1.0), assembler, flush=False)
    others = stream(1.0, 1.2, [("Ada", "hip"), ("Bo", "hip")])
    frames = assemble(others, assembler, flush=False)
    newest = others[-1].time
    assert frames[-1].time == pytest.approx(newest - 0.05, abs=1 / RATE)
    assert frames[-1].time <= newest - 0.05 + 1e-6
    assert list(frames[-1].orientation_valid) == [True, False, True]
    # What it sends now is of frames that are still to be made.
    rest = assemble(stream(newest, newest + 0.1, [("Ada", "wrist")]), assembler)
    assert rest[-1].orientation_valid[1]


def test_sensors_whose_specific_force_is_missing_have_orientations_all_the_same() -> None:
    samples = [replace(one, specific_force=None) if one.carrier == "Bo" else one for one in stream(0.0, 1.0)]
    frames = assemble(samples, FrameAssembler(COLUMNS, RATE))
    assert all(np.all(frame.orientation_valid) for frame in frames)
    assert all(list(frame.acceleration_valid_before) == [True, True, False] for frame in frames[2:])


def test_late_video_keeps_its_frame_and_is_dropped_beyond_the_lag() -> None:
    assembler = FrameAssembler(COLUMNS, RATE, cameras=[CAMERA], lag_frames=15)
    assemble(in_time(stream(0.0, 1.0), [video(0.0)]), assembler, flush=False)
    for time in (0.9, 0.72, 0.9):
        assembler.push(video(time))
    frame, *_ = assemble(stream(1.0, 1.0 + 1 / RATE), assembler, flush=False)
    assert [(video.frame, video.time) for video in frame.video] == [(54, 0.9)]
    assert findings_of(assembler) == ("camera 'phone': 1 video frame came too late",)


def test_video_ahead_waits_for_its_frame() -> None:
    assembler = FrameAssembler(COLUMNS, RATE, cameras=[CAMERA])
    assemble(stream(0.0, 1.0), assembler, flush=False)
    assembler.push(video(1.1))
    frames = assemble(stream(1.0, 1.3), assembler)
    assert [(frame.number, video.frame) for frame in frames for video in frame.video] == [(66, 66)]


def test_the_grid_is_in_step_with_a_video_that_begins_while_sensors_settle() -> None:
    frames = assemble(in_time(stream(0.0, 1.0), [video(0.107)]), FrameAssembler(COLUMNS, RATE, cameras=[CAMERA]))
    assert 0 <= frames[0].time < 1 / RATE
    assert (0.107 - frames[0].time) * RATE == pytest.approx(round((0.107 - frames[0].time) * RATE), abs=1e-6)


def test_time_stays_exact_and_memory_flat_over_hours() -> None:
    assembler = FrameAssembler(COLUMNS, RATE, cameras=[CAMERA])
    begin = 5 * 3600.0
    assemble(stream(begin, begin + 8.0), assembler, flush=False)
    size = assembler._buffer._time.shape
    frames = assemble(stream(begin + 8.0, begin + 16.0), assembler)
    assert assembler._buffer._time.shape == size
    np.testing.assert_allclose([frame.time for frame in frames], begin + np.arange(480, 960) / RATE, atol=1e-9)
    assert all(np.all(frame.acceleration_valid_before) for frame in frames)


@pytest.mark.parametrize("rate", [1000.0, 25.0])
def test_fast_and_slow_sensors(rate: float) -> None:
    frames = assemble(stream(0.0, 2.0, rate=rate), FrameAssembler(COLUMNS, RATE))
    assert len(frames) > 100
    assert all(np.all(frame.orientation_valid) for frame in frames)
    truth = [sample(COLUMNS[1], frame.time).R_inertial_sensor for frame in frames]
    np.testing.assert_allclose(
        [frame.R_inertial_sensor[1] for frame in frames[:100]], truth[:100], atol=0.4 / rate + 1e-5
    )


@pytest.mark.parametrize("changes", [{"patience": 2.0}, {"settle": -1.0}, {"jump": float("nan")}, {"dead_after": 0.0}])
def test_impossible_settings_are_refused(changes: dict[str, float]) -> None:
    with pytest.raises(InputError):
        AssemblySettings(**changes)
