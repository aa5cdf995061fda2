"""Mutations: what a bad disk, a cut connection, a spreadsheet or a hand does to a file; and inside of what is packed.

Bytes flipped in Protobuf messages, records of MCAP, JSON and archives of arrays mostly break their checksums; what lies
behind these is reached by packing anew.
"""

import json
import re
import struct
import zipfile
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Chunk

from tests.live_sender import delimited
from vip_factors.io.mcap_reader import MAGIC, RECORD_HEAD, chunk_data, largest_chunk

NUMBER = re.compile(rb"(?<![\w.])[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?(?![\w.])")
WORD = re.compile(rb"[A-Za-z_][A-Za-z_0-9]*")
CELL = re.compile(rb"[^,;\t ]+|[,;\t ]")
NUMBERS = (
    b"0", b"-1", b"1", b"nan", b"inf", b"-inf", b"1e308", b"-1e308", b"1e-320", b"12345678901234567890", b"9" * 400,
    b"2147483648", b"1000000000", b"0.5", b"-0", b"1e400", b"", b"x", b"NaN", b"true", b'"1"', b"[]", b"{}", b"null",
)  # fmt: skip
WORDS = (
    b"", b"x", b"nan", b"\xff\xfe", b"\x00", b"name", b"time", b"X" * 300, "\u00e9\u4e2d".encode(), b'"', b"[", b"}",
)  # fmt: skip
PIECES = (
    b"\x00", b"\xff", b"\n", b",", b"\t", b'"', b"{", b"}", b"[", b"]", b"<", b"/>", b"=", b"#", b"\r",
    b"\xef\xbb\xbf",
)  # fmt: skip

MESSAGE_HEAD = 22  # bytes of a message's record before its data
INDEX = 0x07  # of a chunk's messages: nothing reads it
LIMITS = (0.0, -1.0, 1.0, float("nan"), float("inf"), float("-inf"), 1e308, -1e308, 1e-310, 0.5, 1e9, 1e20)
INTEGERS = (0, 1, 2, 127, 128, 2**31 - 1, 2**31, 2**32, 2**63 - 1, 2**63, 2**64 - 1, 10**6, 10**9)
VALUES: tuple[Any, ...] = (
    0, -1, 1, 0.5, float("nan"), float("inf"), 1e308, -1e308, 12345678901234567890, 10**400, "", "x", "1", None, True,
    [], {}, [1], [[]], {"a": 1}, 10**9,
)  # fmt: skip

Field = tuple[int, int, Any]
"""Number, wire type and content of a field."""
Mutation = Callable[[bytes, Random], bytes]


def _place(data: bytes, random: Random) -> int:
    """Half of the time near the beginning, where headers are."""
    end = len(data) if random.random() < 0.5 else min(len(data), 400)
    return random.randrange(max(end, 1))


def flip(data: bytes, random: Random) -> bytes:
    """One bit."""
    at = _place(data, random)
    return data[:at] + bytes(one ^ 1 << random.randrange(8) for one in data[at : at + 1]) + data[at + 1 :]


def overwrite(data: bytes, random: Random) -> bytes:
    """Some bytes, with those that numbers at their limits have."""
    at = _place(data, random)
    piece = random.choice((b"\xff", b"\0", b"\x7f", b"\x80")) * random.choice((1, 2, 4, 8))
    if random.random() < 0.3:
        piece = random.choice((b"\0\0\0\0\0\0\xf8\x7f", b"\0\0\0\0\0\0\xf0\x7f", b"\xa0\xc8\xeb\x85\xf3\xcc\xe1\x7f"))
    return data[:at] + piece + data[at + len(piece) :]


def insert(data: bytes, random: Random) -> bytes:
    """Something that does not belong there."""
    at = _place(data, random)
    return data[:at] + random.choice(PIECES) * random.choice((1, 1, 1, 2, 40, 5000)) + data[at:]


def delete(data: bytes, random: Random) -> bytes:
    """A few bytes, or many."""
    at = _place(data, random)
    return data[:at] + data[at + random.choice((1, 2, 4, 8, 50, 400)) :]


def truncate(data: bytes, random: Random) -> bytes:
    """The end is missing."""
    return data[: random.randrange(len(data) + 1)]


def splice(data: bytes, random: Random) -> bytes:
    """A piece stands somewhere else, or twice."""
    start, at = _place(data, random), _place(data, random)
    piece = data[start : start + random.choice((1, 8, 60, 500))]
    keep = len(piece) if random.random() < 0.5 else 0
    return data[:at] + piece + data[at + keep :]


