"""A table of formats and properties: each pixel equals the truth, or the file is refused."""

import io
import struct
from collections.abc import Iterator
from itertools import islice, product
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import simplejpeg
import tifffile
from PIL import Image
from scipy.ndimage import convolve

from classify.base.errors import InputError
from rig.image_file import read_image_file
from tests.image_files import (
    LINEAR_RAW,
    Pixels,
    chunk,
    dng,
    encoded,
    exif,
    private_exif,
    raw_profile,
    text_chunk,
    tiff,
    with_chunks,
    with_segments,
    with_tag,
    xmp,
)

RNG = np.random.default_rng(4)
DEPTHS: dict[int, Any] = {8: np.uint8, 16: np.uint16}
# Unequal values, and no image is its own mirror image.
RGBA = {bits: RNG.integers(1, 1 << bits, (7, 9, 4), DEPTHS[bits]) for bits in DEPTHS}
RGB = {bits: np.ascontiguousarray(RGBA[bits][:, :, :3]) for bits in DEPTHS}
GREY = {bits: np.ascontiguousarray(RGBA[bits][:, :, 0]) for bits in DEPTHS}
# A JPEG keeps smooth images within its loss.
SMOOTH = cv2.resize(RGB[8][:2, :3], (18, 14), interpolation=cv2.INTER_LINEAR)
ORIENTATIONS = range(1, 9)
# One carrier of each format has all orientations, the others have these two.
TURNS = (3, 6)
COMPRESSIONS = (None, "lzw", "deflate", "packbits", "zstd", "lzma")
UNASSOCIATED, ASSOCIATED, UNSPECIFIED = 2, 1, 0
# Name with the suffix of the file, its bytes, and its pixels or why it is refused.
Row = tuple[str, bytes, Pixels | str]


def upright(image: Pixels, orientation: int) -> Pixels:
    """The image by the places that EXIF 2.32 names for the first row and the first column."""
    return {
        1: image, 2: np.fliplr(image), 3: np.rot90(image, 2), 4: np.flipud(image),
        5: np.swapaxes(image, 0, 1), 6: np.rot90(image, -1),
        7: np.swapaxes(np.rot90(image, 2), 0, 1), 8: np.rot90(image),
    }[orientation]  # fmt: skip


def coloured(image: Pixels) -> Pixels:
    """The image without its alpha channel."""
    return image if image.ndim == 2 else image[:, :, :3]


def pillow(image: Any, form: str, **options: Any) -> bytes:
    buffer = io.BytesIO()
    opened = image if isinstance(image, Image.Image) else Image.fromarray(image)
    opened.save(buffer, form, **options)
    return buffer.getvalue()


