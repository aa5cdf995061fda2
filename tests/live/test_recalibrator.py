"""When a calibration is found anew, and from which data: after pauses, and after sensors have moved."""

from concurrent.futures import Future
from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from tracked import filmed

from vip_factors.errors import SolveError
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array, rotation_z
from vip_factors.live import recalibrator
from vip_factors.live.frames import FrameState, LiveFrame, MeasuredStretch, video_of
from vip_factors.live.recalibrator import Recalibrator
from vip_factors.live.start import EarlierCalibration, TrackingStart
from vip_factors.sensors.live import VideoFrame, sensor_columns, stream_head
from vip_factors.settings import LiveSettings

SETTINGS = LiveSettings()
RATE = 60
NEWEST = FrameState(np.zeros((1, 24, 3, 3)), np.zeros((1, 3)), np.eye(3)[None], np.zeros((1, 3)))
SENSORS = 10  # of the filmed wearer
KNOWN = EarlierCalibration({}, np.zeros((1, 3)))


class Asked:
    """Stands for the process: keeps what it is asked, and finds nothing."""

    asked: list[tuple[MeasuredStretch, EarlierCalibration | None]]
    before: list[TrackingStart | None]
    found: TrackingStart | None = None

    def submit(
        self, stretch: MeasuredStretch, settings: Any, earlier: EarlierCalibration | None, before: TrackingStart | None
    ) -> "Future[Any]":
        self.asked.append((stretch, earlier))
        self.before.append(before)
        answer: Future[Any] = Future()
        if self.found is None:
            answer.set_exception(SolveError("nothing"))
        else:
            answer.set_result(self.found)
        return answer

    def close(self) -> None: ...


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[MeasuredStretch, EarlierCalibration | None]]:
    monkeypatch.setattr(recalibrator, "RecalibrationProcess", Asked)
    Asked.asked, Asked.before = [], []
    return Asked.asked


def recalibrating() -> Recalibrator:
    return Recalibrator(stream_head(filmed()), SETTINGS, real_time=False)


def turned(number: int, angle: Array) -> LiveFrame:
    """All sensors measured, each turned by its ``angle`` ``(S,)`` about the vertical."""
    every, force = np.ones(len(angle), bool), np.zeros((len(angle), 3))
    return LiveFrame(number, number / RATE, rotation_z(angle), every, force, every.copy())


def turning(number: int) -> LiveFrame:
    return turned(number, np.full(SENSORS, number / RATE))


def feed(one: Recalibrator, first: int, frames: int) -> list[Finding]:
    told = list[Finding]()
    for number in range(first, first + frames):
        one.remember(turning(number))
        answer = one.answer(number)
        assert answer is None or isinstance(answer, Finding)
        told += [answer] if answer else []
        one.begin(NEWEST)
    return told


def test_it_is_found_anew_with_twice_the_data_and_then_again_and_again(asked: list[Any]) -> None:
    assert len(feed(recalibrating(), 0, 85 * RATE)) == 6
    assert [len(stretch.frames) / RATE for stretch, _ in asked] == [2.5, 5, 10, 20, 40, 40]
    assert [stretch.frames[-1].number + 1 for stretch, _ in asked[-2:]] == [40 * RATE, 80 * RATE]


def test_after_a_pause_it_begins_with_what_is_known(asked: list[Any]) -> None:
    one = recalibrating()
    feed(one, 0, 4 * RATE)
    one.restart(KNOWN)
    feed(one, 4 * RATE, 3 * RATE)
    assert [len(stretch.frames) / RATE for stretch, _ in asked] == [2.5, 2.5]
    assert asked[-1][0].first_number == 4 * RATE
    assert [earlier for _, earlier in asked] == [None, KNOWN]


def test_what_is_known_from_before_a_pause_grows_old(asked: list[Any]) -> None:
    one = recalibrating()
    feed(one, 0, 4 * RATE)
    one.restart(KNOWN)
    feed(one, 4 * RATE, 81 * RATE)
    assert [earlier for _, earlier in asked[1:]] == [KNOWN] * 5 + [None]


def test_a_sensor_that_has_moved_is_used_from_then_on(asked: list[Any]) -> None:
    one = recalibrating()
    feed(one, 0, 12 * RATE)
    one.leave_out([1], 12 * RATE - 1)
    feed(one, 12 * RATE, 6 * RATE)
    stretch, _ = asked[-1]
    seen = np.stack([frame.orientation_valid for frame in stretch.frames])
    number = np.array([frame.number for frame in stretch.frames])
    assert number[-1] == 17 * RATE - 2
    assert number[0] == SETTINGS.coarse_factor  # a pose that was declared was held before
    assert np.array_equal(seen[:, 1], number >= 12 * RATE)
    assert seen[:, [0, 2]].all()


def test_a_sensor_that_moves_ever_again_does_not_keep_it_from_being_found(asked: list[Any]) -> None:
    one = recalibrating()
    for second in range(12):
        feed(one, second * RATE, RATE)
        one.leave_out([0], second * RATE + RATE - 1)
    assert len(asked) >= 2


def test_the_next_one_goes_on_from_the_last_unless_a_sensor_has_moved(
    asked: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    nothing = cast(Any, None)
    monkeypatch.setattr(Asked, "found", TrackingStart(nothing, nothing, [], [], (), (), in_place=True))
    one = recalibrating()
    for number in range(12 * RATE):
        one.remember(turning(number))
        one.answer(number)
        one.begin(NEWEST)
    assert [before is not None and before.in_place for before in Asked.before] == [False, True, True]
    one.leave_out([1], 12 * RATE - 1)
    for number in range(12 * RATE, 18 * RATE):
        one.remember(turning(number))
        one.begin(NEWEST)
    assert Asked.before[3:] == [None]


@pytest.mark.parametrize(("every", "late"), [(1, 0), (2, 1)])
def test_of_each_camera_one_video_frame_is_kept_for_each_coarse_one(asked: list[Any], every: int, late: int) -> None:
    one, names = recalibrating(), ("a", "b")
    for number in range(3 * RATE):
        none = np.zeros((0, 18, 2)), np.zeros((0, 18))
        video = tuple(VideoFrame(name, number / RATE, *none, number) for name in names)
        one.remember(replace(turning(number), video=video if number % every == late else ()))
        one.begin(NEWEST)
    kept = video_of(asked[0][0].frames)
    for name in names:
        frames = [video.frame for video in kept if video.camera == name]
        assert frames == list(range(late, len(asked[0][0].frames), SETTINGS.coarse_factor))


@pytest.mark.parametrize(("begin_s", "expected_s"), [((0.7, 1.0), 2.5), ((3.0, 0.7), 3.2), ((99.0, 0.7), 5.0)])
def test_who_does_not_move_is_waited_for(asked: list[Any], begin_s: tuple[float, float], expected_s: float) -> None:
    """Each of two wearers turns from a time on."""
    wearer = filmed().wearers[0]
    other = replace(wearer, subject=replace(wearer.subject, name="other"), name="other")
    head = stream_head(replace(filmed(), wearers=(wearer, other)))
    begin = np.repeat(begin_s, len(sensor_columns(head)) // 2)
    one = Recalibrator(head, SETTINGS, real_time=True)
    for number in range(6 * RATE):
        one.remember(turned(number, np.where(number / RATE < begin, 0.0, 0.5)))
        one.begin(NEWEST)
    assert asked[0][0].seconds == pytest.approx(expected_s, abs=0.1)
