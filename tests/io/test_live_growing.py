"""An MCAP file that is followed while it is written, and what may be wrong with it."""

import os
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_streams import QUICK, Background, received, short_walk
from mcap_samples import assert_same
from scene_samples import camera_path, filmed_walk

from vip_factors.errors import FileFormatError, InputError
from vip_factors.io.live_growing import GrowingFileSource
from vip_factors.io.live_open import open_source
from vip_factors.io.mcap_frames import sample_messages
from vip_factors.io.mcap_messages import MessageWriter
from vip_factors.io.mcap_reader import LARGEST_CHUNK
from vip_factors.io.mcap_recording import recording_messages, write_recording
from vip_factors.io.schemas.detections_2d_pb2 import Detections2D
from vip_factors.io.schemas.imu_sample_pb2 import ImuSample
from vip_factors.sensors.live import VideoFrame, live_samples, stream_head
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene


def written(scene: Scene, tmp_path: Path) -> bytes:
    path = tmp_path / "whole.mcap"
    write_recording(scene, path, overwrite=True)
    return path.read_bytes()


def followed(path: Path, chosen: Any = QUICK):  # type: ignore[no-untyped-def]
    with open_source(path, follow=True, settings=chosen) as source:
        return received(source)


def by_time(samples: Iterable[Any]) -> tuple[Any, ...]:
    """Samples of one instant by their names: a file has another order of them than a scene."""

    def rank(one: Any) -> tuple[Any, ...]:
        return (one.time, one.camera) if isinstance(one, VideoFrame) else (one.time, one.carrier, one.sensor)

    return tuple(sorted(samples, key=rank))


def assert_followed(scene: Scene, setup: Scene, samples: list[Any]) -> None:
    times = [sample.time for sample in samples]
    assert times == sorted(times)
    assert_same(stream_head(scene), setup)
    assert_same(by_time(live_samples(scene)), by_time(samples))


def standing(scene: Scene) -> Scene:
    """Its camera at a known pose."""
    assert scene.camera is not None
    known = camera_path(np.random.default_rng(0), 1)
    return replace(scene, cameras=(replace(scene.camera, known_path=replace(known, time=np.array([0.25]))),))