def number(data: bytes, random: Random) -> bytes:
    """One number, a word of numbers at their limits, or of none."""
    return _replaced(NUMBER, NUMBERS, data, random)


def word(data: bytes, random: Random) -> bytes:
    """One word: renamed, or written as another word of the file is."""
    found = list(WORD.finditer(data))
    if not found:
        return insert(data, random)
    others = (random.choice(found).group(), random.choice(found).group().upper())
    return _put(data, _chosen(found, random), random.choice((*WORDS, *others)))


def _replaced(pattern: re.Pattern[bytes], new: tuple[bytes, ...], data: bytes, random: Random) -> bytes:
    found = list(pattern.finditer(data))
    return _put(data, _chosen(found, random), random.choice(new)) if found else flip(data, random)


def _chosen(found: list[re.Match[bytes]], random: Random) -> re.Match[bytes]:
    return random.choice(found if random.random() < 0.5 else found[:40])


def _put(data: bytes, where: re.Match[bytes], piece: bytes) -> bytes:
    return data[: where.start()] + piece + data[where.end() :]


def lines(data: bytes, random: Random) -> bytes:
    """A line is missing, stands twice, is empty, or has changed places with another."""
    rows = data.split(b"\n")
    a, b = (random.randrange(len(rows) if random.random() < 0.5 else min(len(rows), 12)) for _ in range(2))
    what = random.randrange(5)
    if what == 0:
        del rows[a]
    elif what == 1:
        rows.insert(b, rows[a])
    elif what == 2:
        rows[a] = b""
    elif what == 3:
        rows[a], rows[b] = rows[b], rows[a]
    else:
        rows = rows[: a + 1] if random.random() < 0.5 else rows[a:]
    return b"\n".join(rows)


def cells(data: bytes, random: Random) -> bytes:
    """A cell of a table is missing, stands twice, or has changed places; in one row, or in all from there on."""
    rows = data.split(b"\n")
    start = random.randrange(len(rows))
    pick, other, what, many = random.random(), random.random(), random.randrange(3), random.random() < 0.5
    for row in range(start, len(rows) if many else start + 1):
        parts = CELL.findall(rows[row])
        if len(parts) < 2:
            continue
        a, b = int(pick * len(parts)), int(other * len(parts))
        if what == 0:
            del parts[a]
        elif what == 1:
            parts.insert(b, parts[a])
        else:
            parts[a], parts[b] = parts[b], parts[a]
        rows[row] = b"".join(parts)
    return b"\n".join(rows)


BYTES: tuple[Mutation, ...] = (flip, overwrite, insert, delete, truncate, splice)
TEXT: tuple[Mutation, ...] = (number, number, number, word, word, lines, cells)


def mutated_bytes(data: bytes, random: Random) -> bytes:
    """By one mutation of bytes."""
    return random.choice(BYTES)(data, random)


def mutated_text(data: bytes, random: Random) -> bytes:
    """By one mutation, mostly of numbers, words, lines and cells."""
    return random.choice(TEXT if random.random() < 0.8 else BYTES)(data, random)


def fields_of(data: bytes) -> list[Field] | None:
    """The fields of a Protobuf message; None if the bytes are none."""
    at, fields = 0, []
    while at < len(data):
        head, at = varint(data, at)
        number, kind = head >> 3, head & 7
        if not number:
            return None
        if kind == 0:
            value: Any
            value, at = varint(data, at)
        elif kind in (1, 5):
            size = 8 if kind == 1 else 4
            value, at = data[at : at + size], at + size
        elif kind == 2:
            size, at = varint(data, at)
            value, at = data[at : at + size], at + size
        else:
            return None
        if at > len(data):
            return None
        fields.append((number, kind, value))
    return fields


def varint(data: bytes, at: int) -> tuple[int, int]:
    """The number there, and where the next thing begins: beyond the end if it is cut."""
    value = 0
    for shift in range(10):
        if at >= len(data):
            return 0, at + 1
        value |= (data[at] & 0x7F) << 7 * shift
        at += 1
        if data[at - 1] < 0x80:
            return value, at
    return 0, len(data) + 1


def _packed_varint(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*out, value])


def protobuf_of(fields: list[Field]) -> bytes:
    """The message of these fields."""
    out = b""
    for number, kind, value in fields:
        out += _packed_varint(number << 3 | kind)
        if kind == 0:
            out += _packed_varint(value)
        else:
            out += delimited(value) if kind == 2 else value
    return out


