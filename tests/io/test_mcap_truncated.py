"""What is read of MCAP files that are cut, damaged, or claim more than there can be."""

import os
import resource
import subprocess
import sys
from functools import cache
from io import BytesIO
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
import zstandard
from hypothesis import example, given, settings
from hypothesis import strategies as st
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.writer import CompressionType, Writer
from mcap_samples import walk

from vip_factors.errors import FileFormatError, InputError
from vip_factors.io.mcap_reader import LARGEST_CHUNK, MAGIC, McapContents, McapWarning, read_contents, read_summary
from vip_factors.io.mcap_recording import read_scene, write_recording
from vip_factors.io.mcap_source import WearerFile, open_source

MESSAGES = 400
PAYLOAD = 600  # bytes, random: nothing to compress


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
    both = [
        pair for message in contents.messages.values() for pair in zip(message.log_times, message.data, strict=True)
    ]
    return contents, [message for _, message in sorted(both)]


def whole_messages(file: bytes, cut: int) -> list[bytes]:
    """The messages in whole chunks before a cut, or outside of chunks."""
    summary = make_reader(BytesIO(file)).get_summary()
    assert summary is not None
    if not summary.chunk_indexes:
        return [payload for payload in payloads() if file.index(payload) + PAYLOAD <= cut]
    ends = [(one.chunk_start_offset + one.chunk_length, one.message_end_time) for one in summary.chunk_indexes]
    return payloads()[: max((last + 1 for end, last in ends if end <= cut), default=0)]


@settings(max_examples=30, deadline=None)
@given(st.data())
@pytest.mark.parametrize("compression", CompressionType)
@pytest.mark.parametrize("chunk_size", [0, 5_000])
def test_all_chunks_before_a_cut_are_read(
    tmp_path_factory: pytest.TempPathFactory, compression: CompressionType, chunk_size: int, data: st.DataObject
) -> None:
    file = file_of(compression, chunk_size)
    cut = data.draw(st.integers(8, len(file)))
    _, found = read_cut(tmp_path_factory.mktemp("cut"), file, cut)
    assert found == whole_messages(file, cut)


def test_a_damaged_chunk_is_left_out_and_the_others_are_read(tmp_path: Path) -> None:
    for compression in CompressionType:
        file = bytearray(file_of(compression, 20_000))
        file[50_000:50_010] = bytes(10)
        (tmp_path / "damaged.mcap").write_bytes(file)
        with pytest.warns(McapWarning, match="a chunk .*left out"):
            contents = read_contents(tmp_path / "damaged.mcap")
        found = {data for message in contents.messages.values() for data in message.data}
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
    assert sum(len(message.data) for message in contents.messages.values()) == 100


def test_the_index_says_when_messages_begin_and_end_if_it_is_whole(tmp_path: Path) -> None:
    file = file_of(CompressionType.ZSTD, 5_000)
    for cut in (0, 1, 9, len(file) - 20):
        (tmp_path / "cut.mcap").write_bytes(file[: len(file) - cut])
        summary = read_summary(tmp_path / "cut.mcap")
        assert (summary is not None) == (cut == 0)
        if summary is not None and summary.statistics is not None:
            assert (summary.statistics.message_start_time, summary.statistics.message_end_time) == (0, MESSAGES - 1)


@pytest.fixture(scope="module")
def recording_file(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("whole") / "r.mcap"
    write_recording(walk(), path)
    return path.read_bytes()


def test_a_damaged_chunk_between_whole_ones_is_reported_by_time_too(tmp_path: Path, recording_file: bytes) -> None:
    summary = make_reader(BytesIO(recording_file)).get_summary()
    assert summary is not None
    chunk = summary.chunk_indexes[len(summary.chunk_indexes) // 2]
    end, file = chunk.chunk_start_offset + chunk.chunk_length, bytearray(recording_file)
    file[end - 20 : end - 10] = bytes(10)
    (tmp_path / "damaged.mcap").write_bytes(file)
    (wearer,) = open_source([tmp_path / "damaged.mcap"], 0.0).wearers
    assert isinstance(wearer, WearerFile)
    with pytest.warns(McapWarning, match="a chunk .*left out"):
        samples = sum(map(len, wearer.between().values()))
    assert 0 < samples < sum(map(len, walk().imus.values()))


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


CLAIM = 2 << 30  # bytes
MOST_BYTES = 1 << 30  # of memory, with the interpreter and its libraries


def zeros(compression: str, size: int) -> bytes:
    """So many zero bytes, compressed piece by piece."""
    zstd, lz = zstandard.ZstdCompressor().compressobj(size=size), lz4.frame.LZ4FrameCompressor()
    piece = bytes(1 << 20)
    if compression == "zstd":
        return b"".join([*(zstd.compress(piece) for _ in range(size >> 20)), zstd.flush()])
    return b"".join([lz.begin(), *(lz.compress(piece) for _ in range(size >> 20)), lz.flush()])


def bomb(compression: str, packed: bytes, claim: int) -> bytes:
    """A file of one chunk."""
    record = RecordBuilder()
    Chunk(compression, packed, 0, 0, 0, claim).write(record)
    return MAGIC + record.end()


@pytest.mark.parametrize(
    ("compression", "held", "claim", "complaint"),
    [
        ("zstd", CLAIM, CLAIM, "claims to hold 2,147,483,648: expected at most 134,217,728"),
        ("zstd", CLAIM, 1000, "claims to hold 2,147,483,648: expected at most 134,217,728"),
        ("lz4", 16 << 20, CLAIM, "claims to hold 2,147,483,648: expected at most 134,217,728"),
        ("lz4", CLAIM, 1000, "a chunk holds 1001 bytes where its head says 1000"),
        ("", 0, 2**62, "claims to hold 4,611,686,018,427,387,904"),
    ],
)
def test_a_chunk_that_claims_gigabytes_is_refused(
    tmp_path: Path, compression: str, held: int, claim: int, complaint: str
) -> None:
    path = tmp_path / "bomb.mcap"
    path.write_bytes(bomb(compression, zeros(compression, held) if held else b"", claim))
    done = subprocess.run(
        [sys.executable, "-m", "vip_factors", "info", str(path)],
        capture_output=True, text=True, timeout=60, check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_DATA, (MOST_BYTES, MOST_BYTES)),
    )  # fmt: skip
    assert done.returncode == 2
    assert complaint in done.stderr
    assert "Traceback" not in done.stderr


def test_the_limit_of_a_chunk_can_be_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "r.mcap"
    write_recording(walk(), path)
    monkeypatch.setenv(LARGEST_CHUNK, "1000")
    for read in (read_scene, lambda path: open_source([path], 0.1)):
        with pytest.raises(FileFormatError, match=rf"r\.mcap: .*expected at most 1,000.*set {LARGEST_CHUNK}"):
            read(path)
    monkeypatch.setenv(LARGEST_CHUNK, str(os.path.getsize(path) * 10))
    assert len(read_scene(path).wearers) == 1
    monkeypatch.setenv(LARGEST_CHUNK, "1 GB")
    with pytest.raises(InputError, match="expected a number of bytes"):
        read_scene(path)
