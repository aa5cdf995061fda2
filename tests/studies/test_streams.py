"""Studies of streams in small: faults, latency, the whole program, its ends.

A tracker that knows the answers stands in for ours in the whole program.
"""

import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from live_answers import answers, live_scene

from tests.running_processes import begun_by, is_running
from tests.studies import stream_faults, stream_program
from tests.studies.faults import (
    OfSensors,
    chosen_faults,
    clock_faults,
    clocks_leaping,
    delayed,
    everything,
    heading_reset,
    lost,
    of_imus,
    of_video,
    repeated,
    turned_on_bone,
)
from tests.studies.live_run import error_over_time, filled_motion
from tests.studies.long_stream import Long, LongRun, LongStream, LongStreamTrials, stream_scene
from tests.studies.processes import process_tree
from tests.studies.speed import measure
from tests.studies.stream_ends import RATE, DiskFull, FullDisk, StreamKill
from tests.studies.stream_faults import FaultTrial, StreamFaults, run_stream, seconds_until_good
from tests.studies.stream_program import Answers, StreamHour, StreamProgram, StreamSlow, dropped
from tests.studies.study import markdown, run
from vip_factors.body.kinematics import Motion
from vip_factors.errors import InputError, RecordingError, VipFactorsError
from vip_factors.geometry.rotations import angle_between, exp, rotation_z
from vip_factors.io.mcap_recording import read_scene, write_recording
from vip_factors.live_estimate import LiveEstimate, LivePose
from vip_factors.sensors.live import ImuSample, LiveSample, VideoFrame, live_samples, stream_head
from vip_factors.sensors.scene import Scene
from vip_factors.settings import LiveSettings
from vip_factors.simulate.gestures import gestures

STUB = Path(__file__).parents[1] / "stub_tracker.py"
linux_only = pytest.mark.skipif(sys.platform != "linux", reason="processes are looked at in /proc")


# Poses and their errors


def _poses(motion: Motion) -> list[LivePose]:
    return [
        LivePose(float(time), R, p)
        for time, R, p in zip(motion.time, motion.R_parent_child, motion.p_world_pelvis, strict=True)
    ]


def test_errors_over_time_are_free_of_the_gauge() -> None:
    truth, R = gestures(4.0, rate=30.0), rotation_z(0.7)
    turned = truth.R_parent_child.copy()
    turned[:, 0] = R @ turned[:, 0]
    moved = replace(truth, R_parent_child=turned, p_world_pelvis=truth.p_world_pelvis @ R.T + [1.0, 2.0, 3.0])
    poses = _poses(moved)
    over_time = error_over_time([*poses[:10], *poses[20:]], truth.skeleton, truth, 30.0)
    assert np.flatnonzero(np.isnan(over_time)).tolist() == list(range(10, 20))
    assert np.nanmax(over_time) < 1e-6


def test_where_tracking_was_lost_the_pose_before_is_kept() -> None:
    truth = gestures(1.0, rate=30.0)
    poses = _poses(truth)
    motion = filled_motion([*poses[:10], *poses[15:]], truth.skeleton, 30.0, "gestures")
    assert len(motion) == len(truth)
    np.testing.assert_array_equal(motion.p_world_pelvis[14], truth.p_world_pelvis[9])
    np.testing.assert_array_equal(motion.p_world_pelvis[15], truth.p_world_pelvis[15])


# Long streams, and what an update takes: six sensors and a fixed camera, a quarter of the work

TRIALS = LongStreamTrials(seconds=12.0, scene_s=8.0, placement="sip6", camera="fixed")


@pytest.fixture(scope="module")
def stream() -> LongStream:
    return LongStream(stream_scene(TRIALS), TRIALS)


def test_the_stream_goes_on_without_a_jolt_and_with_new_noise(stream: LongStream) -> None:
    samples = list(stream)
    assert all(before.time <= after.time for before, after in pairwise(samples))
    assert 11.9 < samples[-1].time <= TRIALS.seconds
    pelvis = [one for one in samples if isinstance(one, ImuSample) and one.sensor == "pelvis"]
    time, R = (np.stack([getattr(one, name) for one in pelvis]) for name in ("time", "R_inertial_sensor"))
    assert np.diff(time).min() > 0
    around = np.abs(time[1:] - 8.0) < 0.1  # where it turns back the wearer rests: filter errors are all that moves
    assert np.rad2deg(angle_between(R[:-1], R[1:]))[around].max() < 3.0
    there, back = (pelvis[int(np.argmin(np.abs(time - at)))].specific_force for at in (6.0, 10.0))
    assert 0 < np.abs(there - back).max() < 3.0


