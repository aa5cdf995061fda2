"""A stream within a program: pushed, followed and listened to, the answers are those of the tracker."""

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path

import numpy as np
import pytest

import vip_factors as vip
from vip_factors.errors import InputError
from vip_factors.live_estimate import LiveEstimate
from vip_factors.sensors.live import LiveItem, LiveLoss, stream_head
from vip_factors.settings import RecalibrationSettings

SLOW = vip.LiveSettings(frame_rate=15.0, recalibration=RecalibrationSettings(use=False))


@pytest.fixture(scope="module")
def recording() -> vip.Scene:
    return vip.simulate(seconds=1.2, placement="sip6", seed=1)


@pytest.fixture(scope="module")
def expected(recording: vip.Scene) -> list[LiveEstimate]:
    tracker = vip.FixedLagTracker(stream_head(recording), SLOW)
    return [answer for sample in vip.live_samples(recording) for answer in tracker.push(sample)] + tracker.finish()


def check_same(answers: list[LiveEstimate], expected: list[LiveEstimate]) -> None:
    assert [answer.frame for answer in answers] == [answer.frame for answer in expected]
    for one, other in zip(answers, expected, strict=True):
        np.testing.assert_allclose(
            one.wearers[0].newest.R_parent_child, other.wearers[0].newest.R_parent_child, atol=1e-9
        )


def test_pushed(recording: vip.Scene, expected: list[LiveEstimate]) -> None:
    stream = vip.Stream(recording, SLOW)
    answers = []
    for sample in vip.live_samples(recording):
        assert isinstance(sample, vip.ImuSample)
        answers += stream.push(
            sample.time, sample.sensor, orientation=sample.R_inertial_sensor, acceleration=sample.specific_force
        )
    check_same(answers + stream.finish(), expected)


def test_followed_beside_an_event_loop(recording: vip.Scene, expected: list[LiveEstimate]) -> None:
    async def arriving() -> AsyncIterator[LiveItem]:
        for sample in vip.live_samples(recording):
            yield sample

    async def answers() -> list[LiveEstimate]:
        return [answer async for answer in vip.Stream(recording, SLOW).follow(arriving())]

    check_same(asyncio.run(answers()), expected)


def test_a_source_that_is_opened(recording: vip.Scene, expected: list[LiveEstimate], tmp_path: Path) -> None:
    check_same(list(vip.stream(vip.write(recording, tmp_path / "walk.mcap"), SLOW)), expected)


def test_raw_samples_track_as_well(recording: vip.Scene, expected: list[LiveEstimate]) -> None:
    stream = vip.Stream(vip.Recording.worn("sip6", initial_pose="n-pose"), SLOW)
    answers = []
    for sample in vip.live_samples(recording):
        assert isinstance(sample, vip.ImuSample)
        answers += stream.push(
            sample.time, sample.sensor, gyroscope=sample.angular_rate, acceleration=sample.specific_force
        )
    answers += stream.finish()
    assert len(answers) == len(expected)
    assert not [finding for answer in answers for finding in answer.findings if finding.kind == "samples unusable"]


def test_a_loss_is_told_with_the_next_answer(recording: vip.Scene) -> None:
    samples = list(vip.live_samples(recording))
    half = len(samples) // 2
    answers = list(vip.Stream(recording, SLOW).estimates([*samples[:half], LiveLoss("3 were lost"), *samples[half:]]))
    assert [str(finding) for answer in answers for finding in answer.findings].count("3 were lost") == 1


def test_a_filmed_scene_with_its_truth_begins_as_well() -> None:
    scene = vip.simulate("gestures", "sip6", "fixed", seconds=1.2, seed=1, initial_pose="none")
    stream = vip.Stream(scene, SLOW, real_time=False)
    answers = []
    for sample in vip.live_samples(scene):
        if isinstance(sample, vip.VideoFrame):
            answers += stream.push_poses(sample.time, sample.pixels, sample.confidence)
        else:
            answers += stream.take(sample)
    assert answers
    assert answers[-1].cameras


def test_who_is_meant_must_be_told(recording: vip.Scene) -> None:
    one = recording.wearers[0]
    two = vip.Scene("two", (one, vip.Recording.worn("sip6", vip.Subject("Bea"))))
    with pytest.raises(InputError, match="without a name: the stream has subject, Bea"):
        vip.Stream(two, SLOW).push(0.0, "head", orientation=np.eye(3))
    with pytest.raises(InputError, match="camera without a name: the stream has none"):
        vip.Stream(one, SLOW).push_poses(0.0, np.zeros((0, 17, 2)))
