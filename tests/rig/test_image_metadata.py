"""What files state beside their pixels: response, exposure time, date; damage is an error."""

import io
import struct
import zlib
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image, ImageCms

from classify.base.errors import InputError
from rig.image_file import read_image_file
from rig.image_metadata import ImageMetadata, metadata_of_info
from tests.image_files import (
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
    xmp,
)

GREY = np.random.default_rng(3).integers(1, 255, (16, 24), np.uint8)
PNG, JPEG = encoded(".png", GREY), encoded(".jpg", GREY)
TGA = io.BytesIO()
Image.fromarray(GREY).save(TGA, "TGA")


def profile(gamma: float | None, space: bytes = b"RGB ") -> bytes:
    """A colour profile with a power as the response of every channel; None for that of sRGB."""
    if gamma is None and space == b"RGB ":
        return ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    fixed = struct.pack(">i", round(65536 * (gamma or 1.0)))
    curve = b"para" + bytes(4) + struct.pack(">HH", 0, 0) + fixed
    if gamma is None:
        numbers = (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)
        curve = b"para" + bytes(4) + struct.pack(">HH", 3, 0)
        curve += b"".join(struct.pack(">i", round(65536 * number)) for number in numbers)
    text = b"my response"
    parts = {
        b"desc": b"desc" + bytes(4) + struct.pack(">I", 12) + text + b"\0" + bytes(79),
        b"wtpt": xyz(0.9642, 1.0, 0.8249), b"cprt": b"text" + bytes(4) + b"none\0",
    }  # fmt: skip
    if space == b"GRAY":
        parts[b"kTRC"] = curve
    else:
        primaries = ((0.4361, 0.2225, 0.0139), (0.3851, 0.7169, 0.0971), (0.1431, 0.0606, 0.7139))
        for name, colour in zip((b"r", b"g", b"b"), primaries, strict=True):
            parts |= {name + b"XYZ": xyz(*colour), name + b"TRC": curve}
    start = 128 + 4 + 12 * len(parts)
    table, data = struct.pack(">I", len(parts)), b""
    for name, part in parts.items():
        padded = part + bytes(-len(part) % 4)
        table += name + struct.pack(">II", start + len(data), len(part))
        data += padded
    size = start + len(data)
    header = struct.pack(">I4sI4s4s4s12s4s", size, b"    ", 0x02400000, b"mntr", space, b"XYZ ",
                         bytes(12), b"acsp") + bytes(28)  # fmt: skip
    header += struct.pack(">iii", 63190, 65536, 54061)
    return header.ljust(128, b"\0") + table + data


def xyz(*numbers: float) -> bytes:
    fixed = [round(65536 * number) for number in numbers]
    return b"XYZ " + bytes(4) + struct.pack(">iii", *fixed)


def iccp(data: bytes) -> bytes:
    return chunk(b"iCCP", b"a name\0\0" + zlib.compress(data))


def gama(value: float) -> bytes:
    return chunk(b"gAMA", struct.pack(">I", round(1e5 * value)))


def cicp(*code: int) -> bytes:
    return chunk(b"cICP", bytes(code))


def app2(data: bytes) -> bytes:
    return with_segments(JPEG, b"ICC_PROFILE\0\1\1" + data, marker=0xE2)


def app1(**values: Any) -> bytes:
    return with_segments(JPEG, b"Exif\0\0" + private_exif(**values))


def tiff_with(code: int, kind: int, *values: Any) -> bytes:
    data = values[0] if isinstance(values[0], bytes) else values
    return tiff(GREY, extratags=[(code, kind, len(data), data, True)])


def tiff_of_exif(data: bytes) -> bytes:
    """A TIFF by Pillow with EXIF data."""
    buffer = io.BytesIO()
    Image.fromarray(GREY).save(buffer, "TIFF", exif=b"Exif\0\0" + data)
    return buffer.getvalue()


