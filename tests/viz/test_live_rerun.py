"""Live Rerun: the process beside the tracker, its file, and what becomes of the tracker when it ends."""

import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from live_answers import answer, answers, live_scene, setup_of

from vip_factors.errors import InputError, VipFactorsError
from vip_factors.live_estimate import LiveEstimate
from vip_factors.sensors.live import VideoFrame, live_samples
from vip_factors.sensors.scene import Scene
from vip_factors.viz import live_rerun
from vip_factors.viz.live_rerun import LiveRerunSink, LiveTarget
from vip_factors.viz.live_view import LiveView
from vip_factors.viz.viewer import complete


def items_of(scene: Scene) -> list[LiveEstimate | VideoFrame]:
    video = [one for one in live_samples(scene) if isinstance(one, VideoFrame)]
    return sorted([*answers(scene), *video], key=lambda one: (one.time, isinstance(one, LiveEstimate)))


def printed(rrd: Path) -> str:
    rerun = Path(sys.executable).with_name("rerun")
    done = subprocess.run([str(rerun), "rrd", "print", "-v", str(rrd)], capture_output=True, text=True, check=True)
    return done.stdout.replace("\\ ", "_")


def drawn(scene: Scene, items: list[LiveEstimate | VideoFrame], rrd: Path, at_once: int = 5) -> set[str]:
    """The entities of the file, drawn in this process."""
    stream = rr.RecordingStream("test")
    stream.save(rrd)
    view = LiveView(stream, setup_of(scene), 60.0)
    for start in range(0, len(items), at_once):
        view.log(items[start : start + at_once])
    stream.flush()
    stream.disconnect()
    return set(re.findall(r"/(?:world|plots|findings|summary|legend)[^\s`:,]*", printed(rrd)))


def test_bodies_camera_people_and_curves_are_there(tmp_path: Path) -> None:
    scene = live_scene(0.5)
    there = drawn(scene, items_of(scene), tmp_path / "a.rrd")
    for entity in (
        "/world/ann/newest/left_knee", "/world/bob/smoothed/left_knee", "/world/camera", "/world/camera/image",
        "/world/camera/image/detected/ann/points", "/world/ann/newest/joints",
        "/world/camera/image/body/ann/limbs", "/world/ann/newest/head/head", "/plots/heading/ann/head",
        "/plots/heading_sigma/bob/head", "/plots/pose_sigma/ann", "/plots/update_ms", "/findings", "/summary",
        "/legend/sensors", "/world/centre",
    ):  # fmt: skip
        assert entity in there, entity
    assert any("nobody" in entity for entity in there)  # the stranger


def test_without_a_camera_covariances_and_calibration(tmp_path: Path) -> None:
    scene = live_scene(0.3, 1, filmed=False)
    bare = [
        replace(one, wearers=tuple(replace(wearer, calibration={}) for wearer in one.wearers))
        for one in answers(scene, covariance=False)
        if one.frame % 7 != 3  # some were dropped
    ]
    there = drawn(scene, bare, tmp_path / "a.rrd")
    assert "/world/ann/newest/pelvis" in there
    assert not any("camera" in entity or "heading" in entity for entity in there)


def test_the_process_writes_the_file_whole(tmp_path: Path) -> None:
    scene = live_scene(0.5)
    rrd = tmp_path / "a.rrd"
    sink = LiveRerunSink(setup_of(scene), LiveTarget(save=rrd))
    items = items_of(scene)
    for item in items:
        sink.write(item) if isinstance(item, LiveEstimate) else sink.write_video(item)
    assert sink.close() == ()
    assert sink.close() == ()
    assert sink.dropped == 0
    assert [path.name for path in tmp_path.iterdir()] == ["a.rrd"]
    there = printed(rrd)
    assert "/world/bob/smoothed/head" in there
    assert "/world/camera/image/detected/ann/points" in there


def test_a_full_queue_drops_and_never_waits(tmp_path: Path) -> None:
    scene = live_scene(0.1)
    sink = LiveRerunSink(setup_of(scene), LiveTarget(save=tmp_path / "a.rrd"), queue_items=3)
    os.kill(sink._process.pid, signal.SIGSTOP)  # a viewer that hangs
    one = answer(scene, 0)
    for _ in range(50):
        sink.write(one)
    assert sink.dropped >= 47
    os.kill(sink._process.pid, signal.SIGCONT)
    sink.close()


