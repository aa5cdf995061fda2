"""Streams as they come in the field: silences, clocks that leap, absurd samples. Nothing ends the stream."""

import re
from dataclasses import replace

import numpy as np
import pytest
from assembly_stream import CAMERA, COLUMNS, RATE, assemble, findings_of, in_time, sample, stream, video

from vip_factors.errors import InputError
from vip_factors.live.assembly import FrameAssembler
from vip_factors.live.frames import LiveFrame
from vip_factors.sensors.live import ImuSample
from vip_factors.settings import AssemblySettings

WRIST = ("Ada", "wrist")
OTHERS = [("Ada", "hip"), ("Bo", "hip")]


def started() -> FrameAssembler:
    """One second of everything has come."""
    assembler = FrameAssembler(COLUMNS, RATE, cameras=[CAMERA])
    assemble(stream(0.0, 1.0), assembler, flush=False)
    assert findings_of(assembler) == ()
    return assembler


def consecutive(frames: list[LiveFrame], first: int = 60) -> bool:
    return [frame.number for frame in frames] == list(range(first, first + len(frames)))


def test_a_silent_sensor_is_given_up_and_welcomed_back() -> None:
    assembler = started()
    assemble(stream(1.0, 3.0, OTHERS), assembler, flush=False)
    assert findings_of(assembler) == ("sensor 'wrist' of 'Ada' has been silent for 1.0 s: going on without it",)
    frame, *_ = assemble(stream(3.0, 3.0 + 1 / RATE, OTHERS), assembler, flush=False)
    assert frame.time == pytest.approx(3.0), "not waited for any more"
    frames = assemble(stream(3.0 + 1 / RATE, 3.5), assembler)
    assert findings_of(assembler) == ("sensor 'wrist' of 'Ada' is back",)
    assert np.all(frames[-1].orientation_valid)
    assert np.all(frames[-1].acceleration_valid_before)


def test_a_sensor_that_begins_late_is_not_waited_for() -> None:
    assembler = FrameAssembler(COLUMNS, RATE)
    assemble(stream(0.0, 1.0, OTHERS), assembler, flush=False)
    assert findings_of(assembler) == ("sensor 'wrist' of 'Ada' has sent nothing yet: going on without it",)
    assert np.all(assemble(stream(1.0, 1.5), assembler)[-1].orientation_valid)
    assert findings_of(assembler) == ("sensor 'wrist' of 'Ada' sends now",)


def test_frames_over_a_pause_of_all_are_there_with_nothing_valid() -> None:
    assembler = started()
    frames = assemble(stream(3.0, 4.0), assembler)
    assert consecutive(frames)
    np.testing.assert_allclose([frame.time for frame in frames], 1.0 + np.arange(len(frames)) / RATE, atol=1e-9)
    pause = [frame for frame in frames if 1.05 < frame.time < 2.95]
    assert len(pause) > 110
    assert not any(np.any(one.orientation_valid) or np.any(one.acceleration_valid_before) for one in pause)
    assert not any(frame.restart for frame in frames)
    assert all(np.all(frame.orientation_valid) for frame in frames if frame.time > 3.05)
    assert findings_of(assembler) == ("all sensors were silent for 2.0 s from 0.98 s on: going on",)


def test_after_a_long_pause_tracking_starts_again() -> None:
    assembler = started()
    frames = assemble(stream(20.0, 21.0), assembler)
    assert consecutive(frames)
    assert [frame.restart for frame in frames] == [True] + [False] * (len(frames) - 1)
    assert frames[0].time == pytest.approx(20.0, abs=2 / RATE)
    assert (frames[0].time * RATE) % 1 == pytest.approx(0, abs=1e-6)
    assert np.all(frames[3].acceleration_valid_before)
    assert findings_of(assembler) == ("all sensors were silent for 19.0 s from 0.98 s on: tracking starts again",)


@pytest.mark.parametrize("time", [0.1, 1.9, 4.0])
def test_video_of_before_a_long_pause_is_not_placed_behind_it(time: float) -> None:
    assembler = started()
    assembler.push(video(time))
    frames = assemble(in_time(stream(20.0, 21.0), [video(20.5)]), assembler)
    ((frame, placed),) = [(frame, one) for frame in frames for one in frame.video]
    assert placed.time == 20.5
    assert frames[placed.frame - 60].time == pytest.approx(20.5)
    assert frame.number - placed.frame in (0, 1)


