"""Messages in a stream of bytes: each after its length as a varint, Protobuf's usual delimited form."""

from collections.abc import Iterator

from vip_factors.errors import FileFormatError

VARINT_BYTES = 5  # enough for 32 GiB


def delimited(message: bytes) -> bytes:
    """A serialised message with its length before it."""
    length, head = len(message), bytearray()
    while length > 0x7F:
        head.append(length & 0x7F | 0x80)
        length >>= 7
    head.append(length)
    return bytes(head) + message


class Deframer:
    """Takes bytes in whatever pieces they come, gives whole messages.

    Args:
        largest: bytes of a message.
    """

    def __init__(self, largest: int) -> None:
        self._largest = largest
        self._buffer = bytearray()

    @property
    def pending(self) -> int:
        """Bytes of a message that is not whole yet."""
        return len(self._buffer)

    def feed(self, data: bytes) -> Iterator[bytes]:
        """The messages that these bytes complete, one after the other; to be iterated to the end.

        Raises:
            FileFormatError: for a length that no message has: the stream cannot be followed any more.
        """
        self._buffer += data
        start = 0
        try:
            while (head := self._head(start)) is not None and head[1] <= len(self._buffer):
                begin, start = head
                yield bytes(self._buffer[begin:start])
        finally:
            del self._buffer[:start]

    def _head(self, start: int) -> tuple[int, int] | None:
        """Where the message that begins at ``start`` has its content; None if its length is not whole yet."""
        length = 0
        for at, byte in enumerate(self._buffer[start : start + VARINT_BYTES]):
            length |= (byte & 0x7F) << 7 * at
            if byte < 0x80:
                if length > self._largest:
                    raise FileFormatError(
                        f"a message of {length:,} bytes is announced: expected at most {self._largest:,}; either the "
                        "bytes are no live messages, or the setting largest_message must grow"
                    )
                begin = start + at + 1
                return begin, begin + length
        if len(self._buffer) - start >= VARINT_BYTES:
            raise FileFormatError("the bytes are no live messages: expected each after its length as a varint")
        return None
