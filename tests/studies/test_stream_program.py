"""The whole program in small, fed over the loopback, killed, on full disks.

A tracker that knows the answers stands in for ours.
"""

import sys
from pathlib import Path

import pytest
from live_answers import live_scene

from tests.studies import stream_ends, stream_hour, stream_slow
from tests.studies.long_stream import LongStreamTrials
from tests.studies.processes import begun_by, is_running, process_tree
from tests.studies.stream_ends import DiskFull, FullDisk, StreamKill, small_scene
from tests.studies.stream_hour import Watch, WholeEnd, whole_stream, whole_tables
from tests.studies.stream_program import StreamProgram
from tests.studies.stream_slow import Answers, StreamSlow
from tests.studies.study import markdown, no_news, run
from vip_factors.errors import InputError, VipFactorsError
from vip_factors.io.mcap_recording import write_scene
from vip_factors.sensors.live import stream_head

STUB = Path(__file__).parents[1] / "stub_tracker.py"


@pytest.fixture
def command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[str, ...]:
    """That runs the program; and a scene that need not be simulated."""
    scene = live_scene(2.0, 1)
    write_scene(scene, tmp_path / "known.mcap")
    for module in (stream_hour, stream_slow):
        monkeypatch.setattr(module, "apart", lambda work, trials: scene)
    return sys.executable, str(STUB), str(tmp_path / "known.mcap")


def test_the_whole_program_over_a_second(command: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream_hour, "START_S", 0.0)
    trials = LongStreamTrials(1.2)
    *parts, end = rows = list(whole_stream(trials, 60.0, 0.6, no_news, command))
    assert (end.code, end.rerun) == (0, True)
    assert end.estimate_s == pytest.approx(1.2 - 0.25, abs=0.1)
    assert sum(part.answers for part in parts) == pytest.approx(72, abs=3)
    assert all(part.missing == 0 and part.dropped == (0, 0) for part in parts)
    assert parts[-1].bytes[0] > parts[0].bytes[0]
    if sys.platform == "linux":
        assert parts[0].memory[2] >= parts[0].memory[0] > 1e7
    assert end.said[0][1] == "the stream has begun"
    assert "Exit code 0; estimate readable" in "".join(whole_tables(trials, 60.0, rows))
    assert "NOT whole" in "".join(whole_tables(trials, 60.0, [*parts, WholeEnd(0.0, 0, 1.0, False)]))


def test_what_was_dropped_and_is_missing_is_counted(tmp_path: Path) -> None:
    watch = Watch(10.0)
    both = "the tracker does not keep up: 3 video frames and 20 IMU samples were dropped; use fewer"
    for time, said in ((20.0, []), (20.1, [both]), (20.5, [both.replace("3 video frames and ", "")])):
        watch.take({"time": time, "findings": said}, 0.1)
    part = watch.end_part(21.0, tmp_path)
    assert (part.answers, part.missing, part.findings) == (3, 3, 2)
    assert part.dropped == (3, 40)
    assert not watch.has_answers


@pytest.mark.slow
def test_a_program_that_does_not_begin_is_told() -> None:
    scene = live_scene(0.2, 1)
    command = (sys.executable, "-c", "import sys; sys.exit('no such thing')")
    with StreamProgram((), lambda answer, age: None, command) as program:
        with pytest.raises(VipFactorsError, match="no such thing"):
            list(program.send(stream_head(scene), ()))
        assert program.end() == 1


@pytest.mark.skipif(sys.platform != "linux", reason="processes are looked at in /proc")
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


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="there a process can be stopped and its time read")
def test_a_slow_machine_for_a_moment(command: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream_slow, "SETTLED_S", 0.3)
    study = StreamSlow(seconds=2.0, begin_s=0.8, end_s=1.2, command=command)
    (result,) = run(study)
    assert result.code == 0
    assert [part.name for part in result.parts] == ["before", "during", "after"]
    assert sum(part.missing for part in result.parts) == 0
    assert result.parts[0].newest_mm == pytest.approx(0, abs=0.5)
    assert result.needed > 0
    assert "got 0.5 of that" in markdown(study, [result])
    with pytest.raises(InputError, match="one after the other"):
        StreamSlow(seconds=2.0, begin_s=1.2, end_s=0.8)


def test_answers_are_in_time_again() -> None:
    answers = Answers()
    ages = [(50.0, 3.0), (54.0, 1.0), (55.0, 0.1), (56.0, 0.1), (58.0, 0.1)]
    answers._rows = [(time, age, 0.0) for time, age in ages]
    assert answers.good_after(50.0) == pytest.approx(5.0)
    assert answers.good_after(56.0) == 0.0


def test_killed_streams_lose_a_chunk_at_most(tmp_path: Path) -> None:
    write_scene(small_scene(2.0), tmp_path / "known.mcap")
    command = (sys.executable, str(STUB), str(tmp_path / "known.mcap"))
    study = StreamKill(kills=1, seconds=2.0, command=command)
    found = run(study)
    for one in found:
        assert one.estimate
        assert one.rerun
        assert one.lost_s < 0.5 + 0.3 + 1 / stream_ends.RATE  # a flush, and a lag that the first pose may be after
        assert one.left == ("e.partial.mcap", "e.partial.rrd")
    assert markdown(study, found).startswith("1 streams killed after")


def test_streams_on_full_disks_are_counted() -> None:
    good = FullDisk(9000, 2, "vip-factors: e.partial.mcap: File too large", named=True, orderly=True)
    bad = FullDisk(8000, 0, "60 frames", named=False, orderly=True)
    assert good.good
    told = markdown(DiskFull(), [good, bad])
    assert "2 streams on full disks: exit code not 0 1, file named 1, nothing half-written 2 times" in told
    assert told.splitlines()[1:] == ["", "- 8000 bytes: exit code 0: 60 frames"]