def test_one_stray_stamp_ahead_makes_nobody_late() -> None:
    assembler = started()
    stray = sample(WRIST, 1.0, stamp=4.0)
    frames = assemble([stray, *stream(1.0, 2.0)], assembler)
    assert all(np.all(frame.orientation_valid) for frame in frames)
    assert consecutive(frames)
    (finding,) = findings_of(assembler)
    assert finding == "the clock of sensor 'wrist' of 'Ada' jumped from 0.98 s to 4.00 s: such samples are refused"


@pytest.mark.parametrize("leap", [-500.0, 500.0])
def test_a_clock_that_starts_again_is_followed(leap: float) -> None:
    assembler = started()
    leapt = [replace(one, time=one.time + leap) if one.sensor == "wrist" else one for one in stream(1.0, 3.0)]
    frames = assemble(leapt, assembler)
    assert consecutive(frames)
    (told,) = findings_of(assembler)
    assert re.search(r"jumped from 1.00 s to .* s: it goes on from there, its .* s are taken for 1.50 s", told)
    later = [frame for frame in frames if frame.time > 1.6]
    assert all(np.all(one.orientation_valid) for one in later)
    truth = sample(WRIST, later[-1].time).R_inertial_sensor
    np.testing.assert_allclose(later[-1].R_inertial_sensor[1], truth, atol=0.05)  # a period off: by arrival alone


def test_clocks_that_start_again_together_stay_in_step() -> None:
    assembler = started()
    assembler.push(video(0.97))
    videos = [video(1.0 + period / 30) for period in range(60)]
    again = [replace(one, time=one.time - 500.0) for one in in_time(stream(1.0, 3.0), videos)]
    frames = assemble(again, assembler)
    assert consecutive(frames)
    assert len(frames) == pytest.approx(1.5 * RATE, abs=2)
    last = frames[-10]
    assert np.all(last.acceleration_valid_before)
    moments = last.time + np.linspace(0.4, 0.6, 401)  # half a second was refused; one instant explains all sensors
    errors = [
        max(
            np.abs(R - sample(c, t).R_inertial_sensor).max()
            for c, R in zip(COLUMNS, last.R_inertial_sensor, strict=True)
        )
        for t in moments
    ]
    assert min(errors) < 2e-3
    assert sum(len(frame.video) for frame in frames) > 30


@pytest.mark.parametrize("epoch", [-1e6, 1e6])
@pytest.mark.parametrize("which", COLUMNS)
def test_clocks_with_epochs_of_their_own_are_brought_together(epoch: float, which: tuple[str, str]) -> None:
    samples = [
        replace(one, time=one.time + epoch) if (one.carrier, one.sensor) == which else one for one in stream(0.0, 4.0)
    ]
    frames = assemble(samples, FrameAssembler(COLUMNS, RATE))
    assert 100 < len(frames) < 300
    assert np.all(frames[-5].orientation_valid)


def test_a_first_sample_of_another_age_does_not_spoil_the_rest() -> None:
    frames = assemble([sample(WRIST, 0.0, stamp=1e9), *stream(0.0, 4.0)], FrameAssembler(COLUMNS, RATE))
    assert len(frames) < 300
    assert np.all(frames[-5].orientation_valid)


def test_a_backlog_is_late_but_keeps_its_times() -> None:
    assembler = started()
    assemble(stream(1.0, 12.0, OTHERS), assembler, flush=False)
    assemble(stream(1.0, 12.0, [WRIST]), assembler, flush=False)
    frames = assemble(stream(12.0, 13.0), assembler)
    assert np.all(frames[-1].orientation_valid)
    truth = sample(WRIST, frames[-1].time).R_inertial_sensor
    np.testing.assert_allclose(frames[-1].R_inertial_sensor[1], truth, atol=1e-3)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"time": float("nan")}, "a time stamp is not finite"),
        ({"time": 1e300}, "a time stamp of 1e+300 s"),
        ({"R_inertial_sensor": None}, "they carry neither an orientation nor the angular rate"),
        ({"R_inertial_sensor": np.full((3, 3), np.nan)}, "an orientation is not a (3, 3) matrix of finite numbers"),
        ({"R_inertial_sensor": np.eye(4)}, "an orientation is not a (3, 3) matrix of finite numbers"),
        ({"R_inertial_sensor": np.diag([1.0, 1.0, -1.0])}, "an orientation is not a rotation matrix"),
        ({"R_inertial_sensor": np.eye(3) * 1.01}, "an orientation is not a rotation matrix"),
        ({"specific_force": np.array([0.0, np.inf, 0.0])}, "a specific force is not three finite numbers"),
        ({"specific_force": np.zeros(2)}, "a specific force is not three finite numbers"),
        ({"specific_force": np.array([0.0, 9810.0, 0.0])}, "a specific force of 9.81e+03 m/s²"),
    ],
)
def test_absurd_samples_are_skipped_and_told_once(change: dict[str, object], reason: str) -> None:
    assembler = started()
    bad = [replace(sample(WRIST, 1.001), **change) for _ in range(5)]  # type: ignore[arg-type]
    frames = assemble([*bad, *stream(1.0, 2.0)], assembler, flush=False)
    assert all(np.all(frame.orientation_valid) for frame in frames)
    (finding,) = findings_of(assembler)
    assert finding.startswith(f"sensor 'wrist' of 'Ada': 1 sample skipped: {reason}")
    assembler.flush()
    (finding,) = findings_of(assembler)
    assert finding.startswith("sensor 'wrist' of 'Ada': 4 samples skipped")