def tiffs() -> Iterator[Row]:
    for bits, planar, alpha in product(DEPTHS, (1, 2), (None, UNASSOCIATED, UNSPECIFIED)):
        image = RGB[bits] if alpha is None else RGBA[bits]
        stored = image if planar == 1 else np.moveaxis(image, -1, 0)
        extras = None if alpha is None else [alpha]
        options = {"planarconfig": planar, "extrasamples": extras, "photometric": "rgb"}
        name = f"rgb {bits} planar {planar} alpha {alpha}.tif"
        yield name, tiff(stored, compression="lzw", **options), RGB[bits]
    for bits, compression in product(DEPTHS, COMPRESSIONS):
        forms = product(("strips", "tiles"), (("<", 0), (">", 0), (">", 1)))
        for form, (order, big) in islice(forms, None if compression in (None, "lzw") else 1):
            sides = {"rowsperstrip": 2} if form == "strips" else {"tile": (16, 16)}
            packed = compression not in (None, "packbits")
            for predictor in (False, True) if packed else (False,):
                options = {"compression": compression, "predictor": predictor, **sides}
                name = f"{bits} {compression} {form} {order} big {big} predictor {predictor}.tif"
                about = {"byteorder": order, "bigtiff": bool(big), **options}
                yield f"grey {name}", tiff(GREY[bits], **about), GREY[bits]
                yield f"rgb {name}", tiff(RGB[bits], **about), RGB[bits]
    for bits in DEPTHS:
        grey_alpha = np.ascontiguousarray(RGBA[bits][:, :, :2])
        two = tiff(grey_alpha, photometric="minisblack", planarconfig=1, extrasamples=[2])
        yield f"grey with alpha {bits}.tif", two, GREY[bits]
        for compression in ("jpegxl", "webp")[: 3 - bits // 8]:
            options = {"compression": compression, "compressionargs": {"lossless": True}}
            yield f"{compression} {bits}.tif", tiff(RGB[bits], **options), RGB[bits]
        opaque = RGBA[bits].copy()
        opaque[:, :, 3] = (1 << bits) - 1
        for planar in (1, 2):
            options = {"planarconfig": planar, "extrasamples": [ASSOCIATED], "photometric": "rgb"}
            for name, image, expected in (
                ("opaque", opaque, RGB[bits]), ("premultiplied", RGBA[bits], "by their alpha"),
            ):  # fmt: skip
                stored = image if planar == 1 else np.moveaxis(image, -1, 0)
                yield f"{name} {bits} planar {planar}.tif", tiff(stored, **options), expected
    yield "pillow.tiff", pillow(GREY[16], "TIFF", compression="tiff_lzw"), GREY[16]
    reversed_bits = np.packbits(np.unpackbits(GREY[8], bitorder="little").reshape(-1, 8), axis=1)
    filled = tiff(reversed_bits.reshape(7, 9), extratags=[(340, 3, 1, 2, True)])
    filled = filled.replace(struct.pack("<HH", 340, 3), struct.pack("<HH", 266, 3))
    yield "fill order.tif", filled, GREY[8]


def refused_tiffs() -> Iterator[Row]:
    grey, rgb = GREY[8], RGB[8]
    for dtype in ("int8", "int16", "uint32", "float16", "float32", "float64"):
        kind = {"i": "INT", "u": "UINT", "f": "IEEEFP"}[dtype[0]]
        yield f"{dtype}.tif", tiff(grey.astype(dtype)), f"{kind} samples of"
    for bits in (1, 2, 4, 10, 12, 14):
        low = (GREY[8] if bits < 9 else GREY[16]) >> (8 - bits if bits < 9 else 16 - bits)
        if bits == 1:
            low = low.astype(bool)
        yield f"{bits} bits.tif", tiff(low, bitspersample=bits), f"samples of {bits} bits"
    palette = {"colormap": np.zeros((3, 256), np.uint16)}
    for kind, image, options in (
        ("MINISWHITE", grey, {}), ("SEPARATED", RGBA[8], {}), ("CIELAB", rgb, {}),
        ("CFA", grey, {}), ("PALETTE", grey, palette), ("YCBCR", rgb, {"compression": "jpeg"}),
    ):  # fmt: skip
        content = tiff(image, photometric=kind.lower(), **options)
        yield f"{kind}.tif", content, f"TIFF pixels are {kind}; save it as grey or RGB"
    for kind in ("YCBCR", "LOGLUV", "ICCLAB", "LINEAR_RAW"):
        content = with_tag(tiff(rgb), 262, tifffile.PHOTOMETRIC[kind])
        yield f"{kind} by its tag.tif", content, f"TIFF pixels are {kind}; save it"
    for compression in ("jpeg", "jpeg2000", "jpegxr", "lerc"):
        yield f"{compression}.tif", tiff(grey, compression=compression), "compression .*with LZW"
    for samples in (2, 3, 5):
        image = np.repeat(grey[:, :, None], samples, axis=2)
        content = tiff(image, photometric="minisblack", planarconfig=1)
        hidden = content.replace(struct.pack("<H", 338), struct.pack("<H", 337), 1)  # ExtraSamples
        yield f"{samples} samples of grey.tif", hidden, f"{samples} samples a pixel"
    planes = tiff(np.stack([grey, grey[::-1], grey]), photometric="minisblack", planarconfig=2)
    yield "stack in planes.tif", planes, "3 samples a pixel are not one"
    unequal = tiff(rgb)
    with tifffile.TiffFile(io.BytesIO(unequal)) as file:
        place = file.pages.first.tags[258].valueoffset
    unequal = unequal[:place] + struct.pack("<HHH", 8, 8, 16) + unequal[place + 6 :]
    yield "unequal depths.tif", unequal, "samples of (8 and 16|16 and 8) bits"
    yield "stack.tif", tiff(np.stack([grey] * 5), photometric="minisblack"), "holds 5 images"
    for name, options in (("imagej", {"imagej": True}), ("shaped", {"truncate": True})):
        buffer = io.BytesIO()
        tifffile.imwrite(buffer, np.stack([grey] * 5), photometric="minisblack", **options)
        yield f"{name}.tif", buffer.getvalue(), "holds 5 images|holds a stack"
    volume = tiff(
        np.stack([grey] * 2), photometric="minisblack", volumetric=True, tile=(16, 16, 16)
    )
    yield "volume.tif", volume, "holds a stack"
    sparse = tiff(grey, rowsperstrip=2)
    with tifffile.TiffFile(io.BytesIO(sparse)) as file:
        place = file.pages.first.tags[279].valueoffset
    for name, size in (("sparse", 0), ("beyond the end", 60000)):
        content = sparse[:place] + struct.pack("<H", size) + sparse[place + 2 :]
        yield f"{name}.tif", content, "a part of the pixels is missing"
    big_tile = tiff(grey, tile=(16, 16))
    for code in (322, 323):
        big_tile = with_tag(big_tile, code, 32768)
    yield "tile of a gigabyte.tif", big_tile, "declares 1073741824 bytes"


def pages() -> Iterator[Row]:
    """Photographs beside thumbnails and others."""
    photograph, small, other = RGB[16], RGB[8][::2, ::2], RGB[16][::-1]
    thumb, full, mask = {"subfiletype": 1}, {"subfiletype": 0}, {"subfiletype": 4}
    bitmap = GREY[8] > 99
    for name, entries, expected in (
        ("thumbnail first", [(small, thumb), (photograph, full)], photograph),
        ("thumbnail last", [(photograph, full), (small, thumb)], photograph),
        ("one of several", [(photograph, {"subfiletype": 2})], photograph),
        ("mask", [(photograph, full), (bitmap, mask)], photograph),
        ("two photographs", [(photograph, full), (other, full)], "holds 2 images"),
        ("unmarked pyramid", [(photograph, full), (small, full)], "holds 2 images"),
        ("thumbnails alone", [(small, thumb), (small[::-1], thumb)], "holds 0 images"),
    ):
        for compression, tile in product((None, "lzw"), (None, (16, 16))):
            buffer = io.BytesIO()
            with tifffile.TiffWriter(buffer) as writer:
                for image, options in entries:
                    kind = "rgb" if image.ndim == 3 else "minisblack"
                    if image.dtype == bool:
                        options = options | {"compression": None}
                    else:
                        options = options | {"compression": compression, "tile": tile}
                    writer.write(image, photometric=kind, metadata=None, **options)
            yield f"{name} {compression} {tile}.tif", buffer.getvalue(), expected
    for name, first, second in (("pyramid", photograph, small), ("sub-image", small, photograph)):
        buffer = io.BytesIO()
        with tifffile.TiffWriter(buffer) as writer:
            options = {"photometric": "rgb", "metadata": None}
            writer.write(first, subifds=1, subfiletype=int(name != "pyramid"), **options)
            writer.write(second, subfiletype=int(name == "pyramid"), **options)
        yield f"{name} in a directory below.tif", buffer.getvalue(), photograph
    uuid = "urn:uuid:00000000-0000-0000-0000-00000000000"
    planes = "".join(
        f'<TiffData FirstC="{c}" IFD="0" PlaneCount="1"><UUID FileName="c{c}.ome.tif">{uuid}{c}'
        "</UUID></TiffData>"
        for c in range(3)
    )
    ome = (
        '<?xml version="1.0"?><OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06" '
        f'UUID="{uuid}1"><Image ID="Image:0"><Pixels ID="Pixels:0" DimensionOrder="XYCZT" '
        'Type="uint16" SizeX="9" SizeY="7" SizeC="3" SizeZ="1" SizeT="1">'
        f'<Channel ID="Channel:0:0" SamplesPerPixel="1"/>{planes}</Pixels></Image></OME>'
    )
    yield "one of three.ome.tif", tiff(GREY[16], description=ome), GREY[16]


def oriented() -> Iterator[Row]:
    grey, rgb = GREY[8], RGB[16]
    png, jpeg = encoded(".png", grey), encoded(".jpg", SMOOTH)
    decoded = simplejpeg.decode_jpeg(jpeg, "rgb")
    raw = np.repeat(np.repeat(RNG.integers(64, 4096, (16, 24), np.uint16), 2, 0), 2, 1)
    for k in ORIENTATIONS:
        data, packet = exif(k), xmp(k)
        blob = b"Exif\0\0" + data
        magick = raw_profile("exif", blob)
        for name, added in {
            "eXIf": chunk(b"eXIf", data),
            "eXIf big-endian": chunk(b"eXIf", exif(k, order=">")),
            "eXIf with prefix": chunk(b"eXIf", blob),
            "eXIf of type LONG": chunk(b"eXIf", exif(k, kind=4)),
            "tEXt": text_chunk("tEXt", "Raw profile type exif", magick),
            "zTXt": text_chunk("zTXt", "Raw profile type exif", magick),
            "iTXt": text_chunk("iTXt packed", "Raw profile type exif", magick),
            "APP1": text_chunk("zTXt", "Raw profile type APP1", raw_profile("generic", blob)),
            "XMP": text_chunk("iTXt", "XML:com.adobe.xmp", packet),
            "packed XMP": text_chunk("iTXt packed", "XML:com.adobe.xmp", xmp(k, "element")),
            "raw XMP": text_chunk("zTXt", "Raw profile type xmp", raw_profile("xmp", packet)),
            "property": text_chunk("tEXt", "exif:Orientation", b"%d" % k),
        }.items():
            if k not in TURNS and name != "eXIf":
                continue
            yield f"{k} {name}.png", with_chunks(png, added), upright(grey, k)
            if name in ("eXIf", "zTXt", "XMP"):
                yield f"{k} {name} last.png", with_chunks(png, added, last=True), upright(grey, k)
        head = b"http://ns.adobe.com/xap/1.0/\0"
        for name, segment in {
            "SHORT": blob, "LONG": b"Exif\0\0" + exif(k, kind=4),
            "BYTE": b"Exif\0\0" + exif(k, kind=1),
            "SHORT big-endian": b"Exif\0\0" + exif(k, order=">"),
            "LONG big-endian": b"Exif\0\0" + exif(k, kind=4, order=">"),
            "XMP": head + packet, "XMP element": head + xmp(k, "element"),
            "XMP with another prefix": head + xmp(k, "prefix"),
            "XMP in the default namespace": head + xmp(k, "default"),
            "XMP with a type": head + xmp(k, "typed"),
            "extended XMP": b"http://ns.adobe.com/xmp/extension/\0" + bytes(40) + packet,
            "another prefix": b"Exif\0\xff" + data, "upper case": b"EXIF\0\0" + data,
        }.items():  # fmt: skip
            if k in TURNS or name == "SHORT":
                yield f"{k} {name}.jpg", with_segments(jpeg, segment), upright(decoded, k)
        tag = (274, 3, 1, k, True)
        yield f"{k}.tif", tiff(rgb, compression="lzw", extratags=[tag]), upright(rgb, k)
        level = np.rint((raw - 64) / (4095 - 64) * 65535).astype(np.uint16)
        yield f"{k} mono.dng", dng(raw, k, LINEAR_RAW), upright(level, k)
        if k not in TURNS:
            continue
        for name, code, resource in (("EXIF", 0x0422, data), ("XMP", 0x0424, packet)):
            block = photoshop(code, resource)
            segment = b"Photoshop 3.0\0" + block
            yield (
                f"{k} {name} of Photoshop.jpg",
                with_segments(jpeg, segment, marker=0xED),
                upright(decoded, k),
            )
            tag = (34377, 1, len(block), block, True)
            yield f"{k} {name} of Photoshop.tif", tiff(rgb, extratags=[tag]), upright(rgb, k)
        planes = np.moveaxis(rgb, -1, 0)
        options = {"photometric": "rgb", "byteorder": ">", "planarconfig": 2}
        yield f"{k} planes.tif", tiff(planes, extratags=[tag], **options), upright(rgb, k)
        big = tiff(rgb, extratags=[(274, 4, 1, k, True)], bigtiff=True)
        yield f"{k} big LONG.tif", big, upright(rgb, k)
        packed = tiff(rgb, extratags=[(700, 1, len(packet), packet, True)])
        yield f"{k} XMP.tif", packed, upright(rgb, k)
        linear = dng(np.dstack([raw] * 3), k, LINEAR_RAW)
        yield f"{k} linear.dng", linear, upright(np.dstack([level] * 3), k)
        yield f"{k} filter.dng", dng(raw, k), upright(interpolated(level), k)
    for name, content in (
        ("a.jpg", with_segments(jpeg, b"Exif\0\0" + exif(6), head + xmp(1))),
        ("a.png", with_chunks(png, chunk(b"eXIf", exif(3)),
                              text_chunk("iTXt", "XML:com.adobe.xmp", xmp(1)))),
        ("b.png", with_chunks(png, chunk(b"eXIf", exif(1)),
                              text_chunk("zTXt", "Raw profile type exif",
                                         raw_profile("exif", b"Exif\0\0" + exif(3))))),
        ("a.tif", tiff(rgb, extratags=[(274, 3, 1, 6, True), (700, 1, len(xmp(3)), xmp(3), True)])),
    ):  # fmt: skip
        yield f"contradictory {name}", content, "orientation . and .; remove the wrong one"
    key = "Raw profile type exif"
    texts = [raw_profile("exif", b"Exif\0\0" + exif(k)) for k in (3, 1)]
    for name, twice in {
        "eXIf": [chunk(b"eXIf", exif(k)) for k in (3, 1)],
        key: [text_chunk("zTXt", key, text) for text in texts],
        "XML:com.adobe.xmp": [text_chunk("iTXt", "XML:com.adobe.xmp", xmp(k)) for k in (3, 1)],
    }.items():  # fmt: skip
        yield f"{name} twice.png", with_chunks(png, *twice), f"holds {name} twice; remove one"
    for k in (1, 3):
        packets = (head + xmp(k), head + xmp(4 - k))
        yield f"two XMP {k}.jpg", with_segments(jpeg, *packets), "orientation 1 and 3"
    private = private_exif(Orientation=3)
    nested = (
        b"II*\0" + struct.pack("<IH", 8, 2) + exif(1)[10:22] + struct.pack("<HHII", 34665, 4, 1, 38)
    )
    yield (
        "in both directories.jpg",
        with_segments(jpeg, b"Exif\0\0" + nested + bytes(4) + exif(3)[8:]),
        "orientation 1 and 3",
    )
    words = photoshop(0x0404, b"Orientation of the camera -> 3") + photoshop(0x0424, b"")
    segment = b"Photoshop 3.0\0" + words
    yield "words.jpg", with_segments(jpeg, segment, marker=0xED), decoded
    yield "private.jpg", with_segments(jpeg, b"Exif\0\0" + private), upright(decoded, 3)
    yield "reference.jpg", with_segments(jpeg, head + xmp(3, "reference")), "'&#51;', which is no"
    word = exif(3)[:10] + struct.pack("<HHI4s", 274, 2, 4, b"abc\0") + bytes(4)
    yield "word.jpg", with_segments(jpeg, b"Exif\0\0" + word), "'abc', which is no"
    cut = with_segments(jpeg, b"Exif\0\0" + exif(3)[:14])
    yield "cut EXIF.jpg", cut, "Corrupt EXIF data"
    twice = with_segments(jpeg, b"Exif\0\0" + exif(1), b"Exif\0\0" + exif(3))
    yield "two orientations.jpg", twice, "holds EXIF data twice"
    yield "unknown orientation.jpg", with_segments(jpeg, b"Exif\0\0" + exif(9)), "orientation 9"
    yield "orientation 0.jpg", with_segments(jpeg, b"Exif\0\0" + exif(0)), decoded


def photoshop(code: int, data: bytes) -> bytes:
    """An image resource block of Photoshop."""
    return b"8BIM" + struct.pack(">HHI", code, 0, len(data)) + data + bytes(len(data) % 2)


def pngs_jpegs_and_tgas() -> Iterator[Row]:
    for bits in DEPTHS:
        for name, image in (("grey", GREY[bits]), ("rgb", RGB[bits]), ("rgba", RGBA[bits])):
            for level in (0, 9):
                options = (cv2.IMWRITE_PNG_COMPRESSION, level)
                yield (
                    f"{name} {bits} {level}.png",
                    encoded(".png", image, *options),
                    coloured(image),
                )
    low = GREY[8] >> 7
    for bits in (1, 2, 4):
        packed = np.packbits(np.unpackbits((GREY[8] >> (8 - bits))[..., None], axis=2)[..., -bits:]
                             .reshape(7, -1), axis=1)  # fmt: skip
        rows = b"".join(b"\0" + row.tobytes() for row in packed)
        expected = (GREY[8] >> (8 - bits)) * np.uint8(255 // ((1 << bits) - 1))
        yield f"{bits} bits.png", bare_png(rows, bits, 0), expected
    for mode in ("L", "LA", "P", "RGB", "RGBA", "1"):
        image = Image.fromarray(RGBA[8]).convert(mode)
        expected = np.asarray(image.convert("RGB" if mode == "P" else mode))
        if mode == "1":
            expected = expected.astype(np.uint8) * 255
        expected = expected[:, :, 0] if mode == "LA" else coloured(expected)
        yield f"pillow {mode}.png", pillow(image, "PNG"), expected
    yield "pillow 16.png", pillow(GREY[16], "PNG"), GREY[16]
    animation = pillow(Image.fromarray(low), "PNG", save_all=True,
                       append_images=[Image.fromarray(GREY[8])])  # fmt: skip
    yield "animation.png", animation, "an animation"
    for quality, sampling in product((75, 95), ("444", "422", "420", "440")):
        content = simplejpeg.encode_jpeg(
            np.ascontiguousarray(SMOOTH), quality, "RGB", colorsubsampling=sampling
        )
        yield f"{quality} {sampling}.jpg", content, SMOOTH
    for options in ((), (cv2.IMWRITE_JPEG_PROGRESSIVE, 1), (cv2.IMWRITE_JPEG_RST_INTERVAL, 1)):
        for name, image in (("grey", SMOOTH[:, :, 1]), ("rgb", SMOOTH)):
            yield f"{name} {options}.jpeg", encoded(".jpeg", image, *options), image
    content = pillow(Image.fromarray(SMOOTH), "JPEG", quality=95, keep_rgb=True)
    yield "stored as RGB.jpg", content, SMOOTH
    cmyk = pillow(Image.fromarray(SMOOTH).convert("CMYK"), "JPEG")
    yield "cmyk.jpg", cmyk, "JPEG pixels are (YCCK|CMYK); save it as grey or RGB$"
    for kind, samples, flags, packed in product((2, 3), (1, 3, 4), (0, 16, 32, 48), (0, 8)):
        image = np.ascontiguousarray(RGBA[8][:, :, :samples])
        stored = image if flags & 32 else image[::-1]
        stored = np.ascontiguousarray(stored[:, ::-1] if flags & 16 else stored)
        body = run_lengths(stored) if packed else stored.tobytes()
        known = (kind == 3) == (samples == 1)
        content = tga_header(kind | packed, image.shape, flags) + body + b"more"
        expected = image[:, :, 0] if samples == 1 else image[:, :, 2::-1]
        yield (
            f"{kind} {samples} {flags} {packed}.tga",
            content,
            expected if known else "TGA of type",
        )
    for mode, rle in product(("L", "RGB", "RGBA"), (None, "tga_rle")):
        image = Image.fromarray(RGBA[8]).convert(mode)
        content = pillow(image, "TGA", compression=rle)
        yield f"pillow {mode} {rle}.tga", content, coloured(np.asarray(image))
    for mode in ("P", "1", "LA"):
        content = pillow(Image.fromarray(RGBA[8]).convert(mode), "TGA")
        yield f"pillow {mode}.tga", content, "TGA of type"
    plain = pillow(RGBA[8], "TGA")[:-26]
    for name, form, expected in (("straight", 3, RGB[8]), ("premultiplied", 4, "by their alpha")):
        extension = bytearray(495)
        extension[:2], extension[494] = struct.pack("<H", 495), form
        footer = struct.pack("<II", len(plain), 0) + b"TRUEVISION-XFILE.\0"
        yield f"{name}.tga", plain + bytes(extension) + footer, expected
    for name, bits in (("15 bits", 15), ("16 bits", 16)):
        yield f"{name}.tga", tga_header(2, (7, 9, 2), 32, bits) + bytes(126), "TGA of type 2 with"
    bomb = tga_header(10, (32000, 32000, 3), 32) + b"\xff\0\0\0" * 50
    yield "bomb.tga", bomb, "declares 4096000000 bytes"


def bare_png(rows: bytes, bits: int, colour: int) -> bytes:
    import zlib

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", 9, 7, bits, colour, 0, 0, 0))
    body = chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + header + body


def tga_header(kind: int, shape: tuple[int, ...], flags: int, bits: int | None = None) -> bytes:
    rows, columns, samples = shape
    numbers = (0, 0, kind, 0, 0, 0, 0, 0, columns, rows, bits or 8 * samples, flags)
    return struct.pack("<BBBHHBHHHHBB", *numbers)


def run_lengths(image: Pixels) -> bytes:
    """Packets of one pixel that is repeated, and of others, within each row."""
    packets = b""
    for row in image:
        packets += b"\x80" + row[0].tobytes() + bytes([len(row) - 2]) + row[1:].tobytes()
    return packets


def interpolated(level: Pixels) -> Pixels:
    """Each colour of a filter array, red first, as the mean of its nearest neighbours."""
    masks = np.zeros((3, *level.shape))
    masks[0, ::2, ::2] = masks[1, ::2, 1::2] = masks[1, 1::2, ::2] = masks[2, 1::2, 1::2] = 1.0
    kernel = np.outer((1.0, 2.0, 1.0), (1.0, 2.0, 1.0))
    planes = []
    for mask in masks:
        sums = [convolve(plane, kernel, mode="constant") for plane in (mask * level, mask)]
        planes.append(np.where(mask > 0, level, sums[0] // sums[1]))
    return np.dstack(planes).astype(np.uint16)


def raws() -> Iterator[Row]:
    """Levels from black to white, with half of the pixels saturated."""
    raw = RNG.integers(200, 4096, (32, 48), np.uint16)
    raw[:, 24:] = 4095
    for black, white in (((0,), (4095,)), ((64,), (4095,)), ((64, 60, 128), (4095, 4000, 3000))):
        three = np.dstack([raw] * 3)
        share = np.clip((three - np.float64(black)) / (np.float64(white) - black), 0.0, 1.0)
        content = dng(three, 1, LINEAR_RAW, black, white)
        yield f"linear {black} {white}.dng", content, np.rint(65535 * share).astype(np.uint16)
    for black in ((0,), (64,), (60, 64, 64, 128)):
        pattern = np.tile(np.resize(black, (2, 2)), (16, 24))
        share = np.clip((raw - pattern) / (4095.0 - pattern), 0.0, 1.0)
        level = np.rint(65535 * share).astype(np.uint16)
        yield f"mono {black}.dng", dng(raw, 1, LINEAR_RAW, black), level
        yield f"filter {black}.dng", dng(raw, 1, black=black), interpolated(level)
    black = (95, 1095, 295, 495)
    quarter = np.tile(np.resize(black, (2, 2)), (16, 24)) * 3 // 4 + 1024
    for top, left in ((4, 6), (5, 6), (4, 7), (5, 7)):
        edged = np.zeros((40, 60), np.uint16)
        edged[top : top + 32, left : left + 48] = quarter
        area = ((50829, 4, 4, (top, left, top + 32, left + 48), True),)
        mono = dng(edged, 1, LINEAR_RAW, black, extra=area)
        yield f"mono at {top} {left}.dng", mono, np.full((32, 48), 16384, np.uint16)
        # LibRaw skips the first row or column if its number is odd.
        shape = (32 - top % 2, 48 - left % 2, 3)
        expected = np.full(shape, 16384, np.uint16)
        yield f"filter at {top} {left}.dng", dng(edged, 1, black=black, extra=area), expected
    deltas = ((50715, 10, 48, (1, 1) * 48, True),)
    yield "deltas.dng", dng(raw, extra=deltas), "a raw image of a kind that is not handled"
    layout = ((50711, 3, 1, 2, True),)
    yield "staggered.dng", dng(raw, extra=layout), "a raw image of a kind that is not handled"
    yield "rgb.dng", tiff(RGB[16]), "a raw image of a kind that is not handled"
    for white in (64, 63):
        content = dng(raw, 1, LINEAR_RAW, (64,), (white,))
        yield f"white {white}.dng", content, "its white level, .*, is not above its black level"
    for name, white in (("two whites", (4095, 4095)), ("two blacks", (4095,))):
        black = (64, 64) if name == "two blacks" else (64,)
        content = dng(np.dstack([raw] * 3), 1, LINEAR_RAW, black, white)
        yield f"{name}.dng", content, "2 levels for 3 samples"
    for code, kind in product((51008, 51009), (7, 8, 10, 11, 12, 13)):
        opcodes = struct.pack(">7I", 2, 4, 1 << 24, 1, 0, kind, 1 << 24) + bytes(8)
        content = dng(raw, extra=((code, 7, len(opcodes), opcodes, True),))
        yield f"opcode {kind} in {code}.dng", content, f"opcode {kind}, which is not handled"
    gain = struct.pack(">5I", 1, 9, 1 << 24, 1, 0)  # the shading of the lens
    yield (
        "gain map.dng",
        dng(raw, extra=((51009, 7, 20, gain, True),)),
        interpolated(np.rint((raw - 64) / (4095 - 64) * 65535).astype(np.uint16)),
    )
    yield "stack.dng", tiff(np.stack([raw] * 2), photometric="minisblack"), "holds 2 images"
    whole = dng(raw)
    for length in (8, 200, len(whole) // 2, len(whole) - 500):
        yield f"cut at {length}.dng", whole[:length], "not a complete DNG image: .*truncated$"


TABLE = {
    row[0]: row
    for rows in (tiffs, refused_tiffs, pages, oriented, pngs_jpegs_and_tgas, raws)
    for row in rows()
}


@pytest.mark.parametrize("name", TABLE)
def test_each_pixel_equals_the_truth_or_the_file_is_refused(
    name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    _, content, expected = TABLE[name]
    path = tmp_path / name.replace("<", "little").replace(">", "big").replace("/", "-")
    path.write_bytes(content)
    if isinstance(expected, str):
        with pytest.raises(InputError, match=expected) as caught:
            read_image_file(path)
        assert str(caught.value).startswith(f"{path}: ")
        assert "\n" not in str(caught.value)
    else:
        image = read_image_file(path)[0]
        assert (image.shape, image.dtype) == (expected.shape, expected.dtype)
        # Rounding, of values and of the means of neighbours, in a DNG.
        loss = {".jpg": 32, ".jpeg": 32, ".dng": 1}.get(path.suffix, 0)
        assert np.abs(image.astype(int) - expected).max() <= loss
    assert capfd.readouterr() == ("", "")