def mutated_protobuf(data: bytes, random: Random) -> bytes:
    """One field of the message, or of one in it, has another value, another number, is missing or stands twice."""
    fields = fields_of(data)
    if not fields:
        return mutated_bytes(data, random)
    row, what = random.randrange(len(fields)), random.randrange(12)
    number, kind, value = fields[row]
    if what == 0:
        del fields[row]
    elif what == 1:
        fields[row:row] = [fields[row]] * random.choice((1, 2, 30))
    elif what == 2:
        fields[row] = (random.choice(fields)[0], kind, value)
    else:
        fields[row] = (number, kind, _mutated_value(kind, value, random))
    return protobuf_of(fields)


def _mutated_value(kind: int, value: Any, random: Random) -> Any:
    if kind == 0:
        return random.choice(INTEGERS)
    if kind == 1:
        return struct.pack("<d", random.choice(LIMITS))
    if kind == 5:
        return struct.pack("<I", random.choice(INTEGERS) % 2**32)
    if len(value) % 8 == 0 and value and random.random() < 0.3:  # as packed numbers
        doubles = list(struct.unpack(f"<{len(value) // 8}d", value))
        if random.random() < 0.3:
            del doubles[random.randrange(len(doubles)) :]
        else:
            doubles[random.randrange(len(doubles))] = random.choice(LIMITS)
        return struct.pack(f"<{len(doubles)}d", *doubles)
    return mutated_protobuf(value, random) if random.random() < 0.9 else mutated_text(value, random)


def records_of(data: bytes) -> list[tuple[int, bytes]]:
    """Opcode and content of all records of an MCAP file, those in its chunks too, up to its footer."""
    at, records = len(MAGIC), []
    while at + RECORD_HEAD.size <= len(data):
        opcode, size = RECORD_HEAD.unpack_from(data, at)
        at += RECORD_HEAD.size + size
        content = data[at - size : at]
        if opcode == Opcode.CHUNK:
            records += records_of(MAGIC + chunk_data(Chunk.read(ReadDataStream(BytesIO(content))), largest_chunk()))
        elif opcode != INDEX:
            records.append((opcode, content))
        if opcode == Opcode.FOOTER:
            break
    return records


def mcap_of(records: list[tuple[int, bytes]]) -> bytes:
    """The file of these records, without chunks, and therefore without checksums."""
    return MAGIC + b"".join(RECORD_HEAD.pack(opcode, len(content)) + content for opcode, content in records) + MAGIC


def mutated_mcap(data: bytes, random: Random) -> bytes:
    """One record has another content, is missing, stands twice or in another place."""
    records = records_of(data)
    row, what = random.randrange(len(records)), random.randrange(12)
    seldom = [i for i, one in enumerate(records) if one[0] != Opcode.MESSAGE or records[i - 1][0] != Opcode.MESSAGE]
    row = random.choice(seldom) if random.random() < 0.5 else row
    opcode, content = records[row]
    if what == 0:
        del records[row]
    elif what == 1:
        records.insert(random.randrange(len(records)), records[row])
    elif opcode != Opcode.MESSAGE:
        records[row] = (opcode, mutated_text(content, random))
    elif what == 2:
        records[row] = (opcode, mutated_bytes(content, random))
    else:
        records[row] = (opcode, content[:MESSAGE_HEAD] + mutated_protobuf(content[MESSAGE_HEAD:], random))
    return mcap_of(records if random.random() < 0.5 else _in_a_chunk(records))


def _in_a_chunk(records: list[tuple[int, bytes]]) -> list[tuple[int, bytes]]:
    """The same with all but the first and the last records in one chunk, without compression or checksum."""
    inner = mcap_of(records[1:-2])[len(MAGIC) : -len(MAGIC)]
    messages = [one for code, one in records if code == Opcode.MESSAGE and len(one) > 13]
    times = [struct.unpack_from("<Q", message, 6)[0] for message in messages] or [0]
    head = struct.pack("<QQQIIQ", min(times), max(times), len(inner), 0, 0, len(inner))
    return [*records[:1], (Opcode.CHUNK, head + inner), *records[-2:]]


def mutated_stream(data: bytes, random: Random) -> bytes:
    """One message of a delimited stream is another, missing, twice, or elsewhere."""
    at, messages = 0, []
    while at < len(data):
        size, at = varint(data, at)
        messages.append(data[at : at + size])
        at += size
    row, what = random.randrange(len(messages) if random.random() < 0.5 else min(2, len(messages))), random.randrange(8)
    if what == 0:
        del messages[row]
    elif what == 1:
        messages.insert(random.randrange(len(messages)), messages[row])
    else:
        messages[row] = mutated_protobuf(messages[row], random)
    return b"".join(map(delimited, messages))


