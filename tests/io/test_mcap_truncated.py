"""A truncated MCAP file yields every whole message before the cut, wherever the cut is."""

from functools import cache
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import zstandard
from hypothesis import example, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from mcap_samples import walk

from vip_factors.errors import FileFormatError
from vip_factors.io.mcap_reader import McapContents, McapWarning, read_contents
from vip_factors.io.mcap_recording import read_scene, write_recording
from vip_factors.io.mcap_records import logged_interval

MESSAGES = 400
PAYLOAD = 600  # bytes, random: nothing to compress, so one chunk of all messages has two zstd blocks


@cache
def payloads() -> list[bytes]:
    rng = np.random.default_rng(0)
    return [bytes(rng.integers(0, 256, PAYLOAD, dtype=np.uint8)) for _ in range(MESSAGES)]


@cache
def file_of(compression: CompressionType, chunk_size: int) -> bytes:
    buffer = BytesIO()
    writer = Writer(buffer, compression=compression, chunk_size=chunk_size, use_chunking=chunk_size > 0)
    writer.start()
    schema = writer.register_schema("acme.Bytes", "none", b"")
    channels = [writer.register_channel(topic, "raw", schema) for topic in ("/a", "/b")]
    for i, payload in enumerate(payloads()):
        writer.add_message(channels[i % 2], i, payload, i)
    writer.finish()
    return buffer.getvalue()


def read_cut(folder: Path, data: bytes, cut: int) -> tuple[McapContents, list[bytes]]:
    path = folder / "cut.mcap"
    path.write_bytes(data[:cut])
    if cut < len(data):
        with pytest.warns(McapWarning, match=f"cut off at byte {cut}"):
            contents = read_contents(path)
    else:
        contents = read_contents(path)
    both = [pair for one in contents.messages.values() for pair in zip(one.log_times, one.data, strict=True)]
    return contents, [message for _, message in sorted(both)]


@settings(max_examples=40, deadline=None)
@given(st.data())
@pytest.mark.parametrize("chunk_size", [0, 5_000, 10_000_000])
def test_uncompressed_messages_are_read_to_the_last_whole_byte(
    tmp_path_factory: pytest.TempPathFactory, chunk_size: int, data: st.DataObject
) -> None:
    file = file_of(CompressionType.NONE, chunk_size)
    cut = data.draw(st.integers(8, len(file)))
    _, found = read_cut(tmp_path_factory.mktemp("cut"), file, cut)
    ends = [file.index(payload) + PAYLOAD for payload in payloads()]
    assert found == [payload for payload, end in zip(payloads(), ends, strict=True) if end <= cut]


def decompressible(file: bytes, cut: int) -> list[bytes]:
    """The messages that zstd's own reader can still make out, chunk by chunk."""
    summary = make_reader(BytesIO(file)).get_summary()
    assert summary is not None
    text = b""
    for index in summary.chunk_indexes:
        start = index.chunk_start_offset + 9 + 8 + 8 + 8 + 4 + 4 + len("zstd") + 8
        packed = file[start : min(start + index.compressed_size, cut)]
        text += zstandard.ZstdDecompressor().stream_reader(BytesIO(packed)).read() if packed else b""
    return [payload for payload in payloads() if payload in text]


@settings(max_examples=40, deadline=None)
@given(st.data())
@pytest.mark.parametrize("chunk_size", [5_000, 10_000_000])
def test_compressed_messages_are_read_to_the_last_whole_block(
    tmp_path_factory: pytest.TempPathFactory, chunk_size: int, data: st.DataObject
) -> None:
    file = file_of(CompressionType.ZSTD, chunk_size)
    cut = data.draw(st.integers(8, len(file)))
    _, found = read_cut(tmp_path_factory.mktemp("cut"), file, cut)
    assert found == decompressible(file, cut)


def test_a_cut_in_the_middle_of_one_large_chunk_still_yields_messages(tmp_path: Path) -> None:
    for compression in (CompressionType.ZSTD, CompressionType.LZ4):
        file = file_of(compression, 10_000_000)
        _, found = read_cut(tmp_path, file, int(len(file) * 0.8))
        assert len(found) >= 100
        assert found == payloads()[: len(found)]


def test_a_cut_in_the_index_at_the_end_loses_nothing(tmp_path: Path) -> None:
    file = file_of(CompressionType.ZSTD, 5_000)
    for lost in (1, 8, 9, 30, 200):
        assert read_cut(tmp_path, file, len(file) - lost)[1] == payloads()


def test_a_damaged_chunk_is_left_out_and_the_others_are_read(tmp_path: Path) -> None:
    for compression in CompressionType:
        file = bytearray(file_of(compression, 20_000))
        file[50_000:50_010] = bytes(10)
        (tmp_path / "damaged.mcap").write_bytes(file)
        with pytest.warns(McapWarning, match="a chunk .*left out"):
            contents = read_contents(tmp_path / "damaged.mcap")
        found = {data for one in contents.messages.values() for data in one.data}
        assert found < set(payloads())
        assert len(found) >= MESSAGES - 40
        assert contents.damage


def test_a_record_of_wrong_length_is_told_as_damage_not_as_a_cut(tmp_path: Path) -> None:
    file = bytearray(file_of(CompressionType.NONE, 0))
    where = file.index(payloads()[100]) - 22 - 8  # the length of the record of message 100
    file[where : where + 8] = b"\xff" * 8
    (tmp_path / "damaged.mcap").write_bytes(file)
    with pytest.warns(McapWarning, match=f"damaged at byte {where - 1}"):
        contents = read_contents(tmp_path / "damaged.mcap")
    assert sum(len(one.data) for one in contents.messages.values()) == 100


def test_the_index_says_when_messages_begin_and_end_if_it_is_whole(tmp_path: Path) -> None:
    file = file_of(CompressionType.ZSTD, 5_000)
    for cut, expected in ((0, (0, MESSAGES - 1)), (1, None), (9, None), (len(file) - 20, None)):
        (tmp_path / "cut.mcap").write_bytes(file[: len(file) - cut])
        assert logged_interval(tmp_path / "cut.mcap") == expected


@pytest.fixture(scope="module")
def recording_file(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("whole") / "r.mcap"
    write_recording(walk(), path)
    return path.read_bytes()


@settings(max_examples=40, deadline=None)
@given(st.floats(0, 0.9999))
@example(0.9)
@pytest.mark.filterwarnings("ignore::vip_factors.io.mcap_reader.McapWarning")
def test_of_a_cut_recording_the_first_samples_of_all_sensors_are_read(
    tmp_path_factory: pytest.TempPathFactory, recording_file: bytes, share: float
) -> None:
    path, whole = tmp_path_factory.mktemp("cut") / "r.mcap", walk()
    cut = int(share * len(recording_file))
    path.write_bytes(recording_file[:cut])
    try:
        read = read_scene(path).wearers[0]
    except FileFormatError as error:
        assert share < 0.2, "the description is lost only with the very beginning"
        assert "cut" in str(error) or "empty" in str(error)  # noqa: PT017
        return
    assert f"cut off at byte {cut}" in read.notes
    for name, stream in read.imus.items():
        np.testing.assert_array_equal(stream.time, whole.imus[name].time[: len(stream)])
        np.testing.assert_array_equal(stream.specific_force, whole.imus[name].specific_force[: len(stream)])
    lengths = [len(stream) for stream in read.imus.values()]
    assert max(lengths, default=0) - min(lengths, default=0) <= 1