def test_updates_are_timed_and_the_start_apart(stream: LongStream) -> None:
    within = (sample for sample in stream if sample.time < 1.6)
    latency = measure(within, stream.setup, LiveSettings(), lambda time: None)
    assert 10 < latency.updates < 50
    assert 0 < latency.seconds["median"] <= latency.seconds["99 %"] <= latency.seconds["worst"]
    assert latency.start_s > latency.seconds["median"]


def test_what_is_too_short_is_said(stream: LongStream) -> None:
    few = [sample for sample in stream if sample.time < 0.5]
    with pytest.raises(RecordingError, match="too short"):
        measure(few, stream.setup, LiveSettings(), lambda time: None)
    with pytest.raises(InputError, match="expected at least 8 s"):
        LongStreamTrials(scene_s=3.0)
    with pytest.raises(InputError, match="clip"):
        Long(clip_s=1.0)
    with pytest.raises(InputError, match="hours"):
        Long(hours=0.0)


def test_a_recording_of_hours_is_a_clip_played_forwards_and_backwards(tmp_path: Path) -> None:
    path = tmp_path / "long.mcap"
    Long(hours=20 / 3600, sensors="sip6", clip_s=8.0).write(path)
    recording = read_scene(path).wearers[0]
    assert recording.truth is None
    assert recording.initial_pose == "t-pose"
    assert recording.interval[1] == pytest.approx(20.0, abs=0.1)
    for one in recording.imus.values():
        assert len(one) > 0.95 * 60 * 20
        assert np.diff(one.time).min() > 0.2 / 60
        R = one.R_inertial_sensor
        assert R is not None
        assert np.rad2deg(angle_between(R[:-1], R[1:])).max() < 20.0
        ends = [np.argmin(np.abs(one.time - at)) for at in (5.0, 11.0)]  # of the first lap, and of the second
        assert np.rad2deg(angle_between(R[ends[0]], R[ends[1]])) < 20.0
    row = LongRun(108000, 600.0, 550.0, 200_000_000, 10**9, 10**8, 2 * 10**8)
    assert "| 108000 | 1000 | 200 | 600 | 1200 | 1100 | 100 | 200 |" in markdown(Long(hours=0.5), [row])


# Faults


def test_it_is_good_again_with_the_first_good_second() -> None:
    usual = np.full(50, 20.0)

    def good(*parts: tuple[float, int]) -> float:
        return seconds_until_good(np.concatenate([np.full(n, value) for value, n in parts]), usual, 10.0, 1.0)

    assert good((20.0, 50)) == 0.0
    assert good((20.0, 10), (80.0, 15), (23.0, 25)) == 1.5
    assert good((20.0, 10), (np.nan, 15), (23.0, 25)) == 1.5
    assert np.isnan(good((20.0, 10), (25.0, 40)))


def test_every_fault_is_a_stream() -> None:
    scene = StreamFaults(seconds=9.5, fault_s=3.0).scene("fixed")
    before = list(live_samples(scene))
    for fault in chosen_faults(scene, 3.0, ()):
        after = list(fault.change(before))
        assert after[:2000] == before[:2000]
        assert len(after) > 0.5 * len(before)
    with pytest.raises(InputError, match="expected some of"):
        chosen_faults(scene, 3.0, ("coffee",))
    few = {name: imu for name, imu in scene.wearers[0].imus.items() if name != "pelvis"}
    with pytest.raises(InputError, match="no sensor 'pelvis'"):
        chosen_faults(replace(scene, wearers=(replace(scene.wearers[0], imus=few),)), 3.0, ())
    with pytest.raises(InputError, match="at least 6 s more"):
        StreamFaults(seconds=8.0, fault_s=3.0)
    with pytest.raises(InputError, match="or neither"):
        StreamFaults(clips=("07_02",))


