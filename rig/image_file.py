"""Read a PNG, JPEG, TIFF, TGA or DNG: damage is an error, memory is bounded.

The tags of a file are checked before its pixels are decoded. simplejpeg and imagecodecs decode JPEG
and PNG, because OpenCV fills the missing part of a truncated JPEG with grey.
"""

import io
import logging
import math
import struct
import warnings
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from classify.base.arrays import Array
from classify.base.errors import InputError
from classify.base.regular_file import read_regular_file

from .image_metadata import ImageMetadata, metadata_of_info, metadata_of_pages, power_response
from .raw_image import linear_raw

if TYPE_CHECKING:
    import tifffile

_Image = npt.NDArray[np.uint8 | np.uint16]
_Decoded = tuple[Array, ImageMetadata]
_MAX_BYTES = 2**31
_MAX_SIDE_PX = 32768
# Largest number of bytes of pixels that a file may declare: the larger of `_SMALL_BYTES` and
# `_MAX_COMPRESSION` times its own length. Zeros are compressed by 1000 and more, photographs with
# noise by less than 100.
_SMALL_BYTES = 2**26
_MAX_COMPRESSION = 200
# Rotations by 90 degrees anticlockwise after mirroring left to right (EXIF 2.32, section 4.6.4).
_ROTATIONS = {1: 0, 2: 0, 3: 2, 4: 2, 5: 1, 6: 3, 7: 3, 8: 1}
_MIRRORED = (2, 4, 5, 7)
_TGA_SIGNATURE, _TGA_EXTENSION_BYTES, _TGA_PREMULTIPLIED = b"TRUEVISION-XFILE.\0", 495, 4
_TGA_RGB, _TGA_GREY, _TGA_RUN_LENGTHS = 2, 3, 8  # image types, and the bit of their compression
_PREMULTIPLIED = "its colours are multiplied by their alpha; save it without alpha"
# EXIF data, XMP with its extensions, and image resources.
_METADATA_SEGMENTS = (b"Exif\0", b"EXIF\0", b"exif\0", b"http://ns.adobe.com/", b"Photoshop 3.0\0")
_ONE_OF_SEVERAL = 2  # a bit of NewSubfileType
_BITS_PER_SAMPLE, _SAMPLE_FORMAT = 258, 339  # tags of TIFF 6.0
# Compressions whose decoders detect missing data; those of JPEG, JPEG 2000 and JPEG XR fill it with
# grey.
_TIFF_COMPRESSIONS = (
    "NONE", "LZW", "ADOBE_DEFLATE", "DEFLATE", "PACKBITS", "LZMA", "ZSTD", "WEBP", "JPEGXL",
)  # fmt: skip
_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_PNG_SAMPLES = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}  # of a pixel, by colour type
_PNG_PALETTE, _PNG_GREY_ALPHA = 3, 4
_PNG_TEXTS = (b"tEXt", b"zTXt", b"iTXt")  # chunks that begin with a keyword
_PNG_METADATA = ("eXIf", "XML:com.adobe.xmp", "exif:Orientation", "iCCP", "sRGB", "gAMA", "cICP")

_RAW = (".cr2", ".cr3", ".nef", ".nrw", ".arw", ".raf", ".orf", ".rw2", ".pef", ".srw")
_REMEDIES = {
    **dict.fromkeys(
        _RAW,
        "; convert it to DNG, as with Adobe DNG Converter or dnglab, and "
        "pip install 'ps4rig[dng]' to read it",
    ),
    **dict.fromkeys((".heic", ".heif"), "; save it as TIFF or PNG of full size"),
}