@pytest.mark.parametrize("make", [short_walk, lambda: standing(short_walk()), filmed_walk])
def test_a_growing_scene_arrives(make: Callable[[], Scene], tmp_path: Path) -> None:
    scene = make()
    scene = replace(scene, wearers=tuple(replace(wearer, truth=None) for wearer in scene.wearers))
    data, path = written(scene, tmp_path), tmp_path / "growing.mcap"

    def grow() -> None:
        with open(path, "wb", buffering=0) as file:
            for start in range(0, len(data), len(data) // 7):
                file.write(data[start : start + len(data) // 7])
                time.sleep(0.02)

    with Background(grow):
        setup, samples, sentences = followed(path)
    assert_followed(scene, setup, samples)
    assert sentences == []


def test_several_wearers_and_a_plain_recording_arrive(tmp_path: Path) -> None:
    scene = short_walk()
    ada = scene.wearers[0]
    bob = replace(ada, subject=replace(ada.subject, name="Bob/2"))
    both = replace(scene, wearers=(ada, bob))
    write_recording(both, tmp_path / "both.mcap")
    setup, samples, sentences = followed(tmp_path / "both.mcap")
    assert_followed(both, setup, samples)
    assert sentences == []

    write_recording(ada, tmp_path / "plain.mcap")
    setup, samples, sentences = followed(tmp_path / "plain.mcap")
    assert_followed(Scene(ada.name, (ada,)), setup, samples)
    assert sentences == []


def test_further_cameras_arrive(tmp_path: Path) -> None:
    scene = standing(short_walk())
    sides = [replace(scene.camera, name=name) for name in ("side/left", "imu")]
    scene = replace(scene, cameras=(scene.camera, *sides))
    write_recording(scene, tmp_path / "three.mcap")
    setup, samples, sentences = followed(tmp_path / "three.mcap")
    assert_followed(scene, setup, samples)
    assert sentences == []


def test_a_file_that_stops_growing_ends_with_one_line(tmp_path: Path) -> None:
    data, path = written(short_walk(), tmp_path), tmp_path / "cut.mcap"
    path.write_bytes(data[: len(data) * 2 // 3])
    _, _, (sentence,) = followed(path)
    assert "it has not grown for 0.3 s" in sentence


@pytest.mark.parametrize(
    ("data", "complaint"), [(b"", "is empty"), (b"\x89MC", "was cut"), (b"words " * 9, "is not an MCAP file")]
)
def test_what_is_no_mcap_file_is_a_format_error(tmp_path: Path, data: bytes, complaint: str) -> None:
    (tmp_path / "bad.mcap").write_bytes(data)
    with pytest.raises(FileFormatError, match=complaint):
        followed(tmp_path / "bad.mcap")


def test_a_file_that_never_comes_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nor did it come within"):
        followed(tmp_path / "none.mcap")


def test_a_file_that_becomes_shorter_is_a_format_error(tmp_path: Path) -> None:
    data, path = written(short_walk(), tmp_path), tmp_path / "shrinks.mcap"
    path.write_bytes(data[: len(data) * 2 // 3])

    def shrink() -> None:
        time.sleep(0.1)
        os.truncate(path, 1000)

    with Background(shrink), pytest.raises(FileFormatError, match="became shorter"):
        followed(path, replace(QUICK, growth_wait=5.0))


def test_leaving_early_ends_the_reader(tmp_path: Path) -> None:
    path = tmp_path / "walk.mcap"
    path.write_bytes(written(short_walk(), tmp_path)[:-200])
    with GrowingFileSource(path) as source:
        next(iter(source))
    assert not source._thread.is_alive()


def composed(path: Path, recording: Recording, add: Callable[[MessageWriter], None]) -> None:
    """A recording's beginning and samples, and then what ``add`` writes."""
    with open(path, "wb") as file, MessageWriter(file, recording.start_ns) as writer:
        writer.add_in_order(*recording_messages(writer, replace(recording, truth=None)))
        add(writer)


def spoilt(tmp_path: Path, add: Callable[[MessageWriter], None]) -> list[str]:
    """The sentences about what ``add`` writes behind a good recording, whose samples all arrive."""
    path, recording = tmp_path / "spoilt.mcap", short_walk().wearers[0]
    composed(path, recording, add)
    _, samples, sentences = followed(path)
    assert len(samples) == sum(map(len, recording.imus.values()))
    return sentences


def test_foreign_and_unparsable_messages_are_left_out(tmp_path: Path) -> None:
    def add(writer: MessageWriter) -> None:
        schema = writer._writer.register_schema("sensor_msgs/msg/Imu", "ros2msg", b"")
        writer.add(writer._writer.register_channel("/imu/tail", "cdr", schema), 0, b"words")
        writer.add(writer.channel("/imu/head", ImuSample), 0, b"\xff")
        writer.add(writer.channel("/wearer/Bob/imu/head", ImuSample), 0, ImuSample(seconds=1.0).SerializeToString())
        writer.add(writer.channel("/else", Detections2D), 0, b"")

    foreign, broken, nobody, stray = spoilt(tmp_path, add)
    assert "/imu/tail has sensor_msgs/msg/Imu (cdr): expected vip_factors.ImuSample" in foreign
    assert "a message on /imu/head is no vip_factors.ImuSample" in broken
    assert "/wearer/Bob/imu/head belongs to nobody" in nobody
    assert "/else belongs to nobody" in stray


def test_a_chunk_larger_than_it_may_be_is_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def add(writer: MessageWriter) -> None:
        writer.flush()
        writer.add(writer.channel("/imu/head", ImuSample), 0, ImuSample(sensor="x" * 50_000).SerializeToString())

    monkeypatch.setenv(LARGEST_CHUNK, "50000")
    (sentence,) = spoilt(tmp_path, add)
    assert "expected at most 50,000" in sentence
    assert "left out" in sentence


def test_samples_without_what_comes_first_are_a_format_error(tmp_path: Path) -> None:
    path = tmp_path / "headless.mcap"
    with open(path, "wb") as file, MessageWriter(file) as writer:
        writer.add_in_order(*[sample_messages(writer, "/imu/head", short_walk().wearers[0].imus["head"])])
    with pytest.raises(FileFormatError, match="there is nothing on /recording/info"):
        followed(path)
