"""Image files with metadata in every place in which programs put them, and raw files."""

import io
import struct
import zlib
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import tifffile
from PIL import ExifTags, Image, TiffImagePlugin

Pixels = npt.NDArray[Any]
CFA, LINEAR_RAW = 32803, 34892


def exif(orientation: int, kind: int = 3, order: str = "<") -> bytes:
    """EXIF data with an orientation, for types and orders that Pillow does not write."""
    mark = b"II*\0" if order == "<" else b"MM\0*"
    form = {1: "B3x", 3: "H2x", 4: "I"}[kind]
    entry = struct.pack(f"{order}HHI{form}", 274, kind, 1, orientation)
    return mark + struct.pack(f"{order}IH", 8, 1) + entry + bytes(4)


def private_exif(**values: Any) -> bytes:
    """EXIF data with tags of the private directory by their names."""
    data = Image.Exif()
    directory = data.get_ifd(ExifTags.IFD.Exif)
    for name, value in values.items():
        tag = ExifTags.Base[name].value
        directory[tag] = TiffImagePlugin.IFDRational(*value) if isinstance(value, tuple) else value
    data[ExifTags.IFD.Exif.value] = directory
    return data.tobytes().removeprefix(b"Exif\0\0")


def xmp(orientation: int, form: str = "attribute") -> bytes:
    """An XMP packet with an orientation."""
    inner = {
        "attribute": f"<rdf:Description rdf:about='' {{0}} tiff:Orientation='{orientation}'/>",
        "element": "<rdf:Description rdf:about='' {0}><tiff:Orientation>"
        f"{orientation}</tiff:Orientation></rdf:Description>",
        "prefix": f"<rdf:Description rdf:about='' {{0}} t:Orientation='{orientation}'/>",
        "default": "<rdf:Description rdf:about=''><Orientation xmlns='http://ns.adobe.com/tiff/1.0/'>"
        f"{orientation}</Orientation></rdf:Description>",
        "typed": "<rdf:Description rdf:about='' {0}><tiff:Orientation rdf:datatype='int'>\n"
        f"<rdf:value> {orientation} </rdf:value></tiff:Orientation></rdf:Description>",
        "reference": "<rdf:Description rdf:about='' {0}><tiff:Orientation>"
        f"&#{ord(str(orientation))};</tiff:Orientation></rdf:Description>",
    }[form].format('xmlns:{}="http://ns.adobe.com/tiff/1.0/"')
    return (
        "<?xpacket begin='\ufeff' id='W5M0MpCehiHzreSzNTczkc9d'?>"
        "<x:xmpmeta xmlns:x='adobe:ns:meta/'>"
        "<rdf:RDF xmlns:rdf='http://www.w3.org/1999/02/22-rdf-syntax-ns#'>"
        + inner.format("t" if form == "prefix" else "tiff")
        + "</rdf:RDF></x:xmpmeta><?xpacket end='w'?>"
    ).encode()


def raw_profile(name: str, data: bytes) -> bytes:
    """Data as ImageMagick writes them into a text chunk."""
    return f"\n{name}\n{len(data):8d}\n{data.hex()}\n".encode()


def chunk(kind: bytes, data: bytes) -> bytes:
    checksum = struct.pack(">I", zlib.crc32(kind + data))
    return struct.pack(">I", len(data)) + kind + data + checksum


def text_chunk(kind: str, keyword: str, text: bytes) -> bytes:
    """A text chunk of a PNG, of kind tEXt, zTXt or iTXt."""
    head = keyword.encode() + b"\0"
    body = {
        "tEXt": text, "zTXt": b"\0" + zlib.compress(text), "iTXt": b"\0\0\0\0" + text,
        "iTXt packed": b"\1\0\0\0" + zlib.compress(text),
    }[kind]  # fmt: skip
    return chunk(kind[:4].encode(), head + body)


def with_chunks(png: bytes, *chunks: bytes, last: bool = False) -> bytes:
    """A PNG with more chunks after its header, or before its end."""
    place = -12 if last else 33
    return png[:place] + b"".join(chunks) + png[place:]


def with_segments(jpeg: bytes, *segments: bytes, marker: int = 0xE1) -> bytes:
    """A JPEG with more application segments."""
    heads = [bytes([0xFF, marker]) + struct.pack(">H", len(each) + 2) for each in segments]
    return jpeg[:2] + b"".join(h + s for h, s in zip(heads, segments, strict=True)) + jpeg[2:]


def encoded(suffix: str, image: Pixels, *options: int) -> bytes:
    """A PNG, JPEG or TIFF of a grey image or of colours in R, G, B and alpha, by OpenCV."""
    order = slice(None) if image.ndim == 2 else [2, 1, 0, 3][: image.shape[-1]]
    return cv2.imencode(suffix, np.ascontiguousarray(image[..., order]), options)[1].tobytes()


def tiff(image: Pixels, **options: Any) -> bytes:
    """A TIFF by tifffile; grey, RGB or RGBA by the shape unless `options` say otherwise."""
    buffer = io.BytesIO()
    kind = "rgb" if image.ndim == 3 else "minisblack"
    with tifffile.TiffWriter(
        buffer, byteorder=options.pop("byteorder", None), bigtiff=options.pop("bigtiff", False)
    ) as writer:
        writer.write(image, **{"photometric": kind, "metadata": None} | options)
    return buffer.getvalue()


def with_tag(content: bytes, code: int, value: int) -> bytes:
    """A TIFF with another value of a short tag."""
    with tifffile.TiffFile(io.BytesIO(content)) as file:
        place, order = file.pages.first.tags[code].valueoffset, file.byteorder
    return content[:place] + struct.pack(f"{order}H", value) + content[place + 2 :]


def dng(
    values: Pixels,
    orientation: int = 1,
    kind: int = CFA,
    black: tuple[int, ...] = (64,),
    white: tuple[int, ...] = (4095,),
    extra: tuple[Any, ...] = (),
) -> bytes:
    """A DNG: red first where it has a colour filter array; four black levels are of 2 x 2 px."""
    matrix = (1, 1, 0, 1, 0, 1, 0, 1, 1, 1, 0, 1, 0, 1, 0, 1, 1, 1)
    tags = [
        (274, 3, 1, orientation, True), (50706, 1, 4, (1, 4, 0, 0), True),
        (50708, 2, 0, "ps4rig", True), (50714, 3, len(black), black, True),
        (50717, 4, len(white), white, True), (50721, 10, 9, matrix, True),
        (50778, 3, 1, 21, True), *extra,
    ]  # fmt: skip
    if kind == CFA:
        tags += [(33421, 3, 2, (2, 2), True), (33422, 1, 4, (0, 1, 1, 2), True)]
    if len(black) == 4:
        tags.append((50713, 3, 2, (2, 2), True))
    # tifffile does not write one sample as LinearRaw.
    mono = kind == LINEAR_RAW and values.ndim == 2
    options = {"photometric": "minisblack" if mono else kind, "extratags": tags}
    content = tiff(values, **options, planarconfig=1 if values.ndim == 3 else None)
    return with_tag(content, 262, LINEAR_RAW) if mono else content
