"""Mutations of bytes and of text: what a bad disk, a cut connection, a spreadsheet or a hand does to a file."""

import re
from collections.abc import Callable
from random import Random

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
