"""Recordings and scenes come back from MCAP files as they were; what is none is refused clearly."""

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from mcap_samples import assert_same, copy_messages, recordings, walk
from scene_samples import filmed_walk, scenes

from vip_factors.body.keypoints import KEYPOINT_SETS
from vip_factors.describe.recordings import recording_tables
from vip_factors.errors import FileFormatError
from vip_factors.io.mcap_camera import detections_of
from vip_factors.io.mcap_messages import MessageWriter
from vip_factors.io.mcap_reader import McapWarning
from vip_factors.io.mcap_recording import FIRST_CAMERA, read_scene, wearer_topics, write_recording
from vip_factors.io.mcap_source import indexed_recording
from vip_factors.io.schemas.camera_info_pb2 import CameraInfo
from vip_factors.io.schemas.detections_2d_pb2 import Detections2D
from vip_factors.io.schemas.geometry_pb2 import QuaternionWxyz, Vector3
from vip_factors.io.schemas.imu_sample_pb2 import ImuSample
from vip_factors.sensors.scene import Scene, Video

FORCE = Vector3(x=0, y=0, z=9.81)


@settings(max_examples=25, deadline=None)
@given(recordings())
def test_round_trip_is_lossless_and_silent(tmp_path_factory: pytest.TempPathFactory, recording) -> None:
    path = tmp_path_factory.mktemp("mcap") / "r.mcap"
    write_recording(recording, path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert_same(Scene(recording.name, (recording,)), read_scene(path))


def test_a_sensor_at_rest_that_measures_only_zeros_keeps_them(tmp_path: Path) -> None:
    recording = walk(5)
    still = replace(
        recording.imus["pelvis"], specific_force=np.zeros((5, 3)), R_inertial_sensor=None, angular_rate=np.zeros((5, 3))
    )
    write_recording(replace(recording, imus={"pelvis": still}), tmp_path / "r.mcap")
    assert_same(still, read_scene(tmp_path / "r.mcap").wearers[0].imus["pelvis"])


def test_other_readers_see_one_channel_per_sensor_with_sorted_nanosecond_times(tmp_path: Path) -> None:
    recording = walk(50, 10)
    write_recording(recording, tmp_path / "r.mcap")
    with open(tmp_path / "r.mcap", "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        assert summary is not None
        assert {f"/imu/{name}" for name in recording.imus} < {channel.topic for channel in summary.channels.values()}
        decoded = [m for *_, m in reader.iter_decoded_messages("/imu/pelvis")]
        logged = [message.log_time for _, _, message in reader.iter_messages("/imu/head")]
    assert [m.specific_force.x for m in decoded] == recording.imus["pelvis"].specific_force[:, 0].tolist()
    assert logged == [recording.start_ns + 10_000_000 * i for i in range(50)]


def test_samples_of_another_writer_need_only_a_time_stamp(tmp_path: Path) -> None:
    with open(tmp_path / "other.mcap", "wb") as file, MessageWriter(file) as writer:
        for i in (1, 0, 2):  # out of order
            message = ImuSample(specific_force=FORCE)
            message.timestamp.seconds, message.timestamp.nanos = 5, 250_000_000 * i
            writer.write("/imu/wrist", message, i)
    with pytest.warns(McapWarning, match="there is no"):
        recording = read_scene(tmp_path / "other.mcap").wearers[0]
    np.testing.assert_allclose(recording.imus["wrist"].time, [5.0, 5.25, 5.5])
    assert recording.name == "other"


def test_samples_that_lack_a_field_others_have_become_gaps(tmp_path: Path) -> None:
    with open(tmp_path / "r.mcap", "wb") as file, MessageWriter(file) as writer:
        for i in range(5):
            turn = QuaternionWxyz(w=1) if i != 2 else None
            message = ImuSample(sensor="a", seconds=i / 10, specific_force=FORCE, orientation_wxyz=turn)
            writer.write("/imu/a", message, i)
    with pytest.warns(McapWarning, match="sensor 'a': 1 incomplete"):
        stream = read_scene(tmp_path / "r.mcap").wearers[0].imus["a"]
    np.testing.assert_allclose(stream.time, [0, 0.1, 0.3, 0.4])


@pytest.mark.parametrize("topics", [("/imu/a", "/imu/b"), ("/imu/a", "/imu/a")])
def test_two_topics_of_one_sensor_or_two_sensors_on_one_topic_are_refused(tmp_path: Path, topics: tuple) -> None:
    sensors = ("a", "a") if topics[0] != topics[1] else ("a", "b")
    with open(tmp_path / "r.mcap", "wb") as file, MessageWriter(file) as writer:
        for i, (topic, sensor) in enumerate(zip(topics, sensors, strict=True)):
            writer.write(topic, ImuSample(sensor=sensor, seconds=i, specific_force=FORCE), i)
    with pytest.warns(McapWarning), pytest.raises(FileFormatError, match=r"r\.mcap.*one topic per sensor"):
        read_scene(tmp_path / "r.mcap")


def test_foreign_channels_are_left_out_and_named(tmp_path: Path) -> None:
    recording = walk(5)
    with open(tmp_path / "r.mcap", "wb") as file, MessageWriter(file) as writer:
        write_recording(recording, tmp_path / "plain.mcap")
        raw = writer._writer
        copy_messages(tmp_path / "plain.mcap", raw)
        video = raw.register_channel("/camera", "json", raw.register_schema("acme.Image", "jsonschema", b"{}"))
        raw.add_message(video, 1, b"{}", 1)
        raw.add_message(raw.register_channel("/blob", "", 0), 1, b"x", 1)
    with pytest.warns(McapWarning, match=r"ignored.*/camera \(acme.Image\).*/blob \(no schema\)"):
        read = read_scene(tmp_path / "r.mcap").wearers[0]
    assert_same(recording, read)


def test_messages_that_do_not_decode_are_named(tmp_path: Path) -> None:
    with open(tmp_path / "r.mcap", "wb") as file, MessageWriter(file) as writer:
        channel = writer.channel("/imu/a", ImuSample)
        writer.add(channel, 0, ImuSample(sensor="a", specific_force=FORCE).SerializeToString())
        writer.add(channel, 1, b"\xff\xff\xff")
    with pytest.warns(McapWarning), pytest.raises(FileFormatError, match=r"message 1 of topic /imu/a"):
        read_scene(tmp_path / "r.mcap")


@pytest.mark.parametrize(
    ("content", "what"), [(b"", "empty"), (b"PK\x03\x04 a zip file", "not an MCAP"), (b"\x89MCAP", "cut after 5 bytes")]
)
def test_what_is_no_mcap_file_is_refused(tmp_path: Path, content: bytes, what: str) -> None:
    (tmp_path / "x.mcap").write_bytes(content)
    with pytest.raises(FileFormatError, match=rf"x\.mcap.*{what}"):
        read_scene(tmp_path / "x.mcap")


@settings(max_examples=25, deadline=None)
@given(scenes())
def test_the_round_trip_of_a_scene_is_lossless_and_silent(
    tmp_path_factory: pytest.TempPathFactory, scene: Scene
) -> None:
    path = tmp_path_factory.mktemp("mcap") / "s.mcap"
    write_recording(scene, path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read = read_scene(path)
    assert_same(scene, read)


def three_cameras() -> Scene:
    """Of which two are further ones."""
    scene = filmed_walk(5)
    assert scene.camera is not None
    assert scene.camera.truth is not None
    path = scene.camera.truth.path
    further = tuple(replace(scene.camera, name=name, known_path=path) for name in ("left", "a/info"))
    return replace(scene, cameras=(scene.camera, *further))


def test_topics_of_wearers_cannot_be_confused() -> None:
    assert wearer_topics(["a"]) == [""]
    assert wearer_topics(["a", "a/imu", "%2F"]) == ["/wearer/a", "/wearer/a%2Fimu", "/wearer/%252F"]


def test_a_video_beside_the_file_moves_with_it(tmp_path: Path) -> None:
    scene = filmed_walk(2)
    assert scene.camera is not None
    for video, where in ((tmp_path / "a" / "v.mp4", tmp_path / "b" / "v.mp4"), (Path("/v.mp4"), Path("/v.mp4"))):
        (tmp_path / "a").mkdir(exist_ok=True)
        write_recording(replace(scene, cameras=(replace(scene.camera, video=Video(video)),)), tmp_path / "a" / "s.mcap")
        (tmp_path / "a").rename(tmp_path / "b")
        read = read_scene(tmp_path / "b" / "s.mcap").camera
        assert read is not None
        assert read.video == Video(where)
        (tmp_path / "b" / "s.mcap").unlink()
        (tmp_path / "b").rmdir()


@pytest.mark.parametrize("share", [0.5, 0.98])
@pytest.mark.filterwarnings("ignore::vip_factors.io.mcap_reader.McapWarning")
def test_of_a_cut_scene_the_first_frames_and_samples_are_read(tmp_path: Path, share: float) -> None:
    scene = filmed_walk()
    other = replace(walk(), subject=replace(walk(1).subject, name="Bea"))
    scene = replace(scene, wearers=(*scene.wearers, other))
    path = tmp_path / "s.mcap"
    write_recording(scene, path)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    read = read_scene(path)
    assert scene.camera is not None
    assert read.camera is not None
    full, cut = scene.camera.detections, read.camera.detections
    np.testing.assert_array_equal(cut.time, full.time[: len(cut.time)])
    np.testing.assert_array_equal(cut.pixels, full.pixels[: len(cut)])
    for wearer in read.wearers:
        assert f"cut off at byte {int(share * len(whole))}" in wearer.notes
        ends = [stream.time[-1] for stream in wearer.imus.values()]
        assert not ends or abs(cut.time[-1] - max(ends)) <= 0.11, "everything ends at one time"


def _written(path: Path, info: CameraInfo, frames: list[Detections2D]) -> Path:
    """A scene with another camera's messages."""
    write_recording(filmed_walk(2), path.with_name("whole.mcap"), overwrite=True)
    with open(path, "wb") as file, MessageWriter(file) as writer:
        left_out = (FIRST_CAMERA("info"), FIRST_CAMERA("detections"), "/truth/camera")
        copy_messages(path.with_name("whole.mcap"), writer._writer, left_out)
        writer.write(FIRST_CAMERA("info"), info, 1)
        for frame in frames:
            writer.write(FIRST_CAMERA("detections"), frame, 1)
    return path


def test_people_of_another_keypoint_set_are_refused(tmp_path: Path) -> None:
    info = CameraInfo(name="c", keypoint_set="own", keypoints=["a", "b"], frames=1)
    frame = Detections2D(people=[Detections2D.Person(pixels=[1, 2], confidence=[1])])
    with pytest.raises(FileFormatError, match=r"s\.mcap: video frame 0.*expected 2 of each.*own"):
        read_scene(_written(tmp_path / "s.mcap", info, [frame]))


def test_frames_lost_in_between_count_as_empty(tmp_path: Path) -> None:
    info = CameraInfo(name="c", keypoint_set="own", keypoints=["a"], frames=5)
    person = Detections2D.Person(pixels=[1, 2], confidence=[1])
    frames = [Detections2D(frame=i, seconds=0.5 * i, people=[person]) for i in (1, 4)]
    with pytest.warns(McapWarning, match="2 of 5 video frames"):
        camera = read_scene(_written(tmp_path / "s.mcap", info, frames)).camera
    assert camera is not None
    np.testing.assert_allclose(camera.detections.time, [0, 0.5, 1, 1.5, 2])
    assert camera.detections.frame.tolist() == [1, 4]
    with pytest.raises(FileFormatError, match="video frame 1 comes twice or late"):
        read_scene(_written(tmp_path / "t.mcap", info, frames[::-1]))


@pytest.mark.parametrize("frame", [2**64 - 1, 10**9])
def test_frame_numbers_that_no_video_has_are_refused(frame: int) -> None:
    with pytest.raises(FileFormatError, match=f"video frame {frame}: expected at most 20,000,000"):
        detections_of(KEYPOINT_SETS["coco17"], [Detections2D(frame=0), Detections2D(frame=frame, seconds=1.0)])


def test_the_index_tells_what_the_samples_do(tmp_path: Path) -> None:
    recording = walk(200, 10)
    first = next(iter(recording.imus))
    gap = recording.imus[first]
    kept = np.r_[0:5, 9 : len(gap)]
    imu = replace(gap, time=gap.time[kept], **{
        name: None if (values := getattr(gap, name)) is None else values[kept]
        for name in ("specific_force", "R_inertial_sensor", "angular_rate", "force_measured")
    })  # fmt: skip
    path = tmp_path / "r.mcap"
    write_recording(replace(recording, imus={**recording.imus, first: imu}), path)
    index = indexed_recording(path, 0.0)
    assert index is not None
    read = read_scene(path).wearers[0]
    tables = list(recording_tables(index.head, index.time, index.truth_frames))
    assert tables == list(recording_tables(read))
    assert [row[5] for row in tables[1].rows if row[0] == first] == ["1"]  # gap
    for name, stream in read.imus.items():
        np.testing.assert_allclose(index.time[name], stream.time, atol=2e-9)
    assert indexed_recording(path, 1e4) is None


def test_without_an_index_or_by_another_clock_samples_are_read(tmp_path: Path) -> None:
    recording, path = walk(200, 10), tmp_path / "r.mcap"
    write_recording(recording, path)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(path.read_bytes()[:-100])
    assert indexed_recording(cut, 0.0) is None
    late = tmp_path / "late.mcap"
    with late.open("wb") as file, MessageWriter(file) as writer:
        copy_messages(path, writer._writer, later_ns=10_000_000)
    assert indexed_recording(late, 0.0) is None
