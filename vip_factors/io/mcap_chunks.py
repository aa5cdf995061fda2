"""What is in a chunk of an MCAP file (https://mcap.dev/spec): its records, decompressed within a limit.

The library decompresses whatever a chunk claims to hold; a chunk of 65 kB may claim gigabytes.
"""

import os
import struct
import zlib
from collections.abc import Iterator

import lz4.frame
import zstandard
from mcap.records import Chunk

from vip_factors.errors import InputError

RECORD_HEAD = struct.Struct("<BQ")  # opcode, length
LARGEST_CHUNK = "VIP_FACTORS_LARGEST_CHUNK"


class ChunkError(Exception):
    """A chunk that cannot be read; the message says why."""


class LargeChunkError(ChunkError):
    """A chunk that holds more than it may, or says so."""


def largest_chunk() -> int:
    """Bytes that a chunk may hold, packed or not: 128 MiB, or :data:`LARGEST_CHUNK` in the environment.

    Recorders close chunks at 1 to 4 MB, those with images in them at a few more.

    Raises:
        InputError: if that is no number.
    """
    limit = os.environ.get(LARGEST_CHUNK) or str(128 << 20)
    if not limit.isdecimal():
        raise InputError(f"{LARGEST_CHUNK}={limit} in the environment: expected a number of bytes")
    return int(limit)


def chunk_data(chunk: Chunk, largest: int) -> bytes:
    """The records of a chunk, decompressed.

    Raises:
        ChunkError: for an unknown compression, or data that does not match its size or checksum.
        LargeChunkError: if it holds more than ``largest`` bytes, or says so.
    """
    packed, size = chunk.data, chunk.uncompressed_size
    try:
        # The size in a zstd frame's own head is allocated, whatever the chunk's head says.
        framed = zstandard.frame_content_size(packed) if chunk.compression == "zstd" else 0
        claimed = max(size, len(packed), framed)
        if claimed > largest:
            raise LargeChunkError(
                f"a chunk of {len(packed):,} bytes claims to hold {claimed:,}: expected at most {largest:,}; if that "
                f"is right, set {LARGEST_CHUNK} to more bytes in the environment"
            )
        data = _decompressed(chunk.compression, packed, size)
    except (zstandard.ZstdError, RuntimeError) as error:  # RuntimeError is lz4's
        raise ChunkError(f"a chunk of {size} bytes does not decompress ({error})") from error
    if len(data) != size:
        raise ChunkError(f"a chunk holds {len(data)} bytes where its head says {size}")
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise ChunkError("a chunk does not match its checksum")
    return data


def _decompressed(compression: str, packed: bytes, size: int) -> bytes:
    if compression == "":
        return packed
    if compression == "zstd":
        return zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)
    if compression == "lz4":
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size + 1))
    raise ChunkError(f"a chunk is compressed with '{compression}' (known: zstd, lz4)")


def records_of(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Opcode, start and end of the content of every whole record of a chunk."""
    size, start = len(data), 0
    unpack = RECORD_HEAD.unpack_from
    while start + RECORD_HEAD.size <= size:
        opcode, length = unpack(data, start)
        start += RECORD_HEAD.size
        if opcode == 0 or start + length > size:
            return
        yield opcode, start, start + length
        start += length
