"""A height map as a Digital Surf ``.sur`` file: one surface, uncompressed, 32 bits a point."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from classify.durable_file import durable_file

from .height_map import HeightMap

# Fields and sizes of the 512-byte header, as surfalize and Gwyddion read it.
_HEADER = struct.Struct("<12s4h30s30s5hf4xh5i3f" + 9 * "16s" + "3f3h12x7hfI6x2h128s5f13s13s")
_SURFACE = 2
_BITS = 32
# Heights are whole numbers up to this; the number for a missing height, two less than the lowest,
# still fits.
_HIGHEST = 2**30
# Any other unit than ASCII has an encoding that readers guess.
_UNIT = b"mm"
_MAX_COMMENT_BYTES = 2**15 - 1


def write_sur(path: Path, heights: HeightMap) -> None:
    """Write heights in mm, rows from the top; points without a height are marked as such.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    values = heights.heights_mm
    missing = np.isnan(values)
    # The step of the file is a float32: heights are divided by what readers multiply with.
    step_mm = float(np.float32(max(float(np.nanmax(np.abs(values))), 1e-12) / _HIGHEST))
    points = np.rint(np.where(missing, 0.0, values.astype(np.float64)) / step_mm).astype("<i4")
    lowest, highest = int(points[~missing].min()), int(points[~missing].max())
    points[missing] = lowest - 2
    about, (rows, columns) = heights.metadata, values.shape
    date = heights.captured_at
    comment = _text(heights.comment, _MAX_COMMENT_BYTES)
    header = _HEADER.pack(
        b"DIGITAL SURF", 0, 1, 1, _SURFACE,  # for PCs, one object, version 1
        _text(about.label, 30), _text(about.operator, 30),
        0, 0, 0, int(missing.any()), 0,  # no kind of acquisition, range or absolute height
        0.0, _BITS, lowest, highest, columns, rows, points.size,
        heights.mm_per_px, heights.mm_per_px, step_mm,
        b"X", b"Y", b"Z", *[_UNIT] * 6, 1.0, 1.0, 1.0,
        0, 0, 0,  # neither replica, inverted nor levelled
        date.second, date.minute, date.hour, date.day, date.month, date.year, date.isoweekday() % 7,
        0.0, 0, len(comment), 0, _text(f"ps4rig {about.software_version}", 128),
        0.0, 0.0, 0.0, 0.0, 0.0, b"", b"",
    )  # fmt: skip
    with durable_file(path) as temporary, temporary.open("wb") as file:
        file.write(header + comment)
        file.write(points.tobytes())


def _text(text: str | None, size: int) -> bytes:
    return (text or "").encode("ascii", "replace")[:size]