def test_the_tracker_goes_on_without_its_viewer(tmp_path: Path) -> None:
    scene = live_scene(0.1)
    sink = LiveRerunSink(setup_of(scene), LiveTarget(save=tmp_path / "a.rrd"), queue_items=3)
    sink._process.kill()
    sink._process.join()
    for _ in range(20):
        sink.write(answer(scene, 0))
    assert any("goes on without it" in one for one in sink.findings())
    assert sink.findings() == ()  # said once
    sink.write(answer(scene, 0))
    sink.close()


@pytest.mark.parametrize("name", ["a.rrd", "a.partial.rrd"])
def test_a_file_that_exists_is_kept(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"mine")
    with pytest.raises(InputError, match=f"{name} exists"):
        LiveRerunSink(setup_of(live_scene(0.1)), LiveTarget(save=tmp_path / "a.rrd"))
    assert (tmp_path / name).read_bytes() == b"mine"


def test_a_viewer_that_cannot_draw_says_why(tmp_path: Path) -> None:
    (tmp_path / "gone").mkdir()
    sink = LiveRerunSink(setup_of(live_scene(0.1)), LiveTarget(save=tmp_path / "gone" / "a.rrd"))
    (tmp_path / "gone").rmdir()
    sink._process.join(30)
    assert any("the viewer stopped" in one for one in sink.findings())
    sink.close()
    assert "a.rrd: it was not written whole" in sink.lost


ORPHAN = """
import os, sys, time
sys.path.insert(0, sys.argv[1])
from live_answers import answer, live_scene, setup_of
from pathlib import Path
from vip_factors.viz.live_rerun import LiveRerunSink, LiveTarget
if __name__ == "__main__":
    scene = live_scene(0.1)
    sink = LiveRerunSink(setup_of(scene), LiveTarget(save=Path(sys.argv[2])))
    writer = sink._queue._writer
    def send(content):
        writer.send_bytes(content)
        if sys.argv[3] == "half an item":
            os.write(writer.fileno(), (1000).to_bytes(4) + b"half")
        print(sink._process.pid, flush=True)
    sink._queue._send_bytes = send
    sink.write(answer(scene, 0))
    time.sleep(60)
"""


@pytest.mark.parametrize("last", ["whole", "half an item"])
def test_a_killed_tracker_leaves_no_process(tmp_path: Path, last: str) -> None:
    script = tmp_path / "orphan.py"
    script.write_text(ORPHAN)
    command = [sys.executable, str(script), str(Path(__file__).parents[1]), str(tmp_path / "a.rrd"), last]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as tracker:
        viewer = int(tracker.stdout.readline())
        tracker.kill()
    deadline = time.monotonic() + 20
    while Path(f"/proc/{viewer}").exists() or _alive(viewer):
        assert time.monotonic() < deadline
        time.sleep(0.1)
    assert "/world/ann/newest/head" in printed(tmp_path / "a.partial.rrd")
    assert not (tmp_path / "a.rrd").exists()


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_most_answers_travel_without_covariances() -> None:
    slim = live_rerun._slim(answer(live_scene(0.5), 20))
    assert slim.wearers[0].newest.joint_covariance is None
    assert slim.wearers[0].smoothed.root_covariance is None
    assert slim.wearers[0].calibration == {}
    np.testing.assert_array_equal(slim.wearers[0].smoothed.time, 5 / 60)


def test_nothing_of_rerun_is_loaded_beside_the_tracker() -> None:
    code = "import sys, vip_factors.viz.live_rerun; sys.exit('rerun' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.fixture(autouse=True)
def _quiet(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_rerun, "END_S", 10.0)


def test_a_file_that_rerun_could_not_write_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stream = rr.RecordingStream("test")
    stream.save(tmp_path / "a.partial.rrd")
    stream.log("a", rr.TextDocument("x"))
    complete(stream, tmp_path / "a.partial.rrd", tmp_path / "a.rrd")
    (tmp_path / "cut.rrd").write_bytes((tmp_path / "a.partial.rrd").read_bytes()[:-100])
    with pytest.raises(VipFactorsError, match=r"a\.rrd: Rerun could not write it"):
        complete(stream, tmp_path / "cut.rrd", tmp_path / "a.rrd")
    monkeypatch.setattr("vip_factors.viz.viewer.FULL_BYTES", 1 << 62)
    with pytest.raises(OSError, match=r"No space left on device: .*a.rrd"):
        complete(stream, tmp_path / "cut.rrd", tmp_path / "a.rrd")
