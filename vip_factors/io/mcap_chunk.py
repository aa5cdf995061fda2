"""The content of one chunk of an MCAP file, whole or as much as there is of it."""

import struct
import zlib

CHUNK_HEAD = struct.Struct("<QQQI")  # start and end log time, uncompressed size, CRC of the content


class ChunkError(Exception):
    """A chunk that cannot be read; the message says why."""


def read_chunk(content: bytes | memoryview, whole: bool = True) -> bytes:
    """The records of a chunk, decompressed.

    Args:
        content: of the chunk record, without opcode and length.
        whole: False if the content is cut off: then everything that decompresses is returned, which is every block
            that was written completely (zstd and lz4 compress in blocks of at most 128 KiB and 4 MiB).

    Raises:
        ChunkError: for an unknown compression, or data that does not match its size or checksum.
    """
    try:
        _, _, size, crc = CHUNK_HEAD.unpack_from(content)
        compression, start = _prefixed_string(content, CHUNK_HEAD.size)
        (length,) = struct.unpack_from("<Q", content, start)
    except (struct.error, UnicodeDecodeError) as error:
        if not whole:
            return b""
        raise ChunkError("a chunk's head is malformed") from error
    packed = bytes(content[start + 8 : start + 8 + length])
    data = _decompress(compression, packed, size, whole)
    if whole and len(data) != size:
        raise ChunkError(f"a chunk holds {len(data)} bytes where its head says {size}")
    if whole and crc and zlib.crc32(data) != crc:
        raise ChunkError("a chunk does not match its checksum")
    return data


def _prefixed_string(content: bytes | memoryview, start: int) -> tuple[str, int]:
    (length,) = struct.unpack_from("<I", content, start)
    end = start + 4 + length
    if end > len(content):
        raise struct.error("string beyond the end")
    return str(content[start + 4 : end], "utf-8"), end


def _decompress(compression: str, packed: bytes, size: int, whole: bool) -> bytes:
    if compression == "":
        return packed
    if compression == "zstd":
        import zstandard

        decompress = zstandard.ZstdDecompressor().decompressobj().decompress
        failure: type[Exception] = zstandard.ZstdError
    elif compression == "lz4":
        import lz4.frame

        decompress, failure = lz4.frame.LZ4FrameDecompressor().decompress, RuntimeError
    else:
        raise ChunkError(f"a chunk is compressed with '{compression}' (known: zstd, lz4)")
    try:
        return decompress(packed)
    except failure as error:
        if not whole:
            return b""
        raise ChunkError(f"a chunk of {size} bytes does not decompress ({error})") from error
