"""Recordings played back, standard input, and what the user may name as a source."""

import io
import os
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from live_sender import delimited, live_messages, write_messages
from live_streams import QUICK, Background, assert_arrived, received, short_walk

from vip_factors.errors import InputError
from vip_factors.io.live_open import RecordingSource, open_source
from vip_factors.io.mcap_recording import read_scene, write_recording


def test_a_recording_is_read_as_fast_as_it_goes_and_nothing_is_dropped(tmp_path: Path) -> None:
    write_recording(short_walk(), tmp_path / "walk.mcap")
    with open_source(str(tmp_path / "walk.mcap"), settings=replace(QUICK, queue_limit=2)) as source:
        setup, samples, sentences = received(source)
    assert_arrived(read_scene(tmp_path / "walk.mcap"), setup, samples)
    assert sentences == []


def test_a_recording_in_its_own_time_comes_when_it_is_due() -> None:
    scene = short_walk()
    with RecordingSource(scene, real_time=True, settings=QUICK) as source:
        begun, arrivals = time.monotonic(), []
        for sample in source:
            arrivals.append((time.monotonic() - begun, sample.time))
    assert len(arrivals) == len(list(live_messages(scene))) - 1
    assert all(came >= time_of - 0.02 for came, time_of in arrivals)


def test_leaving_early_ends_the_reader() -> None:
    with RecordingSource(short_walk(), settings=replace(QUICK, queue_limit=1)) as source:
        next(iter(source))
    assert not source._thread.is_alive()
    with RecordingSource(short_walk(), real_time=True) as source:
        next(iter(source))
    assert not source._thread.is_alive()


def piped(data: bytes, monkeypatch: pytest.MonkeyPatch):  # type: ignore[no-untyped-def]
    """What arrives of bytes through a pipe."""
    out, into = os.pipe()

    def write() -> None:
        with open(into, "wb") as stream:
            stream.write(data)

    with open(out, "rb") as standard_input:
        monkeypatch.setattr(sys, "stdin", standard_input)
        with Background(write), open_source("-", settings=QUICK) as source:
            return received(source)


def test_a_scene_arrives_over_standard_input(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = short_walk()
    out, into = os.pipe()

    def write() -> None:
        with open(into, "wb") as stream:
            write_messages(scene, stream, real_time=True)

    with open(out, "rb") as standard_input:
        monkeypatch.setattr(sys, "stdin", standard_input)
        with Background(write), open_source("-", settings=QUICK) as source:
            setup, samples, sentences = received(source)
    assert_arrived(scene, setup, samples)
    assert sentences == []


def test_standard_input_ends_with_one_line_at_garbage(monkeypatch: pytest.MonkeyPatch) -> None:
    messages = b"".join(map(delimited, list(live_messages(short_walk()))[:11]))
    for rest, complaint in ((b"\xff" * 64, "no live messages"), (b"\x7fxyz", "in the middle of a message")):
        _, samples, (sentence,) = piped(messages + rest, monkeypatch)
        assert len(samples) == 10
        assert complaint in sentence
        assert sentence.startswith("standard input: ")


@pytest.mark.parametrize(
    ("data", "complaint"),
    [
        (b"", "before a header came"),
        (b"GET / HTTP/1.1\r\n" * 20, "no LiveMessage"),
        (b"\x05ab", "in the middle of a message"),
    ],
)
def test_standard_input_without_a_header_is_an_input_error(
    data: bytes, complaint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError, match=complaint):
        piped(data, monkeypatch)


def test_closed_standard_input_is_an_input_error(monkeypatch: pytest.MonkeyPatch) -> None:
    for closed in (None, io.StringIO("words")):
        monkeypatch.setattr(sys, "stdin", closed)
        with pytest.raises(InputError, match="standard input is closed"), open_source("-"):
            pass


@pytest.mark.parametrize(
    ("text", "options", "complaint"),
    [
        *(
            (text, {}, "expected")
            for text in (
                "http://here:80", "ws://here", "ws://here:5000/path", "ws://here:99999", "ws://", "ws://[::1:5",
                "tcp://here:1", "ws://me@here:5000", "ws://5005",
            )
        ),
        ("ws://127.0.0.1:0", {"real_time": True}, "MCAP files only"),
        ("-", {"follow": True}, "MCAP files only"),
        (Path("walk.mcap"), {"follow": True, "real_time": True}, "choose following or real time"),
        (Path("none.mcap"), {}, "no such file"),
        (Path(__file__), {}, "not an MCAP file"),
    ],
)  # fmt: skip
def test_what_names_no_source_is_an_input_error(text: str | Path, options: dict[str, bool], complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        open_source(text, **options)
