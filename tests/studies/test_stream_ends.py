"""Streams that are killed or fill the disk, in small: a tracker that knows the answers stands in for ours."""

import sys
from pathlib import Path

from tests.studies import stream_ends
from tests.studies.stream_ends import (
    EndTrials,
    FullDisk,
    disk_full_table,
    ends_json,
    kill_table,
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


def test_streams_on_full_disks_are_counted() -> None:
    good = FullDisk(9000, 2, "vip-factors: e.partial.mcap: File too large", named=True, orderly=True)
    bad = FullDisk(8000, 0, "60 frames", named=False, orderly=True)
    assert good.good
    told = disk_full_table([good, bad])
    assert "2 streams on full disks: exit code not 0 1, file named 1, nothing half-written 2 times" in told
    assert told.splitlines()[1:] == ["- 8000 bytes: exit code 0: 60 frames"]
