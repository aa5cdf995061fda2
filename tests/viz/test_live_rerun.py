"""A stream in Rerun: what is drawn, its file, and that nothing of it holds the tracker up."""

import re
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
import rerun as rr
from live_answers import answer, answers, live_scene, setup_of
from rerun_files import printed

from vip_factors.errors import InputError, VipFactorsError
from vip_factors.live_estimate import LiveEstimate
from vip_factors.sensors.live import VideoFrame, live_samples
from vip_factors.sensors.scene import Scene
from vip_factors.viz.live_rerun import LiveRerunSink, LiveView
from vip_factors.viz.viewer import complete


def items_of(scene: Scene) -> list[LiveEstimate | VideoFrame]:
    video = [one for one in live_samples(scene) if isinstance(one, VideoFrame)]
    return sorted([*answers(scene), *video], key=lambda one: (one.time, isinstance(one, LiveEstimate)))


def drawn(scene: Scene, items: list[LiveEstimate | VideoFrame], rrd: Path, at_once: int = 5) -> set[str]:
    """The entities of the file, drawn in this process."""
    stream = rr.RecordingStream("test")
    stream.save(rrd)
    view = LiveView(stream, setup_of(scene), 60.0)
    for start in range(0, len(items), at_once):
        view.log(items[start : start + at_once])
    stream.flush()
    stream.disconnect()
    return set(re.findall(r"/(?:world|plots|summary)[^\s`:,]*", printed(rrd)))


@pytest.mark.parametrize("at_once", [1, 40])
def test_bodies_camera_people_and_curves_are_there(tmp_path: Path, at_once: int) -> None:
    scene = live_scene(0.5)
    items = items_of(scene)
    twice = [one for one in items for _ in range(2 if isinstance(one, VideoFrame) else 1)]
    there = drawn(scene, twice, tmp_path / "a.rrd", at_once)
    for entity in (
        "/world/ann/newest/left_knee", "/world/bob/smoothed/left_knee", "/world/camera", "/world/camera/image",
        "/world/camera/image/detected/ann/points", "/world/camera/image/body/ann/limbs",
        "/world/ann/newest/head/head", "/plots/heading_sigma/bob", "/plots/pose_sigma/ann",
        "/plots/update_ms", "/summary", "/world/centre",
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
    assert not any("camera" in entity for entity in there)


def test_the_file_is_written_whole(tmp_path: Path) -> None:
    scene = live_scene(0.5)
    sink = LiveRerunSink(setup_of(scene), save=tmp_path / "a.rrd")
    for item in items_of(scene):
        sink.write(item)
    assert sink.close() == ()
    assert sink.close() == ()
    assert (sink.dropped, sink.lost) == (0, "")
    assert [path.name for path in tmp_path.iterdir()] == ["a.rrd"]
    there = printed(tmp_path / "a.rrd")
    assert "/world/bob/smoothed/head" in there
    assert "/world/camera/image/detected/ann/points" in there


@pytest.mark.parametrize("name", ["a.rrd", "a.partial.rrd"])
def test_a_file_that_exists_is_kept(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"mine")
    with pytest.raises(InputError, match=f"{name} exists"):
        LiveRerunSink(setup_of(live_scene(0.1)), save=tmp_path / "a.rrd")
    assert (tmp_path / name).read_bytes() == b"mine"


@pytest.mark.slow  # Rerun goes on trying for seconds
def test_a_viewer_that_is_not_there_holds_nothing_up() -> None:
    scene = live_scene(0.2)
    sink = LiveRerunSink(setup_of(scene), connect="rerun+http://127.0.0.1:9/proxy")
    for one in answers(scene):
        sink.write(one)
    assert any("never reached" in sentence for sentence in sink.close())


def test_a_drawing_that_fails_says_why_and_ends(tmp_path: Path) -> None:
    scene = live_scene(0.1)
    sink = LiveRerunSink(setup_of(scene), save=tmp_path / "a.rrd")
    sink.write(replace(answer(scene, 0), wearers=()))
    told = sink.close()
    assert len(told) == 1
    assert "tracking goes on without it" in told[0]
    assert sink.lost == f"{tmp_path / 'a.rrd'}: it was not written whole; what there is of it is in " + str(
        tmp_path / "a.partial.rrd"
    )


KILLED = """
import sys, time
sys.path.insert(0, sys.argv[1])
from live_answers import answer, live_scene, setup_of
from pathlib import Path
from vip_factors.viz.live_rerun import LiveRerunSink
scene = live_scene(0.1)
sink = LiveRerunSink(setup_of(scene), save=Path(sys.argv[2]))
sink.write(answer(scene, 0))
time.sleep(60)
"""


def test_a_killed_stream_leaves_what_it_had(tmp_path: Path) -> None:
    partial, until = tmp_path / "a.partial.rrd", time.monotonic() + 60
    command = [sys.executable, "-c", KILLED, str(Path(__file__).parents[1]), str(tmp_path / "a.rrd")]
    with subprocess.Popen(command) as tracker:
        while not (partial.exists() and "/world/ann/newest/head" in printed(partial)):
            assert time.monotonic() < until
            time.sleep(0.2)
        tracker.kill()
    assert "/world/ann/newest/head" in printed(partial)
    assert not (tmp_path / "a.rrd").exists()


def test_a_file_that_rerun_could_not_write_is_an_error(tmp_path: Path) -> None:
    stream = rr.RecordingStream("test")
    stream.save(tmp_path / "a.partial.rrd")
    stream.log("a", rr.TextDocument("x"))
    complete(stream, tmp_path / "a.partial.rrd", tmp_path / "a.rrd")
    (tmp_path / "cut.rrd").write_bytes((tmp_path / "a.partial.rrd").read_bytes()[:-100])
    with pytest.raises(VipFactorsError, match=r"a\.rrd: Rerun could not write it"):
        complete(stream, tmp_path / "cut.rrd", tmp_path / "a.rrd")
