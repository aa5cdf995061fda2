"""The benchmarks of the tracker's speed run, and its memory is bounded."""

from itertools import pairwise

import numpy as np
import pytest

from tests.studies.long_stream import LongStream, LongStreamTrials, stream_scene
from tests.studies.stream_hour import StreamHour, growth, measured_parts
from tests.studies.stream_latency import Latencies, StreamLatency, measure
from tests.studies.stream_references import OURS, run_references
from tests.studies.study import markdown, no_news
from vip_factors.errors import InputError, RecordingError
from vip_factors.live.settings import LiveSettings
from vip_factors.sensors.live import ImuSample
from vip_factors.sensors.scene import Scene

# Six sensors and a fixed camera: a quarter of the work.
TRIALS = LongStreamTrials(seconds=12.0, scene_s=8.0, placement="sip6", camera="fixed")


@pytest.fixture(scope="module")
def scene() -> Scene:
    return stream_scene(TRIALS)


def test_the_stream_goes_on_without_a_jolt_and_with_new_noise(scene: Scene) -> None:
    samples = list(LongStream(scene, TRIALS))
    assert all(before.time <= after.time for before, after in pairwise(samples))
    assert 11.9 < samples[-1].time <= TRIALS.seconds
    pelvis = [one for one in samples if isinstance(one, ImuSample) and one.sensor == "pelvis"]
    time = np.array([one.time for one in pelvis])
    assert np.diff(time).min() > 0
    R = np.stack([one.R_inertial_sensor for one in pelvis if one.R_inertial_sensor is not None])
    turn = np.rad2deg(np.arccos(np.clip((np.einsum("nij,nij->n", R[1:], R[:-1]) - 1) / 2, -1, 1)))
    around = np.abs(time[1:] - 8.0) < 0.1  # where it turns back the wearer rests: filter errors are all that moves
    assert turn[around].max() < 3.0
    there, back = (int(np.argmin(np.abs(time - at))) for at in (6.0, 10.0))
    forces = [pelvis[n].specific_force for n in (there, back)]
    assert forces[0] is not None
    assert forces[1] is not None
    assert 0 < np.abs(forces[0] - forces[1]).max() < 3.0


def test_updates_are_timed_and_the_start_apart(scene: Scene) -> None:
    stream = LongStream(scene, TRIALS)
    within = (sample for sample in stream if sample.time < 2.5)
    latency = measure(within, stream.setup, LiveSettings(), lambda time: None)
    assert 60 < latency.updates < 100
    assert 0 < latency.seconds["median"] <= latency.seconds["99 %"] <= latency.seconds["worst"]
    assert latency.cpu_seconds["median"] > 0
    assert latency.start_s > latency.seconds["median"]
    assert latency.slowest[0].seconds >= latency.slowest[-1].seconds
    assert "| CPU time |" in markdown(Latencies(), [StreamLatency(latency, None, ())])


def test_in_real_time_answers_have_an_age(scene: Scene) -> None:
    stream = LongStream(scene, TRIALS)
    within = (sample for sample in stream if sample.time < 1.3)
    latency = measure(within, stream.setup, LiveSettings(), lambda time: None, real_time=True)
    assert latency.age_s is not None
    assert latency.age_s["median"] > 0
    assert "age of answers" in markdown(Latencies(), [StreamLatency(latency, latency, ())])


@pytest.mark.slow
def test_gtsams_smoothers_are_timed_on_the_same_factors(scene: Scene) -> None:
    stream = LongStream(scene, TRIALS)
    times = run_references(stream, stream.setup, LiveSettings(lag_s=0.15), 2, no_news)
    assert [one.updates for one in times] == [2] * 5
    assert times[0].name == OURS
    assert times[1].differs_m < 1e-6  # the same linear factors
    assert all(np.isfinite(one.differs_m) for one in times)
    assert all(one.median_s > 0 and one.median_cpu_s > 0 for one in times)


@pytest.mark.slow
def test_nothing_grows_with_the_stream(scene: Scene) -> None:
    stream = LongStream(scene, TRIALS)
    parts = tuple(measured_parts(stream, stream.setup, LiveSettings(), 3.0))
    assert [round(part.until) for part in parts] == [3, 6, 9, 12]
    assert all(part.updates > 100 for part in parts)
    # A second holds 60 frames of some hundred objects each: 6 s that are kept would be tens of thousands.
    counts = [part.objects for part in parts[1:]]
    assert max(counts) - min(counts) < 3000
    assert "After the first part: " in markdown(StreamHour(), parts)
    assert abs(growth(parts, lambda part: 2 * part.until) - 7200) < 1e-6


def test_what_is_too_short_is_said(scene: Scene) -> None:
    stream = LongStream(scene, TRIALS)
    few = [sample for sample in stream if sample.time < 0.5]
    with pytest.raises(RecordingError, match="too short"):
        measure(few, stream.setup, LiveSettings(), lambda time: None)
    with pytest.raises(RecordingError, match="too short"):
        run_references(few, stream.setup, LiveSettings(), 5, no_news)
    with pytest.raises(InputError, match="expected at least 8 s"):
        LongStreamTrials(scene_s=3.0)
