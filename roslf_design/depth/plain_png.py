"""PNG files of 8 bits without notes, which most decoded views are, unpacked in half of the time that Pillow takes."""

from __future__ import annotations

import struct
import zlib

import numpy as np
from numpy import int32
from numpy.typing import NDArray

from .._jit import kernel

Bytes = NDArray[np.uint8]
_BEGINNING = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR"
_HEAD = struct.Struct(">16xIIBBBBB")
_CHANNELS = {0: 1, 2: 3}
"""Channels by a PNG's type of colour: grey or RGB."""


@kernel(apart=True)
def _unfilter(lines: Bytes, channels: int, out: Bytes) -> None:
    """Bytes of rows by the differences that each row's first byte says they are from those before and above."""
    above = np.zeros(out.shape[1], np.uint8)
    for v in range(out.shape[0]):
        kind, row, to = lines[v, 0], lines[v, 1:], out[v]
        for c in range(channels):
            left, corner = int32(0), int32(0)
            for u in range(c, to.size, channels):
                over = int32(above[u])
                if kind == 4:
                    # Of the three, that nearest to left + over - corner: those beside it are ordered by what is beyond.
                    beyond, low, high = int32(3) * corner - over - left, min(left, over), max(left, over)
                    near = low if high <= beyond else corner
                    near = high if beyond <= low else near
                else:
                    near = (left + over) // int32(2) if kind == 3 else over if kind == 2 else left * int32(kind)
                left, corner = (int32(row[u]) + near) & int32(255), over
                to[u] = left
        above = to


def unpacked(content: bytes, most: int) -> Bytes | None:
    """Pixels of a file, shape (rows, columns) or with channels at the end; None of one of another kind, or damaged.

    None as well where they are more than `most` bytes.
    """
    if not content.startswith(_BEGINNING) or b"Description" in content or len(content) < _HEAD.size:
        return None
    columns, rows, bits, colours, *others = _HEAD.unpack_from(content)
    channels, at, packed = _CHANNELS.get(colours, 0), 8, []
    size = rows * (columns * channels + 1)
    if bits != 8 or not channels * columns * rows or any(others) or size > most:
        return None
    while at + 12 <= len(content):
        count, name = struct.unpack_from(">I4s", content, at)
        packed += [content[at + 8 : at + 8 + count]] if name == b"IDAT" else []
        at += 12 + count
    stream = zlib.decompressobj()
    try:
        lines = np.frombuffer(stream.decompress(b"".join(packed), size + 1), np.uint8)
    except zlib.error:
        return None
    if lines.size != size or not stream.eof or (lines[:: columns * channels + 1] > 4).any():
        return None
    out = np.empty((rows, columns * channels), np.uint8)
    _unfilter.compiled(lines.reshape(rows, -1), channels, out)
    return out if channels == 1 else out.reshape(rows, columns, channels)
