"""Images are turned upright as their EXIF orientation says, whatever their format."""

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from hypothesis import given
from hypothesis import strategies as st

from classify.errors import InputError
from rig.exif import exif_exposure_ms, exif_orientation, jpeg_exif, upright
from rig.image_file import read_exposure_ms, read_image, read_oriented_image

IMAGE = np.random.default_rng(3).integers(0, 255, (40, 56), np.uint8)
ORIENTATIONS = range(1, 9)


def exif(orientation: int, order: str = "<", kind: int = 3) -> bytes:
    """A TIFF header with one directory: some other tag, then the orientation."""
    mark = b"II*\0" if order == "<" else b"MM\0*"
    other = struct.pack(f"{order}HHII", 0x010F, 2, 4, 0)
    tag = struct.pack(f"{order}HHIHH", 0x0112, kind, 1, orientation, 0)
    return mark + struct.pack(f"{order}IH", 8, 2) + other + tag + bytes(4)


def jpeg(orientation: int, order: str = "<") -> bytes:
    _, content = cv2.imencode(".jpg", IMAGE)
    segment = b"Exif\0\0" + exif(orientation, order)
    plain = content.tobytes()
    return plain[:2] + b"\xff\xe1" + struct.pack(">H", len(segment) + 2) + segment + plain[2:]


def png(orientation: int) -> bytes:
    plain = cv2.imencode(".png", IMAGE)[1].tobytes()
    data = b"eXIf" + exif(orientation)
    chunk = struct.pack(">I", len(data) - 4) + data + struct.pack(">I", zlib.crc32(data))
    return plain[:33] + chunk + plain[33:]  # after the header


@pytest.mark.parametrize("orientation", ORIENTATIONS)
@pytest.mark.parametrize("order", ["<", ">"])
def test_a_jpeg_is_turned_as_by_opencv(tmp_path: Path, orientation: int, order: str) -> None:
    (tmp_path / "a.jpg").write_bytes(jpeg(orientation, order))
    expected = cv2.imread(str(tmp_path / "a.jpg"), cv2.IMREAD_GRAYSCALE)
    image, found = read_oriented_image(tmp_path / "a.jpg")
    np.testing.assert_array_equal(image, expected)
    assert found == orientation


@pytest.mark.parametrize("orientation", ORIENTATIONS)
@pytest.mark.parametrize("form", ["png", "plain.tif", "lzw.tif"])
def test_png_and_tiff_are_turned_as_well(tmp_path: Path, orientation: int, form: str) -> None:
    path = tmp_path / form if form.endswith("tif") else tmp_path / "a.png"
    if form == "png":
        path.write_bytes(png(orientation))
    elif form == "plain.tif":
        tag = (274, 3, 1, orientation, True)
        tifffile.imwrite(path, IMAGE, photometric="minisblack", extratags=[tag])
    else:
        cv2.imwrite(str(path), IMAGE)
        with tifffile.TiffFile(path) as tiff:
            assert tiff.pages.first.compression == tifffile.COMPRESSION.LZW
            offset = tiff.pages.first.tags["SamplesPerPixel"].offset
        content = bytearray(path.read_bytes())
        content[offset : offset + 2] = struct.pack("<H", 274)  # one sample is the default
        content[offset + 8 : offset + 10] = struct.pack("<H", orientation)
        path.write_bytes(content)
    image, found = read_oriented_image(path)
    np.testing.assert_array_equal(image, upright(IMAGE, orientation))
    assert found == orientation


@pytest.mark.parametrize("content", [jpeg(0), jpeg(9), jpeg(65535)])
def test_an_unknown_orientation_is_upright(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.jpg").write_bytes(content)
    assert read_image(tmp_path / "a.jpg").shape == IMAGE.shape


@given(st.data())
def test_damaged_exif_data_are_no_error(data: st.DataObject) -> None:
    content = bytearray(data.draw(st.sampled_from([jpeg(6), jpeg(6, ">"), b"\xff\xd8\xff\xe1"])))
    for _ in range(data.draw(st.integers(0, 6))):
        content[data.draw(st.integers(0, min(len(content), 80) - 1))] = data.draw(
            st.integers(0, 255)
        )
    cut = bytes(content[: data.draw(st.integers(0, len(content)))])
    assert exif_orientation(jpeg_exif(cut)) in ORIENTATIONS
    assert exif_orientation(cut) in ORIENTATIONS
    assert exif_orientation(exif(6, kind=4)) == 1


def exposure_exif(numerator: int, denominator: int, order: str = "<") -> bytes:
    """A TIFF header with a directory that names another, which has the exposure time."""
    mark = b"II*\0" if order == "<" else b"MM\0*"
    first = struct.pack(f"{order}IHHHIII", 8, 1, 0x8769, 4, 1, 26, 0)
    second = struct.pack(f"{order}HHHIII", 1, 0x829A, 5, 1, 44, 0)
    return mark + first + second + struct.pack(f"{order}II", numerator, denominator)


@pytest.mark.parametrize("order", ["<", ">"])
def test_the_exposure_time_is_read(order: str) -> None:
    assert exif_exposure_ms(exposure_exif(1, 60, order)) == pytest.approx(1000 / 60)


@pytest.mark.parametrize("data", [exif(3), b"", exposure_exif(1, 0), exposure_exif(0, 1)])
def test_no_exposure_time_is_none(data: bytes) -> None:
    assert exif_exposure_ms(data) is None


@given(st.binary(max_size=60), st.integers(4, 52))
def test_damaged_exposure_data_are_no_error(noise: bytes, start: int) -> None:
    data = exposure_exif(1, 60)
    exif_exposure_ms(data[:start] + noise)
    exif_exposure_ms(noise)


def test_the_exposure_time_of_every_format_is_read(tmp_path: Path) -> None:
    data = exposure_exif(1, 60)
    plain = cv2.imencode(".jpg", IMAGE)[1].tobytes()
    segment = b"Exif\0\0" + data
    head = b"\xff\xe1" + struct.pack(">H", len(segment) + 2) + segment
    (tmp_path / "a.jpg").write_bytes(plain[:2] + head + plain[2:])
    plain, chunk = cv2.imencode(".png", IMAGE)[1].tobytes(), b"eXIf" + data
    framed = struct.pack(">I", len(data)) + chunk + struct.pack(">I", zlib.crc32(chunk))
    (tmp_path / "a.png").write_bytes(plain[:33] + framed + plain[33:])
    (tmp_path / "a.dng").write_bytes(data)
    for name in ("a.jpg", "a.png", "a.dng"):
        assert read_exposure_ms(tmp_path / name) == pytest.approx(1000 / 60)
    tifffile.imwrite(tmp_path / "a.tif", IMAGE)
    assert read_exposure_ms(tmp_path / "a.tif") is None
    (tmp_path / "cut.png").write_bytes(plain[:40])
    with pytest.raises(InputError, match=r"cut\.png"):
        read_exposure_ms(tmp_path / "cut.png")