def tga_with_gamma(dividend: int, divisor: int) -> bytes:
    plain = TGA.getvalue()[:-26]
    extension = bytearray(495)
    extension[:2] = struct.pack("<H", 495)
    extension[478:482] = struct.pack("<HH", dividend, divisor)
    footer = struct.pack("<II", len(plain), 0) + b"TRUEVISION-XFILE.\0"
    return plain + bytes(extension) + footer


SRGB_XMP = xmp(1).replace(
    b"tiff:Orientation='1'", b"xmlns:exif='http://ns.adobe.com/exif/1.0/' exif:ColorSpace='1'"
)
SRGB, LINEAR, OTHER = profile(None), profile(1.0), profile(2.2)
NAMED = "the colour profile 'my response'"
RESPONSES: dict[str, tuple[bytes, str | None]] = {
    "nothing.png": (PNG, None),
    "nothing.jpg": (JPEG, None),
    "nothing.tif": (tiff(GREY), None),
    "nothing.tga": (TGA.getvalue(), None),
    "a raw image.dng": (dng(np.full((32, 32), 900, np.uint16)), "linear"),
    "sRGB.png": (with_chunks(PNG, chunk(b"sRGB", b"\0")), "srgb"),
    "sRGB and gAMA.png": (with_chunks(PNG, gama(0.45455), chunk(b"sRGB", b"\0")), "srgb"),
    "gAMA 1.png": (with_chunks(PNG, gama(1.0)), "linear"),
    "gAMA 2.2.png": (with_chunks(PNG, gama(0.45455)), "gamma 2.2"),
    "gAMA 0.png": (with_chunks(PNG, gama(0.0)), "gamma inf"),
    "iCCP sRGB.png": (with_chunks(PNG, iccp(SRGB)), "srgb"),
    "iCCP linear.png": (with_chunks(PNG, iccp(LINEAR), gama(0.45455)), "linear"),
    "iCCP grey sRGB.png": (with_chunks(PNG, iccp(profile(None, b"GRAY"))), "srgb"),
    "iCCP grey linear.png": (with_chunks(PNG, iccp(profile(1.0, b"GRAY"))), "linear"),
    "iCCP grey 1.8.png": (with_chunks(PNG, iccp(profile(1.8, b"GRAY"))), NAMED),
    "iCCP 2.2.png": (with_chunks(PNG, iccp(OTHER)), NAMED),
    "iCCP damaged.png": (with_chunks(PNG, iccp(SRGB[:300])), "a damaged colour profile"),
    "no iCCP.png": (with_chunks(PNG, chunk(b"iCCP", b"x\0\0zzz")), "a damaged colour profile"),
    "ImageMagick profile.png": (
        with_chunks(PNG, text_chunk("zTXt", "Raw profile type icc", raw_profile("icc", LINEAR))),
        "linear",
    ),
    "cICP sRGB.png": (with_chunks(PNG, cicp(1, 13, 0, 1), iccp(LINEAR)), "srgb"),
    "cICP linear.png": (with_chunks(PNG, cicp(9, 8, 0, 1)), "linear"),
    "cICP PQ.png": (with_chunks(PNG, cicp(9, 16, 0, 1)), "colour space [16, 0, 1]"),
    "cICP narrow.png": (with_chunks(PNG, cicp(1, 13, 0, 0)), "colour space [13, 0, 0]"),
    "eXIf.png": (with_chunks(PNG, chunk(b"eXIf", private_exif(ColorSpace=1))), "srgb"),
    "XMP.png": (with_chunks(PNG, text_chunk("iTXt", "XML:com.adobe.xmp", SRGB_XMP)), "srgb"),
    "ICC sRGB.jpg": (app2(SRGB), "srgb"),
    "ICC linear.jpg": (app2(LINEAR), "linear"),
    "ICC 2.2.jpg": (app2(OTHER), NAMED),
    "EXIF sRGB.jpg": (app1(ColorSpace=1), "srgb"),
    "EXIF uncalibrated.jpg": (app1(ColorSpace=65535), None),
    "EXIF Adobe RGB.jpg": (app1(ColorSpace=2), "colour space 2"),
    "EXIF gamma 1.jpg": (app1(ColorSpace=65535, Gamma=(1, 1)), "linear"),
    "EXIF gamma 2.2.jpg": (app1(Gamma=(22, 10)), "gamma 2.2"),
    "ICC sRGB.tif": (tiff(GREY, iccprofile=SRGB), "srgb"),
    "ICC linear.tif": (tiff(GREY, iccprofile=LINEAR, byteorder=">", bigtiff=True), "linear"),
    "ICC 2.2.tif": (tiff(GREY, iccprofile=OTHER), NAMED),
    "EXIF sRGB.tif": (tiff_of_exif(private_exif(ColorSpace=1)), "srgb"),
    "EXIF gamma 1.tif": (tiff_of_exif(private_exif(Gamma=(1, 1))), "linear"),
    "TransferFunction.tif": (tiff_with(301, 3, *range(0, 65536, 257)), "a TransferFunction"),
    "GrayResponseCurve.tif": (tiff_with(291, 3, *range(256)), "a GrayResponseCurve"),
    "XMP.tif": (tiff_with(700, 1, SRGB_XMP), "srgb"),
    "gamma 1.tga": (tga_with_gamma(10, 10), "linear"),
    "gamma 2.2.tga": (tga_with_gamma(22, 10), "gamma 2.2"),
}  # fmt: skip