def read_image_file(path: Path) -> tuple[_Image, ImageMetadata]:
    """Read an image and its metadata.

    The image is (H, W) grey or (H, W, 3) RGB without alpha, uint8 or uint16, rotated upright by its
    EXIF or XMP data. A DNG is linear camera RGB.
    """
    readers: dict[str, tuple[str, Callable[[bytes], _Decoded]]] = {
        ".png": ("PNG", _png), ".jpg": ("JPEG", _jpeg), ".jpeg": ("JPEG", _jpeg),
        ".tif": ("TIFF", _tiff), ".tiff": ("TIFF", _tiff), ".tga": ("TGA", _tga),
        ".dng": ("DNG", partial(_tiff, is_raw=True)),
    }  # fmt: skip
    if path.suffix.lower() not in readers:
        remedy = _REMEDIES.get(path.suffix.lower(), "")
        raise InputError(f"{path}: images come as PNG, JPEG, TIFF, TGA or DNG{remedy}")
    kind, reader = readers[path.suffix.lower()]
    content = read_regular_file(path, _MAX_BYTES)
    try:
        # Pillow warns of oddities in EXIF data that do not concern the image. Only a truncated
        # directory (a count of 2 bytes, entries of 12) is an error: it may lack the orientation.
        with warnings.catch_warnings(action="ignore"):
            warnings.filterwarnings("error", r"Corrupt EXIF data\. +Expecting to read (2|12) bytes")
            pixels, metadata = reader(content)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except Exception as error:  # of many types, of six libraries
        text = " ".join(str(error).split()) or type(error).__name__
        message = f"not a complete {kind} image: {text}; it may be truncated"
        raise InputError(f"{path}: {message}") from error
    if metadata.orientation in _MIRRORED:
        pixels = pixels[:, ::-1]
    return np.ascontiguousarray(np.rot90(pixels, _ROTATIONS[metadata.orientation])), metadata


def _require_size(rows: int, columns: int, declared_bytes: int, file_bytes: int) -> None:
    if not (0 < rows <= _MAX_SIDE_PX and 0 < columns <= _MAX_SIDE_PX):
        raise InputError(f"{columns} x {rows} px; sides up to {_MAX_SIDE_PX} are handled")
    if declared_bytes > max(_SMALL_BYTES, _MAX_COMPRESSION * file_bytes):
        raise InputError(
            f"declares {declared_bytes} bytes of pixels in {file_bytes} bytes; save it uncompressed"
        )


def _jpeg(content: bytes) -> _Decoded:
    import simplejpeg
    from PIL.JpegImagePlugin import JpegImageFile

    if not content.startswith(b"\xff\xd8"):
        raise ValueError("no JPEG signature")
    rows, columns, colours, _ = simplejpeg.decode_jpeg_header(content)
    is_grey = colours.lower() == "gray"
    if not is_grey and colours.lower() not in ("rgb", "ycbcr"):
        raise InputError(f"JPEG pixels are {colours}; save it as grey or RGB")
    _require_size(rows, columns, rows * columns * (1 if is_grey else 3), len(content))
    image: npt.NDArray[np.uint8] = simplejpeg.decode_jpeg(content, "gray" if is_grey else "rgb")
    header = JpegImageFile(io.BytesIO(content))
    segments = [data for _, data in header.applist if data.startswith(_METADATA_SEGMENTS)]
    exif = [data for data in segments if data[:4].upper() == b"EXIF"]
    if sum(data[6:10] in (b"II*\0", b"MM\0*") for data in exif) > 1:
        raise InputError("holds EXIF data twice; remove one of them")
    # EXIF data may continue in further segments, each with its own marker.
    joined_exif = [b"".join((exif[0], *(data[6:] for data in exif[1:])))] if exif else []
    others = [data for data in segments if data not in exif]
    info = {name: header.info[name] for name in header.info.keys() - {"exif", "xmp"}}
    metadata = metadata_of_info(info, segments=[*joined_exif, *others])
    return image[:, :, 0] if is_grey else image, metadata


