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

from rig.exif import exif_orientation, jpeg_exif, upright
from rig.image_file import read_image, read_oriented_image

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
