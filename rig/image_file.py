"""Read a PNG, JPEG, TIFF, TGA or DNG: damage is an error, memory is bounded.

OpenCV fills the missing part of a truncated JPEG with grey, and libpng prints warnings. So a JPEG
is decoded by simplejpeg, which makes warnings errors, and a PNG is checked before it is decoded.
"""

import io
import math
import struct
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from classify.errors import InputError
from classify.regular_file import read_regular_file

from .exif import (
    UPRIGHT,
    checked_orientation,
    exif_exposure_ms,
    exif_orientation,
    jpeg_exif,
    upright,
)
from .tga import decode_tga, tga_size

Image = npt.NDArray[np.uint8 | np.uint16]
_MAX_BYTES = 2**31
_MAX_SIDE_PX = 32768
# A file may declare this many bytes of pixels, or this many times its own length if that is more.
# Zeros are compressed by 1000 and more, photographs with noise by less than 100.
_SMALL_BYTES = 2**26
_MAX_COMPRESSION = 200
_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
# Samples per pixel, and the allowed bits of a sample, for each colour type of a PNG (section 11.2.2
# of its specification).
_PNG_COLOUR_TYPES = {
    0: (1, (1, 2, 4, 8, 16)), 2: (3, (8, 16)), 3: (1, (1, 2, 4, 8)), 4: (2, (8, 16)),
    6: (4, (8, 16)),
}  # fmt: skip
_PNG_PALETTE = 3
# First column and row, and steps between columns and rows, of the passes of a PNG.
_ONE_PASS = ((0, 0, 1, 1),)
_ADAM7 = (
    (0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2),
    (0, 1, 1, 2),
)  # fmt: skip


def read_image(path: Path) -> Image:
    """Read an image as (H, W) grey or (H, W, 3) RGB, uint8 or uint16; alpha is left out.

    Pixel values are those of the file. The image is turned upright as its EXIF data say. Bytes
    after the end of a JPEG or PNG are ignored.

    Raises
    ------
    InputError
        If the file is missing, damaged, not one grey or colour image of 8 or 16 bits, or declares
        far more pixels than a file of its length can hold.
    """
    return read_oriented_image(path)[0]


def read_oriented_image(path: Path) -> tuple[Image, int]:
    """Read an image as `read_image`, with the EXIF orientation, 1 to 8, that was undone.

    A DNG is read as `rig.dng.read_dng` does.
    """
    if path.suffix.lower() == ".dng":
        from .dng import read_dng

        raw, orientation = read_dng(path)
        return upright(raw, orientation), orientation
    readers = {
        ".png": _png, ".jpg": _jpeg, ".jpeg": _jpeg, ".tif": _tiff, ".tiff": _tiff, ".tga": _tga,
    }  # fmt: skip
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise InputError(f"{path}: images come as PNG, JPEG, TIFF, TGA or DNG")
    content = read_regular_file(path, _MAX_BYTES)
    try:
        image, orientation = reader(content)
    except (ValueError, cv2.error) as error:
        raise InputError(f"{path}: {error}") from error
    if image.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{path}: {image.dtype} pixels; give 8 or 16 bit")
    if image.ndim == 3 and image.shape[2] == 1:
        image = image[:, :, 0]
    if image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] not in (3, 4)):
        raise InputError(f"{path}: {image.shape} is not one grey or colour image")
    return image if image.ndim == 2 else image[:, :, :3], orientation


def read_exposure_ms(path: Path) -> float | None:
    """Return the exposure time in the EXIF data of an image; None if there is none.

    Raises
    ------
    InputError
        If the file is missing, or is a PNG that is damaged.
    """
    content = read_regular_file(path, _MAX_BYTES)
    suffix = path.suffix.lower()
    try:
        if suffix == ".png":
            return exif_exposure_ms(_png_exif(_png_chunks(content)))
    except ValueError as error:
        raise InputError(f"{path}: {error}") from error
    # A TIFF, and so a DNG, has the form of EXIF data itself.
    return exif_exposure_ms(jpeg_exif(content) if suffix in (".jpg", ".jpeg") else content)


def _require_size(rows: int, columns: int, declared_bytes: int, held_bytes: int) -> None:
    if not (0 < rows <= _MAX_SIDE_PX and 0 < columns <= _MAX_SIDE_PX):
        raise ValueError(f"{columns} x {rows} px; sides up to {_MAX_SIDE_PX} are handled")
    if declared_bytes > max(_SMALL_BYTES, _MAX_COMPRESSION * held_bytes):
        raise ValueError(
            f"declares {declared_bytes} bytes of pixels in {held_bytes} bytes; save it uncompressed"
        )


def _by_opencv(content: bytes, kind: str) -> npt.NDArray[Any]:
    # OpenCV logs an error on stderr before it returns None.
    level = cv2.utils.logging.setLogLevel(0)
    try:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    finally:
        cv2.utils.logging.setLogLevel(level)
    if image is None:
        raise ValueError(f"not a readable {kind}; it may be truncated")
    return np.ascontiguousarray(image[:, :, 2::-1]) if image.ndim == 3 else image


def _jpeg(content: bytes) -> tuple[npt.NDArray[Any], int]:
    import simplejpeg

    try:
        if not content.startswith(b"\xff\xd8"):
            raise ValueError("no JPEG signature")
        rows, columns, colours, _ = simplejpeg.decode_jpeg_header(content)
        grey = colours.lower() == "gray"
        if not grey and colours.lower() not in ("rgb", "ycbcr"):
            raise ValueError(f"pixels are {colours}; save it as grey or RGB")
        _require_size(rows, columns, rows * columns * (1 if grey else 3), len(content))
        image: npt.NDArray[np.uint8] = simplejpeg.decode_jpeg(content, "gray" if grey else "rgb")
    except ValueError as error:
        raise ValueError(f"not a complete JPEG image: {error}; it may be truncated") from error
    orientation = exif_orientation(jpeg_exif(content))
    return upright(image, orientation), orientation


