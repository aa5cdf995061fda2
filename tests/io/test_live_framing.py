"""Delimited messages: what is whole arrives; no bytes raise anything unforeseen."""

from io import BytesIO

import pytest
from hypothesis import given
from hypothesis import strategies as st
from live_sender import delimited

from vip_factors.errors import FileFormatError
from vip_factors.io.live.standard_input import delimited_messages
from vip_factors.io.schemas.live_message_pb2 import LiveMessage


def received(data: bytes) -> tuple[list[bytes], bool]:
    """Messages, and whether the bytes were refused after them."""
    messages = list[bytes]()
    try:
        messages.extend(delimited_messages(BytesIO(data), 1000))
    except FileFormatError:
        return messages, True
    return messages, False


@given(st.lists(st.binary(max_size=300)), st.integers(0))
def test_a_stream_gives_all_whole_messages(messages: list[bytes], kept: int) -> None:
    data = b"".join(map(delimited, messages))
    assert received(data) == (messages, False)
    kept %= len(data) + 1
    whole, is_refused = received(data[:kept])
    assert whole == messages[: len(whole)]
    assert is_refused == (sum(len(delimited(message)) for message in whole) < kept)


@given(st.binary(max_size=400))
def test_any_bytes_are_messages_or_refused(data: bytes) -> None:
    messages, is_refused = received(data)
    assert is_refused or sum(len(delimited(message)) for message in messages) <= len(data)


@given(st.text(max_size=300))
def test_it_is_the_usual_delimited_form(carrier: str) -> None:
    reference = pytest.importorskip("google.protobuf.proto", reason="Protobuf before 5.28 has none to compare with")
    message, stream = LiveMessage(carrier=carrier), BytesIO()
    reference.serialize_length_prefixed(message, stream)
    assert delimited(message.SerializeToString()) == stream.getvalue()


def test_a_length_beyond_the_limit_is_refused_before_its_bytes_come() -> None:
    head = delimited(b"x" * 1001)[:2]
    with pytest.raises(FileFormatError, match=r"1,001 bytes is announced: expected at most 1,000"):
        list(delimited_messages(BytesIO(head), 1000))