def mutated_json(data: bytes, random: Random) -> bytes:
    """One value is another, missing, twice, or has another key."""
    try:
        tree = json.loads(data)
    except ValueError:
        return mutated_text(data, random)
    places: list[tuple[Any, Any]] = []
    _places(tree, places)
    if not places or random.random() < 0.01:
        return json.dumps(random.choice(VALUES)).encode()
    inside, key = random.choice(places)
    what = random.randrange(6)
    if what == 0:
        del inside[key]
    elif what == 1 and isinstance(inside, list):
        inside.insert(key, inside[key])
    elif what == 1:
        inside[random.choice(("", "x", "name", *inside))] = inside.pop(key)
    else:
        inside[key] = random.choice(VALUES)
    return json.dumps(tree).encode()


def _places(tree: Any, places: list[tuple[Any, Any]]) -> None:
    items = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, value in items:
        places.append((tree, key))
        _places(value, places)


def mutated_arrays(content: dict[str, Any], random: Random) -> dict[str, Any]:
    """One array has another shape, type or number in it, is missing or has another name."""
    name = random.choice(sorted(content))
    value, rest = np.asarray(content[name]), {key: one for key, one in content.items() if key != name}
    flat = value.astype(float).reshape(-1) if value.dtype.kind in "fiub" else np.zeros(value.size)
    flat[random.randrange(max(flat.size, 1)) : random.choice((flat.size, flat.size // 2))] = random.choice(LIMITS)
    one = np.array(np.asarray(content[name]), copy=True)
    if one.dtype.kind == "f" and one.size:
        one.reshape(-1)[random.randrange(one.size)] = random.choice(LIMITS)
    others: tuple[Any, ...] = (
        value[: random.randrange(3)] if value.ndim else np.array([]),
        value.reshape(-1) if value.ndim > 1 else value[None],
        np.zeros(value.shape, random.choice(("f4", "i8", "c16", "S8", "U4", "?"))),
        random.choice((np.float64(random.choice(LIMITS)), np.array("x"), np.zeros((0, 3)), np.zeros(0))),
        np.swapaxes(value, 0, -1) if value.ndim else value,
        one, one, one, flat.reshape(value.shape),
    )  # fmt: skip
    what = random.randrange(len(others) + 2)
    if what == len(others):
        return rest
    return rest | ({random.choice(sorted(content)): value} if what > len(others) else {name: others[what]})


def mutated_npz(data: bytes, random: Random) -> bytes:
    """An archive of arrays, one of which is another; or other bytes of one, with the checksum to them."""
    if random.random() < 0.6:
        with np.load(BytesIO(data), allow_pickle=False) as archive:
            content = mutated_arrays(dict(archive), random)
        out = BytesIO()
        np.savez(out, **content)
        return out.getvalue()
    with zipfile.ZipFile(BytesIO(data)) as archive_file:
        parts = {name: archive_file.read(name) for name in archive_file.namelist()}
    name = random.choice(sorted(parts))
    parts[name] = mutated_text(parts[name], random) if random.random() < 0.5 else mutated_bytes(parts[name], random)
    out = BytesIO()
    with zipfile.ZipFile(out, "w") as archive_file:
        for one, content_bytes in parts.items():
            archive_file.writestr(one, content_bytes)
    return out.getvalue()


MUTATIONS: dict[str, tuple[Mutation, ...]] = {
    ".mcap": (mutated_mcap, mutated_mcap, mutated_mcap, mutated_bytes),
    ".messages": (mutated_stream, mutated_stream, mutated_bytes),
    ".json": (mutated_json, mutated_json, mutated_text),
    ".npz": (mutated_npz, mutated_npz, mutated_npz, mutated_bytes),
    ".onnx": (mutated_protobuf, mutated_protobuf, mutated_bytes),
    **dict.fromkeys((".mp4", ".png", ".jpg", ".db"), (mutated_bytes,)),
}
"""By the suffix of a file; all others are text."""


def mutated(name: str, content: bytes, random: Random) -> bytes:
    """A file of that name, damaged once."""
    try:
        return random.choice(MUTATIONS.get(Path(name).suffix, (mutated_text,)))(content, random)
    except Exception:  # damaged before, so that it cannot be unpacked any more
        return mutated_bytes(content, random)