@pytest.mark.parametrize("name", RESPONSES)
def test_the_stated_response_is_found(name: str, tmp_path: Path) -> None:
    content, expected = RESPONSES[name]
    (tmp_path / name).write_bytes(content)
    assert read_image_file(tmp_path / name)[1].response == expected


TAKEN = private_exif(
    ExposureTime=(1, 60), DateTimeOriginal="2024:05:01 12:34:56", OffsetTimeOriginal="+02:00"
)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.jpg", with_segments(JPEG, b"Exif\0\0" + TAKEN)),
        ("a.png", with_chunks(PNG, chunk(b"eXIf", TAKEN))),
        ("a.tif", tiff_of_exif(TAKEN)),
    ],
)
def test_exposure_time_and_date_are_read(name: str, content: bytes, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    metadata = read_image_file(tmp_path / name)[1]
    assert metadata.capture_date == "2024-05-01T12:34:56+02:00"
    assert metadata.exposure_ms == pytest.approx(1000 / 60)


@pytest.mark.parametrize(
    ("values", "exposure_ms", "capture_date"),
    [
        ({}, None, None),
        ({"ExposureTime": (1, 0)}, None, None),
        ({"ExposureTime": (0, 1)}, None, None),
        ({"ExposureTime": "long"}, None, None),
        ({"DateTimeOriginal": "2024:05:01 12:34:56"}, None, "2024-05-01T12:34:56"),
        ({"DateTimeOriginal": "0000:00:00 00:00:00"}, None, None),
        ({"DateTimeOriginal": "    :  :     :  :  "}, None, None),
        (
            {"DateTimeOriginal": "2024:05:01 12:34:56", "OffsetTimeOriginal": "   :  "},
            None,
            "2024-05-01T12:34:56",
        ),
    ],
)
def test_unknown_exposure_times_and_dates_are_none(
    values: dict[str, Any], exposure_ms: float | None, capture_date: str | None
) -> None:
    metadata = metadata_of_info({"exif": b"Exif\0\0" + private_exif(**values)})
    assert metadata == ImageMetadata(exposure_ms=exposure_ms, capture_date=capture_date)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("damaged")


@given(data=st.data())
def test_damaged_exif_data_are_read_or_refused(folder: Path, data: st.DataObject) -> None:
    plain = data.draw(st.sampled_from([exif(6), exif(6, order=">"), TAKEN]))
    content = bytearray(plain[: data.draw(st.integers(0, len(plain)))])
    for _ in range(data.draw(st.integers(0, 6))):
        if content:
            content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    (folder / "a.jpg").write_bytes(with_segments(JPEG, b"Exif\0\0" + bytes(content)))
    with suppress(InputError):
        assert read_image_file(folder / "a.jpg")[1].orientation in range(1, 9)
