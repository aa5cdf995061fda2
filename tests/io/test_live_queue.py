"""What waits for the tracker: order kept, video frames dropped first, losses told once a second."""

from threading import Thread

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vip_factors.io.live_source import LiveQueue
from vip_factors.sensors.live import ImuSample, LiveFinding, LiveItem, LiveLoss, VideoFrame


def imu(time: float) -> ImuSample:
    return ImuSample("Ada", "head", time)


def video(time: float) -> VideoFrame:
    return VideoFrame("phone", time, np.zeros((0, 17, 2)), np.zeros((0, 17)))


def drained(queue: LiveQueue) -> list[LiveItem]:
    queue.finish()
    items = []
    while (item := queue.get()) is not None:
        items.append(item)
    return items


class Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


@given(st.lists(st.sampled_from(["imu", "video", "finding"])))
def test_what_fits_comes_out_as_it_went_in(kinds: list[str]) -> None:
    made = {"imu": imu, "video": video, "finding": lambda time: LiveFinding(str(time))}
    items = [made[kind](float(time)) for time, kind in enumerate(kinds)]
    queue = LiveQueue(1000)
    for item in items:
        queue.put(item)
    assert [id(one) for one in drained(queue)] == [id(one) for one in items]


@given(st.lists(st.booleans(), max_size=60), st.integers(1, 10))
def test_video_frames_are_dropped_before_imu_samples_and_old_before_new(frames: list[bool], limit: int) -> None:
    items = [video(float(time)) if frame else imu(float(time)) for time, frame in enumerate(frames)]
    queue = LiveQueue(limit)
    for item in items:
        queue.put(item)
    assert len(queue) <= limit
    assert len(queue) == len(items) or len(items) > limit
    left = [item for item in drained(queue) if not isinstance(item, LiveFinding)]
    assert [one.time for one in left] == sorted(one.time for one in left)
    samples = [one for one in items if isinstance(one, ImuSample)]
    newest = [one for one in left if isinstance(one, ImuSample)]
    assert newest == samples[len(samples) - len(newest) :]
    assert bool(newest) == bool(samples)
    kept = [one.time for one in left if isinstance(one, VideoFrame)]
    assert len(kept) + len(newest) <= limit
    last = [one.time for one in items if isinstance(one, VideoFrame)][-len(kept) :]
    assert not kept or kept == last


def test_losses_are_said_once_a_second_and_told_every_ten_and_at_the_end() -> None:
    clock = Clock()
    queue = LiveQueue(2, clock=clock)

    def flood() -> list[LiveItem]:
        for time in range(5):
            queue.put(imu(time))
        queue.put(video(9.0))
        got = [queue.get()]
        while len(queue):
            got.append(queue.get())
        return [item for item in got if isinstance(item, LiveLoss)]

    (told,) = flood()
    assert "4 IMU samples were dropped; this machine is too slow" in told.sentence
    assert not told.is_repeat
    clock.now = 0.9
    assert flood() == []
    clock.now = 1.1
    (said,) = flood()
    assert said.is_repeat
    assert flood() == []
    clock.now = 10.5
    (told,) = flood()
    assert "16 IMU samples" in told.sentence
    assert not told.is_repeat
    flood()
    (told,) = drained(queue)
    assert isinstance(told, LiveLoss)
    assert "4 IMU samples" in told.sentence
    assert not told.is_repeat


@pytest.mark.parametrize("drops", [True, False])
def test_what_is_late_has_waited_but_nothing_of_a_file(drops: bool) -> None:
    clock = Clock()
    queue = LiveQueue(8, drops, clock)
    for clock.now in (1.0, 1.5):
        queue.put(imu(clock.now))
    clock.now = 2.0
    waited = [queue.waited_s for _ in range(2) if queue.get()]
    assert waited == ([1.0, 0.5] if drops else [0.0, 0.0])
    assert not queue.is_behind
    queue.put(imu(2.0))
    assert not queue.is_behind
    clock.now = 2.1
    assert queue.is_behind == drops


def test_findings_are_never_dropped() -> None:
    queue = LiveQueue(1)
    for number in range(5):
        queue.put(LiveFinding(str(number)))
        queue.put(imu(number))
    told = [item.sentence for item in drained(queue) if isinstance(item, LiveFinding)]
    assert [one for one in told if len(one) == 1] == list("01234")


def test_a_reader_that_may_wait_loses_nothing() -> None:
    queue = LiveQueue(3, drops=False)

    def fill() -> None:
        for time in range(500):
            queue.put(imu(time) if time % 5 else video(time))
        queue.finish()

    thread = Thread(target=fill)
    thread.start()
    times = []
    while (item := queue.get()) is not None:
        assert len(queue) <= 3
        times.append(item.time)
    thread.join(10)
    assert times == list(range(500))


@pytest.mark.parametrize("drops", [True, False])
def test_closing_wakes_whoever_waits(drops: bool) -> None:
    queue = LiveQueue(1, drops)
    queue.put(imu(0))
    writer = Thread(target=lambda: queue.put(imu(1)))
    writer.start()
    queue.close()
    writer.join(10)
    assert not writer.is_alive()
    assert queue.get() is None

    empty = LiveQueue(1, drops)
    reader = Thread(target=empty.get)
    reader.start()
    empty.close()
    reader.join(10)
    assert not reader.is_alive()