def _png(content: bytes) -> _Decoded:
    """Check all chunks and the declared size, then decode the critical chunks only."""
    # The others change no pixel, and libpng warns of some.
    import imagecodecs
    from PIL.PngImagePlugin import PngImageFile

    chunks = list(_png_chunks(content))
    colour_type = _check_png_header(chunks, len(content))
    data_of = {chunk.kind: chunk.data for chunk in chunks}
    if b"acTL" in data_of:
        raise InputError("an animation; save one image")
    names = Counter(
        chunk.data.split(b"\0")[0] if chunk.kind in _PNG_TEXTS else chunk.kind for chunk in chunks
    )
    for name in names:
        text = name.decode("latin-1")
        is_metadata = text in _PNG_METADATA or text.startswith("Raw profile type ")
        if is_metadata and names[name] > 1:
            raise InputError(f"holds {text} twice; remove one of them")
    critical = (b"IHDR", b"IDAT", b"IEND", *((b"PLTE",) if colour_type == _PNG_PALETTE else ()))
    critical_content = b"".join(chunk.content for chunk in chunks if chunk.kind in critical)
    image: Any = imagecodecs.png_decode(_PNG_SIGNATURE + critical_content)
    # Pillow reads only the chunks before the pixels.
    chunks.sort(key=lambda chunk: chunk.kind in (b"IDAT", b"IEND"))
    sorted_content = b"".join(chunk.content for chunk in chunks)
    info = PngImageFile(io.BytesIO(_PNG_SIGNATURE + sorted_content)).info
    stated_responses = []
    if b"cICP" in data_of:
        # Transfer characteristics of ITU-T H.273, then full-range RGB.
        code = data_of[b"cICP"][1:]
        responses = {b"\x08\0\1": "linear", b"\x0d\0\1": "srgb"}
        stated_responses = [responses.get(code, f"colour space {[*code]}")]
    metadata = metadata_of_info(info, *stated_responses)
    if image.ndim == 2 or colour_type == _PNG_GREY_ALPHA:
        return np.atleast_3d(image)[:, :, 0], metadata
    return image[:, :, :3], metadata


class _PngChunk(NamedTuple):
    kind: bytes
    data: bytes
    content: bytes  # length, kind, data and checksum


def _png_chunks(content: bytes) -> Iterator[_PngChunk]:
    start = len(_PNG_SIGNATURE)
    if content[:start] != _PNG_SIGNATURE:
        raise ValueError("no PNG signature")
    while len(content) >= start + 12:
        end = start + 8 + int.from_bytes(content[start : start + 4], "big")
        if content[end : end + 4] != zlib.crc32(content[start + 4 : end]).to_bytes(4, "big"):
            raise ValueError("a checksum is wrong")
        kind = content[start + 4 : start + 8]
        yield _PngChunk(kind, content[start + 8 : end], content[start : end + 4])
        if kind == b"IEND":
            return
        start = end + 4
    raise ValueError("the end is missing")