def test_samples_of_frames_made_long_ago_are_counted() -> None:
    assembler = started()
    assemble([sample(WRIST, 0.85 + 0.001 * n) for n in range(12)], assembler)
    assert findings_of(assembler) == (
        "sensor 'wrist' of 'Ada': 1 sample came too late",
        "sensor 'wrist' of 'Ada': 11 samples came too late",
    )


def test_a_sensor_that_is_always_late_is_not_waited_for() -> None:
    assembler = started()
    late = [replace(one, time=one.time - 0.15) for one in stream(1.0, 4.0, [WRIST])]
    samples = [one for three in zip(*(stream(1.0, 4.0, [c]) for c in OTHERS), late, strict=True) for one in three]
    frames = assemble(samples, assembler, flush=False)
    assert frames[-1].time == pytest.approx(4.0 - 1 / RATE)
    assert any("has come too late for" in one for one in findings_of(assembler))
    frames = assemble(stream(4.0, 5.0), assembler)
    assert np.all(frames[-1].orientation_valid)


def test_one_clock_ahead_makes_not_all_others_late() -> None:
    columns = [("Ada", name) for name in "abcde"]
    samples = [replace(one, time=one.time + (0.2 if one.sensor == "a" else 0.0)) for one in stream(0.0, 3.0, columns)]
    assembler = FrameAssembler(columns, RATE)
    frames = assemble(samples, assembler, flush=False)
    assert all(np.all(frame.orientation_valid[1:]) for frame in frames)
    assert findings_of(assembler) == ()


def test_unknown_names_are_told_once_each_and_bounded() -> None:
    assembler = started()
    for number in range(150):
        for _ in range(2):
            assembler.push(ImuSample("Eve", f"{number}" * 200, 1.0, np.eye(3)))
    findings = findings_of(assembler)
    assert len(findings) == 101
    assert findings[0].startswith("sensor '0000")
    assert all(len(finding) < 200 for finding in findings)
    assembler.push(replace(video(1.0), camera="door"))
    assert findings_of(assembler) == ()


@pytest.mark.parametrize(
    "change",
    [
        {"pixels": np.zeros((1, 17, 2)), "confidence": np.ones((1, 17))},
        {"confidence": np.ones((2, 18))},
        {"pixels": np.full((1, 18, 2), np.nan)},
        {"pixels": np.full((1, 18, 2), 1e9)},
        {"confidence": np.full((1, 18), np.nan)},
        {"pixels": np.zeros((1001, 18, 2)), "confidence": np.ones((1001, 18))},
        {"pixels": "none"},
        {"time": float("inf")},
    ],
)
def test_absurd_video_frames_are_skipped(change: dict[str, object]) -> None:
    assembler = started()
    assembler.push(replace(video(1.0), **change))  # type: ignore[arg-type]
    assert not any(frame.video for frame in assemble(stream(1.0, 1.5), assembler))
    (finding,) = findings_of(assembler)
    assert finding.startswith("camera 'phone': 1 video frame skipped: ")


def test_keypoints_that_were_not_found_may_be_nan() -> None:
    assembler = started()
    frame = video(1.0)
    frame.pixels[0, 3] = np.nan
    frame.confidence[0, 3] = 0.0
    assembler.push(frame)
    assert sum(len(one.video) for one in assemble(stream(1.0, 1.5), assembler)) == 1


