"""The raw image of a DNG, linear from its black to its white level."""

import io
import struct
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from classify.base.arrays import Array, FloatMap
from classify.base.errors import InputError

_CFA, _LINEAR_RAW = 32803, 34892  # photometric interpretations of a mosaic, and of whole pixels
_UNSIGNED = 1  # a sample format
_RATIONALS = (5, 10)  # field types of TIFF 6.0, unsigned and signed
# Tags of the Digital Negative Specification 1.7.
_CFA_LAYOUT, _RECTANGULAR = 50711, 1
_BLACK_REPEAT, _BLACK, _BLACK_DELTA_H, _BLACK_DELTA_V, _WHITE = range(50713, 50718)
_ACTIVE_AREA = 50829
# Lists of corrections before demosaicing, and those that change the response of pixels or rows.
_OPCODE_LISTS, _RESPONSE_OPCODES = (51008, 51009), (7, 8, 10, 11, 12, 13)


def linear_raw(content: bytes, page: Any) -> npt.NDArray[np.uint16]:
    """Raw image (H, W) or (H, W, 3) of a `tifffile` page as linear camera RGB, 0 to 65535.

    Raises
    ------
    InputError
        Without rawpy, or for a raw image that is not handled.
    """
    try:
        import rawpy
    except ImportError:
        raise InputError(
            "a DNG is read by rawpy, which is not installed: pip install 'ps4rig[dng]'"
        ) from None
    samples, kind = page.samplesperpixel, page.photometric
    refusal = InputError("a raw image of a kind that is not handled; convert it to a TIFF")
    black_deltas = (_numbers(page, tag, 0) for tag in (_BLACK_DELTA_H, _BLACK_DELTA_V))
    if (
        (kind, samples) not in ((_CFA, 1), (_LINEAR_RAW, 1), (_LINEAR_RAW, 3))
        or page.tags.valueof(_CFA_LAYOUT, _RECTANGULAR) != _RECTANGULAR
        or page.sampleformat != _UNSIGNED
        or any(delta.any() for delta in black_deltas)
    ):
        raise refusal
    for tag in _OPCODE_LISTS:
        for opcode in _opcodes(page.tags.valueof(tag, b"")):
            if opcode in _RESPONSE_OPCODES:
                raise InputError(
                    f"corrected by opcode {opcode}, which is not handled; convert to TIFF"
                )
    with rawpy.imread(io.BytesIO(content)) as raw:
        shape, values = raw.raw_image.shape[:2], np.atleast_3d(raw.raw_image_visible)
        if shape != page.shape[:2] or (kind == _CFA and raw.num_colors != 3):
            raise refusal
        origin = (raw.sizes.top_margin, raw.sizes.left_margin)
        levels = _from_black_to_white(values[:, :, :samples], origin, page)
        if kind == _LINEAR_RAW:
            return levels if samples == 3 else levels[:, :, 0]
        # LibRaw fills in the missing colours of these levels, and does nothing else.
        raw.raw_image_visible[:] = levels[:, :, 0]
        rgb: Array = raw.postprocess(
            gamma=(1, 1), no_auto_bright=True, no_auto_scale=True, adjust_maximum_thr=0.0,
            output_bps=16, output_color=rawpy.ColorSpace.raw, user_flip=0, user_black=0,
            user_cblack=[0] * 4, user_sat=65535, user_wb=[1.0] * 4,
            demosaic_algorithm=rawpy.DemosaicAlgorithm.LINEAR,
        )  # fmt: skip
    return np.asarray(rgb, np.uint16)


def _from_black_to_white(
    values: Array, origin: tuple[int, int], page: Any
) -> npt.NDArray[np.uint16]:
    """Raw values from `origin`, with the page's black level at 0 and its white level at 65535."""
    # Black levels repeat from the active area, of which LibRaw leaves out an odd row and column.
    top, left = np.subtract(origin, _numbers(page, _ACTIVE_AREA, 0, 0)[:2].astype(int))
    rows, columns = (np.arange(size) for size in values.shape[:2])
    tile_rows, tile_columns = _numbers(page, _BLACK_REPEAT, 1, 1).astype(int)
    tile = _numbers(page, _BLACK, 0).reshape(tile_rows, tile_columns, -1)
    black = tile[np.ix_((top + rows) % tile_rows, (left + columns) % tile_columns)]
    white = _numbers(page, _WHITE, (1 << page.bitspersample) - 1)
    for levels in (black, white):
        if levels.shape[-1] not in (1, values.shape[2]):
            raise InputError(f"states {levels.shape[-1]} levels for {values.shape[2]} samples")
    if (white <= black).any():
        raise InputError(
            f"its white level, {white.min():g}, is not above its black level, {black.max():g}"
        )
    share = np.clip((values - black) / (white - black), 0.0, 1.0)
    return np.asarray(np.rint(65535.0 * share), np.uint16)


def _numbers(page: Any, tag: int, *default: float) -> FloatMap:
    """Values of a tag; a rational is stored as numerator and denominator."""
    entry = page.tags.get(tag)
    numbers = np.ravel(default if entry is None else entry.value).astype(np.float32)
    is_rational = entry is not None and entry.dtype in _RATIONALS
    return numbers[::2] / numbers[1::2] if is_rational else numbers


def _opcodes(content: bytes) -> Iterator[int]:
    """Numbers of the opcodes in a list of corrections, whose parameters are skipped."""
    start = 4  # after the number of opcodes
    while len(content) >= start + 16:
        opcode, _version, _flags, parameter_bytes = struct.unpack_from(">4I", content, start)
        yield opcode
        start += 16 + parameter_bytes
