"""Files made from good ones by small damage: bytes, tokens, spans, and halves of two files."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from random import Random

LONGEST = 20_000  # bytes; what grows further is cut, or spans of spans would eat the time

_NUMBERS = b"nan inf -inf 1e999 -0 0 -1 1 0.5 1e-320 3e38 2147483648 -2147483649 1e --1 0x10 1_000".split()
_MARKS = (
    b"[]",
    b"{}",
    b"[[",
    b"}}",
    b'""',
    b'"',
    b"'",
    b"\\",
    b"\\\n",
    b"#",
    b"\0",
    b"\r",
    b"\n",
    b"\t",
    b" ",
    b"/",
    b"//",
)
_BYTES = (b"\xff", b"\xef\xbb\xbf", b"\xff\xfe", "ä€😀".encode(), b"9" * 30, b"a" * 5000)
_PATHS = (b"../", b"..\\", b"../secret.png", b"/etc/passwd", b"~root/x", b"NUL", b"%s%n", b"true", b"null")
_KEYS = (b"mtllib ", b"usemtl ", b"newmtl ", b"map_Kd ", b"-bm 2 ", b"-s 1 1 1 ", b"Ns 2", b"Kd 1", b"spectral")
_DEEP = (b"[" + b".".join([b"a"] * 2000) + b"]\n", b"[" * 2000, b'{"a":' * 2000)
_LINES = (b"f 1 2 3", b"f 0 0 0", b"f -1 -2 -3", b"f 1/1/1 2//2 3", b"v 1 2", b"v nan 0 0")
_XML = (
    b"<", b">", b"/>", b"<!--", b"-->", b"<![CDATA[", b"&amp;", b"&#27;", b"&x;", b"<!DOCTYPE scene [", b"$size",
    b"\\$", b'<sensor type="perspective">', b'<film type="../../evil">', b"</sensor>", b' name="fov"', b"<include/>",
)  # fmt: skip
_LISTS = (b"*", b"**/", b"[a-", b"?", b"--type", b" # ", b"scene.toml\n", b"\\\n")
_CONTROLS = (b"\\n", b"\\u001b", b"\\ud800", b"\\u2028", b"\x1b[2J", b"\xc2\x9b")
TOKENS = (*_NUMBERS, *_MARKS, *_BYTES, *_PATHS, *_KEYS, *_LINES, *_DEEP, *_XML, *_LISTS, *_CONTROLS)

Mutation = Callable[[bytes, Random, Sequence[bytes]], bytes]


def mutated(seeds: Sequence[bytes], random: Random) -> bytes:
    """One of the seeds, damaged one to six times."""
    data = random.choice(seeds)
    for _ in range(random.choice((1, 1, 2, 3, 6))):
        data = random.choice(MUTATIONS)(data, random, seeds)[:LONGEST]
    return data


def _span(data: bytes, random: Random) -> tuple[int, int]:
    start = random.randrange(len(data) + 1)
    return start, min(len(data), start + random.choice((1, 2, 4, 8, 64, 512)))


def _flip(data: bytes, random: Random, seeds: Sequence[bytes]) -> bytes:
    if not data:
        return data
    at = random.randrange(len(data))
    return data[:at] + bytes([data[at] ^ 1 << random.randrange(8)]) + data[at + 1 :]


def _byte(data: bytes, random: Random, seeds: Sequence[bytes]) -> bytes:
    start, _ = _span(data, random)
    return data[:start] + bytes([random.choice((0, 1, 127, 128, 255, random.randrange(256)))]) + data[start + 1 :]


def _cut(data: bytes, random: Random, seeds: Sequence[bytes]) -> bytes:
    return data[: random.randrange(len(data) + 1)]


def _without(data: bytes, random: Random, seeds: Sequence[bytes]) -> bytes:
    start, end = _span(data, random)
    return data[:start] + data[end:]


def _repeated(data: bytes, random: Random, seeds: Sequence[bytes]) -> bytes:
    start, end = _span(data, random)
    return data[:end] + data[start:end] * random.choice((1, 3, 100)) + data[end:]


def _token(data: bytes, random: Random, seeds: Sequence[bytes]) -> bytes:
    start, end = _span(data, random)
    return data[:start] + random.choice(TOKENS) + data[start if random.random() < 0.5 else end :]


def _value(data: bytes, random: Random, seeds: Sequence[bytes]) -> bytes:
    """Another token in the place of a number."""
    numbers = list(re.finditer(rb"-?\d+\.?\d*(?:[eE][-+]?\d+)?", data))
    if not numbers:
        return data
    number = random.choice(numbers)
    return data[: number.start()] + random.choice(TOKENS) + data[number.end() :]


def _whole_number(data: bytes, random: Random, seeds: Sequence[bytes]) -> bytes:
    """Four bytes as a size or an offset that is too large, negative, or 0."""
    if len(data) < 4:
        return data
    at = random.randrange(len(data) - 3)
    value = random.choice((0, 1, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 1_000_000_000, 65536))
    return data[:at] + value.to_bytes(4, random.choice(("little", "big"))) + data[at + 4 :]


def _lines(data: bytes, random: Random, seeds: Sequence[bytes]) -> bytes:
    """Two lines change places."""
    lines = data.split(b"\n")
    i, j = random.randrange(len(lines)), random.randrange(len(lines))
    lines[i], lines[j] = lines[j], lines[i]
    return b"\n".join(lines)


def _spliced(data: bytes, random: Random, seeds: Sequence[bytes]) -> bytes:
    other = random.choice(seeds)
    return data[: random.randrange(len(data) + 1)] + other[random.randrange(len(other) + 1) :]


MUTATIONS: tuple[Mutation, ...] = (
    _flip, _byte, _cut, _without, _repeated, _token, _token, _value, _value, _whole_number, _lines, _spliced,
)  # fmt: skip
