"""Streams that are killed or fill the disk, in small: a tracker that knows the answers stands in for ours."""

import sys
from pathlib import Path

from vip_factors.benchmark import stream_ends
from vip_factors.benchmark.stream_ends import (
    EndTrials,
    disk_full_table,
    ends_json,
    kill_table,
    run_disk_full,
    run_stream_kill,
    small_scene,
)
from vip_factors.io.mcap_scene_recording import write_scene

STUB = Path(__file__).parents[1] / "stub_tracker.py"


def trials(folder: Path, count: int) -> EndTrials:
    write_scene(small_scene(2.0), folder / "known.mcap")
    return EndTrials(count, 2.0, command=(sys.executable, str(STUB), str(folder / "known.mcap")))


def test_killed_streams_lose_a_chunk_at_most(tmp_path: Path) -> None:
    found = run_stream_kill(trials(tmp_path, 1))
    for one in found:
        assert one.estimate
        assert one.rerun
        assert one.lost_s < 0.5 + 0.3 + 1 / stream_ends.RATE  # a flush, and a lag that the first pose may be after
        assert one.left == ("e.partial.mcap", "e.partial.rrd")
    assert kill_table(found).startswith("1 streams killed after")
    assert "lost_s" in ends_json(found)


def test_streams_on_full_disks_say_so(tmp_path: Path) -> None:
    found = run_disk_full(trials(tmp_path, 1))
    assert all(one.good for one in found), disk_full_table(found)
    assert "exit code not 0 1, file named 1, nothing half-written 1 times" in disk_full_table(found)
