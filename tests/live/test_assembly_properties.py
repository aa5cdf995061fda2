"""Whatever the order in which samples come, frames come in theirs."""

from dataclasses import replace

import numpy as np
from assembly_stream import CAMERA, COLUMNS, RATE, assemble, assert_same, in_time, stream, video
from hypothesis import given, settings
from hypothesis import strategies as st

from vip_factors.live.assembly import FrameAssembler
from vip_factors.live.frames import LiveFrame
from vip_factors.sensors.live import ImuSample, LiveSample, VideoFrame
from vip_factors.settings import AssemblySettings

SECONDS = 1.2
WHOLE = in_time(stream(0.0, SECONDS, rate=100.0), [video(period / 30) for period in range(36)])


def in_order_once(frames: list[LiveFrame]) -> None:
    assert [frame.number for frame in frames] == list(range(len(frames)))
    handed = [(video.camera, video.time) for frame in frames for video in frame.video]
    assert len(handed) == len(set(handed))
    assert all(video.frame <= frame.number for frame in frames for video in frame.video)
    for frame in frames:
        assert np.all(np.isfinite(frame.specific_force_before))
        np.testing.assert_allclose(frame.R_inertial_sensor @ np.swapaxes(frame.R_inertial_sensor, 1, 2)
                                   - np.eye(3), 0, atol=1e-9)  # fmt: skip


@settings(max_examples=15)
@given(seed=st.integers(0, 2**32 - 1), loss=st.floats(0, 0.6), twice=st.floats(0, 0.5), delay=st.floats(0, 0.05))
def test_any_order_within_patience(seed: int, loss: float, twice: float, delay: float) -> None:
    random = np.random.default_rng(seed)
    arrivals = [(one.time + random.uniform(0, delay), one) for one in WHOLE if random.random() >= loss]
    arrivals += [(at + random.uniform(0, delay), one) for at, one in arrivals if random.random() < twice]
    ordered = [one for _, one in sorted(arrivals, key=lambda arrival: arrival[0])]
    frames = assemble(ordered, FrameAssembler(COLUMNS, RATE, cameras=[CAMERA]))
    in_order_once(frames)
    if frames:
        times = np.array([frame.time for frame in frames])
        np.testing.assert_allclose(times, times[0] + np.arange(len(times)) / RATE, atol=1e-9)
        newest = max(one.time for one in ordered if isinstance(one, ImuSample))
        assert newest - 1 / RATE < times[-1] <= newest + 1e-6


def by_frame(one: LiveSample) -> int:
    return int(np.floor(one.time * RATE + 1e-6))


@settings(max_examples=8)
@given(seed=st.integers(0, 2**32 - 1))
def test_any_order_within_a_frame_is_the_same_if_asked_for(seed: int) -> None:
    random = np.random.default_rng(seed)
    swapped = sorted(WHOLE, key=lambda one: (by_frame(one), random.random()))
    waiting = AssemblySettings(reordering=1 / RATE)
    assert_same(
        assemble(swapped, FrameAssembler(COLUMNS, RATE, waiting)), assemble(WHOLE, FrameAssembler(COLUMNS, RATE))
    )


@settings(max_examples=8)
@given(seed=st.integers(0, 2**32 - 1))
def test_sensors_may_come_in_any_order_within_a_frame(seed: int) -> None:
    """Each sensor's own samples in order, as over TCP: no waiting is needed for the same frames, videos included."""
    random = np.random.default_rng(seed)
    place = {id(one): (by_frame(one), random.random()) for one in WHOLE}
    queues: dict[object, list[LiveSample]] = {}
    for one in WHOLE:
        source = one.camera if isinstance(one, VideoFrame) else (one.carrier, one.sensor)
        queues.setdefault(source, []).append(one)
    slots = sorted((*place[id(one)], source) for source, queue in queues.items() for one in queue
                   for source in [str(source)])  # fmt: skip
    named = {str(source): iter(queue) for source, queue in queues.items()}
    mixed = [next(named[source]) for _, _, source in slots]
    frames = assemble(mixed, FrameAssembler(COLUMNS, RATE, cameras=[CAMERA]))
    plain = assemble(WHOLE, FrameAssembler(COLUMNS, RATE, cameras=[CAMERA]))
    assert_same(frames, plain)
    videos = [{(video.frame, video.time) for frame in run for video in frame.video} for run in (frames, plain)]
    assert videos[0] == videos[1]


@settings(max_examples=15)
@given(seed=st.integers(0, 2**32 - 1))
def test_nothing_a_source_sends_raises(seed: int) -> None:
    random = np.random.default_rng(seed)
    bad_times = [np.nan, -np.inf, 1e300, -1e9, 1e9, 0.0]
    samples: list[LiveSample] = []
    for one in WHOLE:
        kind = random.integers(12)
        if kind == 0:
            one = replace(one, time=float(random.choice(bad_times)))
        elif kind == 1:
            one = replace(one, time=one.time + float(random.normal(0, 3)))
        elif kind == 2 and isinstance(one, ImuSample):
            one = replace(one, R_inertial_sensor=random.normal(size=(3, 3)))
        elif kind == 3 and isinstance(one, ImuSample):
            one = replace(one, specific_force=random.normal(size=3) * 10.0 ** random.integers(-3, 300))
        samples.append(one)
    if seed % 2:
        samples[0] = replace(samples[0], time=float(random.choice([-1e9, 1e9, 5.0])))
    assembler = FrameAssembler(COLUMNS, RATE, cameras=[CAMERA])
    in_order_once(assemble(samples, assembler))
    assert len(assembler.take_findings()) < 100
