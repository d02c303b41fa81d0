"""A height map as a Digital Surf ``.sur`` file: one surface, uncompressed, 32 bits a point."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from classify.base.durable_file import durable_file

from .height_map import HeightMap

# Fields and sizes of the header, as surfalize and rosettasciio read it.
_HEADER = struct.Struct("<12s4h30s30s5hf4xh5i3f" + 9 * "16s" + "3f3h12x7hfI6x2h128s5f13s13s")
_SURFACE = 2
_BITS = 32
# Largest point, as a number of steps above the offset; 32 bits could hold twice as many.
_HIGHEST = 2**30
# Readers differ in whether the lowest point is subtracted (rosettasciio) or not (surfalize), and in
# the unit of the offset. With 0 as the lowest point and micrometres they agree.
_LOWEST = 0
_SMALLEST_RANGE_UM = 1e-9  # of a level surface; far below the resolution of any instrument
_MISSING = _LOWEST - 2  # by the format
_UNIT, _UM_PER_MM = "\N{MICRO SIGN}m", 1e3
_MAX_COMMENT_BYTES = 2**15 - 1


def write_sur(path: Path, heights: HeightMap) -> None:
    """Write heights in micrometres, rows from the top; NaN becomes a missing point."""
    heights_um = _UM_PER_MM * heights.heights_mm.astype(np.float64)
    missing = np.isnan(heights_um)
    # Offset and step are float32 in the file, so the points are computed from the rounded values.
    offset_um = np.nextafter(np.float32(np.nanmin(heights_um)), np.float32(-np.inf))
    heights_um -= offset_um
    step_um = np.float32(max(np.nanmax(heights_um), _SMALLEST_RANGE_UM) / _HIGHEST)
    points = np.rint(np.where(missing, 0.0, heights_um) / step_um).astype("<i4")
    points[missing] = _MISSING
    metadata, (rows, columns) = heights.metadata, points.shape
    date, um_per_px = heights.captured_at, _UM_PER_MM * heights.mm_per_px
    comment = heights.comment.encode("latin-1", "replace")[:_MAX_COMMENT_BYTES]
    header = _HEADER.pack(
        b"DIGITAL SURF", 0, 1, 1, _SURFACE,  # for PCs, one object, version 1
        _text(metadata.label, 30), _text(metadata.operator, 30),
        0, 0, 0, int(missing.any()), 0,  # no kind of acquisition, range or absolute height
        0.0, _BITS, _LOWEST, _HIGHEST, columns, rows, points.size,
        um_per_px, um_per_px, step_um,
        *(_text(text, 16) for text in ("X", "Y", "Z", *[_UNIT] * 6)), 1.0, 1.0, 1.0,
        0, 0, 0,  # neither replica, inverted nor levelled
        date.second, date.minute, date.hour, date.day, date.month, date.year, date.isoweekday() % 7,
        0.0, 0, len(comment), 0, _text(f"ps4rig {metadata.software_version}", 128),
        0.0, 0.0, offset_um, 0.0, 0.0, _text("", 13), _text("", 13),
    )  # fmt: skip
    with durable_file(path) as temporary, temporary.open("wb") as file:
        file.write(header + comment)
        file.write(points.tobytes())


def _text(text: str | None, size: int) -> bytes:
    return (text or "").encode("latin-1", "replace")[:size].ljust(size)