def test_what_is_no_sample_is_refused() -> None:
    with pytest.raises(InputError, match="ImuSample"):
        started().push("hello")  # type: ignore[arg-type]


def test_an_empty_stream_ends_without_frames() -> None:
    assembler = FrameAssembler(COLUMNS, RATE, AssemblySettings(), [CAMERA])
    assembler.push(video(0.0))
    assert assembler.flush() == []
    assert findings_of(assembler) == ()


def test_a_gap_of_dropped_samples_is_not_blamed_on_the_sensors() -> None:
    assembler = started()
    assembler.note_loss()
    assemble(stream(3.0, 4.0), assembler)
    (finding,) = findings_of(assembler)
    assert finding == (
        "all sensors were silent for 2.0 s from 0.98 s on, as the tracker did not keep up and their samples were "
        "dropped: going on"
    )


def test_one_sensor_without_samples_is_not_called_silent_where_some_were_dropped() -> None:
    assembler = started()
    assembler.note_loss()
    assemble(stream(1.0, 3.0, OTHERS), assembler, flush=False)
    (finding,) = findings_of(assembler)
    assert finding == (
        "sensor 'wrist' of 'Ada' is without samples for 1.0 s, as the tracker did not keep up and dropped some: "
        "going on without it"
    )


def test_clocks_that_leap_together_are_told_once_and_counted() -> None:
    columns = [("Ada", f"sensor{number}") for number in range(13)]
    assembler = FrameAssembler(columns, RATE)
    assemble(stream(0.0, 1.0, columns), assembler, flush=False)
    told = []
    for one in stream(1.0, 6.0, columns):
        assembler.push(replace(one, time=one.time - 60.0))
        told += findings_of(assembler)
    (sentence,) = told
    assert "'sensor0' of 'Ada' jumped from 0.98 s to -59.00 s" in sentence
    assert sentence.endswith("; so did 12 more")


@pytest.mark.parametrize("leap", [-0.3, -1.0, 0.3, 1.0])
def test_a_small_step_of_one_clock_is_followed_and_told_once(leap: float) -> None:
    assembler, told = started(), []
    frames = []
    for one in stream(1.0, 4.0):
        frames += assembler.push(replace(one, time=one.time + leap) if one.sensor == "wrist" else one)
        told += findings_of(assembler)
    (sentence,) = told
    assert "'wrist' of 'Ada' jumped" in sentence
    later = [frame for frame in frames if frame.time > 1.6]
    assert len(later) > 130
    for one in later:
        assert np.all(one.orientation_valid)
        truth = sample(WRIST, one.time).R_inertial_sensor
        np.testing.assert_allclose(one.R_inertial_sensor[1], truth, atol=0.05)  # a period off: by arrival alone


def test_every_jump_is_told_but_not_for_ever() -> None:
    assembler, told = started(), list[float]()
    for one in stream(1.0, 41.0):
        leaps = 100.0 * int(one.time)  # every second
        assembler.push(replace(one, time=one.time + leaps) if one.sensor == "wrist" else one)
        told += [one.time for sentence in findings_of(assembler) if "jumped" in sentence]
    assert 11 <= len(told) <= 14
    assert np.all(np.diff(told[:10]) < 1.2)


def test_a_clock_without_any_order_is_told_once() -> None:
    assembler, random, told = started(), np.random.default_rng(0), []
    for one in stream(1.0, 6.0):
        stamp = float(random.uniform(-1e4, 1e4))
        assembler.push(replace(one, time=stamp) if one.sensor == "wrist" else one)
        told += findings_of(assembler)
    assert [("jumped" in one, "silent" in one) for one in told].count((True, False)) == 1
    assert len(told) == 2


def test_gaps_of_dropped_samples_are_no_jumps_of_clocks() -> None:
    columns = [("Ada", f"sensor{number}") for number in range(13)]
    assembler, told = FrameAssembler(columns, RATE), list[str]()
    for period, one in enumerate(stream(0.0, 8.0, columns)):
        # What is dropped need not begin or end with all sensors at once.
        if 13 * 120 + 5 <= period < 13 * 250 + 3 or 13 * 250 + 7 <= period < 13 * 370 + 1:
            continue
        if period == 13 * 250 + 3:
            assembler.note_loss()
        assembler.push(one)
        told += findings_of(assembler)
    assert told
    assert not any("clock" in one for one in told)
