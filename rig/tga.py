"""Decoding of Truevision TGA: grey or colour of 8 bits, plain or run-length encoded.

Published sets of photometric stereo come in it, and OpenCV does not read it. The header is that of
the Truevision TGA File Format Specification, version 2.0.
"""

import struct

import numpy as np
import numpy.typing as npt

_HEADER = struct.Struct("<BBBHHBHHHHBB")
_TRUE_COLOUR, _GREY, _RUN_LENGTHS = 2, 3, 8
_RIGHT_TO_LEFT, _TOP_DOWN = 0x10, 0x20


def tga_size(content: bytes) -> tuple[int, int, int]:
    """Rows, columns and bytes per pixel that a TGA declares.

    Raises
    ------
    ValueError
        If it is not a TGA of a handled type.
    """
    if len(content) < _HEADER.size:
        raise ValueError("no TGA header; the file is truncated")
    _, _, kind, _, _, _, _, _, columns, rows, depth, _ = _HEADER.unpack_from(content)
    depths = {_TRUE_COLOUR: (24, 32), _GREY: (8,)}.get(kind & ~_RUN_LENGTHS, ())
    if depth not in depths:
        raise ValueError(
            f"TGA of type {kind} with {depth} bits per pixel; save it as PNG, grey or RGB"
        )
    return rows, columns, depth // 8


def decode_tga(content: bytes) -> npt.NDArray[np.uint8]:
    """Decode a TGA as (H, W) grey, or (H, W, 3) RGB without alpha.

    Raises
    ------
    ValueError
        If it is not a complete TGA of a handled type.
    """
    rows, columns, samples = tga_size(content)
    id_bytes, has_map, kind, _, map_entries, map_bits, *_, descriptor = _HEADER.unpack_from(content)
    start = _HEADER.size + id_bytes + (map_entries * -(-map_bits // 8) if has_map else 0)
    size = rows * columns * samples
    body = content[start:]
    pixels = _expanded(body, size, samples) if kind & _RUN_LENGTHS else body[:size]
    if len(pixels) != size:
        raise ValueError("the pixels of the TGA are incomplete; it may be truncated")
    image = np.frombuffer(pixels, np.uint8).reshape(rows, columns, samples)
    if not descriptor & _TOP_DOWN:
        image = image[::-1]
    if descriptor & _RIGHT_TO_LEFT:
        image = image[:, ::-1]
    # Stored as blue, green, red and alpha.
    return np.ascontiguousarray(image[:, :, 0] if samples == 1 else image[:, :, 2::-1])


def _expanded(packets: bytes, size: int, samples: int) -> bytes:
    """Expand packets of 1 to 128 pixels: a run of one pixel, or as many pixels as follow."""
    parts, at, expanded = [], 0, 0
    while expanded < size and at < len(packets):
        count = (packets[at] & 0x7F) + 1
        is_run = packets[at] & 0x80
        end = at + 1 + samples * (1 if is_run else count)
        part = packets[at + 1 : end] * (count if is_run else 1)
        parts.append(part)
        at, expanded = end, expanded + len(part)
    return b"".join(parts)
