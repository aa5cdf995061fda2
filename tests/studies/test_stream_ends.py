"""Streams that are killed or fill the disk, in small: a tracker that knows the answers stands in for ours."""

import sys
from pathlib import Path

from tests.studies import stream_ends
from tests.studies.stream_ends import DiskFull, FullDisk, StreamKill, small_scene
from tests.studies.study import markdown, run
from vip_factors.io.mcap_recording import write_scene

STUB = Path(__file__).parents[1] / "stub_tracker.py"


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