def test_after_a_leap_of_all_clocks_poses_are_on_the_scenes(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = live_scene(1.0, 1)

    class Prompt:
        """Answers each of the pelvis's samples with a pose of that time."""

        def __init__(self, setup: Scene, settings: LiveSettings) -> None:
            self._answer = next(answers(scene))

        def push(self, sample: LiveSample) -> list[LiveEstimate]:
            if not isinstance(sample, ImuSample) or sample.sensor != "pelvis":
                return []
            (one,) = self._answer.wearers
            newest = replace(one.newest, time=sample.time)
            return [replace(self._answer, time=sample.time, wearers=(replace(one, newest=newest),))]

        def finish(self) -> list[LiveEstimate]:
            return []

    monkeypatch.setattr(stream_faults, "FixedLagTracker", Prompt)
    samples = [ImuSample("ann", "pelvis", number / 10, R, FORCE) for number in range(60)]
    fault = next(one for one in clock_faults(2.0) if one.name == "all clocks 60 s ahead")
    ours, usual = (run_stream(samples, scene, LiveSettings(), one) for one in (fault, None))
    assert [one.time for one in ours.poses] == pytest.approx([one.time for one in usual.poses], abs=1e-6)
    assert len(ours.findings) == 60


def test_the_table_says_what_was_measured() -> None:
    trial = FaultTrial(
        "pelvis dead", "fixed", "gestures", (20.0, 50.0, float("nan")), (20.0, 21.0, 22.0), 1.5, 12,
        ((8.0, "it is dead"), (9.0, "it is dead")),
    )  # fmt: skip
    failed = replace(trial, fault="other", failure="ValueError: x", findings=())
    table = markdown(StreamFaults(), [trial, failed])
    assert "| pelvis dead | 20.0 | 50.0 (21.0) | n/a (22.0) | 1.5 | 12 |" in table
    assert "failed: ValueError: x" in table
    assert "8.0 s: it is dead (2 times)" in table


R = exp(np.array([0.1, -0.7, 0.4]))
FORCE = np.array([1.0, -2.0, 9.0])


def samples(seconds: float = 2.0) -> list[LiveSample]:
    """Two sensors at 60 Hz and a camera at 30 Hz, in the order of time."""
    made: list[LiveSample] = []
    for number in range(round(seconds * 60)):
        time = number / 60
        made += [ImuSample("ann", name, time, R, FORCE) for name in ("wrist", "shin")]
        if number % 2 == 0:
            made.append(VideoFrame("phone", time, np.zeros((0, 18, 2)), np.zeros((0, 18))))
    return made


def _key(sample: LiveSample) -> tuple[float, str]:
    return sample.time, sample.sensor if isinstance(sample, ImuSample) else ""


def test_a_share_is_lost_within_the_time_only() -> None:
    left = [_key(one) for one in lost(samples(), of_imus, 0.5, 1.5, 0.3, seed=1)]
    gone = [one for one in samples() if _key(one) not in set(left)]
    assert all(isinstance(one, ImuSample) and 0.5 <= one.time < 1.5 for one in gone)
    assert 0.2 < len(gone) / 120 < 0.4
    assert left == [_key(one) for one in lost(samples(), of_imus, 0.5, 1.5, 0.3, seed=1)]
    assert all(one.sensor != "shin" for one in lost(samples(), OfSensors(["shin"]), 0.0) if isinstance(one, ImuSample))


@given(st.floats(0, 0.5), st.floats(0, 0.2), st.integers(0, 9))
def test_what_is_late_comes_in_the_order_of_its_arrival(delay: float, jitter: float, seed: int) -> None:
    before = samples(1.0)
    after = list(delayed(before, of_video, delay, 0.2, 0.8, jitter, seed))
    assert sorted(map(_key, after)) == sorted(map(_key, before))
    kept = [_key(one) for one in after if isinstance(one, ImuSample)]
    assert kept == [_key(one) for one in before if isinstance(one, ImuSample)]
    newest = -1.0
    for one in after:
        if isinstance(one, ImuSample):
            newest = max(newest, one.time)
        elif 0.2 <= one.time < 0.8:
            assert newest >= min(one.time + delay, 59 / 60) - 2 / 60


def test_samples_are_repeated_turned_and_moved_in_time() -> None:
    after = list(repeated(samples(), everything, 1.0, 0.0))
    assert after[::2] == after[1::2]
    turn = np.array([0.0, 0.6, 0.3])
    for sample in turned_on_bone(samples(), "wrist", turn, 1.0, takes=0.5):
        if isinstance(sample, ImuSample):  # gravity slips with the strap
            np.testing.assert_allclose(sample.R_inertial_sensor @ sample.specific_force, R @ FORCE, atol=1e-12)
            share = np.clip((sample.time - 1.0) / 0.5, 0, 1) if sample.sensor == "wrist" else 0.0
            np.testing.assert_allclose(R.T @ sample.R_inertial_sensor, exp(turn * share), atol=1e-12)
    for sample in heading_reset(samples(), "shin", 1.0, 1.0):
        if isinstance(sample, ImuSample):
            moved = sample.sensor == "shin" and sample.time >= 1.0
            np.testing.assert_allclose(sample.R_inertial_sensor, rotation_z(1.0) @ R if moved else R)
    times = [one.time for one in clocks_leaping(samples(), [(1.0, everything, -5.0)])]
    assert (min(times), max(times) < 1.0) == (-4.0, True)


# The whole program


@pytest.fixture
def command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[str, ...]:
    """That runs the program; and a scene that need not be simulated."""
    scene = live_scene(2.0, 1)
    write_recording(scene, tmp_path / "known.mcap")
    monkeypatch.setattr(stream_program, "apart", lambda work, trials: scene)
    monkeypatch.setattr(stream_program, "START_S", 0.0)
    return sys.executable, str(STUB), str(tmp_path / "known.mcap")


def test_the_whole_program_over_a_second(command: tuple[str, ...]) -> None:
    study = StreamHour(minutes=1.2 / 60, part_minutes=0.6 / 60, command=command)
    *spans, end = rows = run(study)
    assert (end.code, end.rerun, len(spans)) == (0, True, 2)
    assert end.estimate_s == pytest.approx(1.2 - 0.25, abs=0.1)
    assert sum(one.answers for one in spans) == pytest.approx(72, abs=3)
    assert all(one.missing == 0 and one.dropped == (0, 0) for one in spans)
    assert spans[1].newest_mm == pytest.approx(0, abs=0.5)  # a sender is believed after a second
    assert spans[1].bytes[0] > spans[0].bytes[0]
    if sys.platform == "linux":
        assert spans[0].memory[2] >= spans[0].memory[0] > 1e7
    assert spans[1].said[0][1] == "the stream has begun"
    assert "Exit code 0; estimate readable" in markdown(study, rows)
    assert "NOT whole" in markdown(study, [*spans, replace(end, rerun=False)])


@pytest.mark.slow
@linux_only
def test_a_slow_machine_for_a_moment(command: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream_program, "SETTLED_S", 0.3)
    study = StreamSlow(seconds=2.0, begin_s=0.8, end_s=1.2, command=command)
    *spans, end = rows = run(study)
    assert (end.code, len(spans)) == (0, 4)
    assert sum(one.missing for one in spans) == 0
    assert spans[1].cpu_share > 0
    assert end.good_after_s is not None
    assert "Answers were in time again" in markdown(study, rows)


def test_what_cannot_be_slowed_is_told() -> None:
    with pytest.raises(InputError, match="one after the other"):
        StreamSlow(seconds=2.0, begin_s=1.2, end_s=0.8)


def test_what_was_dropped_is_counted_and_answers_are_in_time_again() -> None:
    both = "the tracker does not keep up: 3 video frames and 20 IMU samples were dropped; use fewer"
    assert dropped([both, "fine", both.replace("3 video frames and ", "")]) == (3, 40)
    answers = Answers()
    answers.rows = [(50.0, 3.0), (54.0, 1.0), (55.0, 0.1), (56.0, 0.1), (58.0, 0.1)]
    assert answers.good_after(50.0) == pytest.approx(5.0)
    assert answers.good_after(56.0) == 0.0


@pytest.mark.slow
def test_a_program_that_does_not_begin_is_told() -> None:
    command = (sys.executable, "-c", "import sys; sys.exit('no such thing')")
    with StreamProgram((), lambda answer, age: None, command) as program:
        with pytest.raises(VipFactorsError, match="no such thing"):
            list(program.send(stream_head(live_scene(0.2, 1)), ()))
        assert program.end() == 1


@linux_only
def test_processes_are_found() -> None:
    import os
    import subprocess

    child = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    assert child.pid in begun_by(os.getpid())
    assert is_running(child.pid)
    tree = process_tree(os.getpid())
    assert tree is not None
    assert tree.own > 1e7
    child.communicate()
    assert not is_running(child.pid)
    assert process_tree(child.pid) is None


def test_killed_streams_lose_a_chunk_at_most(tmp_path: Path) -> None:
    study = StreamKill(kills=1, seconds=2.0)
    with pytest.MonkeyPatch.context() as patch:
        known = live_scene(2.0, 1, filmed=False)  # need not be simulated
        patch.setattr("tests.studies.stream_ends.write_recording", lambda made, path: write_recording(known, path))
        write_recording(known, tmp_path / "known.mcap")
        (one,) = found = run(replace(study, command=(sys.executable, str(STUB), str(tmp_path / "known.mcap"))))
    assert one.estimate
    assert one.rerun
    assert one.lost_s < 0.5 + 0.3 + 1 / RATE  # a flush, and a lag that the first pose may be after
    assert one.left == ("e.partial.mcap", "e.partial.rrd")
    assert markdown(study, found).startswith("1 streams killed after")


def test_streams_on_full_disks_are_counted() -> None:
    good = FullDisk(9000, 2, "vip-factors: e.partial.mcap: File too large", named=True, orderly=True)
    bad = FullDisk(8000, 0, "60 frames", named=False, orderly=True)
    told = markdown(DiskFull(), [good, bad])
    assert "2 streams on full disks: exit code not 0 1, file named 1, nothing half-written 2 times" in told
    assert told.splitlines()[1:] == ["", "- 8000 bytes: exit code 0: 60 frames"]