def _png(content: bytes) -> tuple[npt.NDArray[Any], int]:
    """Check all chunks and the length of the pixels, then decode the critical chunks.

    No ancillary chunk changes a pixel value, and libpng prints warnings about them.
    """
    try:
        chunks = list(_png_chunks(content))
        indexed = _check_png_pixels([(chunk[4:8], chunk[8:-4]) for chunk in chunks], len(content))
    except ValueError as error:
        raise ValueError(f"not a complete PNG image: {error}; it may be truncated") from error
    critical = (b"IHDR", b"IDAT", b"IEND", *((b"PLTE",) if indexed else ()))
    image = _by_opencv(_PNG_SIGNATURE + b"".join(c for c in chunks if c[4:8] in critical), "PNG")
    orientation = exif_orientation(_png_exif(chunks))
    return upright(image, orientation), orientation


def _png_exif(chunks: Iterable[bytes]) -> bytes:
    return next((chunk[8:-4] for chunk in chunks if chunk[4:8] == b"eXIf"), b"")


def _png_chunks(content: bytes) -> Iterator[bytes]:
    """Yield each chunk: length, type, data and checksum."""
    start = len(_PNG_SIGNATURE)
    if content[:start] != _PNG_SIGNATURE:
        raise ValueError("no PNG signature")
    while len(content) >= start + 12:
        end = start + 8 + int.from_bytes(content[start : start + 4], "big")
        if content[end : end + 4] != zlib.crc32(content[start + 4 : end]).to_bytes(4, "big"):
            raise ValueError("a checksum is wrong")
        yield content[start : end + 4]
        if content[start + 4 : start + 8] == b"IEND":
            return
        start = end + 4
    raise ValueError("the end is missing")


def _check_png_pixels(chunks: list[tuple[bytes, bytes]], held_bytes: int) -> bool:
    """Check header, palette and pixel data; return whether the pixels are palette indices."""
    kind, header = chunks[0]
    if kind != b"IHDR" or len(header) != 13:
        raise ValueError("no header")
    columns, rows, depth, colour_type, compression, filtering, interlace = struct.unpack(
        ">IIBBBBB", header
    )
    samples, depths = _PNG_COLOUR_TYPES.get(colour_type, (0, ()))
    if depth not in depths or compression or filtering or interlace > 1:
        raise ValueError("the header is invalid")
    bits = samples * depth
    passes = [
        (math.ceil((rows - y) / step_y), math.ceil((columns - x) / step_x))
        for x, y, step_x, step_y in (_ADAM7 if interlace else _ONE_PASS)
    ]
    sizes = [(h, 1 + math.ceil(w * bits / 8)) for h, w in passes if h > 0 and w > 0]
    declared = sum(h * row_bytes for h, row_bytes in sizes)
    _require_size(rows, columns, declared, held_bytes)
    inflate = zlib.decompressobj()
    try:
        packed = b"".join(data for kind, data in chunks if kind == b"IDAT")
        raw = inflate.decompress(packed, declared + 1)
    except zlib.error as error:
        raise ValueError(f"pixel data: {error}") from error
    if len(raw) != declared or not inflate.eof or inflate.unused_data:
        raise ValueError("the pixel data do not have the length that the header declares")
    start = 0
    for h, row_bytes in sizes:
        if max(raw[start : start + h * row_bytes : row_bytes]) > 4:
            raise ValueError("a row has an unknown filter type")
        start += h * row_bytes
    palettes = [data for kind, data in chunks if kind == b"PLTE"]
    indexed = bool(colour_type == _PNG_PALETTE)
    if indexed and (len(palettes) != 1 or len(palettes[0]) not in range(3, 769, 3)):
        raise ValueError("the palette is missing or invalid")
    return indexed


def _tga(content: bytes) -> tuple[npt.NDArray[Any], int]:
    rows, columns, samples = tga_size(content)
    _require_size(rows, columns, rows * columns * samples, len(content))
    return decode_tga(content), UPRIGHT


def _tiff(content: bytes) -> tuple[npt.NDArray[Any], int]:
    # Imported here, so that a simulated rig opens without it.
    import tifffile

    try:
        with tifffile.TiffFile(io.BytesIO(content)) as tiff:
            page, shape, pages = tiff.pages.first, tiff.series[0].shape, len(tiff.series[0])
            grey, rgb = tifffile.PHOTOMETRIC.MINISBLACK, tifffile.PHOTOMETRIC.RGB
            kind = page.photometric
            tag = page.tags.get("Orientation")
            orientation = UPRIGHT if tag is None else checked_orientation(int(tag.value))
            _require_size(page.shape[0], page.shape[1], tiff.series[0].nbytes, len(content))
            # LZW, OpenCV's default, is read by tifffile only with a further package.
            if kind in (grey, rgb) and page.compression != tifffile.COMPRESSION.LZW:
                return upright(tiff.asarray(), orientation), orientation
    except Exception as error:
        raise ValueError(
            f"not a readable TIFF ({error}); it may be truncated, or its compression is not handled"
        ) from error
    if kind not in (grey, rgb):
        name = tifffile.PHOTOMETRIC(kind).name
        raise ValueError(f"TIFF pixels are {name}; save it as grey or RGB")
    if len(shape) > 3 or pages > 1:
        raise ValueError(f"{shape} is not one grey or colour image")
    return _by_opencv(content, "TIFF"), orientation  # OpenCV has turned it upright
