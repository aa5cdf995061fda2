"""Delimited messages: any chunking of the bytes gives the same ones; no bytes raise anything unforeseen."""

from io import BytesIO
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from live_sender import delimited

from vip_factors.errors import FileFormatError
from vip_factors.io.live.messages import Deframer
from vip_factors.io.schemas.live_message_pb2 import LiveMessage


def pieces(data: bytes, cuts: list[int]) -> list[bytes]:
    ends = sorted({0, len(data), *(cut % (len(data) + 1) for cut in cuts)})
    return [data[a:b] for a, b in pairwise(ends)]


def deframed(parts: list[bytes], largest: int = 1000) -> tuple[list[bytes], bool, int]:
    """Messages, whether the bytes were refused, and what is pending."""
    deframer, messages = Deframer(largest), []
    try:
        for part in parts:
            for message in deframer.feed(part):
                messages.append(message)
    except FileFormatError:
        return messages, True, 0
    return messages, False, deframer.pending


@given(st.lists(st.binary(max_size=300)), st.lists(st.integers(0)))
def test_any_chunking_gives_the_same_messages(messages: list[bytes], cuts: list[int]) -> None:
    data = b"".join(map(delimited, messages))
    assert deframed(pieces(data, cuts)) == (messages, False, 0)


@given(st.binary(max_size=400), st.lists(st.integers(0)))
def test_any_bytes_are_messages_or_refused_however_they_are_cut(data: bytes, cuts: list[int]) -> None:
    assert deframed(pieces(data, cuts)) == deframed([data])


@given(st.lists(st.binary(min_size=1, max_size=300), min_size=1), st.integers(1))
def test_a_truncated_stream_gives_all_whole_messages(messages: list[bytes], lost: int) -> None:
    data = b"".join(map(delimited, messages))
    kept = data[: len(data) - 1 - lost % len(data)]
    found, refused, pending = deframed([kept])
    assert not refused
    assert found == messages[: len(found)]
    assert sum(len(delimited(one)) for one in found) + pending == len(kept)


@given(st.text(max_size=300))
def test_it_is_the_usual_delimited_form(carrier: str) -> None:
    protobufs_own = pytest.importorskip("google.protobuf.proto", reason="Protobuf before 5.28 has none to compare with")
    message, stream = LiveMessage(carrier=carrier), BytesIO()
    protobufs_own.serialize_length_prefixed(message, stream)
    assert delimited(message.SerializeToString()) == stream.getvalue()


def test_a_length_beyond_the_limit_is_refused_before_its_bytes_come() -> None:
    head = delimited(b"x" * 1001)[:2]
    with pytest.raises(FileFormatError, match=r"1,001 bytes is announced: expected at most 1,000"):
        list(Deframer(1000).feed(head))
