"""PNG files unpacked without Pillow, against Pillow."""

import io
import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from roslf_design.depth.plain_png import unpacked

MOST = 10**6


def chunk(name, content):
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))


def png(rows, columns, colours, lines, bits=8, interlaced=0, beside=b""):
    """A file by rows of bytes, each the filter's number and what it left, in two chunks."""
    head = struct.pack(">IIBBBBB", columns, rows, bits, colours, 0, 0, interlaced)
    packed = zlib.compress(lines)
    parts = chunk(b"IDAT", packed[:10]) + chunk(b"IDAT", packed[10:])
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + beside + parts + chunk(b"IEND", b"")


@pytest.mark.parametrize(("colours", "channels"), [(0, 1), (2, 3)])
def test_all_filters_give_pillows_pixels(colours, channels):
    rng = np.random.default_rng(7)
    lines = rng.integers(0, 256, (60, 1 + 37 * channels), np.uint8)
    lines[::2, 1:] //= 100  # small differences, which leave neighbours alike
    lines[:, 0] = np.arange(60) * 7 % 5
    content = png(60, 37, colours, lines.tobytes())
    shown = np.asarray(Image.open(io.BytesIO(content)))
    assert np.array_equal(unpacked(content, MOST), shown)


def test_what_else_a_png_may_be_is_left_to_pillow():
    lines = np.zeros((9, 10), np.uint8).tobytes()
    good = png(9, 9, 0, lines)
    assert unpacked(good, MOST) is not None
    note, wrong = chunk(b"tEXt", b"Description\0{}"), np.full((9, 10), 5, np.uint8).tobytes()
    others = [
        png(9, 9, 0, lines, interlaced=1), png(9, 9, 3, lines), png(9, 4, 0, lines[:81], bits=16),
        png(9, 9, 0, lines, beside=note), png(9, 9, 0, wrong), png(9, 9, 0, lines[:-1]), png(9, 9, 0, lines + b"\0"),
        png(0, 9, 0, b""), png(9, 0, 0, bytes(9)), good[:60], good[:20], b"", good.replace(b"IDAT", b"IDOT"),
    ]  # fmt: skip
    assert [unpacked(content, MOST) for content in others] == [None] * len(others)
    assert unpacked(good, 80) is None  # of 81 pixels
