"""Recordings come back from MCAP files as they were; what is no recording is refused clearly."""

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory
from mcap_samples import assert_same, recordings, walk

from vip_factors.errors import FileFormatError, InputError, RecordingError
from vip_factors.io.mcap_reader import McapWarning
from vip_factors.io.mcap_recording import read_recording, write_recording
from vip_factors.io.mcap_writer import MessageWriter
from vip_factors.io.schemas.geometry_pb2 import QuaternionWxyz, Vector3
from vip_factors.io.schemas.imu_sample_pb2 import ImuSample

FORCE = Vector3(x=0, y=0, z=9.81)


@settings(max_examples=60, deadline=None)
@given(recordings())
def test_round_trip_is_lossless_and_silent(tmp_path_factory: pytest.TempPathFactory, recording) -> None:
    path = tmp_path_factory.mktemp("mcap") / "r.mcap"
    write_recording(recording, path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert_same(recording, read_recording(path))


def test_a_sensor_at_rest_that_measures_only_zeros_keeps_them(tmp_path: Path) -> None:
    recording = walk(5)
    still = replace(
        recording.imus["pelvis"], specific_force=np.zeros((5, 3)), R_inertial_sensor=None, angular_rate=np.zeros((5, 3))
    )
    write_recording(replace(recording, imus={"pelvis": still}), tmp_path / "r.mcap")
    assert_same(still, read_recording(tmp_path / "r.mcap").imus["pelvis"])


def test_other_readers_see_one_channel_per_sensor_with_sorted_nanosecond_times(tmp_path: Path) -> None:
    recording = walk(50, 10)
    write_recording(recording, tmp_path / "r.mcap")
    with open(tmp_path / "r.mcap", "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        assert summary is not None
        assert {f"/imu/{name}" for name in recording.imus} < {one.topic for one in summary.channels.values()}
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
        recording = read_recording(tmp_path / "other.mcap")
    np.testing.assert_allclose(recording.imus["wrist"].time, [5.0, 5.25, 5.5])
    assert recording.name == "other"


def test_samples_that_lack_a_field_others_have_become_gaps(tmp_path: Path) -> None:
    with open(tmp_path / "r.mcap", "wb") as file, MessageWriter(file) as writer:
        for i in range(5):
            turn = QuaternionWxyz(w=1) if i != 2 else None
            message = ImuSample(sensor="a", seconds=i / 10, specific_force=FORCE, orientation_wxyz=turn)
            writer.write("/imu/a", message, i)
    with pytest.warns(McapWarning, match="sensor 'a': 1 incomplete"):
        stream = read_recording(tmp_path / "r.mcap").imus["a"]
    np.testing.assert_allclose(stream.time, [0, 0.1, 0.3, 0.4])


@pytest.mark.parametrize("topics", [("/imu/a", "/imu/b"), ("/imu/a", "/imu/a")])
def test_two_topics_of_one_sensor_or_two_sensors_on_one_topic_are_refused(tmp_path: Path, topics: tuple) -> None:
    sensors = ("a", "a") if topics[0] != topics[1] else ("a", "b")
    with open(tmp_path / "r.mcap", "wb") as file, MessageWriter(file) as writer:
        for i, (topic, sensor) in enumerate(zip(topics, sensors, strict=True)):
            writer.write(topic, ImuSample(sensor=sensor, seconds=i, specific_force=FORCE), i)
    with (
        pytest.warns(McapWarning),
        pytest.raises(FileFormatError, match=r"r\.mcap.*one topic per sensor"),
    ):
        read_recording(tmp_path / "r.mcap")


def test_foreign_channels_are_left_out_and_named(tmp_path: Path) -> None:
    recording = walk(5)
    with open(tmp_path / "r.mcap", "wb") as file, MessageWriter(file) as writer:
        write_recording(recording, tmp_path / "plain.mcap")
        from vip_factors.io.mcap_reader import read_contents

        writer.copy(read_contents(tmp_path / "plain.mcap"))
        raw = writer._writer
        video = raw.register_channel("/camera", "json", raw.register_schema("acme.Image", "jsonschema", b"{}"))
        raw.add_message(video, 1, b"{}", 1)
        raw.add_message(raw.register_channel("/blob", "", 0), 1, b"x", 1)
    with pytest.warns(McapWarning, match=r"left out.*/camera \(acme.Image\).*/blob \(no schema\)"):
        read = read_recording(tmp_path / "r.mcap")
    assert_same(recording, read)


def test_a_file_without_our_messages_is_refused_with_its_topics(tmp_path: Path) -> None:
    with open(tmp_path / "other.mcap", "wb") as file:
        writer = Writer(file)
        writer.start()
        writer.add_message(writer.register_channel("/odometry", "json", 0), 0, b"{}", 0)
        writer.finish()
    with pytest.warns(McapWarning), pytest.raises(FileFormatError, match=r"other\.mcap.*found topics /odometry"):
        read_recording(tmp_path / "other.mcap")


def test_messages_that_do_not_decode_are_named(tmp_path: Path) -> None:
    with open(tmp_path / "r.mcap", "wb") as file, MessageWriter(file) as writer:
        channel = writer.channel("/imu/a", ImuSample)
        writer.add(channel, 0, ImuSample(sensor="a", specific_force=FORCE).SerializeToString())
        writer.add(channel, 1, b"\xff\xff\xff")
    with pytest.warns(McapWarning), pytest.raises(FileFormatError, match=r"message 1 of topic /imu/a"):
        read_recording(tmp_path / "r.mcap")


def test_unusable_samples_are_refused_with_the_file_named(tmp_path: Path) -> None:
    with open(tmp_path / "r.mcap", "wb") as file, MessageWriter(file) as writer:
        for i in range(2):
            writer.write("/imu/a", ImuSample(sensor="a", seconds=1.0, specific_force=FORCE), i)
    with pytest.warns(McapWarning), pytest.raises(RecordingError, match=r"r\.mcap.*sensor 'a'"):
        read_recording(tmp_path / "r.mcap")


@pytest.mark.parametrize(
    ("content", "what"),
    [(b"", "empty"), (b"PK\x03\x04 a zip file", "not an MCAP"), (b"\x89MCAP", "cut after 5 bytes")],
)
def test_what_is_no_mcap_file_is_refused(tmp_path: Path, content: bytes, what: str) -> None:
    (tmp_path / "x.mcap").write_bytes(content)
    with pytest.raises(FileFormatError, match=rf"x\.mcap.*{what}"):
        read_recording(tmp_path / "x.mcap")


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_recording(tmp_path / "none.mcap")


def test_an_interrupt_leaves_the_old_file_and_no_trace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_recording(walk(5), tmp_path / "r.mcap")
    before = (tmp_path / "r.mcap").read_bytes()
    add = MessageWriter.add

    def interrupted(self: MessageWriter, channel: int, time_ns: int, data: bytes) -> None:
        if time_ns > walk(1).start_ns:
            raise KeyboardInterrupt
        add(self, channel, time_ns, data)

    monkeypatch.setattr(MessageWriter, "add", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_recording(walk(20), tmp_path / "r.mcap", overwrite=True)
    assert [path.name for path in tmp_path.iterdir()] == ["r.mcap"]
    assert (tmp_path / "r.mcap").read_bytes() == before


def test_what_the_truth_does_not_know_is_kept(tmp_path: Path) -> None:
    recording = walk()
    known = frozenset({"pelvis", "left_hip", "right_hip"})
    assert recording.truth is not None
    write_recording(replace(recording, truth=replace(recording.truth, known_bones=known)), tmp_path / "a.mcap")
    truth = read_recording(tmp_path / "a.mcap").truth
    assert truth is not None
    assert truth.known_bones == known
    write_recording(recording, tmp_path / "b.mcap")
    truth = read_recording(tmp_path / "b.mcap").truth
    assert truth is not None
    assert truth.known_bones is None