def _check_png_header(chunks: list[_PngChunk], file_bytes: int) -> int:
    """Check the header and the size that it declares; return the colour type."""
    if not chunks or chunks[0].kind != b"IHDR" or len(chunks[0].data) != 13:
        raise ValueError("no header")
    columns, rows, depth, colour_type = struct.unpack(">IIBB", chunks[0].data[:10])
    samples = _PNG_SAMPLES.get(colour_type, 0)
    _require_size(rows, columns, rows * columns * samples * depth // 8, file_bytes)
    return int(colour_type)


def _tga(content: bytes) -> _Decoded:
    from PIL.TgaImagePlugin import TgaImageFile

    image_type, bits = content[2], content[16]
    if (image_type & ~_TGA_RUN_LENGTHS, bits) not in (
        (_TGA_RGB, 24),
        (_TGA_RGB, 32),
        (_TGA_GREY, 8),
    ):
        raise InputError(
            f"TGA of type {image_type} with {bits} bits a pixel; save it as PNG, grey or RGB"
        )
    image = TgaImageFile(io.BytesIO(content))
    _require_size(image.height, image.width, 4 * image.width * image.height, len(content))
    try:
        pixels = np.asarray(image)
    except OSError as error:  # also for a run that crosses rows, in a complete file
        raise InputError(f"TGA: {error}; it may be truncated, else save it as PNG") from error
    # Extension area of the TGA specification 2.0: gamma as a fraction, and the type of alpha.
    extension = bytes(_TGA_EXTENSION_BYTES)
    if content.endswith(_TGA_SIGNATURE) and (start := int.from_bytes(content[-26:-22], "little")):
        extension = content[start : start + _TGA_EXTENSION_BYTES]
    dividend, divisor = struct.unpack_from("<HH", extension, 478)
    if extension[494] == _TGA_PREMULTIPLIED and (pixels.T[3:] < 255).any():
        raise InputError(_PREMULTIPLIED)
    metadata = ImageMetadata(response=power_response(dividend / divisor) if divisor else None)
    return pixels if pixels.ndim == 2 else pixels[:, :, :3], metadata


def _tiff(content: bytes, is_raw: bool = False) -> _Decoded:
    """Decode the only image of full resolution."""
    # Imported here, so that a simulated rig opens without it.
    import tifffile

    tifffile.logger().addHandler(logging.NullHandler())  # keeps its warnings away from stderr
    with tifffile.TiffFile(io.BytesIO(content)) as tiff:
        # Pages and their parents; a page of the top level counts as its own parent.
        pages: list[tuple[Any, Any]] = [(page, page) for page in tiff.pages]
        pages += [(child, parent) for parent, _ in pages for child in parent.pages or ()]
        if not pages:
            raise ValueError("it holds no image")
        full_pages = [pair for pair in pages if not pair[0].subfiletype & ~_ONE_OF_SEVERAL]
        if len(full_pages) != 1:
            raise InputError(
                f"holds {len(full_pages)} images of full resolution; save one in a file"
            )
        page, parent = full_pages[0]
        segments = zip(page.dataoffsets, page.databytecounts, strict=True)
        if any(size == 0 or start + size > len(content) for start, size in segments):
            raise ValueError("a part of the pixels is missing")
        samples = math.prod(page.chunked) * math.prod(page.chunks)
        declared = samples * max(8, *np.ravel(page.bitspersample).tolist()) // 8
        _require_size(page.imagelength, page.imagewidth, declared, len(content))
        # The series of an OME-TIFF may have images in other files.
        own_series = (
            [] if tiff.is_ome else [series for series in tiff.series if series.keyframe is page]
        )
        if page.imagedepth > 1 or any(
            series.size != page.size or series.transform for series in own_series
        ):
            raise InputError("holds a stack of images; save one in a file")
        metadata = metadata_of_pages(*dict.fromkeys((parent, page)))
        if is_raw:
            return linear_raw(content, page), replace(metadata, response="linear")
        return _tiff_pixels(page), metadata


def _tiff_pixels(page: "tifffile.TiffPage") -> Array:
    import tifffile

    kind = tifffile.PHOTOMETRIC(page.photometric).name
    colours = {"MINISBLACK": 1, "RGB": 3}.get(kind)
    extras, samples = page.extrasamples, page.samplesperpixel
    if colours is None:
        raise InputError(f"TIFF pixels are {kind}; save it as grey or RGB")
    formats = {*np.ravel(page.tags.valueof(_SAMPLE_FORMAT, tifffile.SAMPLEFORMAT.UINT))}
    depths = {*np.ravel(page.tags.valueof(_BITS_PER_SAMPLE, 1))}
    if depths not in ({8}, {16}) or formats != {tifffile.SAMPLEFORMAT.UINT}:
        names = " and ".join(tifffile.SAMPLEFORMAT(number).name for number in formats)
        bits = " and ".join(map(str, depths))
        raise InputError(
            f"{names} samples of {bits} bits; save it as unsigned integers of 8 or 16 bits"
        )
    # OpenCV does not declare its alpha channel. More than one further plane may be other images.
    if (samples - len(extras) != colours and (kind, samples) != ("RGB", 4)) or len(extras) > 1:
        raise InputError(f"{samples} samples a pixel are not one grey or colour image")
    compression = tifffile.COMPRESSION(page.compression).name
    if compression not in _TIFF_COMPRESSIONS:
        raise InputError(f"compression {compression}; save it with LZW, deflate or none")
    pixels = page.asarray()
    if page.axes == "SYX":
        pixels = np.moveaxis(pixels, 0, -1)
    pixels = pixels.reshape(page.imagelength, page.imagewidth, samples)
    for plane, extra in enumerate(extras, start=colours):
        alpha = pixels[:, :, plane]
        if extra == tifffile.EXTRASAMPLE.ASSOCALPHA and alpha.min() < np.iinfo(alpha.dtype).max:
            raise InputError(_PREMULTIPLIED)
    return pixels[:, :, 0] if colours == 1 else pixels[:, :, :3]
